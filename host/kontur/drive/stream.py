# SPDX-License-Identifier: Apache-2.0
"""Streaming a trajectory to an enabled drive: go-back-N with credit, so that a bus that loses frames loses no knot.

docs/protocol.md has the rules. The drive reports in TPDO1 how many knots it took and how many more it has room for; a
knot that was sent and is not taken within the time of flight was lost, and everything from it on is sent again.

TPDO1 has no checksum beyond that of CAN, so nothing hangs on a single one: its count may be wrong in both directions
and the next one puts it right, and what it says of the state is asked for by SDO before anything is done about it.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kontur.can import wire
from kontur.drive.device import BIT_PATH_RUNS, BIT_TARGET_REACHED, ENABLE, RESEND_S, RUN_PATH, Device
from kontur.errors import DeviceError, EmcyError, StreamError

FLIGHT_MAX_S, FLIGHT_MIN_S = 0.02, 0.002
"""Time in which a knot frame is taken and its TPDO1 is back, if neither was lost: within these, by SDO round trips.
A line slower than the host makes it longer, by what was seen to wait before it."""

WINDOW = 63
"""Knots on their way at most. Numbers count to 256, and no two on their way may look alike: a corrupted count in TPDO1
can seem to free as many as are on their way, so that it would take four such counts running for that."""

_NUMBERS = 256
_BURST = 16
_QUEUED_MAX_S = 0.5  # half of what the drive's queue holds
_SILENCE_S = 2.0  # longer than a bus is off before it recovers: then the drive tells what it did meanwhile
_START_TIMEOUT_S, _STOP_TIMEOUT_S = 0.5, 5.0
_BEGIN, _ABORT, _RESUME = 1, 2, 3
_STATE_IDLE, _STATE_FILLING, _STATE_RUNNING, _STATE_STOPPING, _STATE_DONE, _STATE_STOPPED = range(6)
_BEGIN_ATTEMPTS = 5


@dataclass(frozen=True)
class StreamResult:
    """`completed`: the drive went the whole way; else it was asked to stop, and did so on the path, or a
    `fault` ended it.

    `start_s`, `stop_s`: time of the target when the motion was started, and when it was asked to stop, or reported the
    fault.
    `accepted`: knots taken by the drive; `executed`: knots passed; `retransmitted`: knot frames sent again;
    `rejected`: knot frames that the drive did not take, by reason. `rates`: from which time on which rate was asked for
    (feed override), the first one from the start. `passed`: knots that were passed before, of a path that goes on.
    """

    completed: bool
    start_s: float
    stop_s: float | None
    accepted: int
    executed: int
    retransmitted: int
    rejected: dict[str, int]
    rates: tuple[tuple[float, float], ...] = ()
    fault: EmcyError | None = None
    passed: int = 0


def stream(
    device: Device,
    knots_nm: NDArray[np.int32],
    *,
    before_start: Callable[[], None] = lambda: None,
    progress: Callable[[float], None] = lambda share: None,
    stop_requested: Callable[[], bool] = lambda: False,
    rate: Callable[[], float] = lambda: 1.0,
    resume: bool = False,
    raise_fault: bool = True,
) -> StreamResult:
    """Send `knots_nm` (N, 2) and let the drive follow them; returns when it stands still again.

    The drive must be enabled and stand at the first knot. `before_start` is called when the queue is full and motion is
    about to start; `progress` with the share of knots taken by the drive, 0..1; when `stop_requested` returns True the
    drive stops on the path. `rate` tells the feed override, 0 to 1.2, 0 to hold, and may change at any time.

    `resume`: go on with these knots, all of them as they were, where the drive stopped on the path before it was
    switched off, by a fault or by its master, as at `stop_requested`; the axes must not have been moved since.

    Raises StreamError, NoAnswerError, and EmcyError when the drive reports a fault; one during the motion is returned
    instead where `raise_fault` is False.
    """
    sender = _Sender(device, knots_nm, resume)
    passed = int(device.confirmed("stream.executed")) if resume else 0
    sender.fill()
    while (now := rate()) == 0.0 and not stop_requested():
        sender.advance()
    now = now or 1.0
    device.override_feed(now)
    before_start()
    start_s = _start(device)
    rates = [(start_s, now)]
    stop_s = None
    fault = None
    try:
        while now == 0.0 or device.both_axes(BIT_PATH_RUNS) or _runs(device):
            if (wanted := rate()) != now:
                rates.append((device.link.time_s, wanted))
                device.override_feed(wanted)
                if now == 0.0:
                    device.link.wait(lambda: _started(device), _START_TIMEOUT_S)
                now = wanted
            if stop_requested():
                stop_s = device.link.time_s
                if not device.insist(ENABLE, lambda: _stands(device), _STOP_TIMEOUT_S):
                    raise StreamError(f"the drive does not stop on the path, {_STOP_TIMEOUT_S:g} s waited")
                break
            sender.advance()
            progress(sender.accepted / len(knots_nm))
    except EmcyError as error:
        if raise_fault:
            raise
        fault = error
        stop_s = device.link.time_s if stop_s is None else stop_s
        device.link.wait(lambda: device.both_axes(BIT_PATH_RUNS, False), _STOP_TIMEOUT_S)
    device.release_path()
    result = StreamResult(
        completed=stop_s is None,
        start_s=start_s,
        stop_s=stop_s,
        accepted=int(device.confirmed("stream.accepted")),
        executed=int(device.confirmed("stream.executed")),
        retransmitted=sender.retransmitted,
        rejected={reason: int(device.confirmed(f"stream.rejected_{reason}")) for reason in ("sequence", "crc", "full")},
        rates=tuple(rates),
        fault=fault,
        passed=passed,
    )
    if result.completed:
        _check_end(device, knots_nm)
    return result


def begin(device: Device, knots_nm: NDArray[np.int32]) -> None:
    """Open the drive's queue for `knots_nm` (N, 2), and see that it is open for these.

    Raises DeviceError when the drive does not stand at the first.
    """
    x, y = _start_nm(knots_nm)
    if device.confirmed("stream.state") not in (_STATE_IDLE, _STATE_DONE):
        device.write("stream.command", _ABORT)  # one that was stopped, or is of another master
    for _ in range(_BEGIN_ATTEMPTS):
        device.write("stream.total", len(knots_nm))
        device.write("stream.start_x", x)
        device.write("stream.start_y", y)
        try:
            device.write("stream.command", _BEGIN)
        except DeviceError:
            device.check()  # a fault is why, and says more
            raise
        state, accepted, *end = (device.confirmed(f"stream.{name}") for name in ("state", "accepted", "end_x", "end_y"))
        if state == _STATE_FILLING and accepted == 0 and end == [x, y]:
            return
    raise StreamError("the drive does not open its queue for the path; does the bus corrupt frames?")


def resume_stream(device: Device, knots_nm: NDArray[np.int32]) -> int:
    """Open the drive's queue again for what is left of `knots_nm` (N, 2); returns how many knots it has.

    Raises StreamError: the path that the drive has left is another one, or it cannot go on.
    """
    if device.confirmed("stream.state") != _STATE_STOPPED:
        raise StreamError(
            "the drive cannot go on with the path: it did not stop on it, or the axes were moved since; plan anew from "
            "where they stand"
        )
    accepted, executed = (int(device.confirmed(f"stream.{name}")) for name in ("accepted", "executed"))
    total, checksum = (int(device.confirmed(f"stream.{name}")) for name in ("total", "checksum"))
    known = zlib.crc32(np.ascontiguousarray(knots_nm[:executed], dtype="<i4").tobytes())
    if total != len(knots_nm) or accepted > total or checksum != known:
        raise StreamError(f"the drive has left another path than this one, at knot {executed} of {total}")
    device.write("stream.command", _RESUME)
    return accepted


def _start(device: Device) -> float:
    """Let path time run; returns when it was told to."""
    begin_s = start_s = device.link.time_s
    while start_s - begin_s < _START_TIMEOUT_S:
        if device.insist(RUN_PATH, lambda: _started(device), RESEND_S):
            return start_s
        start_s = device.link.time_s
    raise StreamError(f"the drive does not start the path, {_START_TIMEOUT_S:g} s waited")


def _started(device: Device) -> bool:
    device.check()
    return device.both_axes(BIT_PATH_RUNS) or device.both_axes(BIT_TARGET_REACHED)


def _runs(device: Device) -> bool:
    """Whether the path runs by the drive's own word, after its statuswords said that it does not."""
    device.check()
    return device.confirmed("stream.state") in (_STATE_RUNNING, _STATE_STOPPING)


