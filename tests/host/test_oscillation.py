# SPDX-License-Identifier: Apache-2.0
"""The watch for oscillation: each kind is seen within 100 ms of its onset, and a good machine is never taken for one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from kontur import machine as machines
from kontur.cli import main
from kontur.drive.controllers import CONTROLLERS
from kontur.drive.target import Target
from kontur.experiments.robust import robust
from kontur.machine import Machine
from kontur.path import programs, shapes
from kontur.path.geometry import Program
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.runs.runner import RunOptions, RunResult, run

TABLE1 = machines.load(machines.DEFAULT)
STIFF = machines.load(machines.MACHINES / "stiff_scale.toml")
BALL_SCREW = machines.load(machines.MACHINES / "ball_screw.toml")
OSCILLATION = 0xFF1F
CIRCLE = shapes.circle(4e-3, 0.05)
PART = Path(__file__).parents[2] / "examples/part.ngc"


def drive(controller: str, machine: Machine, parameters: dict[str, float], program: Program = CIRCLE) -> RunResult:
    options = RunOptions(parameters=parameters, raise_fault=False)
    return run(plan(program, limits(machine)), controller, Target(machine=machine), options)


def with_lag(machine: Machine, lag_s: float) -> Machine:
    return replace(machine, x=replace(machine.x, current_lag_s=lag_s), y=replace(machine.y, current_lag_s=lag_s))


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
    "too much gain": ("cascade", TABLE1, {"cascade.velocity_gain": 5000.0, "cascade.position_gain": 500.0}),
    "too much gain of the compensator": ("ccu", TABLE1, {"compensator.phi": 0.0002}),
    "mode of a stiff table": ("ccu", STIFF, {}),
    "mode of a stiff table under the cascade": ("cascade", STIFF, {}),
    "mode of a ball screw": ("ccu", BALL_SCREW, {}),
    "lag of the force": ("ccu", with_lag(TABLE1, 2e-3), {}),
}


@pytest.mark.parametrize("kind", OSCILLATING)
def test_oscillation_is_seen_within_100_ms_of_its_onset(kind: str) -> None:
    controller, machine, parameters = OSCILLATING[kind]
    result = drive(controller, machine, parameters | {"oscillation.reaction": 0.0})
    assert OSCILLATION in result.warnings
    assert result.completed
    assert onset_s(result) <= 0.1
    assert "Hz" in result.log.meta["oscillation"]


def test_run_that_oscillates_stops_on_the_path_and_says_at_what_frequency() -> None:
    result = drive("cascade", STIFF, {})
    assert result.fault is not None
    assert result.fault.code == OSCILLATION
    assert "Hz" in str(result.fault)
    assert not result.completed
