# SPDX-License-Identifier: Apache-2.0
"""The sender of a stream: go-back-N with credit, so that a bus that loses frames loses no knot.

docs/protocol.md, Streaming knots, has the rules. The drive reports in TPDO1 how many knots it has accepted and how many
more it has room for. A knot that was sent and is not accepted within the time of flight counts as lost, and everything
from it on is sent again. kontur.drive.stream uses it; tests drive it step by step.

TPDO1 has no checksum beyond that of CAN, so no decision depends on a single one. A wrong count is corrected by the next
one, and the state is read by SDO before anything is done about it.
"""

from __future__ import annotations

import zlib
from array import array
from bisect import bisect_left
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from kontur.can import outputs as switched
from kontur.can import wire
from kontur.can.outputs import Outputs
from kontur.drive.device import Device
from kontur.errors import DeviceError, StreamError

FLIGHT_MAX_S, FLIGHT_MIN_S = 0.02, 0.002
"""Bounds of the time of flight: from the sending of a knot to the TPDO1 that acknowledges it, when neither is lost.
Between them it follows from the SDO round trips. A line that is slower than the host adds the time for which knots have
been seen to wait before it."""

WINDOW = 63
"""Greatest number of knots on their way. Their numbers are modulo 256. A corrupted count in TPDO1 can release as many
knots as are on their way. It takes four such counts in a row until two knots on their way have equal numbers."""

IDLE, FILLING, RUNNING, STOPPING, DONE, STOPPED = range(6)
"""States of a stream (`stream.state`)."""

_START_KNOTS = 992  # about a second; the rest of the queue is filled while the path runs
_NUMBERS = 256
_BURST = 16
_QUEUED_MAX_S = 0.5  # far less than what the drive's queue holds
_SILENCE_S = 2.0  # a bus that is off recovers sooner, and then the drive reports what happened meanwhile
_BEGIN, _ABORT, _RESUME, RELEASE = 1, 2, 3, 4
_BEGIN_ATTEMPTS = 5


class Knots(Protocol):
    """The knots of a stream, more of which may come while it runs."""

    @property
    def complete(self) -> bool:
        """Whether these are all."""

    @property
    def knots_nm(self) -> NDArray[np.int32]:
        """Those that are there (N, 2)."""

    @property
    def switches(self) -> bool:
        """Whether they may have outputs."""

    @property
    def holds(self) -> int:
        """At how many knots the path is held, all in all."""

    def outputs_from(self, knot: int) -> Outputs:
        """The changes of the outputs from this knot on, as far as there are knots."""

    def done(self, knots: int) -> float:
        """The share of the path that so many knots are."""


@dataclass(frozen=True)
class AllKnots:
    """Knots that are all there, and their outputs."""

    knots_nm: NDArray[np.int32]
    outputs: Outputs = switched.NONE
    complete: bool = True

    @property
    def switches(self) -> bool:
        return len(self.outputs) > 0

    @property
    def holds(self) -> int:
        return len(self.outputs.holds)

    def outputs_from(self, knot: int) -> Outputs:
        return self.outputs.since(knot)

    def done(self, knots: int) -> float:
        return knots / len(self.knots_nm)


def begin_stream(device: Device, knots_nm: NDArray[np.int32], complete: bool = True) -> None:
    """Open the drive's queue for a stream of `knots_nm` (N, 2), and read back that it is open for these. Where they are
    not all, its total is written later.

    Raises DeviceError when the drive does not stand at the first.
    """
    x, y = start_nm(knots_nm)
    if device.read_stable("stream.state") not in (IDLE, DONE):
        device.write("stream.command", _ABORT)  # a stream that was stopped, or is another master's
    for _ in range(_BEGIN_ATTEMPTS):
        device.write("stream.total", len(knots_nm) if complete else 0)
        device.write("stream.start_x", x)
        device.write("stream.start_y", y)
        try:
            device.write("stream.command", _BEGIN)
        except DeviceError:
            device.faults.check()  # where a fault is the reason, its message says more
            raise
        state, accepted, *end = (
            device.read_stable(f"stream.{name}") for name in ("state", "accepted", "end_x", "end_y")
        )
        if state == FILLING and accepted == 0 and end == [x, y]:
            return
    raise StreamError("the drive does not open its queue for the path; does the bus corrupt frames?")


def check_stopped(device: Device) -> None:
    """Raises StreamError: the drive did not stop on a path."""
    state = device.read_stable("stream.state")
    if state == DONE:
        raise StreamError("the drive has nothing to go on with: its last path, or jog, has gone to the end")
    if state != STOPPED:
        raise StreamError(
            "the drive cannot go on with the path: it did not stop on it, or the axes were moved since; plan anew from "
            "where they stand"
        )


