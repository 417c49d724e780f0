# SPDX-License-Identifier: Apache-2.0
"""Streaming a trajectory to an enabled drive: go-back-N with credit, so that a bus that loses frames loses no knot.

docs/protocol.md has the rules. The drive reports in TPDO1 how many knots it took and how many more it has room for; a
knot that was sent and is not taken within FLIGHT_S was lost, and everything from it on is sent again.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kontur import wire
from kontur.device import BIT_PATH_RUNS, BIT_TARGET_REACHED, ENABLE, RUN_PATH, Device
from kontur.errors import StreamError

FLIGHT_S = 0.02
"""Time in which a knot frame is taken and its TPDO1 is back, if neither was lost."""

WINDOW = 255
"""Knots on their way at most: their numbers count to 256, and no two may look alike."""

_BURST = 16
_SILENCE_S = 1.0
_STOP_TIMEOUT_S = 5.0
_BEGIN, _ABORT = 1, 2
_STATE_DONE = 4


@dataclass(frozen=True)
class StreamResult:
    """`completed`: the drive went the whole way; else it was asked to stop, and did so on the path.

    `start_s`, `stop_s`: time of the target when the motion was started, and when it was asked to stop.
    `accepted`: knots taken by the drive; `executed`: knots passed; `retransmitted`: knot frames sent again;
    `rejected`: knot frames that the drive did not take, by reason.
    """

    completed: bool
    start_s: float
    stop_s: float | None
    accepted: int
    executed: int
    retransmitted: int
    rejected: dict[str, int]


def stream(
    device: Device,
    knots_nm: NDArray[np.int32],
    *,
    before_start: Callable[[], None] = lambda: None,
    progress: Callable[[float], None] = lambda share: None,
    stop_requested: Callable[[], bool] = lambda: False,
) -> StreamResult:
    """Send `knots_nm` (N, 2) and let the drive follow them; returns when it stands still again.

    The drive must be enabled and stand at the first knot. `before_start` is called when the queue is full and motion is
    about to start; `progress` with the share of knots taken by the drive, 0..1; when `stop_requested` returns True the
    drive stops on the path. Raises StreamError, EmcyError, NoAnswerError.
    """
    sender = _Sender(device, knots_nm)
    sender.fill()
    before_start()
    start_s = device.link.time_s
    device.controlwords(RUN_PATH, RUN_PATH)
    device.wait(
        lambda: device.both_axes(BIT_PATH_RUNS) or device.both_axes(BIT_TARGET_REACHED), 0.5, "does not start the path"
    )
    stop_s = None
    while device.both_axes(BIT_PATH_RUNS):
        if stop_requested():
            stop_s = device.link.time_s
            device.controlwords(ENABLE, ENABLE)
            device.wait(lambda: device.both_axes(BIT_PATH_RUNS, False), _STOP_TIMEOUT_S, "does not stop on the path")
            break
        sender.advance()
        progress(sender.accepted / len(knots_nm))
    device.controlwords(ENABLE, ENABLE)
    result = StreamResult(
        completed=stop_s is None,
        start_s=start_s,
        stop_s=stop_s,
        accepted=sender.accepted,
        executed=int(device.read("stream.executed")),
        retransmitted=sender.retransmitted,
        rejected={reason: int(device.read(f"stream.rejected_{reason}")) for reason in ("sequence", "crc", "full")},
    )
    if result.completed:
        _check_end(device, knots_nm)
    else:
        device.write("stream.command", _ABORT)
    return result


def begin(device: Device, knots_nm: NDArray[np.int32]) -> None:
    """Open the drive's queue for `knots_nm` (N, 2). Raises DeviceError when the drive does not stand at the first."""
    x, y = _start_nm(knots_nm)
    device.write("stream.total", len(knots_nm))
    device.write("stream.start_x", x)
    device.write("stream.start_y", y)
    device.write("stream.command", _BEGIN)


class _Sender:
    """Keeps the drive's queue filled. `accepted`: knots known to be taken; `_sent`: the next knot to send."""

    def __init__(self, device: Device, knots_nm: NDArray[np.int32]) -> None:
        self.device = device
        self.accepted = 0
        self.retransmitted = 0
        self._knots_nm = knots_nm
        self._frames = wire.pack_knots(knots_nm, _start_nm(knots_nm))
        self._sent = self._ever_sent = 0
        self._sent_s = np.zeros(len(knots_nm))
        self._end_checked = False
        self._cob_id = wire.RPDO2 + device.link.node_id
        begin(device, knots_nm)
        self._room = int(device.read("stream.free"))
        self._credit = min(self._room, WINDOW)
        self._seen = device.link.status_count
        self._heard_s = self._taken_s = device.link.time_s

    def fill(self) -> None:
        """Send until the queue is full or everything is there."""
        goal = min(self._room, len(self._frames))
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
        end = min(self._sent + _BURST, self._credit, len(self._frames))
        for i in range(self._sent, end):
            link.send(self._cob_id, self._frames[i])
        self._sent_s[self._sent : end] = now_s
        self._sent = max(self._sent, end)
        self._ever_sent = max(self._ever_sent, end)
        more = self._sent < min(self._credit, len(self._frames))
        link.pump(1e-3 if more else FLIGHT_S)
        device.check()
        if link.status_count != self._seen:
            self._seen = link.status_count
            self._heard_s = link.time_s
            self._take_status()
        elif link.time_s - self._heard_s > _SILENCE_S:
            raise StreamError(f"the drive has sent no status for {_SILENCE_S:g} s: is the bus still there?")

    def _take_status(self) -> None:
        status = self.device.link.status
        assert status is not None
        newly = (status.accepted - self.accepted) & 0xFFFF
        if newly > self._ever_sent - self.accepted:
            return  # not of this stream
        self.accepted += newly
        if newly:
            self._taken_s = self._heard_s
        self._sent = max(self._sent, self.accepted)
        self._credit = self.accepted + min(status.free, WINDOW)
        if self.accepted < self._sent and self.device.link.time_s - self._sent_s[self.accepted] > FLIGHT_S:
            self.retransmitted += self._sent - self.accepted
            self._sent = self.accepted
        if self.accepted == len(self._frames) and not self._end_checked:
            self._check_last_knot()
            self._end_checked = True

    def _check_last_knot(self) -> None:
        got = (self.device.read("stream.end_x"), self.device.read("stream.end_y"))
        want = (int(self._knots_nm[-1, 0]), int(self._knots_nm[-1, 1]))
        if got != want:
            self.device.controlwords(ENABLE, ENABLE)
            raise StreamError(f"the drive's last knot is {got} nm instead of {want} nm: the stream was corrupted")


def _check_end(device: Device, knots_nm: NDArray[np.int32]) -> None:
    device.check()
    if device.read("stream.state") != _STATE_DONE:
        underruns = device.read("stream.underruns")
        why = "it ran out of knots (the host or the bus was too slow)" if underruns else "it was halted"
        raise StreamError(
            f"the drive stopped on the path before its end: {why}; {device.read('stream.executed')} knots done"
        )
    want = zlib.crc32(np.ascontiguousarray(knots_nm, dtype="<i4").tobytes())
    if (got := device.read("stream.checksum")) != want:
        raise StreamError(f"the drive went through other knots than were sent (checksum {got:08X}h, not {want:08X}h)")


def _start_nm(knots_nm: NDArray[np.int32]) -> tuple[int, int]:
    return (int(knots_nm[0, 0]), int(knots_nm[0, 1]))
