# SPDX-License-Identifier: Apache-2.0
"""The experiment on real machines: what it draws can be simulated and told, and its counts and ratios are right."""

import pytest

from kontur.drive.target import Target, open_drive
from kontur.errors import MachineError
from kontur.experiments import machines
from kontur.machine import NOTHING, Machine


def test_a_seed_draws_the_same_machine_again_and_another_seed_another() -> None:
    assert machines.draw(7) == machines.draw(7)
    assert machines.draw(7) != machines.draw(8)


def test_both_kinds_of_feedback_and_delay_are_drawn() -> None:
    drawn = [machines.draw(seed) for seed in range(1, 41)]
    assert {machine.delay_periods for machine in drawn} == {1, 2}
    assert 8 <= sum(machine.x.scale_m > 0.0 for machine in drawn) <= 24
    assert min(machine.x.resonance_Hz for machine in drawn) < 60.0
    assert max(machine.x.resonance_Hz for machine in drawn) > 200.0


@pytest.mark.parametrize("machine", [*machines.packaged(), *map(machines.draw, range(1, 13))], ids=lambda m: m.name)
def test_a_drive_can_be_told_all_of_a_drawn_machine(machine: Machine) -> None:
    values = machine.parameters()
    with open_drive(Target(machine=machine, told=NOTHING)) as device:
        for name, value in values.items():
            device.write(name, value)
        for name, value in values.items():
            assert device.read(name) == pytest.approx(value, rel=1e-3, abs=1e-3)


def ran(mean_um: float | None, ended: str = "") -> dict[str, object]:
    return {"mean_um": mean_um, "max_um": mean_um, "ended": ended, "why": ended}


def test_ratios_are_of_the_same_machine_and_case_and_failures_are_counted() -> None:
    rows = [
        {"runs": {"a": {"ccu full": ran(1.0), "cascade full": ran(1.5), "cascade rigid": ran(6.0)}}},
        {"runs": {"a": {"ccu full": ran(2.0), "cascade full": ran(1.8), "cascade rigid": ran(4.0)}}},
        {"runs": {"a": {"ccu full": ran(None, "tripped"), "cascade full": ran(3.0), "cascade rigid": ran(9.0)}}},
        {"runs": {"a": {"ccu full": ran(1.0), "cascade full": ran(4.0), "cascade rigid": ran(None, "oscillating")}}},
    ]
    found = machines.summarise(rows)
    assert (found["unstable"], found["oscillating"], found["tripped"]) == (0, 1, 1)
    assert found["ratio_rigid_median"] == pytest.approx(4.0)
    assert found["ratio_rigid_worst"] == pytest.approx(2.0)
    assert found["ratio_law_median"] == pytest.approx(1.5)
    assert found["ratio_law_worst"] == pytest.approx(0.9)


def test_a_machine_without_a_design_is_a_row_as_others_are(monkeypatch: pytest.MonkeyPatch) -> None:
    def design(*_: object) -> None:
        raise MachineError("no gains of ccu keep the limits")

    monkeypatch.setattr(machines, "design", design)
    row = machines._driven((machines.draw(1), "ccu", "full", "f32"))
    assert row["design"] is None
    assert {one["ended"] for one in row["runs"].values()} == {"no design"}
    found = machines.summarise([{"runs": {case: {"ccu full": one} for case, one in row["runs"].items()}}])
    assert (found["no_design"], found["tripped"], found["ratio_law_worst"]) == (4, 0, None)


def test_a_run_that_trips_says_why() -> None:
    weak = machines.draw(1)
    case = machines.cases()["r4@100"]
    found = machines._drive(weak, case, "cascade", weak.parameters() | {"plant_x.force_limit": 10.0}, "f32")
    assert found["ended"] in ("tripped", "oscillating", "unstable")
    assert found["why"]
