# SPDX-License-Identifier: Apache-2.0
"""The connection to one drive: python-canopen on a python-can bus, without threads. kontur.drive builds on it.

Every wait receives and handles frames meanwhile. So the same code serves a real drive and a simulated one, whose time
passes only while frames are received. All times are of the target's clock: the drive's own time in the simulator, else
the wall clock.

The time of a simulated drive may pass with SYNC alone (`clock.pace`, `kontur sim --pace sync`). Then a wait goes in
rounds. A round sends SYNC and handles frames until one carries the tick that this SYNC leads to. A frame after that one
belongs to the next round, however fast it arrives, so each run is the same. SDO transfers take no time there. When a
frame was lost, and every 64 rounds, the drive's tick is read by SDO; so no SYNC is repeated because an answer was slow.
"""

from __future__ import annotations

import errno
import functools
import logging
import math
import queue
import re
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import can
import canopen
import numpy as np
from canopen.objectdictionary import ObjectDictionary, import_od
from canopen.sdo import SdoAbortedError, SdoClient, SdoCommunicationError
from canopen.sdo.constants import ABORT_TIMED_OUT, RESPONSE_ABORTED, RESPONSE_DOWNLOAD
from numpy.typing import NDArray

from kontur.can import EDS, wire
from kontur.can.bad_bus import BadBus
from kontur.can.simulated import simulated
from kontur.can.wire import Status, Telemetry
from kontur.errors import BusError, DeviceError, NoAnswerError

HEARTBEAT_S = 0.1
RESEND_S = 0.05
"""Time after which a command that shows no effect is sent again."""
DROPPED = ("foreign", "length", "status", "line")
"""Why what was received is not used. foreign: a drive sends no 29-bit identifiers, CAN FD, or remote frames.
length: it is corrupted. status: a TPDO1 whose count of knots cannot be. line: text in slcan that is no frame."""
_EMCY, _SDO_RESPONSE, _SDO_REQUEST = 0x80, 0x580, 0x600
_BOOT_UP = 0
_DOWNLOAD, _UPLOAD = 1, 2
_REQUESTS_BY_NAME = (_DOWNLOAD, _UPLOAD)  # command specifiers whose answers name their object
_HEARTBEAT_OPERATIONAL = b"\x05"

_TICK, _ERROR_REGISTER = "clock.tick", "error_register"
_ROUND_S = 0.02  # wall clock; after it a frame of the round counts as lost, and the drive's tick is read
_SILENCE_S = 10.0  # wall clock
_UNDATED_MAX = 4  # rounds without telemetry, after which it counts as off, and the tick is read at once
_QUEUE_FULL_S = 2.0  # as long as a stream waits for a silent drive
_QUEUE_POLL_S = 1e-3
_ASK_EACH = 64  # rounds: a SYNC that the bus repeated leaves frames behind, which would accumulate
_TAKE_FRAMES, _TAKE_S = 1024, 0.4  # of telemetry that is handed over at once; about as many come in that time
_AHEAD_MS = 1000  # greatest lead of a drive's tick over its frames
_QUEUE_FULL = re.compile(r"(buffer|queue)\b.*\b(full|overflow)", re.IGNORECASE)
_SOCKETCAN = re.compile(r"socketcan channel '([^']+)'")

# Their warnings are about what is raised as an exception here anyway.
logging.getLogger("canopen").addHandler(logging.NullHandler())
logging.getLogger("can").addHandler(logging.NullHandler())


