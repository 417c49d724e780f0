# SPDX-License-Identifier: Apache-2.0
"""`kontur commission` ends safely at each step, goes on after it, and leaves a drive on a bus as it was.

What a step finds is made up here; the drive and its bus are those of kontur-sim.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from click.testing import CliRunner, Result
from test_commission import identified

from kontur.cli import main
from kontur.commissioning import identify as identify_module
from kontur.commissioning.first_moves import Agreed, Diagnosis
from kontur.commissioning.prove import Evidence, Proof
from kontur.commissioning.session import commissioned, parameters_kept
from kontur.drive.target import Target, open_drive
from kontur.errors import DeviceError
from kontur.machine import MACHINES
from kontur.sim import process

TEXT = (MACHINES / "ball_screw.toml").read_text()
CHANGED = {"smc.lambda": 77.0}


@pytest.fixture(scope="module")
def sim() -> Iterator[process.SimProcess]:
    with process.start(slcan_tcp="0", pace="sync", machine=MACHINES / "ball_screw.toml") as drive:
        yield drive


class Steps:
    """The steps of a commissioning, made up. `fails`: the one that ends with `error`, after a change of the drive."""

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, fails: str = "", error: type[BaseException] = DeviceError
    ) -> None:
        self.fails, self.error = fails, error
        self.did: list[str] = []
        monkeypatch.setattr("kontur.commissioning.session.identify", self.identify)
        monkeypatch.setattr("kontur.commissioning.gains.designs", self.designs)
        monkeypatch.setattr("kontur.commissioning.prove.candidate", lambda model, name, values: None)
        monkeypatch.setattr("kontur.commissioning.prove.prove", self.prove)
        monkeypatch.setattr("kontur.commissioning.filed.write_report", lambda path, *_: path.write_text("report"))
        monkeypatch.setattr("kontur.cli.commission._pictures", lambda out, found: None)
        monkeypatch.setattr("kontur.cli.commission._as_json", lambda design: {})

    def _end(self, step: str) -> None:
        self.did.append(step)
        if step == self.fails:
            raise self.error("broken")

    def identify(self, device: Any, axis: str, agreed: Agreed, say: Any, stop_requested: Any) -> Any:
        device.parameters.set(CHANGED)
        self._end(f"identify {axis}")
        return identified()

    def designs(self, machine: Any, controllers: Sequence[str], *_: Any) -> list[Any]:
        self._end("tune")
        values = {"smc.lambda": 50.0, "plant_x.mass": 100.0, "position_limit_x.max": 1e6}
        return [SimpleNamespace(controller=name, parameters=values, limit="It is limited.") for name in controllers]

    def prove(self, target: Target, *rest: Any) -> Evidence:
        with open_drive(target) as device:
            device.parameters.set(CHANGED)
            device.select_controller("cascade")
        self._end("prove")
        return Evidence([Proof("r4@20 ccw", "ccu", 3.0, 1.0 if self.fails != "proof" else 9.0, 1.9, 2.0)])


def commission(out: Path, *more: str) -> Result:
    return CliRunner().invoke(main, ["commission", "--yes", "--json", "--out", str(out), *more])


def on(sim: process.SimProcess, machine: Path = MACHINES / "ball_screw.toml") -> list[str]:
    return ["-i", sim.interface, "-c", sim.channel, "--machine", str(machine)]


def fail(device: Any, drive: process.SimProcess) -> None:
    """End with a diagnosis, and with a drive that is gone."""
    with parameters_kept(device):
        drive.end()
        raise Diagnosis("jammed", "is jammed")


def state(sim: process.SimProcess) -> tuple[dict[str, float], int, int]:
    """Parameters, controller and holder of the drive."""
    with open_drive(Target(bus=sim.options())) as device:
        return device.parameters.dump(), device.read("controller.select"), device.read("master.holder")


@pytest.mark.parametrize(
    ("fails", "error"),
    [("identify y", DeviceError), ("tune", KeyboardInterrupt), ("prove", DeviceError), ("prove", KeyboardInterrupt)],
)
def test_drive_on_a_bus_is_as_it_was_after_an_end_at_any_step(
    fails: str, error: type[BaseException], sim: process.SimProcess, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = Steps(monkeypatch, fails, error)
    before = state(sim)
    done = commission(tmp_path, *on(sim))
    assert steps.did[-1] == fails
    assert state(sim) == before
    assert done.exit_code == (1 if error is DeviceError else 130)
    result = json.loads((tmp_path / "commission.json").read_text())
    assert result["saved"] is False
    assert ("diagnosis" in result) == (error is DeviceError)


def test_proof_that_does_not_hold_leaves_the_drive_as_it_was_and_the_code_is_1(
    sim: process.SimProcess, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Steps(monkeypatch, "proof")
    before = state(sim)
    done = commission(tmp_path, *on(sim))
    assert state(sim) == before
    assert done.exit_code == 1
    assert "no better" in json.loads(done.stdout)["diagnosis"]["text"]


def test_circles_before_have_the_lengths_that_were_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps = Steps(monkeypatch)
    seen: list[dict[str, float]] = []
    monkeypatch.setattr(
        "kontur.commissioning.prove.prove",
        lambda target, candidates, before, *rest: seen.append(before) or steps.prove(target),
    )
    machine = tmp_path / "lead_screw.toml"
    machine.write_text((MACHINES / "lead_screw.toml").read_text())
    commission(tmp_path / "out", "--machine", str(machine), "--untold", "all", "--index-distance", "10")
    assert seen[0]["plant_x.encoder"] == pytest.approx(identified().encoder_m * 1e6)
    assert seen[0]["position_limit_x.max"] > 0
    assert "plant_x.mass" not in seen[0]


def test_commissioning_that_was_broken_off_goes_on_after_its_last_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = ["--machine", str(MACHINES / "ball_screw.toml"), "--untold"]
    steps = Steps(monkeypatch, "prove", KeyboardInterrupt)
    assert commission(tmp_path, *machine).exit_code == 130
    assert steps.did == ["identify x", "identify y", "tune", "prove"]
    first = json.loads((tmp_path / "commission.json").read_text())
    steps = Steps(monkeypatch)
    assert commission(tmp_path, *machine, "--for", "quiet").exit_code == 0  # the aim is that of the tuning
    assert steps.did == ["tune", "prove"]
    result = json.loads((tmp_path / "commission.json").read_text())
    assert result["saved"] is True
    assert result["axes"] == first["axes"]
    assert (tmp_path / "proof.html").exists()
    Steps(monkeypatch, "identify x", KeyboardInterrupt)
    assert commission(tmp_path, *machine).exit_code == 130  # has found nothing, so the record stays
    assert json.loads((tmp_path / "commission.json").read_text()) == result
    steps = Steps(monkeypatch)
    assert commission(tmp_path, *machine).exit_code == 0  # a finished one begins anew
    assert steps.did[0] == "identify x"


def test_steps_of_another_machine_are_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Steps(monkeypatch, "tune", KeyboardInterrupt)
    commission(tmp_path, "--machine", str(MACHINES / "ball_screw.toml"), "--untold")
    steps = Steps(monkeypatch)
    done = commission(tmp_path, "--machine", str(MACHINES / "stiff_scale.toml"), "--untold")
    assert done.exit_code == 1
    assert "progress.json: is of a commissioning that was broken off with another machine" in done.stderr
    assert "name another folder with --out, or delete this file to begin anew" in done.stderr
    assert steps.did == []
    (tmp_path / "progress.json").write_text("[1]")
    assert "is not what kontur commission writes" in commission(tmp_path).stderr


def test_mended_wiring_is_no_other_drive_before_a_step_is_done(
    sim: process.SimProcess, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Steps(monkeypatch, "identify x")
    commission(tmp_path, *on(sim))
    with open_drive(Target(bus=sim.options())) as device:
        device.parameters.set({"wiring_x.invert_force": 1.0})
    steps = Steps(monkeypatch, "tune")
    assert "broken" in commission(tmp_path, *on(sim)).stderr
    assert steps.did == ["identify x", "identify y", "tune"]
    assert state(sim)[0]["wiring_x.invert_force"] == 1
    with open_drive(Target(bus=sim.options())) as device:
        device.parameters.set({"wiring_x.invert_force": 0.0})
    assert "another wiring" in commission(tmp_path, *on(sim)).stderr


def test_soft_limits_of_the_user_stay(tmp_path: Path, sim: process.SimProcess, monkeypatch: pytest.MonkeyPatch) -> None:
    Steps(monkeypatch, "prove")
    commission(tmp_path, *on(sim))
    text = (tmp_path / "params-ccu.toml").read_text()
    assert "lambda = 50.0" in text
    assert "position_limit" not in text


def test_design_without_a_filter_leaves_none_in_the_drive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = ("zero_1", "zero_damping_1", "pole_1", "pole_damping_1")
    of_before = {f"force_filter_x.{name}": value for name, value in zip(names, (80.0, 0.3, 78.0, 0.7), strict=True)}
    Steps(monkeypatch)
    with process.start(slcan_tcp="0", pace="sync", machine=MACHINES / "ball_screw.toml") as drive:
        with open_drive(Target(bus=drive.options())) as device:
            device.parameters.set(of_before)
        assert commission(tmp_path, *on(drive)).exit_code == 0
        after = state(drive)[0]
    assert (after["force_filter_x.zero_1"], after["force_filter_x.pole_1"]) == (0.0, 0.0)  # off


@pytest.mark.parametrize(("options", "kind"), [([], "length"), (["--length-checked"], "device")])
def test_length_of_a_count_that_nothing_proves_ends_before_anything_moves(
    options: list[str], kind: str, sim: process.SimProcess, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = Steps(monkeypatch, "identify x")
    machine = tmp_path / "machine.toml"
    machine.write_text(TEXT.replace("[x]\n", "[x]\nindex_m = 0.0\n"))
    done = commission(tmp_path / "out", *on(sim, machine), *options)
    result = json.loads(done.stdout)
    assert done.exit_code == 1
    assert result["saved"] is False
    if kind == "length":
        assert result["diagnosis"]["kind"] == "length"
        assert "encoder count of x is" in result["diagnosis"]["text"]
        assert "--index-distance" in result["diagnosis"]["text"]
        assert steps.did == []
    else:
        assert steps.did == ["identify x"]


def test_index_distance_of_the_machine_file_is_that_of_a_drive_on_a_bus(
    sim: process.SimProcess, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[float] = []
    steps = Steps(monkeypatch, "identify x")
    monkeypatch.setattr(
        "kontur.commissioning.session.identify",
        lambda device, axis, agreed, *_: seen.append(agreed.index_m) or steps.identify(device, axis, agreed, *_),
    )
    commission(tmp_path / "a", *on(sim))
    commission(tmp_path / "b", *on(sim), "--index-distance", "5")
    commission(tmp_path / "c", "--machine", str(MACHINES / "ball_screw.toml"), "--untold")
    assert seen == [0.01, 0.005, 0.0]


def test_stop_is_obeyed_while_the_response_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[object] = []
    monkeypatch.setattr(
        identify_module.response, "measure", lambda device, axis, setup, **more: seen.append(more["stop_requested"])
    )
    monkeypatch.setattr(identify_module.response, "joined", lambda parts: None)
    mover = SimpleNamespace(device=None, axis="x", low_m=-0.1, high_m=0.1, stop_requested=object())
    identify_module._response(mover, Agreed(100.0), 50.0)  # type: ignore[arg-type]
    assert seen == [mover.stop_requested, mover.stop_requested]


def test_drive_that_is_gone_when_it_is_to_be_restored_is_told() -> None:
    warnings: list[str] = []
    with process.start(slcan_tcp="0", pace="sync") as drive:
        target = Target(bus=drive.options())
        with commissioned(target, {"smc.lambda": 1.0}, warnings.append):
            drive.end()
    assert "has not got its parameters back" in warnings[0]
    assert "switch it off and on" in warnings[0]


def test_first_error_is_told_where_the_drive_cannot_be_restored_either() -> None:
    with process.start(slcan_tcp="0", pace="sync") as drive, open_drive(Target(bus=drive.options())) as device:
        with pytest.raises(Diagnosis, match="is jammed\nThe drive has not got its parameters back") as caught:
            fail(device, drive)
        assert caught.value.kind == "jammed"
