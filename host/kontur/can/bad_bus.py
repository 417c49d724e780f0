# SPDX-License-Identifier: Apache-2.0
"""A bad bus: a python-can bus around any other one that loses, repeats, delays, swaps and corrupts its frames.

It serves to test how a host and a drive cope with transmission errors. Faults of a drive: see kontur.can.emcy.

    can.Bus(interface="kontur-bad-bus", inner="socketcan", channel="can0", drop=0.02, flip=0.005, seed=1)

Options that are not named in BusFaults go to the inner bus. Each direction has a random stream of its own, so what
happens to a frame depends on the seed and on the frames before it in its direction alone.
"""

from __future__ import annotations

import copy
import dataclasses
import errno
import math
import random
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

import can

from kontur.can.bus import open_bus

_ID_BITS, _DLC_BITS = 11, 4
_SWAP_WAIT_S = 0.01  # a swapped frame waits no longer than that for the next one
_FOREVER_S = 3600.0


@dataclasses.dataclass(frozen=True)
class BusFaults:
    """What happens to each frame, as probabilities 0..1.

    `drop`: it is lost. `duplicate`: it arrives twice. `delay`: it arrives up to `delay_s` later; others may overtake
    it. `reorder`: it changes places with the next one. `flip`: 1 to `flip_bits` bits of its identifier, length or data
    are inverted, as if CAN's CRC had not detected that. `burst`: it is lost, and so are the next ones, `burst_frames`
    in all. `bus_off`: from it on, no frame passes in either direction for `bus_off_s`. Times are of the target's clock.

    `txqueuelen`: what the host sends waits in a queue for so many frames, as that of a SocketCAN interface, from which
    `frames_per_s` leave; send() raises ENOBUFS while it is full. 0: frames leave at once.
    """

    drop: float = 0.0
    duplicate: float = 0.0
    delay: float = 0.0
    reorder: float = 0.0
    flip: float = 0.0
    burst: float = 0.0
    bus_off: float = 0.0
    delay_s: float = 0.005
    flip_bits: int = 3
    burst_frames: int = 20
    bus_off_s: float = 1.0
    txqueuelen: int = 0
    frames_per_s: float = 8000.0
    seed: int = 1

    def __post_init__(self) -> None:
        for name in ("drop", "duplicate", "delay", "reorder", "flip", "burst", "bus_off"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name}={getattr(self, name):g} is no probability; it must be 0..1")
        for name, least, greatest in (("delay_s", 0.0, 60.0), ("bus_off_s", 0.0, 60.0)):
            if not least <= getattr(self, name) <= greatest:
                raise ValueError(f"{name}={getattr(self, name):g} is out of range; it must be {least:g}..{greatest:g}")
        if not 0 <= self.txqueuelen <= 1_000_000 or not 1e-3 <= self.frames_per_s <= 1e6:
            raise ValueError("txqueuelen must be 0..1000000 frames, frames_per_s 0.001..1000000")
        if not 1 <= self.flip_bits <= 64 or not 1 <= self.burst_frames <= 1_000_000:
            raise ValueError("flip_bits must be 1..64, burst_frames 1..1000000")


BUS_FAULT_NAMES = tuple(field.name for field in dataclasses.fields(BusFaults))


@dataclasses.dataclass
class Counts:
    """Counts of one direction; `lost` are frames that were dropped one by one, not in bursts, and `refused` those that
    found the transmit queue full."""

    frames: int = 0
    lost: int = 0
    duplicated: int = 0
    delayed: int = 0
    reordered: int = 0
    flipped: int = 0
    lost_in_bursts: int = 0
    lost_bus_off: int = 0
    refused: int = 0


