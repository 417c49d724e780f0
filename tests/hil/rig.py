# SPDX-License-Identifier: Apache-2.0
"""A drive with its host, and the one way it is moved: circles from where it stands, within limits set before."""

from __future__ import annotations

import time
import zlib

import can
import numpy as np
from numpy.typing import NDArray
from targets import MACHINE, Drive

from kontur.can import wire
from kontur.can.link import Link
from kontur.can.simulated import simulated
from kontur.drive.device import Device
from kontur.drive.pdos import TELEMETRY
from kontur.path import shapes
from kontur.planning import planner
from kontur.planning.bounds import limits
from kontur.sim.bus import KonturBus

Knots = NDArray[np.int32]
Metres = NDArray[np.float64]

RESET_NODE, RESET_COMMUNICATION, START, STOP, PRE_OPERATIONAL = 129, 130, 1, 2, 128
STATE_OF = {START: 0x05, STOP: 0x04, PRE_OPERATIONAL: 0x7F}
BOOT_S = 3.0
PATIENCE_S = 60.0  # by the wall clock, on a machine that is busy with other work
STOPPED = 5  # 2200h state
STANDS_MPS = 2e-3  # slower than that an axis is said to stand: above what noise and a stop's end make of it


# A real table moves within 2 mm of where it stands, slowly, and with a part of the force it could use.
_RADIUS_M, _FEED_MPS = 0.001, 0.01
_TRAVEL_NM = 2_500_000
_FORCE_SHARE = 0.25
_FOLLOWING_NM = 500_000
_SIMULATED_RADIUS_M, _SIMULATED_FEED_MPS = 0.004, 0.1


