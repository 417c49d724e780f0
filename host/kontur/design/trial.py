# SPDX-License-Identifier: Apache-2.0
"""The error of a short move on the simulated machine, which decides between gains that keep the margins.

`loop` has no table that moves in its gap, no friction that builds up, no counts and no adaptation. This move has them
all: a circle at a high feed and then, round the reversal of each axis, at a low one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from kontur.drive.target import Target
from kontur.errors import DeviceError
from kontur.machine import NOTHING, Machine
from kontur.path.geometry import KNOT_S, Arc, Line, Move, Program
from kontur.planning.bounds import limits
from kontur.planning.planner import Trajectory, plan
from kontur.runs.runner import RunOptions, RunResult, run

STOPPED = 1e3
"""In place of the logarithm of an error: the drive stopped with a fault."""
_RADIUS_M = 3e-3
_FAST_MPS, _SLOW_MPS = 0.08, 0.005
_FAST, _SLOW = math.radians(2 * 360 + 160), math.radians(130)  # the slow part begins 20 degrees before a reversal
_UNSCORED = math.pi  # in which the axes speed up
_STOPS_M = 0.03  # from stop to stop, and back


class Trial:
    """The move in the middle of the travel of `machine`, under `controller`. Raises PathError: there is no room."""

    def __init__(self, machine: Machine, controller: str) -> None:
        self.machine, self.controller = machine, controller
        self._centre_m = np.array([0.5 * (low + high) for low, high in machine.soft_limits_m])
        self._radius_m = min(_RADIUS_M, *(0.25 * (high - low) for low, high in machine.soft_limits_m))
        centre = (float(self._centre_m[0]), float(self._centre_m[1]))
        parts = (
            (Arc(centre, self._radius_m, 0.0, _FAST), _FAST_MPS),
            (Arc(centre, self._radius_m, _FAST, _SLOW), _SLOW_MPS),
        )
        start = (centre[0] + self._radius_m, centre[1])
        program = Program("trial", tuple(Move(arc, feed) for arc, feed in parts), start)
        self._trajectory = plan(program, limits(machine))
        self._target = Target(machine=replace(machine, friction_schedule=()), seed=1, told=NOTHING)

    def __call__(self, parameters: Mapping[str, float]) -> float:
        """Logarithm of the true contour error, m: the mean over each feed, and of both the geometric mean."""
        try:
            truth = self._run(self._trajectory, parameters).truth
        except DeviceError:
            return STOPPED
        assert truth is not None
        error_m = np.abs(np.hypot(*(truth.pos_m - self._centre_m).T) - self._radius_m)
        angle = self._trajectory.path_s_m / self._radius_m
        rows = len(error_m) * KNOT_S / self._trajectory.duration_s
        begin, middle = (int(rows * np.searchsorted(angle, at)) for at in (_UNSCORED, _FAST))
        return 0.5 * sum(math.log(float(np.mean(part))) for part in (error_m[begin:middle], error_m[middle:]))

    def quiet(self, parameters: Mapping[str, float]) -> bool:
        """Whether the drive is not stopped, neither on the circle nor on a line that both axes go as fast as they may,
        and back."""
        try:
            for trajectory in (self._trajectory, self._between_stops()):
                self._run(trajectory, parameters)
        except DeviceError:
            return False
        return True

    def _between_stops(self) -> Trajectory:
        half_m = np.array([min(0.5 * _STOPS_M, 0.4 * (high - low)) for low, high in self.machine.soft_limits_m])
        start, end = ((float(x), float(y)) for x, y in (self._centre_m - half_m, self._centre_m + half_m))
        feed_mps = math.hypot(*(axis.velocity_mps for axis in self.machine.axes))
        there, back = Move(Line(start, end), feed_mps), Move(Line(end, start), feed_mps)
        return plan(Program("between stops", (there, back), start), limits(self.machine))

    def _run(self, trajectory: Trajectory, parameters: Mapping[str, float]) -> RunResult:
        return run(trajectory, self.controller, self._target, RunOptions(parameters=parameters))
