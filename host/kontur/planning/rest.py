# SPDX-License-Identifier: Apache-2.0
"""The rest of a trajectory that was left on its way: on the same path, from standstill."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from kontur.path.geometry import FloatArray
from kontur.planning import knots
from kontur.planning.ahead import Planned
from kontur.planning.path_time import PathTime
from kontur.planning.planner import Trajectory, positions

_STEPS = 10  # of path time in a millisecond, as the control periods of the drive
EQUAL = 2  # knots more at either end, so that the spline rests there


@dataclass(frozen=True)
class Rest:
    """A trajectory to stream and, for each of its knots, the path time (n,) of the whole trajectory in ms."""

    trajectory: Planned
    path_ms: FloatArray | range


def whole(trajectory: Planned) -> Rest:
    """All of `trajectory`."""
    return Rest(trajectory, range(len(trajectory.knots_nm)))


def rest(trajectory: Trajectory, from_ms: int, stop_time_ms: float) -> Rest:
    """What is left of `trajectory` from path time `from_ms` on, which is before its end.

    Path time gains speed as it does on a drive that goes on after a stop, within `stop_time_ms`
    (limits.path_stop_time). So the rest depends on these two values alone.
    """
    path_ms = _path_ms(len(trajectory.knots_nm), from_ms, stop_time_ms)
    at = np.arange(len(trajectory.path_s_m), dtype=np.float64)
    s_m = CubicSpline(at, trajectory.path_s_m, bc_type="clamped")(path_ms)
    s_m = np.maximum.accumulate(np.clip(s_m, trajectory.path_s_m[from_ms], trajectory.path_s_m[-1]))
    position_m = positions(trajectory.driven, s_m)
    knots_nm = knots.to_nm(knots.control_points(position_m))
    left = replace(trajectory, knots_nm=knots_nm, position_m=position_m, path_s_m=s_m, digest=knots.digest(knots_nm))
    return Rest(replace(left, feed=None), path_ms)


def rest_of_length(trajectory: Trajectory, count: int, stop_time_ms: float) -> Rest | None:
    """The rest of `trajectory` that has `count` knots; None: there is none."""
    total = len(trajectory.knots_nm)
    gained_ms = _gained_ms(total, stop_time_ms)
    lengths = np.searchsorted(gained_ms, np.arange(1, total)) + 1 + 2 * EQUAL  # of 1, 2 ... ms of the trajectory
    left = np.flatnonzero(lengths == count)
    return rest(trajectory, total - 2 - int(left[0]), stop_time_ms) if left.size else None


def _gained_ms(total: int, stop_time_ms: float) -> FloatArray:
    """Path time (n,) each ms after a start from standstill, until it has passed `total` ms."""
    length = math.ceil(total + stop_time_ms)
    path = PathTime(0.0, stop_time_ms * _STEPS)
    path.advance(1.0, length * _STEPS)
    return np.asarray(path.at(np.arange(length + 1.0) * _STEPS) / _STEPS)


def _path_ms(total: int, from_ms: int, stop_time_ms: float) -> FloatArray:
    left = total - 1 - from_ms
    gained_ms = _gained_ms(total, stop_time_ms)
    gained_ms = gained_ms[: int(np.searchsorted(gained_ms, left)) + 1]
    return np.asarray(from_ms + np.pad(np.minimum(gained_ms, left), EQUAL, mode="edge"))
