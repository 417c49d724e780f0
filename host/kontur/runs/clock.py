# SPDX-License-Identifier: Apache-2.0
"""The time of a run: path time at each moment since the start of the path, and the times of the telemetry rows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kontur.can import wire
from kontur.drive.stream import Motion
from kontur.path.geometry import KNOT_S
from kontur.planning.ahead import Planned
from kontur.planning.path_time import RATE_MAX, PathTime

Floats = NDArray[np.float64]


class RunClock:
    """Time since the path was started, and path time by the feed overrides that `motion` was commanded so far.

    `start_period`: the control period in which the path started, counted from power-on where the host's clock is the
    drive's. `periods`: length of the run in control periods, None as long as its end is not known.
    """

    def __init__(self, trajectory: Planned, motion: Motion, control_hz: int, stop_time_s: float) -> None:
        self.control_hz = control_hz
        self.start_period = round(motion.start_s * control_hz)
        self.periods: int | None = None
        self._motion = motion
        self._stop = round(stop_time_s * control_hz)
        self._trajectory = trajectory
        self._goal = motion.rates[0][1]
        # A path that is resumed starts from standstill, not at full rate.
        first = 0.0 if motion.passed else self._goal
        self._path = PathTime(first, self._stop, motion.passed * KNOT_S * control_hz)
        self._rates, self._stops, self._last, self._released = 1, False, 0, 0
        self._before = sum(hold < motion.passed for hold in motion.holds)
        self._first_tick: int | None = None

    def follow(self, now_s: float) -> None:
        """Take in what was commanded until `now_s` by the clock of the target."""
        self._take_commands()
        self._path.advance(self._goal, self._period(now_s))
        self._find_end()

    def finish(self) -> None:
        """Take in all commands; `periods` is known then."""
        self._take_commands()
        planned = len(self._trajectory.knots_nm) * KNOT_S * self.control_hz
        left = math.ceil(min(self._length, planned) / self._goal) if self._goal > 0.0 else 0
        self._path.advance(self._goal, self._last + round(RATE_MAX * self._stop) + left)
        self._find_end()
        if self.periods is None:
            self.periods = self._last + self._stop

    @property
    def _length(self) -> float:
        """Path time at the end, in control periods; infinite as long as it is not known."""
        periods = self._trajectory.duration_s * self.control_hz
        return periods if math.isinf(periods) else float(round(periods))

    def forget(self, time_s: float) -> None:
        """Path time before `time_s` is not needed any more."""
        self._path.forget(time_s * self.control_hz)

    def path_time(self, time_s: Floats) -> Floats:
        """Path time (n,) in s."""
        return np.asarray(np.minimum(self._path.at(time_s * self.control_hz), self._length) / self.control_hz)

    def rate(self, time_s: Floats) -> Floats:
        """Rate (n,) of path time; 0 where it is to stop, or has come to its end."""
        period = time_s * self.control_hz
        return np.where(self._path.at(period) < self._length, self._path.rate(period), 0.0)

    def of_ticks(self, tick: NDArray[np.int64], began: int | None, by_device_time: bool) -> Floats:
        """Time (n,) in s of telemetry rows, the first ones of the run first.

        The row of tick i was sampled in control period `i ms - 1`, counted from 0. The control period in which the path
        started is known where the host's clock is the drive's (simulated drives). Else it is in the millisecond before
        the row of tick `began`, which the drive names (TelemetryStream.path_began); this is right to 0.5 ms. Where no
        such frame has come, the first row counts as the start.
        """
        if self._first_tick is None and len(tick):
            self._first_tick = int(tick[0])
        if self._first_tick is None:
            return np.empty(0)
        if not by_device_time:
            since = tick - self._first_tick if began is None else tick - began + 0.5
            return np.asarray(since * wire.TICK_PERIOD_S)
        periods = round(wire.TICK_PERIOD_S * self.control_hz)
        first = self.start_period // periods + 1
        since = (self._first_tick - first + 0x8000) % 0x10000 - 0x8000 + (tick - self._first_tick)
        return np.asarray(((first + since) * periods - 1 - self.start_period) / self.control_hz)

    def _period(self, at_s: float) -> int:
        return round((at_s - self._motion.start_s) * self.control_hz)

    def _take_commands(self) -> None:
        motion = self._motion
        self._path.hold = self._hold()
        commands: list[tuple[int, float | None]]  # the time, and the rate; None: a hold is released
        commands = [(self._period(at_s), rate) for at_s, rate in motion.rates[self._rates :]]
        commands += [(self._period(at_s), None) for at_s in motion.released[self._released :]]
        commands.sort(key=lambda command: command[0])
        self._rates = len(motion.rates)
        if motion.stop_s is not None and not self._stops:
            self._stops = True
            commands.append((self._period(motion.stop_s), 0.0))
        for begin, goal in commands:
            self._path.advance(self._goal, begin)
            self._last = begin
            if goal is not None:
                self._goal = goal
            else:
                self._released += 1
                self._path.hold = self._hold()

    def _hold(self) -> float:
        """Path time, in control periods, from which on it is held next."""
        holds, number = self._motion.holds, self._before + self._released
        return holds[number] * KNOT_S * self.control_hz if number < len(holds) else math.inf

    def _find_end(self) -> None:
        if self.periods is None and (ends := self._path.reaches(self._length)) is not None:
            self.periods = round(ends)
