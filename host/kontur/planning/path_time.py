# SPDX-License-Identifier: Apache-2.0
"""How far path time advances on a drive that is slowed, held or sped up: the model of firmware/motion/path_clock.h.

It is computed from the feed overrides and the times at which they were commanded. What slows the drive without a
command, a lack of knots or a fault, is not in it. Used to find the reference of each row of a log.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]

RATE_MAX = 1.2
_SLOPE_MAX, _JERK_MAX = 4.0 / 3.0, 16.0 / 3.0  # of the rate, in stop times
_RATE_SMALL, _SLOPE_SMALL = 5e-6, 1.0 / 128.0


class PathTime:
    """Path time over time, in control periods, as far as advance() has gone; straight between its points.

    It begins in period 0 at path time `path` with `rate`, 0 to RATE_MAX. `stop_periods`: path_stop_time.
    """

    def __init__(self, rate: float, stop_periods: float, path: float = 0.0) -> None:
        self.now = 0
        self.hold = math.inf  # path time from which on it is held
        self._rate, self._slope = rate, 0.0
        self._stop_periods = stop_periods
        self._time, self._path, self._rates = [0], [path], [rate]  # the rate holds from the point on
        self._goals: list[tuple[int, float]] = [(0, rate)]  # that it goes to from a period on

    def advance(self, goal: float, until: int) -> None:
        """Go on until the period `until`, with `goal` as the commanded rate, or to 0 from `hold` on."""
        while self.now < until:
            ahead = self.hold - (self._path[-1] + self._rates[-1] * (self.now - self._time[-1]))
            wanted = goal if ahead > 0.0 else 0.0
            if wanted != self._goals[-1][1]:
                self._goals.append((self.now, wanted))
            if self._rate == wanted and self._slope == 0.0:
                held = wanted > 0.0 and ahead < wanted * (until - self.now)
                self.now = self.now + math.ceil(ahead / wanted) if held else until
                continue
            self._rate, self._slope = _moved(self._rate, self._slope, wanted, 1.0 / self._stop_periods)
            self._path.append(self._path[-1] + self._rates[-1] * (self.now - self._time[-1]))
            self._time.append(self.now)
            self._rates.append(self._rate)
            self.now += 1

    def at(self, period: _Floats) -> _Floats:
        """Path time (n,) at `period` (n,)."""
        point = np.maximum(np.searchsorted(self._time, period, side="right") - 1, 0)
        time, path, rates = (np.array(values, dtype=np.float64) for values in (self._time, self._path, self._rates))
        return np.asarray(path[point] + rates[point] * (period - time[point]))

    def rate(self, period: _Floats) -> _Floats:
        """Rate (n,) of path time at `period` (n,); 0 where it is to stop."""
        point = np.maximum(np.searchsorted(self._time, period, side="right") - 1, 0)
        goal = np.maximum(np.searchsorted([at for at, _ in self._goals], period, side="right") - 1, 0)
        goes = np.array([wanted > 0.0 for _, wanted in self._goals])[goal]
        return np.where(goes, np.array(self._rates)[point], 0.0)

    def reaches(self, path: float) -> float | None:
        """Period at which path time is `path`; None when it is not reached up to now."""
        if self._path[-1] + self._rates[-1] * (self.now - self._time[-1]) < path:
            return None
        point = max(0, int(np.searchsorted(self._path, path)) - 1)
        rate = self._rates[point]
        return self._time[point] + ((path - self._path[point]) / rate if rate > 0.0 else 0.0)

    def forget(self, period: float) -> None:
        """Keep only what is from `period` on."""
        first = max(0, int(np.searchsorted(self._time, period, side="right")) - 1)
        for values in (self._time, self._path, self._rates):
            del values[:first]


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
