#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A master of cyclic modes that needs nothing of this project: python-canopen's primitives alone. Only what the
command line starts uses kontur, to give the simulated drive the gains of its machine.

test_cyclic_modes.py uses it. By itself it drives circles for as long as it is told, and prints how far off they were:

    .venv/bin/python tests/hil/foreign_master.py --minutes 10 --cycle-ms 1 --jitter 0.2 --ppm 500

The simulated drive is in this process, and its time passes in recv() of the bus, so ten minutes take two or three.
"""

from __future__ import annotations

import argparse
import math
import random
import struct
import sys
from collections.abc import Callable

import can
import canopen
import numpy as np

from kontur import machine
from kontur.can.link import Link
from kontur.drive.device import Device

Y = 0x800  # from an object of axis x to that of axis y
CYCLIC_POSITION = 8
ENABLED, STATE = 0x27, 0x6F
RADIUS_M, SPEED_MPS, RAMP_S = 0.02, 0.1, 0.2
_NOT_VALID = 1 << 31
_SETTLE_S = 0.1
_PART_S = 10.0  # what is recorded of the truth at once

Path = Callable[[float], tuple[float, float]]
"""Positions in nm after a time in s."""


class _Polled(canopen.Network):  # type: ignore[misc]
    """Handles what has come whenever it sends, so that no thread is needed."""

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        super().send_message(can_id, data, remote)
        self.pump()

    def pump(self, timeout_s: float = 0.0) -> None:
        """Let time pass for up to `timeout_s`, or until a frame has come, and handle all that there is."""
        while (frame := self.bus.recv(timeout_s)) is not None:
            self.notify(frame.arbitration_id, frame.data, frame.timestamp)
            timeout_s = 0.0


class ForeignMaster:
    """Both axes of the drive with `node_id` on `bus`, which has a clock of its own (`time_s`)."""

    def __init__(self, bus: can.BusABC, node_id: int = 1) -> None:
        self.bus, self.node_id = bus, node_id
        self.network = _Polled(bus)
        self.node = self.network.add_node(canopen.RemoteNode(node_id, canopen.ObjectDictionary()))
        self.codes: list[int] = []
        self.node.emcy.add_callback(lambda error: self.codes.append(error.code))

    @property
    def time_s(self) -> float:
        now_s: float = self.bus.time_s  # type: ignore[attr-defined]
        return now_s

    def write(self, index: int, sub: int, size: int, value: int) -> None:
        self.node.sdo.download(index, sub, value.to_bytes(size, "little", signed=value < 0))

    def read(self, index: int, sub: int = 0) -> int:
        return int.from_bytes(self.node.sdo.upload(index, sub), "little", signed=True)

    def write_both(self, index: int, sub: int, size: int, value: int) -> None:
        for axis in (0, Y):
            self.write(index + axis, sub, size, value)

    def positions_nm(self) -> tuple[int, int]:
        return self.read(0x6064), self.read(0x6064 + Y)

    def statuswords(self) -> tuple[int, int]:
        return self.read(0x6041) & 0xFFFF, self.read(0x6041 + Y) & 0xFFFF

    def wait(self, duration_s: float) -> None:
        self.wait_until(self.time_s + duration_s)

    def wait_until(self, end_s: float) -> None:
        while self.time_s < end_s - 1e-9:
            self.network.pump(end_s - self.time_s)

    def map_rpdo(self, number: int, kind: int, *entries: int) -> None:
        """Map entries (index << 16 | sub-index << 8 | bits) into an RPDO with this transmission type."""
        communication, mapping, cob_id = 0x1400 + number - 1, 0x1600 + number - 1, 0x100 + 0x100 * number + self.node_id
        self.write(communication, 1, 4, _NOT_VALID | cob_id)
        self.write(communication, 2, 1, kind)
        self.write(mapping, 0, 1, 0)
        for sub, entry in enumerate(entries, 1):
            self.write(mapping, sub, 4, entry)
        self.write(mapping, 0, 1, len(entries))
        self.write(communication, 1, 4, cob_id)

    def set_up(self, cycle_ms: int, mode: int, *entries: int) -> None:
        """Map `entries` into the third RPDO, which takes effect at SYNC; operational, both axes in `mode`."""
        self.network.send_message(0, bytes([0x80, self.node_id]))
        self.map_rpdo(3, 1, *entries)
        self.write_both(0x60C2, 1, 1, cycle_ms)
        self.network.send_message(0, bytes([0x01, self.node_id]))
        self.write_both(0x6060, 0, 1, mode)

    def controlwords(self, x: int, y: int) -> None:
        self.network.send_message(0x200 + self.node_id, struct.pack("<HH", x, y))

    def enable(self) -> None:
        for word in (0x06, 0x07, 0x0F):
            self.statuswords()
            self.wait(0.002)
            self.controlwords(word, word)
        self.wait(0.01)
        assert [word & STATE for word in self.statuswords()] == [ENABLED, ENABLED]

    def begin(self, path: Path, cycle_ms: int, *, jitter: float = 0.0, ppm: float = 0.0, seed: int = 1) -> None:
        """Follow `path` from now on. SYNC is late or early by up to `jitter` cycles, and the clock slow by `ppm`."""
        self._path, self._cycle_s, self._cycle = path, cycle_ms * 1e-3, 0
        self._jitter, self._slow, self._noise = jitter, 1.0 + ppm * 1e-6, random.Random(seed)
        self._begin_s = self.time_s + self._cycle_s

    def follow(self, duration_s: float) -> None:
        """Send positions with SYNC, for so long."""
        for _ in range(round(duration_s / self._cycle_s)):
            late = self._cycle * self._slow + self._noise.uniform(-self._jitter, self._jitter)
            x, y = self._path(self._cycle * self._cycle_s)
            self.wait_until(self._begin_s + late * self._cycle_s)
            self.network.send_message(0x400 + self.node_id, struct.pack("<ii", round(x), round(y)))
            self.network.send_message(0x80, b"")
            self._cycle += 1


def circles(start_nm: tuple[int, int], duration_s: float) -> Path:
    """Laps to the left of `start_nm`, from standstill to standstill."""
    radius_nm, speed_nmps = RADIUS_M * 1e9, SPEED_MPS * 1e9
    end_s = duration_s - _SETTLE_S

    def ramp(t: float) -> float:
        """Way of a start, in s at full speed"""
        t = min(max(t, 0.0), RAMP_S)
        return 0.5 * (t - RAMP_S / math.pi * math.sin(math.pi * t / RAMP_S))

    def at(t: float) -> tuple[float, float]:
        t = min(max(t - _SETTLE_S, 0.0), end_s - _SETTLE_S)
        left = end_s - _SETTLE_S - t
        way_s = ramp(t) + max(0.0, t - RAMP_S) + ramp(RAMP_S) - ramp(left) - max(0.0, RAMP_S - left)
        angle = way_s * speed_nmps / radius_nm
        return start_nm[0] + radius_nm * (math.cos(angle) - 1.0), start_nm[1] + radius_nm * math.sin(angle)

    return at


def off_circle_m(position_m: np.ndarray, start_nm: tuple[int, int]) -> np.ndarray:
    """Distances (n,) of true positions (n, 2) from the circle of circles()."""
    off: np.ndarray = np.abs(
        np.hypot(position_m[:, 0] - start_nm[0] * 1e-9 + RADIUS_M, position_m[:, 1] - start_nm[1] * 1e-9) - RADIUS_M
    )
    return off


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--cycle-ms", type=int, default=1)
    parser.add_argument("--jitter", type=float, default=0.2, help="of SYNC, in cycles")
    parser.add_argument("--ppm", type=float, default=500.0, help="by which the master's clock is slow")
    args = parser.parse_args()
    with can.Bus(interface="kontur", channel="sim", seed=1) as bus:
        Device(Link(bus, 1)).parameters.set(machine.load().parameters())  # as `kontur param load` does
        master = ForeignMaster(bus)
        master.set_up(args.cycle_ms, CYCLIC_POSITION, 0x607A0020, 0x687A0020)
        master.enable()
        start_nm = master.positions_nm()
        duration_s = args.minutes * 60.0
        master.begin(circles(start_nm, duration_s), args.cycle_ms, jitter=args.jitter, ppm=args.ppm)
        parts = []
        bus.start_recording()  # type: ignore[attr-defined]
        for part_s in [_PART_S] * int(duration_s // _PART_S) + [duration_s % _PART_S]:
            master.follow(part_s)
            off_m = off_circle_m(bus.take_truth().pos_m, start_nm)  # type: ignore[attr-defined]
            parts.append((off_m.sum(), off_m.size, off_m.max(initial=0.0)))
        total_m, samples, most_m = np.array(parts).T
        states = [word & STATE for word in master.statuswords()]
        print(
            f"{args.minutes:g} min, cycle {args.cycle_ms} ms, jitter {args.jitter:g}, {args.ppm:g} ppm: mean "
            f"{total_m.sum() / samples.sum() * 1e6:.3f} um, max {most_m.max() * 1e6:.2f} um, EMCY {master.codes}"
        )
    return 0 if states == [ENABLED, ENABLED] and not master.codes else 1


if __name__ == "__main__":
    sys.exit(main())
