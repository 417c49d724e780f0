# SPDX-License-Identifier: Apache-2.0
"""`kontur commission`: what it writes, when it stores, and what it says where something is wrong."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from kontur.cli import main
from kontur.cli.commission import AIMS
from kontur.cli.identify import show
from kontur.commissioning import machine_file
from kontur.commissioning.fit import Dynamics, Friction, Value
from kontur.commissioning.identify import Identified
from kontur.commissioning.prove import Proof, problem_of
from kontur.commissioning.response import Response
from kontur.commissioning.reversal import Presliding
from kontur.commissioning.screw import Harmonics, Screw, Transmission
from kontur.errors import MachineError
from kontur.machine import MACHINES, load

BALL_SCREW = load(MACHINES / "ball_screw.toml")


def identified(delay: int = 1, elastic: bool = True) -> Identified:
    empty = np.zeros(1)
    return Identified(
        breakaway_N=70.0,
        encoder_m=76.29e-9,
        friction=Friction(Value(60.0, 2.0), Value(600.0, 30.0), Value(1.25, 0.1), Value(0.004, 0.002)),
        dynamics=Dynamics(
            mass_kg=Value(100.0, 2.0),
            resonance_Hz=Value(90.0 if elastic else 0.0, 1.0),
            resonance_damping=Value(0.03, 0.01),
            motor_share=Value(0.5, 0.02),
            lag_delay_s=Value(4e-4, 3e-5),
            current_lag_s=4e-4 - delay * 1e-4,
            delay_periods=delay,
            encoder_at="motor",
            misfit=0.5,
        ),
        screw=Screw(0.01, Harmonics((1.0, 0.0, 0.5), (0.0, 0.5, 0.0), 0.2), None),
        transmission=None,
        encoder_noise_m=(Value(0.0, 2.2e-8), None),
        noise_N=0.5,
        presliding=Presliding(Value(2e-5, 2e-6), Value(75.0, 3.0), Value(6e-6, 1e-6), None),
        response=Response(empty, np.zeros((2, 1), complex), np.zeros((2, 1)), empty.astype(complex), empty, empty),
        speeds=(),
    )


def test_machine_file_is_one_and_says_what_was_found(tmp_path: Path) -> None:
    machine = machine_file.machine(BALL_SCREW, {"x": identified(), "y": identified(2, elastic=False)})
    file = tmp_path / "machine.toml"
    file.write_text(machine_file.text(machine))
    read = load(file)
    assert read == machine
    assert read.x.mass_kg == 100.0
    assert read.x.resonance_Hz == 90.0
    assert read.y.resonance_Hz == 0.0
    assert read.delay_periods == 2
    assert read.x.current_lag_s + 2e-4 == pytest.approx(4e-4)
    assert read.x.presliding_m == 2e-5
    assert read.x.backlash_m == 6e-6
    assert read.x.soft_limit_m == BALL_SCREW.x.soft_limit_m
    assert read.x.lead_error == 0.0


def test_json_has_each_figure_with_its_uncertainty_and_what_was_not_seen() -> None:
    found_x = machine_file.as_json(identified(elastic=False))
    assert found_x["mass_kg"] == {"value": 100.0, "uncertainty": 2.0}
    assert found_x["resonance_Hz"] is None
    assert "resonance_Hz" in found_x["not_seen"]
    assert found_x["backlash_m"] == {"value": 6e-6, "uncertainty": 1e-6}  # that of the reversals, without a scale
    for name in ("lead_error", "friction_share", "ripple", "squareness_rad"):
        assert name in found_x["not_seen"]
    assert "mass_kg" not in found_x["not_seen"]
    json.dumps(found_x)


def test_what_was_found_is_printed_with_its_uncertainty(capsys: pytest.CaptureFixture[str]) -> None:
    show({"x": replace(identified(), steps_s={"friction": 40.0}), "y": identified(elastic=False)})
    rows = {line.split()[1]: line.split("│")[2:4] for line in capsys.readouterr().out.splitlines() if "│" in line}
    assert [cell.strip() for cell in rows["mass_kg"]] == ["100 ± 2", "100 ± 2"]
    assert [cell.strip() for cell in rows["resonance_Hz"]] == ["90 ± 1", "-"]
    assert set(rows) == set(machine_file.quantities(identified()))


def test_phases_of_cogging_are_told_to_the_drive() -> None:
    values = machine_file.parameters({"x": identified()})
    assert values["screw_x.lead"] == 10_000.0
    assert values["screw_x.cogging_cos_1"] == 1.0
    assert values["screw_x.cogging_sin_2"] == 0.5
    assert values["screw_x.ripple_sin_2"] == 0.0
    assert "screw_x.error_sin" not in values


def test_what_a_scale_shows_is_in_the_machine_file_and_told_to_the_drive() -> None:
    ripple = Harmonics((0.01, 0.0, 0.0), (0.0, 0.005, 0.0), 0.002)
    once = Harmonics((3e-6, 0.0, 0.0), (4e-6, 0.0, 0.0), 1e-7)
    shown = Transmission(Value(1e-4, 1e-6), once, Value(8e-6, 1e-6), Value(0.6, 0.05), ((0.0, 0.0), (0.1, 1e-5)))
    found = replace(identified(), screw=Screw(0.01, None, ripple), transmission=shown)
    axis = machine_file.axis(BALL_SCREW.x, found)
    assert axis.ripple == pytest.approx(0.015)
    assert axis.lead_once_m == pytest.approx(5e-6)
    assert (axis.lead_error, axis.backlash_m, axis.friction_share) == (1e-4, 8e-6, 0.6)
    values = machine_file.parameters({"x": found})
    assert values["screw_x.ripple_cos_1"] == 0.01
    assert values["screw_x.cogging_cos_1"] == 0.0
    assert (values["screw_x.error_cos"], values["screw_x.error_sin"]) == (3.0, 4.0)
    found_x = machine_file.as_json(found)
    assert found_x["backlash_m"] == {"value": 8e-6, "uncertainty": 1e-6}
    assert found_x["lead_map_m"] == [[0.0, 0.0], [0.1, 1e-5]]
    assert "lead_error" not in found_x["not_seen"]
    assert "cogging_N" in found_x["not_seen"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, ""),
        ({"ms_measured": 2.3}, "exceeds 2.2"),
        (
            {"after_um": None, "after_stopped": "the drive stopped"},
            "with the new gains, the drive stopped; if the gains",
        ),
        ({"after_um": 5.5}, "no better: 3.25 µm after, 3.00 before"),
        ({"after_um": 4.5}, ""),
        ({"before_um": None}, ""),
        ({"controller": "cascade", "ms_measured": 9.0}, ""),  # the comparison is not what is stored
    ],
)
def test_design_is_kept_only_where_the_proof_holds(change: dict[str, object], words: str) -> None:
    good = Proof("r20@100 ccw", "ccu", 3.0, 1.0, 1.9, 2.0)
    assert (problem_of([good, replace(good, **change)], "ccu") == "") == (words == "")  # type: ignore[arg-type]
    assert words in problem_of([good, replace(good, **change)], "ccu")  # type: ignore[arg-type]


def test_wrong_direction_is_said_in_words_and_nothing_is_saved(tmp_path: Path) -> None:
    machine = tmp_path / "wrong.toml"
    text = (MACHINES / "ball_screw.toml").read_text()
    machine.write_text(text.replace("[x]\n", "[x]\nforce_inverted = true\n"))
    out = tmp_path / "out"
    result = CliRunner().invoke(
        main, ["commission", "--machine", str(machine), "--untold", "--yes", "--json", "--out", str(out)]
    )
    assert result.exit_code == 1
    assert "opposite directions" in result.stderr
    printed = json.loads(result.stdout)
    assert printed == json.loads((out / "commission.json").read_text())
    assert printed["saved"] is False
    assert printed["diagnosis"]["kind"] == "polarity"
    assert "wiring_x.invert_force" in printed["diagnosis"]["text"]
    assert set(printed) >= {"axes", "design", "proof", "saved"}


def test_each_step_is_explained_and_asked_for(tmp_path: Path) -> None:
    result = CliRunner().invoke(main, ["commission", "--out", str(tmp_path / "out")], input="n\n")
    assert result.exit_code == 1
    assert "identify: Each axis moves within its soft limits" in result.stderr
    assert "Go on?" in result.stderr


@pytest.mark.parametrize("verb", [["commission", "--out", "unused"], ["identify"]])
def test_without_a_known_length_the_distance_of_index_pulses_is_needed(verb: list[str]) -> None:
    result = CliRunner().invoke(main, [*verb, "--untold", "all"])
    assert result.exit_code == 2
    assert "--index-distance" in result.stderr


@pytest.mark.parametrize("aim", list(AIMS))
def test_tune_designs_with_the_limits_of_its_aim(aim: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked = []

    def design(machine: object, controller: str, compensation: str, ms: float, force_step_N: float, _: object) -> None:
        asked.append((controller, compensation, ms, force_step_N))
        raise MachineError("no gains")

    monkeypatch.setattr("kontur.design.search.design", design)
    file = str(MACHINES / "ball_screw.toml")
    result = CliRunner().invoke(main, ["tune", file, "--for", aim, "-o", str(tmp_path / "p.toml")])
    assert result.exit_code == 1
    assert asked == [("ccu", "full", *AIMS[aim])]
