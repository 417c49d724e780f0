# SPDX-License-Identifier: Apache-2.0
"""The watch for oscillation: each kind is seen within 100 ms of its onset, and a good machine gives no alarm."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from kontur import machine as machines
from kontur.cli import main
from kontur.drive.controllers import CONTROLLERS
from kontur.drive.target import Target
from kontur.errors import EmcyError
from kontur.experiments.robust import robust
from kontur.machine import Machine
from kontur.path import programs, shapes
from kontur.path.geometry import Program
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.runs.runner import RunOptions, RunResult, run

TABLE1 = machines.load(machines.DEFAULT)
_SCALED = machines.load(machines.MACHINES / "stiff_scale.toml")
# The gains of Table 1 shake both; scales calm them.
SCALED = replace(_SCALED, gains=TABLE1.gains)
STIFF = replace(_SCALED, x=replace(_SCALED.x, scale_m=0.0), y=replace(_SCALED.y, scale_m=0.0), gains=TABLE1.gains)
BALL_SCREW = replace(machines.load(machines.MACHINES / "ball_screw.toml"), gains=TABLE1.gains)
OSCILLATION, FOLLOWING = 0xFF1F, 0x8611
CIRCLE = shapes.circle(4e-3, 0.05)
PART = Path(__file__).parents[2] / "examples/part.ngc"


def drive(controller: str, machine: Machine, parameters: dict[str, float], program: Program = CIRCLE) -> RunResult:
    options = RunOptions(parameters=parameters, raise_fault=False)
    return run(plan(program, limits(machine)), controller, Target(machine=machine), options)


def with_lag(machine: Machine, lag_s: float) -> Machine:
    return replace(machine, x=replace(machine.x, current_lag_s=lag_s), y=replace(machine.y, current_lag_s=lag_s))


def with_mode(machine: Machine, share: float) -> Machine:
    x, y = (replace(axis, resonance_Hz=share * axis.resonance_Hz) for axis in machine.axes)
    return replace(machine, x=x, y=y)


def onset_s(result: RunResult, limit_N: float = 30.0) -> float:
    """When the force began to swing that swung when the capture was triggered, s before that.

    Swings are what is left of the force without its mean over 25 ms; a pause of 25 ms is the end of one.
    """
    capture = result.capture
    assert capture is not None
    width = round(0.025 / (capture.time_s[1] - capture.time_s[0]))
    begins = []
    for name in ("force_x", "force_y"):
        force = capture[name]
        swing = (
            force
            - np.convolve(np.pad(force, width // 2, mode="edge"), np.ones(width) / width, "same")[
                width // 2 : width // 2 + len(force)
            ]
        )
        large = capture.time_s[(np.abs(swing) > limit_N) & (capture.time_s <= 0.0)]
        if large.size and large[-1] > -0.025:
            pauses = np.flatnonzero(np.diff(large) > 0.025)
            begins.append(large[pauses[-1] + 1 if pauses.size else 0])
    return -min(begins)


OSCILLATING = {
    "too much gain": ("ccu", TABLE1, {"plant_x.mass": 440.0, "plant_y.mass": 490.0}),
    "too much gain of the cascade": ("cascade", with_lag(TABLE1, 1e-3), {"plant_x.mass": 880.0, "plant_y.mass": 980.0}),
    "mode of a stiff table": ("ccu", STIFF, {}),
    "mode of a stiff table under the cascade": ("cascade", STIFF, {}),
    "mode of a stiff table, 30 % lower": ("ccu", with_mode(STIFF, 0.7), {}),
    "mode of a stiff table, 30 % higher": ("ccu", with_mode(STIFF, 1.3), {}),
    "mode of a ball screw": ("ccu", BALL_SCREW, {}),
    "mode of a ball screw, 30 % lower": ("ccu", with_mode(BALL_SCREW, 0.7), {}),
    "mode of a ball screw, 30 % higher": ("ccu", with_mode(BALL_SCREW, 1.3), {}),
    "lag of the force": ("ccu", with_lag(TABLE1, 2e-3), {}),
    "longer lag of the force": ("ccu", with_lag(TABLE1, 3e-3), {}),
}


@pytest.mark.parametrize("kind", OSCILLATING)
def test_oscillation_is_seen_within_100_ms_of_its_onset(kind: str) -> None:
    controller, machine, parameters = OSCILLATING[kind]
    result = drive(controller, machine, parameters | {"oscillation.reaction": 0.0})
    assert OSCILLATION in result.warnings
    assert result.completed
    assert onset_s(result) <= 0.1
    assert "Hz" in result.log.meta["oscillation"]


@pytest.mark.parametrize("reaction", [1, 2, 3])
@pytest.mark.parametrize(
    "kind", ["too much gain", "mode of a stiff table under the cascade", "longer lag of the force"]
)
def test_oscillation_ends_the_run_as_its_parameter_says(kind: str, reaction: int) -> None:
    controller, machine, parameters = OSCILLATING[kind]
    result = drive(controller, machine, parameters | {"oscillation.reaction": float(reaction)})
    assert result.fault is not None
    assert result.fault.code == OSCILLATION
    assert not result.completed
    assert onset_s(result) <= 0.1


def test_second_encoder_that_counts_the_wrong_way_is_an_oscillation_before_the_path_begins() -> None:
    with pytest.raises(EmcyError, match="FF1Fh"):
        drive("ccu", SCALED, {"second_encoder_x.invert": 1.0, "second_encoder_x.crossover": 25.0})


def test_force_that_acts_the_wrong_way_runs_away_and_is_stopped_within_100_ms_of_its_onset() -> None:
    result = drive("ccu", TABLE1, {"wiring_x.invert_force": 1.0})
    assert result.fault is not None
    assert result.fault.code == FOLLOWING
    assert onset_s(result) <= 0.1


def test_run_that_oscillates_stops_on_the_path_and_says_at_what_frequency() -> None:
    result = drive("cascade", STIFF, {})
    assert result.fault is not None
    assert result.fault.code == OSCILLATION
    assert "Hz" in str(result.fault)
    assert not result.completed


@pytest.mark.parametrize("reaction", [0, 4])
def test_run_that_oscillated_and_went_on_tells_it(reaction: int) -> None:
    command = ["run", "circle", "--radius", "4", "--feed", "50", "--controller", "cascade", "--json"]
    machine = str(machines.MACHINES / "stiff_scale.toml")
    command += ["--machine", machine, "--compensation", "rigid", "--set", f"oscillation.reaction={reaction}"]
    command += [f"--set={name}={value}" for name, value in TABLE1.gains.items()]
    result = CliRunner().invoke(main, command)
    assert result.exit_code == 0
    assert "FF1Fh" in result.stderr
    told = json.loads(result.stdout)["notes"][-1]
    assert re.search(r"cascade oscillated: .* at \d+ Hz with \d+ N", told)
    assert ("gains lowered" in told) == (reaction == 4)


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("feed_mps", [4.488e-3, 0.1])
def test_circle_of_the_paper_gives_no_alarm(controller: str, feed_mps: float) -> None:
    result = drive(controller, TABLE1, {}, shapes.circle(4e-3, feed_mps, laps=1.0 if feed_mps < 0.01 else 10.0))
    assert result.completed
    assert OSCILLATION not in result.warnings


def test_small_features_with_a_reversal_every_few_milliseconds_give_no_alarm() -> None:
    for radius_m in (2e-5, 1e-4, 5e-4):
        assert drive("ccu", TABLE1, {}, shapes.circle(radius_m, 0.02, laps=20.0)).completed


def test_part_with_corners_gives_no_alarm() -> None:
    assert drive("ccu", TABLE1, {}, programs.load(str(PART))).completed


def test_draws_of_the_robustness_experiment_whose_force_swings_most_give_no_alarm() -> None:
    rows = robust(TABLE1, [4, 17, 31], controllers=["ccu"])
    assert [row["controllers"]["ccu"]["unstable"] for row in rows] == [None] * 3


FALSE_ALARMS = {41: "cascade", 119: "ccu", 148: "ccu", 1010: "ccc", 1056: "ccu", 1070: "ccu", 1074: "ccu", 1195: "ccu"}
"""Draws that were stopped: answers to a path (41, 148, 1010, 1070), and axes that hunt for a count."""


@pytest.mark.parametrize("seed", FALSE_ALARMS)
def test_draw_whose_force_only_answers_path_or_encoder_gives_no_alarm(seed: int) -> None:
    controller = FALSE_ALARMS[seed]
    assert robust(TABLE1, [seed], controllers=[controller])[0]["controllers"][controller]["unstable"] is None


def test_draw_whose_axis_sticks_and_slips_is_stopped() -> None:
    why = robust(TABLE1, [1006], controllers=["ccu"])[0]["controllers"]["ccu"]["unstable"]
    assert why is not None
    assert "FF1Fh" in why