def executed_of(device: Device, knots_nm: NDArray[np.int32]) -> int | None:
    """How many knots of its stream the drive has executed, if `knots_nm` (N, 2) begin with these; None: they do not."""
    executed, checksum = (int(device.read_stable(f"stream.{name}")) for name in ("executed", "checksum"))
    known = zlib.crc32(np.ascontiguousarray(knots_nm[:executed], dtype="<i4").tobytes())
    return executed if executed <= len(knots_nm) and checksum == known else None


def stopped_after(device: Device, knots_nm: NDArray[np.int32], complete: bool = True) -> int:
    """How many knots of the stream `knots_nm` (N, 2) the drive has executed, which it stopped on. Where they are not
    `complete`, their number is not compared.

    Raises StreamError: the drive did not stop on a path, or on another one.
    """
    check_stopped(device)
    total, executed = int(device.read_stable("stream.total")), executed_of(device, knots_nm)
    if executed is None or (complete and total not in (0, len(knots_nm))):  # 0: it was stopped while it was planned
        executed = int(device.read_stable("stream.executed"))
        raise StreamError(
            f"the drive has left another path than this one, at knot {executed}; "
            "give the file and the options of the run that was stopped"
        )
    return executed


def resume_stream(device: Device, knots_nm: NDArray[np.int32], complete: bool = True) -> int:
    """Open the drive's queue again for the rest of `knots_nm` (N, 2); returns how many knots it has. They are
    `complete`, or more will come.

    Raises StreamError: the drive stopped on another path, or cannot resume.
    """
    stopped_after(device, knots_nm, complete)
    accepted = int(device.read_stable("stream.accepted"))
    device.write("stream.command", _RESUME)
    return accepted


def start_nm(knots_nm: NDArray[np.int32]) -> tuple[int, int]:
    """The position that a stream of `knots_nm` (N, 2) starts from."""
    return (int(knots_nm[0, 0]), int(knots_nm[0, 1]))