class Rig:
    """`device` on `link` on `bus`, after reset node, in a `with`."""

    def __init__(self, drive: Drive, bus: can.BusABC | None = None) -> None:
        self.drive = drive
        self.radius_m = _SIMULATED_RADIUS_M if drive.simulated else _RADIUS_M
        self.feed_mps = _SIMULATED_FEED_MPS if drive.simulated else _FEED_MPS
        self.rate = 1.0
        """The feed override, which the way of a stop goes by."""
        self.muted = drive.simulated and not drive.stepped  # telemetry stays off: the processor is for what is tested
        self.connect(bus)

    def connect(self, bus: can.BusABC | None = None, *, heartbeat: bool = True) -> None:
        """Find the drive on `bus`, or on one that is opened; without a heartbeat, only look on at another host."""
        self.bus = bus or self.drive.open()
        self.link = Link(self.bus, self.drive.node_id)
        self.device = Device(self.link)
        self.seen_late = self.drive.truth_m is None and not heartbeat
        if self.seen_late:
            self.note_error()
            self.link.record_telemetry()

    def fall_silent(self) -> None:
        """No heartbeat of the host any more."""
        self.link.stop_heartbeat()

    def __enter__(self) -> Rig:
        self.reset()
        self.device.parameters.set(self.drive.parameters if self.drive.simulated else self._safe())
        return self

    def __exit__(self, *raised: object) -> None:
        try:
            if not self.drive.simulated:
                self.device.axes.disable()  # on the path, if one runs
                self.reset()
        finally:
            self.bus.shutdown()

    def stall(self, duration_s: float) -> None:
        """Let the drive's time pass while the host neither sends nor receives what it should."""
        simulator = simulated(self.bus)
        if not self.drive.stepped:
            time.sleep(duration_s)
        elif isinstance(simulator, KonturBus):
            simulator.sim.run(round(duration_s * simulator.sim.control_hz))
        else:
            for _ in range(round(duration_s / wire.TICK_PERIOD_S)):
                self.link.send(wire.SYNC, b"")

    def nmt(self, command: int) -> None:
        """Send an NMT command to the drive."""
        self.link.send(0, bytes([command, self.drive.node_id]))

    def heartbeats(self) -> list[int]:
        """The NMT states that the drive reports, from now on: a list that grows as the link is pumped."""
        states: list[int] = []
        self.link._network.subscribe(0x700 + self.drive.node_id, lambda _id, data, _t: states.append(data[0]))
        return states

    def reset(self, command: int = RESET_NODE) -> None:
        """Send an NMT reset and wait for the boot-up message."""
        states = self.heartbeats()
        self.nmt(command)
        limit_s = BOOT_S if self.drive.stepped or not self.drive.simulated else PATIENCE_S
        assert self.link.wait(lambda: 0 in states, limit_s), f"no boot-up message {limit_s:g} s after a reset"
        if self.drive.truth_m is None and not self.muted:
            self.device.pdos.require(*TELEMETRY)
        self.link.emergencies.clear()

    def circle(self, laps: float) -> Knots:
        """Knots (n, 2) in nm of a circle that starts where the drive stands and lies on the side of lesser x."""
        here_nm = np.array(self.device.position_nm())
        self.centre_m = here_nm * 1e-9 - [self.radius_m, 0.0]
        knots_nm = planner.plan(shapes.circle(self.radius_m, self.feed_mps, laps), limits(MACHINE)).knots_nm
        moved: Knots = (knots_nm - knots_nm[0] + here_nm).astype(np.int32)
        return moved

    def off_circle_m(self, position_m: Metres) -> Metres:
        """Distance (n,) of positions (n, 2) from the circle."""
        off: Metres = np.abs(np.hypot(*(position_m - self.centre_m).T) - self.radius_m)
        return off

    def positions_m(self) -> tuple[Metres, float]:
        """Positions (n, 2) since the last `link.record_telemetry()` or before, and the time between two of them: the
        truth, for which a simulated drive is switched off, or of a real drive what its telemetry says."""
        if self.drive.truth_m is not None:
            control_s = 1.0 / self.device.read("clock.control_hz")
            return self.drive.truth_m(), control_s
        start_nm = (round(self.centre_m[0] * 1e9 + self.radius_m * 1e9), round(self.centre_m[1] * 1e9))
        position_m = self.link.recorded_telemetry(start_nm).position_m
        return position_m[~np.isnan(position_m).any(axis=1)], 1e-3  # a record may begin within a millisecond

    def note_error(self) -> None:
        """Of the motion so far, by the drive's own estimate: what a stop is measured by that nobody else has seen."""
        self.before_m = self.device.read("estimated_contour_error.max")
        self.before_knots = self.device.read("stream.executed")

    def assert_stopped_on_the_path(self) -> None:
        """The stop at the end of the motion was no further from the circle than the motion before, plus one encoder
        count. The last thing to do with a drive."""
        stop_s = self.device.read("limits.path_stop_time") * 1e-3 * stop_share(self.rate)
        feed_mps = self.feed_mps * self.rate
        count_m = self.device.read("plant_x.encoder") * 1e-6
        if self.muted and self.drive.truth_m is None:  # by the drive's own word, of each millisecond
            assert self.device.read("stream.state") == STOPPED
            assert self.device.read("stream.executed") > self.before_knots + 0.5 * stop_s * 1e3 * self.rate
            assert self.device.read("estimated_contour_error.max") <= self.before_m + count_m
            return
        position_m, step_s = self.positions_m()
        off_m = self.off_circle_m(position_m)
        window = round(1e-3 / step_s)
        speed_mps = np.hypot(*(position_m[window:] - position_m[:-window]).T) / (window * step_s)
        moving = np.flatnonzero(speed_mps > STANDS_MPS)
        assert moving.size, "it never moved"
        begin = moving[-1] - round(stop_s / step_s)
        assert begin > moving[0], "it stopped before it had got going"
        assert speed_mps[begin - window] > 0.9 * feed_mps, "it was slow before it stopped"
        way_m = np.hypot(*np.diff(position_m[begin : moving[-1]], axis=0).T).sum()
        assert way_m > 0.3 * feed_mps * stop_s, f"{way_m * 1e3:.3f} mm in its stop: not along the path"
        before_m = self.before_m if self.seen_late else off_m[:begin].max()
        assert off_m[begin:].max() <= before_m + count_m

    def _safe(self) -> dict[str, float]:
        """Limits for a real table, from what it has now."""
        values = {
            "limits.velocity": 5 * self.feed_mps,
            "following_window_x": _FOLLOWING_NM,
            "following_window_y": _FOLLOWING_NM,
        }
        for axis, here_nm in zip("xy", self.device.position_nm(), strict=True):
            values |= {
                f"plant_{axis}.force_limit": self.device.read(f"plant_{axis}.force_limit") * _FORCE_SHARE,
                f"position_limit_{axis}.min": here_nm - _TRAVEL_NM,
                f"position_limit_{axis}.max": here_nm + _TRAVEL_NM,
            }
        return values


def stop_share(rate: float) -> float:
    """Of limits.path_stop_time, what a stop from this rate takes: its slope goes to 4/3 at most, and back, and changes
    by 16/3 in that time (motion/path_clock.h)."""
    return 0.25 + 0.75 * rate if rate > 1.0 / 3.0 else (0.75 * rate) ** 0.5


def moving(position_m: Metres, step_s: float) -> NDArray[np.intp]:
    """The rows of positions (n, 2), `step_s` apart, where they move faster than STANDS_MPS, over 1 ms."""
    window = round(1e-3 / step_s)
    return np.flatnonzero(np.hypot(*(position_m[window:] - position_m[:-window]).T) > STANDS_MPS * window * step_s)


def checksum(knots_nm: Knots) -> int:
    """What 2200h checksum must be after these knots."""
    return zlib.crc32(np.ascontiguousarray(knots_nm, dtype="<i4").tobytes())
