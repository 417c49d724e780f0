# SPDX-License-Identifier: Apache-2.0
"""Movements at constant speed for measurements, to and fro within the soft limits, in profile velocity mode."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from kontur.can import wire
from kontur.drive.device import Device
from kontur.drive.single_axis import VELOCITY_MODE, change_mode
from kontur.drive.state_machine import BIT_TARGET_REACHED
from kontur.errors import DeviceError

T = TypeVar("T")

_CLEARANCE_M = 1e-3  # from the soft limits
_TIMEOUT_S = 2.0  # beyond what a change of speed takes
_STANDS = 1 << 12  # of the statusword in profile velocity mode
_SPARE_S, _MORE_S, _SPARE_MAX_S = 0.05, 0.3, 1.0  # for a program that is late
_BACK_MPS = 0.05
SETTLE_S = 0.15  # after a change of speed, until the axis follows


class Mover:
    """One axis of an enabled drive. `low_m`, `high_m`: where it may be, which the soft limits hold it to. `held_back`:
    they did so at the end of the last movement, since this program was late: the speed was not that of the movement."""

    def __init__(self, device: Device, axis: str, stop_requested: Callable[[], bool] = lambda: False) -> None:
        self.device, self.axis, self.stop_requested = device, axis, stop_requested
        change_mode(device, (axis,), VELOCITY_MODE)
        limits = [float(device.read(f"position_limit_{axis}.{end}")) * wire.M_PER_NM for end in ("min", "max")]
        self.low_m, self.high_m = limits[0] + _CLEARANCE_M, limits[1] - _CLEARANCE_M
        rates = (f"profile_acceleration_{axis}", f"profile_deceleration_{axis}")
        self.held_back = False
        self._spare_s = _SPARE_S
        self._slowest_mps2 = min(float(device.read(name)) * 1e-6 for name in rates)

    def position_m(self) -> float:
        return float(self.device.read(f"position_actual_{self.axis}")) * wire.M_PER_NM

    def change_s(self, speed_mps: float) -> float:
        """How long a change from standstill to this speed takes."""
        return abs(speed_mps) / self._slowest_mps2

    def check(self) -> None:
        """Raise what the drive reports, and Interrupted (KeyboardInterrupt) where a stop is requested."""
        self.device.faults.check()
        if self.stop_requested():
            raise KeyboardInterrupt

    def run(self, velocity_mps: float) -> None:
        """Take this velocity, and return when the axis has it."""
        device, axis = self.device, self.axis
        device.write(f"target_velocity_{axis}", velocity_mps * 1e6)
        device.axes.refresh()
        bit = _STANDS if velocity_mps == 0.0 else BIT_TARGET_REACHED
        device.wait(
            lambda: bool(device.axes.status(axis) & bit),
            2.0 * self.change_s(max(abs(velocity_mps), 0.05)) + _TIMEOUT_S,
            f"does not bring axis {axis} to {velocity_mps * 1e3:g} mm/s; is a limit switch closed?",
        )

    def pause(self, duration_s: float) -> None:
        """Let time pass, and watch meanwhile."""
        end_s = self.device.link.time_s + duration_s
        while (left_s := end_s - self.device.link.time_s) > 0.0:
            self.device.link.wait(lambda: False, min(0.02, left_s))
            self.check()

    @contextmanager
    def moving(self, velocity_mps: float, settle_s: float = SETTLE_S) -> Iterator[None]:
        """At this velocity inside, and settled; at rest afterwards."""
        try:
            self.run(velocity_mps)
            self.pause(settle_s)
            yield
            self.device.axes.refresh()
            self.held_back = not self.device.axes.status(self.axis) & BIT_TARGET_REACHED
        finally:
            self.device.write(f"target_velocity_{self.axis}", 0)
        self.run(0.0)

    def steadily(self, measure: Callable[[], T]) -> T:
        """What `measure` finds in a movement as long as longest_s() says; again, where the axis was held back in it."""
        while True:
            start_m = self.position_m()
            found = measure()
            if not self.held_back:
                return found
            self.late()
            self.go(start_m, _BACK_MPS)

    def late(self) -> None:
        """Leave more room before the soft limits from now on. Raises DeviceError where it is much already."""
        self._spare_s += _MORE_S
        if self._spare_s > _SPARE_MAX_S:
            raise DeviceError(
                f"axis {self.axis} comes to the end of its travel before a measurement is done: this computer or the "
                f"bus is too slow; close other programs, or widen position_limit_{self.axis}"
            )

    def room_m(self, sign: float) -> float:
        """How far the axis may go in this direction."""
        here_m = self.position_m()
        return self.high_m - here_m if sign > 0.0 else here_m - self.low_m

    def way_m(self, speed_mps: float, duration_s: float) -> float:
        """How far the axis goes in a movement that has this speed so long, after it has settled."""
        return speed_mps * (duration_s + self.change_s(speed_mps) + SETTLE_S + self._spare_s)

    def longest_s(self, speed_mps: float, sign: float) -> float:
        """How long the axis may run at this speed, after it has settled, before it has to slow down."""
        return max(0.0, (self.room_m(sign) - self.way_m(speed_mps, 0.0)) / speed_mps)

    def go(self, position_m: float, speed_mps: float) -> None:
        """Come near this position, within some mm, where the limits allow it. A short way is gone more slowly."""
        position_m = min(max(position_m, self.low_m), self.high_m)
        way_m = position_m - self.position_m()
        if abs(way_m) < 1e-3:
            return
        sign = 1.0 if way_m > 0.0 else -1.0
        speed_mps = min(speed_mps, math.sqrt(0.4 * abs(way_m) * self._slowest_mps2))
        stop_m = 0.5 * speed_mps * self.change_s(speed_mps) + 0.05 * speed_mps  # and what is read and written meanwhile
        with self.moving(sign * speed_mps, 0.0):
            end_s = self.device.link.time_s + 2.0 + abs(way_m) / speed_mps
            while sign * (position_m - self.position_m()) > stop_m:
                self.pause(0.01)
                if self.device.link.time_s > end_s:
                    raise DeviceError(f"axis {self.axis} does not come to {position_m * 1e3:.1f} mm")
        self.held_back = False