class KnotSender:
    """Keeps the drive's queue filled with `knots` and their outputs, of a new stream or of one that is resumed.

    `accepted`: knots that the drive is known to have accepted, of `total`, which is 0 as long as it is not known;
    `retransmitted`: knot frames sent again; `holds`: the knots so far at which the path is held.
    """

    def __init__(self, device: Device, knots: Knots, resume: bool = False) -> None:
        self.device = device
        self.total = len(knots.knots_nm) if knots.complete else 0
        self.accepted = resume_stream(device, knots.knots_nm, self.total > 0) if resume else 0
        self.retransmitted = 0
        self._knots = knots
        self.holds: list[int] = []
        self._frames = bytearray()
        self._changes, self._output_frames = array("q"), bytearray()  # knots with a frame of outputs, and these
        self._pack()
        self._first = self.accepted
        self._sent = self._ever_sent = self.accepted  # the next knot to send, and the greatest one that was sent
        self._sent_s = [0.0] * _NUMBERS  # of the knots on their way, by number
        self._sent_once = self.accepted  # from this knot on, each was sent once only
        self._end_checked = False
        self._cob_id = wire.RPDO2 + device.link.node_id
        self._outputs_cob_id = wire.RPDO5 + device.link.node_id
        if not resume:
            begin_stream(device, knots.knots_nm, self.total > 0)
        elif not device.read_stable("stream.total"):
            device.write("stream.total", self.total)
        self._size = int(device.read_stable("ip_buffer_x.size"))
        self._room = int(device.read_stable("stream.free"))
        self._credit = self.accepted + min(self._room, WINDOW)
        self._flight_s = min(FLIGHT_MAX_S, FLIGHT_MIN_S + 2.0 * device.link.round_trip_s)
        self._queued_s = 0.0
        self._passed = 0
        self._seen = device.link.status_count
        self._heard_s = self._accepted_s = device.link.time_s

    @property
    def share(self) -> float:
        """The share of the path that path time has passed, by the latest TPDO1."""
        return self._knots.done(self._passed)

    def fill(self) -> None:
        """Send until the queue has what a path starts with. Raises StreamError when the drive accepts no knot."""
        goal = min(self.accepted + min(self._room, _START_KNOTS), len(self._frames) // 8)
        while self.accepted < goal:
            self.advance()
            if self.device.link.time_s - self._accepted_s > _SILENCE_S:
                raise StreamError(
                    f"the drive has accepted no knot for {_SILENCE_S:g} s: does the bus lose all frames to it?"
                )

    def advance(self) -> None:
        """Send what there is credit for, at most one burst, then wait a little for the drive's answer.

        Raises EmcyError when the drive reports a fault, StreamError when it has fallen silent.
        """
        link, device = self.device.link, self.device
        if not self.total:
            self._take()
        limit = min(self._credit, len(self._frames) // 8)
        for i in range(self._sent, min(self._sent + _BURST, limit)):
            at = bisect_left(self._changes, i)
            if at < len(self._changes) and self._changes[at] == i:
                link.send(self._outputs_cob_id, bytes(self._output_frames[6 * at : 6 * at + 6]))
            link.send(self._cob_id, bytes(self._frames[8 * i : 8 * i + 8]))  # which may wait
            self._sent_s[i % _NUMBERS] = link.time_s
            self._sent = i + 1
        self._ever_sent = max(self._ever_sent, self._sent)
        link.poll(1e-3 if self._sent < limit else FLIGHT_MAX_S)
        link.handle_pending()  # by an old status, knots would seem lost that have arrived meanwhile
        device.faults.check()
        if link.status_count != self._seen:
            self._seen = link.status_count
            before_s, self._heard_s = self._heard_s, link.time_s
            self._handle_status(before_s)
        elif link.time_s - self._heard_s > _SILENCE_S:
            raise StreamError(f"the drive has sent no status for {_SILENCE_S:g} s: is the bus still there?")

    def _take(self) -> None:
        """Take in the knots that have come; the drive is told their total when it is known."""
        complete = self._knots.complete
        self._pack()
        if complete:
            self.total = len(self._frames) // 8
            self.device.write("stream.total", self.total)

    def _pack(self) -> None:
        knots_nm, packed = self._knots.knots_nm, len(self._frames) // 8
        if packed and len(knots_nm) == packed:
            return
        before = start_nm(knots_nm[packed - 1 :] if packed else knots_nm)
        frames = wire.pack_knots(knots_nm[packed:], before, packed)
        if packed:
            self._frames += frames
        else:
            self._frames = frames  # an hour of them is not copied
        if self._knots.switches:
            outputs = self._knots.outputs_from(packed)
            switched.chained(self._frames, outputs)
            self._changes.frombytes(outputs.knot.astype(np.int64).tobytes())
            self._output_frames += outputs.frames().tobytes()
            self.holds += outputs.holds

    def _handle_status(self, before_s: float) -> None:
        """Acknowledge knots by the latest TPDO1, and go back if one was lost. The one before came at `before_s`."""
        status = self.device.link.status
        assert status is not None
        newly = (status.accepted - self.accepted + 0x8000 & 0xFFFF) - 0x8000
        if not max(-WINDOW, self._first - self.accepted) <= newly <= self._ever_sent - self.accepted:
            self.device.link.count_dropped("status")  # corrupted, or not of this stream
            return
        self.accepted += newly  # negative if the count before was corrupted
        if newly > 0:
            self._accepted_s = self._heard_s
            if self.accepted > self._sent_once:  # the last of them was still on its way at `before_s`
                queued_s = before_s - self._sent_s[(self.accepted - 1) % _NUMBERS]
                self._queued_s = min(max(queued_s, 0.0), _QUEUED_MAX_S)
        self._passed = max(self._passed, self.accepted - (self._size - status.free))
        self._sent = max(self._sent, self.accepted)
        self._credit = self.accepted + min(status.free, WINDOW)
        if newly <= 0 and self.accepted < self._sent:
            # What is sent again waits before a slow line, too. Four times that wait, so that it does not count as lost.
            way_s = self._flight_s + 4.0 * self._queued_s
            if self._heard_s - self._sent_s[self.accepted % _NUMBERS] > way_s:
                self.retransmitted += self._sent - self.accepted
                self._sent_once = max(self._sent_once, self._sent)
                self._sent = self.accepted
        if self.total and self.accepted == self.total and not self._end_checked:
            self._check_last_knot()

    def _check_last_knot(self) -> None:
        self.accepted = int(self.device.read_stable("stream.accepted"))
        if self.accepted != self.total:
            return
        self._end_checked = True
        got = (self.device.read_stable("stream.end_x"), self.device.read_stable("stream.end_y"))
        want = start_nm(self._knots.knots_nm[-1:])
        if got != want:
            self.device.axes.stop_path()
            raise StreamError(f"the drive's last knot is {got} nm instead of {want} nm: the stream was corrupted")