class _Direction:
    """One direction: takes frames in, and delivers them now, later or never."""

    def __init__(self, faults: BusFaults, stream: str, clock: Callable[[], float]) -> None:
        self.counts = Counts()
        self._faults = faults
        self._random = random.Random(f"{faults.seed} {stream}")
        self._clock = clock
        self._late: list[tuple[float, can.Message]] = []
        self._swapped: tuple[float, can.Message] | None = None
        self._burst_left = 0

    def put(self, message: can.Message, is_off: bool) -> tuple[list[can.Message], bool]:
        """The frames that are delivered now, in order, and whether the bus goes off with this one."""
        f, draw, counts = self._faults, self._random.random, self.counts
        counts.frames += 1
        # The number of draws is always the same, so that one more kind of fault does not change the others.
        drop, duplicate, delay, reorder, flip, burst, off = (draw() for _ in range(7))
        if is_off or off < f.bus_off:
            counts.lost_bus_off += 1
            return [], not is_off
        if self._burst_left == 0 and burst < f.burst:
            self._burst_left = f.burst_frames
        if self._burst_left:
            self._burst_left -= 1
            counts.lost_in_bursts += 1
            return [], False
        if drop < f.drop:
            counts.lost += 1
            return [], False
        if flip < f.flip:
            counts.flipped += 1
            message = self._flipped(message)
        out = [message]
        if duplicate < f.duplicate:
            counts.duplicated += 1
            out.append(message)
        if delay < f.delay:
            counts.delayed += 1
            due_s = self._clock() + f.delay_s * draw()
            self._late += [(due_s, copy.copy(m)) for m in out]
            return self._released(), False
        if self._swapped is None and reorder < f.reorder:
            counts.reordered += 1
            self._swapped = (self._clock() + _SWAP_WAIT_S, copy.copy(message))
            return out[1:], False
        return out + self._released(), False

    def due(self) -> list[can.Message]:
        """The delayed frames that are due."""
        now_s = self._clock()
        out = [message for due_s, message in self._late if due_s <= now_s]
        if out:
            self._late = [(due_s, message) for due_s, message in self._late if due_s > now_s]
        if self._swapped is not None and self._swapped[0] <= now_s:
            out += self._released()
        return out

    def next_s(self) -> float:
        """When the next delayed frame is due; infinity when there is none."""
        times = [due_s for due_s, _ in self._late] + ([self._swapped[0]] if self._swapped else [])
        return min(times, default=float("inf"))

    @property
    def has_delayed(self) -> bool:
        """Whether any frame is delayed or waits to be swapped."""
        return bool(self._late) or self._swapped is not None

    def _released(self) -> list[can.Message]:
        """The frame that has waited for the next one."""
        swapped, self._swapped = self._swapped, None
        return [swapped[1]] if swapped else []

    def _flipped(self, message: can.Message) -> can.Message:
        can_id, length, data = message.arbitration_id, message.dlc, bytearray(message.data)
        bits = _ID_BITS + _DLC_BITS + 8 * len(data)
        for bit in self._random.sample(range(bits), self._random.randint(1, min(self._faults.flip_bits, bits))):
            if bit < _ID_BITS:
                can_id ^= 1 << bit
            elif bit < _ID_BITS + _DLC_BITS:
                length ^= 1 << (bit - _ID_BITS)
            else:
                at = bit - _ID_BITS - _DLC_BITS
                data[at // 8] ^= 1 << at % 8
        length = min(length, 8)  # a length above 8 means 8
        return can.Message(
            timestamp=message.timestamp,
            arbitration_id=can_id,
            is_extended_id=message.is_extended_id,
            is_remote_frame=message.is_remote_frame,
            dlc=length,
            data=None if message.is_remote_frame else data[:length].ljust(length, b"\x00"),
            channel=message.channel,
        )


class _TransmitQueue:
    """Holds `length` frames, which leave one after the other, `frames_per_s`; the one that is leaving still counts."""

    def __init__(self, length: int, frames_per_s: float, clock: Callable[[], float]) -> None:
        self.clock = clock
        self._length, self._frame_s = length, 1.0 / frames_per_s
        self._waiting: deque[tuple[float, can.Message]] = deque()  # and when they have left

    def put(self, message: can.Message) -> bool:
        """Whether there is room for the frame."""
        if len(self._waiting) >= self._length:
            return False
        begin_s = max(self.clock(), self._waiting[-1][0] if self._waiting else self.clock())
        self._waiting.append((begin_s + self._frame_s, copy.copy(message)))
        return True

    def due(self) -> Iterator[can.Message]:
        """The frames that have left by now."""
        while self._waiting and self._waiting[0][0] <= self.clock():
            yield self._waiting.popleft()[1]

    def until_due_s(self) -> float:
        """Time until the next one has left; infinity when none waits."""
        return self._waiting[0][0] - self.clock() if self._waiting else math.inf


class BadBus(can.BusABC):
    """A bad bus around `inner`, which is a python-can interface, or a bus; that is shut down with this one.

    Faults are given one by one, by their names, or together as `faults`. Their seed has the same name as an option of
    the simulated drive's bus; give `faults` where both are needed.

    `to_drive` and `to_host` count what happened to the frames sent and received. Raises can.CanInitializationError, or
    what open_bus() raises for the inner bus. Error frames pass unchanged.
    """

    def __init__(
        self,
        channel: Any = None,
        can_filters: Any = None,
        *,
        inner: str | can.BusABC = "kontur",
        faults: BusFaults | None = None,
        **options: Any,
    ) -> None:
        if faults is None:
            given = {name: options.pop(name) for name in BUS_FAULT_NAMES if name in options}
            try:
                faults = BusFaults(**given)
            except (TypeError, ValueError) as error:
                raise can.CanInitializationError(f"kontur-bad-bus: {error}") from error
        named = {"interface": inner, **({} if channel is None else {"channel": channel}), **options}
        self.inner = inner if isinstance(inner, can.BusABC) else open_bus(named)
        self.channel_info = f"{self.inner.channel_info}, with faults"
        self._wait_clock = _clock_of(self.inner)
        self.clock = self._wait_clock
        """Clock of delays and of bus-off."""
        self._queue = _TransmitQueue(faults.txqueuelen, faults.frames_per_s, self._wait_clock)
        self._has_queue = faults.txqueuelen > 0
        self._to_drive = _Direction(faults, "to the drive", lambda: self.clock())
        self._to_host = _Direction(faults, "to the host", lambda: self.clock())
        self.to_drive, self.to_host = self._to_drive.counts, self._to_host.counts
        self._bus_off_s = faults.bus_off_s
        self._off_until_s = float("-inf")
        self._arrived: deque[can.Message] = deque()
        self._lock = threading.RLock()  # of the frames to the drive: recv() may release one while another thread sends
        super().__init__(channel=channel, can_filters=can_filters)

    @property
    def time_s(self) -> float:
        """Time of the target."""
        return self.clock()

    def follow(self, clock: Callable[[], float]) -> None:
        """Use the clock of a link to a drive whose time passes with SYNC. The queue empties by the wall clock then,
        since SYNC itself may wait in it."""
        self.clock = clock
        self._queue.clock = time.monotonic

    def go_bus_off(self, duration_s: float | None = None) -> None:
        """Let no frame pass for `duration_s` of the target's time, by default `bus_off_s`."""
        self._off_until_s = self.clock() + (self._bus_off_s if duration_s is None else duration_s)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame through the faults. A lost one raises nothing, as on a real bus.

        Raises can.CanOperationError when the transmit queue is full, like SocketCAN.
        """
        with self._lock:
            if not self._has_queue:
                self._transmit(msg)
                return
            self._release()
            if not self._queue.put(msg):
                self.to_drive.refused += 1
                raise can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The oldest frame that came through; None when none does within `timeout`, in the target's time."""
        end_s = self._wait_clock() + (_FOREVER_S if timeout is None else max(0.0, timeout))
        while True:
            self._release()
            while self._arrived:
                message = self._arrived.popleft()
                if self._matches_filters(message):
                    return message
            left_s = end_s - self._wait_clock()
            until_due_s = min(self._to_drive.next_s(), self._to_host.next_s()) - self.clock()
            until_due_s = min(until_due_s, self._queue.until_due_s())
            received = self.inner.recv(max(0.0, min(left_s, until_due_s)))
            if received is None:
                if self._wait_clock() >= end_s:
                    return None
            elif received.is_error_frame:
                self._arrived.append(received)
            else:
                now, goes_off = self._to_host.put(received, self.clock() < self._off_until_s)
                if goes_off:
                    self.go_bus_off()
                self._arrived += now

    def shutdown(self) -> None:
        """Shut the inner bus down, too."""
        super().shutdown()
        self.inner.shutdown()

    def _transmit(self, message: can.Message) -> None:
        out = self._to_drive.due() if self._to_drive.has_delayed else []
        now, goes_off = self._to_drive.put(message, self.clock() < self._off_until_s)
        if goes_off:
            self.go_bus_off()
        for message in out + now:
            self.inner.send(message)

    def _release(self) -> None:
        """Pass on the frames that have left the queue, and the delayed ones that are due."""
        if self._has_queue:
            with self._lock:
                for message in self._queue.due():
                    self._transmit(message)
        if self._to_drive.has_delayed:
            with self._lock:
                for message in self._to_drive.due():
                    self.inner.send(message)
        if self._to_host.has_delayed:
            self._arrived += self._to_host.due()


def _clock_of(bus: can.BusABC) -> Callable[[], float]:
    """The clock of the timeouts of `bus`: its own `time_s` if it has one, else the wall clock."""
    return (lambda: float(bus.time_s)) if hasattr(bus, "time_s") else time.monotonic
