# SPDX-License-Identifier: Apache-2.0
"""A simulated drive without python-can: frames go in by hand, knots by function call, time passes in whole chunks."""

import functools
import zlib

import numpy as np
from numpy.typing import NDArray

from kontur import machine
from kontur.can import wire
from kontur.drive.state_machine import ENABLE, RUN_PATH, SHUTDOWN, SWITCH_ON
from kontur.drive.target import Target, open_drive
from kontur.planning.path_time import PathTime
from kontur.planning.planner import Trajectory
from kontur.sim.library import Sim

MACHINE = machine.load()
HALT = RUN_PATH | 0x100
KNOT = 10
"""Control periods."""
STREAM, FEED_OVERRIDE = 0x2200, 0x2131
_DONE = 4


def path_time(wanted: list[tuple[int, float]], end: int, stop_periods: int) -> PathTime:
    """Path time up to the period `end`, after the commanded rates, each with the period from which on it holds."""
    path = PathTime(wanted[0][1], stop_periods)
    until = [period for period, _ in wanted[1:]] + [end]
    for (_, rate), next_ in zip(wanted, until, strict=True):
        path.advance(rate, min(next_, end))
    return path


@functools.cache
def _gains() -> list[tuple[int, int, int]]:
    """Those of MACHINE: index, sub-index and value on the wire."""
    with open_drive(Target(MACHINE)) as device:
        return [device.on_wire(name, value) for name, value in MACHINE.gains.items()]


class Drive:
    """The drive of a Sim, enabled and on its way from the first tick on."""

    def __init__(self, trajectory: Trajectory, seed: int = 1) -> None:
        self._knots_nm = trajectory.knots_nm
        self._sim = sim = Sim(MACHINE.starting_at(trajectory.program.start_m), seed)
        for index, subindex, count in _gains():
            self.download(index, subindex, count.to_bytes(4, "little"))
        sim.send(wire.NMT, bytes([wire.NMT_START, 1]))
        sim.run(5 * KNOT)
        for controlword in (SHUTDOWN, SWITCH_ON, ENABLE):
            self.command(controlword)
            sim.run(2 * KNOT)
        x, y = (int(v) for v in self._knots_nm[0])
        for subindex, value, size in ((4, len(self._knots_nm), 4), (2, x, 4), (3, y, 4), (1, 1, 1)):
            self.download(STREAM, subindex, value.to_bytes(size, "little", signed=value < 0))
        self._taken = sim.push_knots(self._knots_nm)
        sim.start_schedule()
        sim.record(True)
        self.command(RUN_PATH)

    def command(self, controlword: int) -> None:
        self._sim.send(wire.RPDO1 + 1, wire.pack_controlwords(controlword, controlword))

    def run(self, periods: int) -> None:
        """Let time pass, with a queue that is kept full."""
        while periods > 0:
            chunk = min(periods, 400 * KNOT)
            self._sim.run(chunk)
            self._taken += self._sim.push_knots(self._knots_nm[self._taken :])
            periods -= chunk

    def finish(self) -> NDArray[np.float64]:
        """True positions (n, 2) in m. The path must have come to its end by the knots that were sent, all of them."""
        assert self.stream(5) == _DONE
        assert self.stream(8) == len(self._knots_nm)
        assert self.stream(12) == zlib.crc32(np.ascontiguousarray(self._knots_nm, dtype="<i4").tobytes())
        assert self.stream(18) == 0  # underruns
        position_m = self._sim.truth().pos_m
        self._sim.close()
        return position_m

    def download(self, index: int, subindex: int, data: bytes) -> None:
        request = bytes([0x23 | (4 - len(data)) << 2]) + index.to_bytes(2, "little") + bytes([subindex])
        assert self._ask(request + data.ljust(4, b"\0"))[0] == 0x60

    def stream(self, subindex: int) -> int:
        return int.from_bytes(self._ask(bytes([0x40, 0x00, 0x22, subindex, 0, 0, 0, 0]))[4:], "little")

    def _ask(self, request: bytes) -> bytes:
        while self._sim.recv() is not None:
            pass
        self._sim.send(0x601, request)
        while (frame := self._sim.recv()) is not None:
            if frame.id == 0x581:
                return frame.data
        raise AssertionError("no answer")