def _stands(device: Device) -> bool:
    device.check()
    return device.both_axes(BIT_PATH_RUNS, False)


class _Sender:
    """Keeps the drive's queue filled. `accepted`: knots known to be taken; `_sent`: the next knot to send."""

    def __init__(self, device: Device, knots_nm: NDArray[np.int32], resume: bool = False) -> None:
        self.device = device
        self.accepted = resume_stream(device, knots_nm) if resume else 0
        self.retransmitted = 0
        self._knots_nm = knots_nm
        self._frames = wire.pack_knots(knots_nm, _start_nm(knots_nm))
        self._total = len(knots_nm)
        self._sent = self._ever_sent = self.accepted
        self._sent_s = [0.0] * _NUMBERS  # of the knots on their way, by number
        self._sent_once = self.accepted  # from this knot on
        self._end_checked = False
        self._cob_id = wire.RPDO2 + device.link.node_id
        if not resume:
            begin(device, knots_nm)
        self._room = int(device.confirmed("stream.free"))
        self._credit = self.accepted + min(self._room, WINDOW)
        self._flight_s = min(FLIGHT_MAX_S, FLIGHT_MIN_S + 2.0 * device.link.round_trip_s)
        self._queued_s = 0.0
        self._seen = device.link.status_count
        self._heard_s = self._taken_s = device.link.time_s

    def fill(self) -> None:
        """Send until the queue is full or everything is there."""
        goal = min(self.accepted + self._room, self._total)
        while self.accepted < goal:
            self.advance()
            if self.device.link.time_s - self._taken_s > _SILENCE_S:
                raise StreamError(
                    f"the drive has taken no knot for {_SILENCE_S:g} s: does the bus lose all frames to it?"
                )

    def advance(self) -> None:
        """Send what there is credit for, at most one burst, then wait a little for the drive."""
        link, device = self.device.link, self.device
        now_s = link.time_s
        limit = min(self._credit, self._total)
        for i in range(self._sent, min(self._sent + _BURST, limit)):
            link.send(self._cob_id, self._frames[8 * i : 8 * i + 8])
            self._sent_s[i % _NUMBERS] = now_s
            self._sent = i + 1
        self._ever_sent = max(self._ever_sent, self._sent)
        link.pump(1e-3 if self._sent < limit else FLIGHT_MAX_S)
        link.catch_up()  # an old status would tell of knots that are not there yet, and they would be sent again
        device.check()
        if link.status_count != self._seen:
            self._seen = link.status_count
            before_s, self._heard_s = self._heard_s, link.time_s
            self._take_status(before_s)
        elif link.time_s - self._heard_s > _SILENCE_S:
            raise StreamError(f"the drive has sent no status for {_SILENCE_S:g} s: is the bus still there?")

    def _take_status(self, before_s: float) -> None:
        """Of the latest status; the one before it came at `before_s`."""
        status = self.device.link.status
        assert status is not None
        newly = (status.accepted - self.accepted + 0x8000 & 0xFFFF) - 0x8000
        if not -WINDOW <= newly <= self._ever_sent - self.accepted:
            return  # corrupted, or not of this stream
        self.accepted += newly  # or less, if the one before was corrupted
        if newly > 0:
            self._taken_s = self._heard_s
            if self.accepted > self._sent_once:  # the last one taken was on its way for longer than until `before_s`
                queued_s = before_s - self._sent_s[(self.accepted - 1) % _NUMBERS]
                self._queued_s = min(max(queued_s, 0.0), _QUEUED_MAX_S)
        self._sent = max(self._sent, self.accepted)
        self._credit = self.accepted + min(status.free, WINDOW)
        if newly <= 0 and self.accepted < self._sent:
            # What is sent twice goes through a slow line, too: four times, so that it is not taken for lost in turn.
            way_s = self._flight_s + 4.0 * self._queued_s
            if self._heard_s - self._sent_s[self.accepted % _NUMBERS] > way_s:
                self.retransmitted += self._sent - self.accepted
                self._sent_once = max(self._sent_once, self._sent)
                self._sent = self.accepted
        if self.accepted == self._total and not self._end_checked:
            self._check_last_knot()

    def _check_last_knot(self) -> None:
        self.accepted = int(self.device.confirmed("stream.accepted"))
        if self.accepted != self._total:
            return
        self._end_checked = True
        got = (self.device.confirmed("stream.end_x"), self.device.confirmed("stream.end_y"))
        want = (int(self._knots_nm[-1, 0]), int(self._knots_nm[-1, 1]))
        if got != want:
            self.device.release_path()
            raise StreamError(f"the drive's last knot is {got} nm instead of {want} nm: the stream was corrupted")


def _check_end(device: Device, knots_nm: NDArray[np.int32]) -> None:
    """Every knot was executed once and in order, or StreamError says what happened instead."""
    device.check()
    executed = device.confirmed("stream.executed")
    if device.confirmed("stream.state") != _STATE_DONE:
        underruns = device.confirmed("stream.underruns")
        why = "it ran out of knots (the host or the bus was too slow)" if underruns else "it was halted"
        raise StreamError(f"the drive stopped on the path before its end: {why}; {executed} knots done")
    want = zlib.crc32(np.ascontiguousarray(knots_nm, dtype="<i4").tobytes())
    got = device.confirmed("stream.checksum")
    if got != want or executed != len(knots_nm):
        raise StreamError(
            f"the drive went through other knots than were sent: {executed} of {len(knots_nm)}, "
            f"checksum {got:08X}h, not {want:08X}h"
        )


def _start_nm(knots_nm: NDArray[np.int32]) -> tuple[int, int]:
    return (int(knots_nm[0, 0]), int(knots_nm[0, 1]))
