# SPDX-License-Identifier: Apache-2.0
"""How far path time came on a drive that was slowed, held or sped up (firmware/drive/path.h), known from when that was
asked for. What slows it unasked, want of knots or a fault, is not in it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

RATE_MAX = 1.2
_SLOPE_MAX, _JERK_MAX = 4.0 / 3.0, 16.0 / 3.0  # of the rate, in stop times
_RATE_SMALL, _SLOPE_SMALL = 5e-6, 1.0 / 128.0


def rates(wanted: Sequence[tuple[int, float]], periods: int, stop_periods: float) -> NDArray[np.float64]:
    """Rate (periods,) of path time in each control period, the first one of the motion being 0.

    `wanted`: from which period on which rate was asked for, 0 to RATE_MAX, in order, the first one from period 0; a rate
    of 0 before the motion has begun is not meant. `stop_periods`: path_stop_time in control periods.
    """
    result = np.empty(periods)
    rate, slope, step = wanted[0][1], 0.0, 1.0 / stop_periods
    ends = [period for period, _ in wanted[1:]] + [periods]
    for (begin, goal), end in zip(wanted, ends, strict=True):
        for period in range(min(begin, periods), min(end, periods)):
            if rate == goal and slope == 0.0:
                result[period : min(end, periods)] = rate
                break
            rate, slope = _moved(rate, slope, goal, step)
            result[period] = rate
    return result


def path_time_s(rate: NDArray[np.float64], control_hz: int) -> NDArray[np.float64]:
    """Path time (n + 1,) in s at the beginning of each control period, and at the end of the last one."""
    return np.concatenate([[0.0], np.cumsum(rate)]) / control_hz


def _moved(rate: float, slope: float, goal: float, step: float) -> tuple[float, float]:
    """One control period, `step` stop times long, towards `goal`: moved() of firmware/drive/path.c."""
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
