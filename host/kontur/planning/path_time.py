# SPDX-License-Identifier: Apache-2.0
"""How far path time advances on a drive that is slowed, held or sped up: the model of firmware/motion/path_clock.h.

It is computed from the feed overrides and the times at which they were commanded. What slows the drive without a
command, a lack of knots or a fault, is not in it. Used to find the reference of each row of a log.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]

RATE_MAX = 1.2
_SLOPE_MAX, _JERK_MAX = 4.0 / 3.0, 16.0 / 3.0  # of the rate, in stop times
_RATE_SMALL, _SLOPE_SMALL = 5e-6, 1.0 / 128.0


def curve(wanted: Sequence[tuple[int, float]], end: int, stop_periods: float) -> tuple[_Floats, _Floats]:
    """Points (n,) of path time over time, both in control periods, from 0 to `end`; straight between them.

    `wanted`: the commanded rates, 0 to RATE_MAX, each with the period from which on it holds, in order, the first one
    from period 0 and above 0. `stop_periods`: path_stop_time.
    """
    rate, slope, path = wanted[0][1], 0.0, 0.0
    time, paths = [0], [0.0]
    until = [period for period, _ in wanted[1:]] + [end]
    for (begin, goal), next_ in zip(wanted, until, strict=True):
        now = min(begin, end)
        while now < min(next_, end):
            if rate == goal and slope == 0.0:
                passed = min(next_, end) - now
            else:
                rate, slope = _moved(rate, slope, goal, 1.0 / stop_periods)
                passed = 1
            now += passed
            path += rate * passed
            time.append(now)
            paths.append(path)
    return np.array(time, dtype=np.float64), np.array(paths)


def _moved(rate: float, slope: float, goal: float, step: float) -> tuple[float, float]:
    """One control period, `step` stop times long, towards `goal`; the same as in firmware/motion/path_clock.c."""
    gap = goal - rate
    change = _JERK_MAX * step
    landing = math.sqrt(change * change / 4.0 + 2.0 * _JERK_MAX * abs(gap)) - change / 2.0
    wanted = math.copysign(min(_SLOPE_MAX, landing), gap)
    slope = min(max(wanted, slope - change), slope + change)
    rate += slope * step
    left = goal - rate
    if (abs(left) < _RATE_SMALL or (left < 0.0) != (gap < 0.0)) and abs(slope) < max(_SLOPE_SMALL, change):
        return goal, 0.0
    return min(max(rate, min(goal, _RATE_SMALL)), RATE_MAX), slope