class Link:
    """One drive with `node_id` on `bus`, which stays the caller's to shut down.

    `status` is the latest TPDO1, None before the first; `status_count`: number of TPDO1 received. `statuswords` are
    those that were the same in two TPDO1 in a row, so that one corrupted frame has no effect. `emergencies` are the
    EMCY objects received since the caller cleared the list, as (code, register, data); `reported`: all codes so far.
    `misdirected` are objects, (index, subindex), that the drive acknowledged in place of the one that was to be set:
    the request was corrupted.
    """

    def __init__(self, bus: can.BusABC, node_id: int, eds: str | Path = EDS) -> None:
        if not 1 <= node_id <= 31:
            raise DeviceError(f"node id {node_id}: a kontur drive has one of 1..31")
        self.bus = bus
        self.node_id = node_id
        self.status: Status | None = None
        self.status_count = 0
        self.statuswords = (0, 0)
        self._statuswords_count = 0  # `status_count` when they came the second time
        self.misdirected: list[tuple[int, int]] = []
        self._round_trips_s: deque[float] = deque(maxlen=16)
        self.emergencies: list[tuple[int, int, bytes]] = []
        self.reported: list[int] = []
        self._sync_ms = 0  # device time that passes at each SYNC; 0: time passes by itself
        self._tick_ms = 0
        self._rounds = 0
        self._dated_round = -_UNDATED_MAX  # the last one in which telemetry with a tick came
        # A bus with a clock of its own, the simulator's, has a `time_s`.
        self._clock: Callable[[], float] = (lambda: bus.time_s) if hasattr(bus, "time_s") else time.monotonic
        self._next_heartbeat_s = math.inf
        self.frames = 0
        """Sent and received so far."""
        self._dropped = dict.fromkeys(DROPPED, 0)
        self._recording: _Recording | None = None
        self._watching: _Recording | None = None
        # Services and PDOs of fixed length; frames of another one are corrupted.
        self._lengths = {_SDO_RESPONSE + node_id: 8, _EMCY + node_id: 8, wire.HEARTBEAT + node_id: 1}
        self._lengths |= {cob + node_id: 8 for cob in (wire.TPDO1, *wire.TELEMETRY)}
        self._tick_ids = (wire.TPDO2 + node_id, wire.TPDO3 + node_id)
        self._telemetry_ids = frozenset(cob + node_id for cob in wire.TELEMETRY)
        self._network = _LinkedNetwork(self, bus)
        self.node = _PolledNode(self, node_id, str(eds))
        self._network.add_node(self.node)
        self._network.subscribe(wire.TPDO1 + node_id, self._on_status)
        self._network.subscribe(wire.HEARTBEAT + node_id, self._on_heartbeat)
        self.node.emcy.add_callback(self._on_emergency)

    @property
    def time_s(self) -> float:
        """Now, by the clock of the target."""
        return self._clock()

    @property
    def round_trip_s(self) -> float:
        """Within this time most of the last SDO requests were answered: all but the slowest quarter.

        So an answer that the bus held up for once does not count.
        """
        in_order = sorted(self._round_trips_s)
        return in_order[(len(in_order) - 1) * 3 // 4] if in_order else 0.0

    @property
    def dropped(self) -> dict[str, int]:
        """What was received so far and not used, by reason (DROPPED)."""
        garbled = getattr(getattr(self.bus, "inner", self.bus), "garbled", 0)
        return self._dropped | {"line": garbled}

    def count_dropped(self, reason: str) -> None:
        """Note that a frame was not used."""
        self._dropped[reason] += 1

    def answered(self, round_trip_s: float) -> None:
        """Note that an SDO request was answered after `round_trip_s`."""
        self._round_trips_s.append(round_trip_s)

    @property
    def by_device_time(self) -> bool:
        """Whether `time_s` is the drive's own time since power-on, which passes only as the host receives."""
        return simulated(self.bus) is not None or self._sync_ms > 0

    @property
    def follows_sync(self) -> bool:
        """Whether the drive's time passes with this host's SYNC alone."""
        return self._sync_ms > 0

    def follow_sync(self, tick_ms: int, period_ms: int) -> None:
        """Let poll() send SYNC from now on: the drive, now at `tick_ms`, lets `period_ms` pass at each."""
        self._tick_ms, self._sync_ms = tick_ms, period_ms
        self._clock = lambda: self._tick_ms * 1e-3
        if isinstance(self.bus, BadBus):
            self.bus.follow(self._clock)
        if self._next_heartbeat_s < math.inf:
            self._next_heartbeat_s = self._clock()

    def send(self, cob_id: int, data: bytes) -> None:
        """Send one frame; while the transmit queue of the bus is full, wait and handle frames. Raises BusError."""
        self.frames += 1
        message = can.Message(arbitration_id=cob_id, data=data, is_extended_id=False)
        end_s = self.answer_time_s + _QUEUE_FULL_S
        while True:
            try:
                self.bus.send(message)
                return
            except can.CanError as error:
                if not _is_queue_full(error):
                    raise BusError(f"{self.bus.channel_info}: sending failed: {error}") from error
                if self.answer_time_s > end_s:
                    raise BusError(_queue_full(str(self.bus.channel_info))) from error
            self._receive(_QUEUE_POLL_S)

    @property
    def has_own_channel(self) -> bool:
        """Whether SDO requests go by a channel that is this host's alone (1201h)."""
        return bool(self.node.sdo.rx_cobid != _SDO_REQUEST + self.node_id)

    def use_channel(self, request: int, response: int) -> None:
        """Send SDO requests with this identifier from now on, and take the answers with the other one."""
        sdo = self.node.sdo
        self._network.unsubscribe(sdo.tx_cobid, sdo.on_response)
        sdo.rx_cobid, sdo.tx_cobid = request, response
        self._network.subscribe(response, sdo.on_response)
        self._lengths[response] = 8

    def use_default_channel(self) -> None:
        """Send SDO requests by the channel that every master has."""
        self.use_channel(_SDO_REQUEST + self.node_id, _SDO_RESPONSE + self.node_id)

    def _on_heartbeat(self, _cob_id: int, data: bytearray, _time: float) -> None:
        if data[0] == _BOOT_UP:  # the drive has forgotten its holder
            self.use_default_channel()

    def send_heartbeat(self) -> None:
        """Send the host's heartbeat now, and in poll() every HEARTBEAT_S until stop_heartbeat(). Raises BusError.

        A program that only reads sends none: the drive would accept it in place of that of the master that holds it.
        """
        self._next_heartbeat_s = self._clock() + HEARTBEAT_S
        self.send(wire.HEARTBEAT + wire.HOST_NODE_ID, _HEARTBEAT_OPERATIONAL)

    def stop_heartbeat(self) -> None:
        """Send no heartbeat from now on."""
        self._next_heartbeat_s = math.inf

    def poll(self, timeout_s: float) -> bool:
        """Wait at most `timeout_s` for one frame and handle it; False when none came. Raises BusError.

        Where time passes with SYNC, let one period pass and handle its frames; then it raises NoAnswerError, too.
        """
        now_s = self._clock()
        if now_s >= self._next_heartbeat_s:
            self.send_heartbeat()
        if self._sync_ms:
            self._round()
            return True
        return self._receive(min(timeout_s, self._next_heartbeat_s - now_s))

    def _receive(self, timeout_s: float) -> bool:
        for recording in (self._recording, self._watching):
            if recording is not None:
                recording.hand_over_if_due()
        try:
            message = self.bus.recv(timeout_s)
        except can.CanError as error:
            raise BusError(f"{self.bus.channel_info}: receiving failed: {error}") from error
        if message is None:
            return False
        self.frames += 1
        if message.is_error_frame:
            return True
        if message.is_extended_id or message.is_fd or message.is_remote_frame:
            self.count_dropped("foreign")
        elif self._lengths.get(message.arbitration_id, message.dlc) != message.dlc:
            self.count_dropped("length")
        elif message.arbitration_id in self._telemetry_ids:
            if self._sync_ms and message.arbitration_id in self._tick_ids:
                self._see_tick(message.data[0] | message.data[1] << 8)
            self._record(message)
        else:
            if message.arbitration_id == wire.TPDO1 + self.node_id:
                self._record(message)
            self._network.notify(message.arbitration_id, message.data, message.timestamp)
        return True

    def _record(self, message: can.Message) -> None:
        for recording in (self._recording, self._watching):
            if recording is not None:
                recording.frames.append((message.arbitration_id - self.node_id, message.data))

    def handle_pending(self) -> None:
        """Handle the frames that have arrived already: after a pause of the host, `status` is an old one until then."""
        drive = simulated(self.bus)
        if self._sync_ms or (drive is not None and not drive.by_clock):
            return  # time does not pass while the host pauses
        end_s = time.monotonic() + HEARTBEAT_S
        while self._receive(0.0) and time.monotonic() < end_s:
            pass

    def wait(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Handle frames until `condition` holds; False when it does not within `timeout_s`."""
        end_s = self._clock() + timeout_s
        while not condition():
            left_s = end_s - self._clock()
            if left_s <= 0.0:
                return False
            self.poll(left_s)
        return True

    def statuswords_since(self, status_count: int) -> bool:
        """Whether both TPDO1 that `statuswords` rest on have come since `status_count` had this value.

        Where that was after an SDO write, they are about what was written: the drive's TPDO1 and answers keep their
        order.
        """
        return self._statuswords_count >= status_count + 2

    @property
    def answer_time_s(self) -> float:
        """Now, by the clock of the timeout of an SDO request.

        Where time passes with SYNC it is the wall clock, since the drive's time does not pass during a transfer.
        """
        return time.monotonic() if self._sync_ms else self._clock()

    def wait_for_answer(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """wait() by `answer_time_s`."""
        if not self._sync_ms:
            return self.wait(condition, timeout_s)
        end_s = self.answer_time_s + timeout_s
        while not condition():
            left_s = end_s - self.answer_time_s
            if left_s <= 0.0:
                return False
            self._receive(left_s)
        return True

    def record_telemetry(self, take: _Take | None = None, every_s: float = _TAKE_S) -> None:
        """Record all telemetry frames and TPDO1 from now on, and discard those recorded before.

        `take` is called with function (m,) and payload (m, 8) of those that have come in about `every_s`; without it
        they are kept for recorded_telemetry().
        """
        self._recording = _Recording(take, every_s, self.by_device_time)

    def recorded_telemetry(self, start_nm: tuple[int, int]) -> Telemetry:
        """Stop recording and unpack the telemetry; `start_nm` is a position within 8 mm of the first one recorded."""
        recording, self._recording = self._recording, None
        frames = recording.taken() if recording is not None else _unpacked([])
        return wire.unpack_telemetry(*frames, start_nm)

    def stop_recording(self) -> None:
        """Hand over what was recorded, and record no more."""
        recording, self._recording = self._recording, None
        if recording is not None:
            recording.hand_over()

    @contextmanager
    def telemetry_watched(self, take: _Take, every_s: float) -> Iterator[None]:
        """Call `take` as record_telemetry() does, beside any recording; one at a time."""
        watching = self._watching = _Recording(take, every_s, self.by_device_time)
        try:
            yield
        finally:
            self._watching = None
            watching.hand_over()

    def _round(self) -> None:
        goal_ms = self._tick_ms + self._sync_ms
        self._rounds += 1
        dated = self._rounds - self._dated_round < _UNDATED_MAX
        wait_s = _ROUND_S if self._rounds % _ASK_EACH and self.node.nmt.state == "OPERATIONAL" and dated else 0.0
        now_s = time.monotonic()
        end_s, ask_s = now_s + _SILENCE_S, now_s + wait_s
        self.send(wire.SYNC, b"")
        while self._tick_ms < goal_ms:
            now_s = time.monotonic()
            if now_s < ask_s:
                self._receive(ask_s - now_s)
                continue
            tick_ms = self._ask_tick()
            if tick_ms is None:
                if now_s > end_s:
                    raise NoAnswerError(
                        f"node {self.node_id} on {self.bus.channel_info} is silent, {_SILENCE_S:g} s waited"
                    )
            elif tick_ms < goal_ms:
                self.send(wire.SYNC, b"")  # the SYNC before was lost
            else:
                self._tick_ms = tick_ms
            ask_s = time.monotonic() + wait_s

    def _see_tick(self, tick_ms: int) -> None:
        self._dated_round = self._rounds
        if tick_ms == (self._tick_ms + self._sync_ms) & 0xFFFF:
            self._tick_ms += self._sync_ms

    def _ask_tick(self) -> int | None:
        """Tick of the drive; None when the answer is lost or implausible.

        It is read twice, with another object in between, since a corrupted answer would set the two clocks apart.
        """
        try:
            answers = [self._upload(name) for name in (_TICK, _ERROR_REGISTER, _TICK)]
        except (SdoAbortedError, SdoCommunicationError):
            return None
        if answers[0] != answers[2]:
            return None
        tick_ms = int.from_bytes(answers[0], "little")
        return tick_ms if 0 <= tick_ms - self._tick_ms <= _AHEAD_MS else None

    def _upload(self, name: str) -> bytes:
        variable = self.node.object_dictionary[name]
        data: bytes = self.node.sdo.upload(variable.index, variable.subindex)
        return data

    def _on_emergency(self, emcy: Any) -> None:
        self.emergencies.append((emcy.code, emcy.register, bytes(emcy.data)))
        if emcy.code not in self.reported:
            self.reported.append(emcy.code)

    def _on_status(self, _cob_id: int, data: bytearray, _timestamp: float) -> None:
        before, self.status = self.status, wire.unpack_status(bytes(data))
        self.status_count += 1
        if before is not None and before.statusword == self.status.statusword:
            self.statuswords = self.status.statusword
            self._statuswords_count = self.status_count


_Take = Callable[[NDArray[np.int64], NDArray[np.uint8]], None]


class _Recording:
    """Frames (function, payload) as they come; `take` gets them each `every_s`."""

    def __init__(self, take: _Take | None, every_s: float, by_device_time: bool) -> None:
        self.frames: list[tuple[int, bytearray]] = []
        self._take, self._every_s = take, every_s
        self._taken_s = math.inf if by_device_time else time.monotonic()  # wall clock

    def hand_over_if_due(self) -> None:
        """By the number of frames alone where time is the drive's, so that equal runs stay equal."""
        if self._take is None or not self.frames:
            return
        if (
            len(self.frames) >= _TAKE_FRAMES * self._every_s / _TAKE_S
            or time.monotonic() - self._taken_s >= self._every_s
        ):
            self._taken_s = max(self._taken_s, time.monotonic())
            self.hand_over()

    def hand_over(self) -> None:
        """Give all frames to `take`, also none."""
        if self._take is not None:
            self._take(*self.taken())

    def taken(self) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
        """Function (m,) and payload (m, 8) of all frames, which are forgotten."""
        frames, self.frames = self.frames, []
        return _unpacked(frames)


def _unpacked(frames: list[tuple[int, bytearray]]) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    function = np.array([f for f, _ in frames], dtype=np.int64)
    return function, np.frombuffer(b"".join(d for _, d in frames), dtype=np.uint8).reshape(-1, 8)


def _is_queue_full(error: can.CanError) -> bool:
    """python-can has no exception for it: SocketCAN gives an error number or a text, other interfaces a text."""
    return error.error_code in (errno.ENOBUFS, errno.EAGAIN) or bool(_QUEUE_FULL.search(str(error)))


def _queue_full(channel: str) -> str:
    text = (
        f"{channel}: its transmit queue has been full for {_QUEUE_FULL_S:g} s. Either no node acknowledges (check the "
        "drive's supply, cable, termination, bit rate), or other nodes leave no room on the bus"
    )
    if interface := _SOCKETCAN.match(channel):
        text += (
            f"; `ip -details link show {interface[1]}` says which. A longer queue: as root, "
            f"`ip link set {interface[1]} txqueuelen 1000`"
        )
    return text


class _LinkedNetwork(canopen.Network):  # type: ignore[misc]  # the library is not typed
    """A network that sends through the link."""

    def __init__(self, link: Link, bus: can.BusABC) -> None:
        super().__init__(bus)
        self._link = link

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        self._link.send(can_id, data)


@functools.lru_cache(8)
def _dictionary(eds: str, node_id: int) -> ObjectDictionary:
    """The objects of a node, which nobody changes. Reading the EDS takes longer than a short run."""
    return import_od(eds, node_id)


class _PolledNode(canopen.RemoteNode):  # type: ignore[misc]
    """A remote node whose SDO client polls the link while it waits."""

    def __init__(self, link: Link, node_id: int, eds: str) -> None:
        self._link = link
        super().__init__(node_id, _dictionary(eds, node_id))

    def add_sdo(self, rx_cobid: int, tx_cobid: int) -> Any:
        client = _PolledSdoClient(self._link, rx_cobid, tx_cobid, self.object_dictionary)
        self.sdo_channels.append(client)
        return client


class _PolledSdoClient(SdoClient):  # type: ignore[misc]
    def __init__(self, link: Link, rx_cobid: int, tx_cobid: int, od: Any) -> None:
        super().__init__(rx_cobid, tx_cobid, od)
        self._link = link

    def read_response(self) -> Any:
        if not self._link.wait_for_answer(lambda: not self.responses.empty(), self.RESPONSE_TIMEOUT):
            raise SdoCommunicationError("No SDO response received")
        return super().read_response()

    def request_response(self, sdo_request: Any) -> Any:
        """Wait for the answer about the requested object; one about another is late, repeated or corrupted."""
        if sdo_request[0] >> 5 not in _REQUESTS_BY_NAME:
            return super().request_response(sdo_request)
        self.responses: queue.Queue[bytes] = queue.Queue()
        self.send_request(sdo_request)
        begin_s = self._link.time_s
        end_s = self._link.answer_time_s + self.RESPONSE_TIMEOUT
        while self._link.wait_for_answer(lambda: not self.responses.empty(), end_s - self._link.answer_time_s):
            response = self.responses.get_nowait()
            if response[1:4] != sdo_request[1:4]:
                if response[0] == RESPONSE_DOWNLOAD and sdo_request[0] >> 5 == _DOWNLOAD:
                    self._link.misdirected.append((int.from_bytes(response[1:3], "little"), response[3]))
            elif response[0] == RESPONSE_ABORTED:
                raise SdoAbortedError(int.from_bytes(response[4:8], "little"))
            else:
                self._link.answered(self._link.time_s - begin_s)
                return response
        self.abort(ABORT_TIMED_OUT)
        raise SdoCommunicationError("No SDO response received")
