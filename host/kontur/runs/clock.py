# SPDX-License-Identifier: Apache-2.0
"""The time of a run: path time at each moment since the start of the path, and the times of the telemetry rows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kontur.can import wire
from kontur.drive.stream import StreamResult
from kontur.path.geometry import KNOT_S
from kontur.planning import path_time
from kontur.planning.planner import Trajectory

Floats = NDArray[np.float64]


class RunClock:
    """Time since the path was started, and path time by the feed overrides that were commanded.

    `periods`, `end_s`: length of the run, in control periods and in seconds. `start_period`: the control period in
    which the path started, counted from power-on where the host's clock is the drive's.
    """

    def __init__(self, trajectory: Trajectory, streamed: StreamResult, control_hz: int, stop_time_s: float) -> None:
        self.control_hz = control_hz
        self.start_period = round(streamed.start_s * control_hz)
        stop = round(stop_time_s * control_hz)
        wanted = [(round((at_s - streamed.start_s) * control_hz), rate) for at_s, rate in streamed.rates]
        if streamed.stop_s is not None:
            wanted.append((round((streamed.stop_s - streamed.start_s) * control_hz), 0.0))
        length = round(trajectory.duration_s * control_hz)
        last, rate = wanted[-1]
        if streamed.passed:
            wanted.insert(0, (0, 0.0))  # a path that is resumed starts from standstill, not at full rate
        horizon = last + round(path_time.RATE_MAX * stop) + (math.ceil(length / rate) if rate > 0.0 else 0)
        self._periods, path = path_time.curve(wanted, horizon, stop)
        path += streamed.passed * KNOT_S * control_hz
        self._path, self._length = path, length
        ends = float(np.interp(length, path, self._periods))
        self.periods = round(ends) if path[-1] >= length else last + stop
        self.end_s = self.periods / control_hz

    def path_time(self, time_s: Floats) -> Floats:
        """Path time (n,) in s."""
        path = np.interp(time_s * self.control_hz, self._periods, self._path)
        return np.asarray(np.minimum(path, self._length) / self.control_hz)

    def of_ticks(self, tick: NDArray[np.int64], by_device_time: bool) -> Floats:
        """Time (n,) in s of telemetry rows. The row of tick i was sampled in control period `i ms - 1`, counted from 0.

        The control period in which the path started is known where the host's clock is the drive's (simulated drives).
        Else the first row after the command to start counts as the start, which is right to 1 ms and the time on the
        bus.
        """
        if not by_device_time or not len(tick):
            return np.asarray((tick - tick[:1]) * wire.TICK_PERIOD_S)
        periods = round(wire.TICK_PERIOD_S * self.control_hz)
        first = self.start_period // periods + 1
        since = (tick[0] - first + 0x8000) % 0x10000 - 0x8000 + (tick - tick[0])
        return np.asarray(((first + since) * periods - 1 - self.start_period) / self.control_hz)
