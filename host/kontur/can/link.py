# SPDX-License-Identifier: Apache-2.0
"""The connection to one drive: python-canopen on a python-can bus, without threads.

Whoever waits for something pumps the bus meanwhile, so a simulated drive, whose time passes in recv() only, and a real
one are served by the same code. All times are of the target's clock: device time in the simulator, else the wall clock.

A simulated drive whose time passes with SYNC alone (2020h:4, `kontur sim --pace sync`) is served in rounds, by its own
time: send SYNC, handle frames until one carries the tick that the SYNC has led to. What comes after it belongs to the
next round, however fast it arrives, so a run is the same each time. SDO transfers take no time there. Where a frame was
lost, and every now and then, the drive is asked for its tick: no SYNC is sent twice because an answer was slow.
"""

from __future__ import annotations

import logging
import math
import queue
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import canopen
import numpy as np
from canopen.sdo import SdoAbortedError, SdoClient, SdoCommunicationError
from canopen.sdo.constants import ABORT_TIMED_OUT, RESPONSE_ABORTED, RESPONSE_DOWNLOAD

from kontur.can import wire
from kontur.can.bad_bus import BadBus
from kontur.can.simulated import simulated
from kontur.can.wire import Status, Telemetry
from kontur.errors import BusError, DeviceError, NoAnswerError

EDS = Path(__file__).parents[1] / "kontur.eds"
HEARTBEAT_S = 0.1
RESEND_S = 0.05
"""Time after which a command that shows no effect is sent again."""
_EMCY, _SDO_RESPONSE = 0x80, 0x580
_DOWNLOAD, _UPLOAD = 1, 2
_REQUESTS_BY_NAME = (_DOWNLOAD, _UPLOAD)  # command specifiers whose answers name their object
_HEARTBEAT_OPERATIONAL = b"\x05"

_TICK_OBJECT, _ERROR_REGISTER = (0x2020, 3), (0x1001, 0)
_ROUND_S = 0.02  # wall clock, after which a round is taken to have lost a frame, and the drive is asked
_SILENCE_S = 10.0  # wall clock
_ASK_EACH = 64  # rounds: SYNCs that the bus doubled leave frames behind, which would pile up
_AHEAD_MS = 1000  # that a drive can be in front of its frames

# Their warnings are about what is raised as an exception here anyway.
logging.getLogger("canopen").addHandler(logging.NullHandler())
logging.getLogger("can").addHandler(logging.NullHandler())


class Link:
    """One drive with `node_id` on `bus`, which stays the caller's to shut down.

    `status` is the latest TPDO1, None before the first, `status_count` how many came; `statuswords` are those that came
    the same twice running, so that one corrupted frame tells nothing; `emergencies` are the EMCY objects received and
    not yet taken by the caller, as (code, register, data), `reported` the codes of all so far. `misdirected` are
    objects, (index, subindex), that the drive says it has set when it was told to set others: the request was
    corrupted.
    """

    def __init__(self, bus: can.BusABC, node_id: int, eds: str | Path = EDS) -> None:
        if not 1 <= node_id <= 31:
            raise DeviceError(f"node id {node_id}: a kontur drive has one of 1..31")
        self.bus = bus
        self.node_id = node_id
        self.status: Status | None = None
        self.status_count = 0
        self.statuswords = (0, 0)
        self.misdirected: list[tuple[int, int]] = []
        self._round_trips_s: deque[float] = deque(maxlen=16)
        self.emergencies: list[tuple[int, int, bytes]] = []
        self.reported: list[int] = []
        self._sync_ms = 0  # device time that passes at each SYNC; 0: time passes by itself
        self._tick_ms = 0
        self._rounds = 0
        # A bus whose time passes by its own rules, in the simulator, says so by having a `time_s`.
        self._clock: Callable[[], float] = (lambda: bus.time_s) if hasattr(bus, "time_s") else time.monotonic
        self._next_heartbeat_s = math.inf
        self.frames = 0
        """Sent and received so far."""
        self._recording = False
        self._frames: list[tuple[int, bytearray]] = []
        # Services of fixed length; frames of another one are corrupted.
        self._lengths = {_SDO_RESPONSE + node_id: 8, _EMCY + node_id: 8, wire.HEARTBEAT + node_id: 1}
        self._tick_ids = (wire.TPDO2 + node_id, wire.TPDO3 + node_id)
        self._telemetry_ids = frozenset(cob + node_id for cob in wire.TELEMETRY)
        self._network = canopen.Network(bus)
        self.node = _PolledNode(self, node_id, str(eds))
        self._network.add_node(self.node)
        self._network.subscribe(wire.TPDO1 + node_id, self._on_status)
        self.node.emcy.add_callback(self._on_emergency)

    @property
    def time_s(self) -> float:
        """Now, by the clock of the target."""
        return self._clock()

    @property
    def round_trip_s(self) -> float:
        """The longest time that one of the last SDO requests took until it was answered."""
        return max(self._round_trips_s, default=0.0)

    def answered(self, round_trip_s: float) -> None:
        """An SDO request was answered after `round_trip_s`."""
        self._round_trips_s.append(round_trip_s)

    @property
    def by_device_time(self) -> bool:
        """Whether `time_s` is the drive's own time since power-on, which passes as the host asks for it."""
        return simulated(self.bus) is not None or self._sync_ms > 0

    def follow_sync(self, tick_ms: int, period_ms: int) -> None:
        """The drive, now at `tick_ms`, lets `period_ms` pass at each SYNC: from now on pump() sends them."""
        self._tick_ms, self._sync_ms = tick_ms, period_ms
        self._clock = lambda: self._tick_ms * 1e-3
        if isinstance(self.bus, BadBus):
            self.bus.clock = self._clock
        if self._next_heartbeat_s < math.inf:
            self._next_heartbeat_s = self._clock()

    def send(self, cob_id: int, data: bytes) -> None:
        """Send one frame. Raises BusError."""
        self.frames += 1
        try:
            self.bus.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))
        except can.CanError as error:
            raise BusError(f"{self.bus.channel_info}: sending failed: {error}") from error

    def send_heartbeat(self) -> None:
        """Send the host's heartbeat now; from now on pump() does so every HEARTBEAT_S, until rest(). Raises BusError.

        Who only looks on sends none: it would pass for that of a host that holds the drive, and has died.
        """
        self._next_heartbeat_s = self._clock() + HEARTBEAT_S
        self.send(wire.HEARTBEAT + wire.HOST_NODE_ID, _HEARTBEAT_OPERATIONAL)

    def stop_heartbeat(self) -> None:
        """Send no heartbeat any more."""
        self._next_heartbeat_s = math.inf

    def poll(self, timeout_s: float) -> bool:
        """Wait at most `timeout_s` for one frame and handle it; False when none came. Raises BusError.

        Where time passes with SYNC: let one period pass, and handle the frames of it. Raises NoAnswerError, too.
        """
        now_s = self._clock()
        if now_s >= self._next_heartbeat_s:
            self.send_heartbeat()
        if self._sync_ms:
            self._round()
            return True
        return self._receive(min(timeout_s, self._next_heartbeat_s - now_s))

    def _receive(self, timeout_s: float) -> bool:
        try:
            message = self.bus.recv(timeout_s)
        except can.CanError as error:
            raise BusError(f"{self.bus.channel_info}: receiving failed: {error}") from error
        if message is None:
            return False
        self.frames += 1
        if message.arbitration_id in self._telemetry_ids:
            if self._sync_ms and message.arbitration_id in self._tick_ids and len(message.data) == 8:
                self._see_tick(message.data[0] | message.data[1] << 8)
            if self._recording and len(message.data) == 8:
                self._frames.append((message.arbitration_id - self.node_id, message.data))
        elif (
            not message.is_error_frame
            and not message.is_remote_frame
            and self._lengths.get(message.arbitration_id, message.dlc) == message.dlc
        ):
            self._network.notify(message.arbitration_id, message.data, message.timestamp)
        return True

    def handle_pending(self) -> None:
        """Handle the frames that have come already: after a pause of the host they say what was true long ago."""
        drive = simulated(self.bus)
        if self._sync_ms or (drive is not None and not drive.by_clock):
            return  # the drive waits for the host
        end_s = time.monotonic() + HEARTBEAT_S
        while self._receive(0.0) and time.monotonic() < end_s:
            pass

    def wait(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Pump until `condition` holds; False when it does not within `timeout_s`."""
        end_s = self._clock() + timeout_s
        while not condition():
            left_s = end_s - self._clock()
            if left_s <= 0.0:
                return False
            self.poll(left_s)
        return True

    @property
    def answer_time_s(self) -> float:
        """Now, by the clock that counts while an answer to an SDO request is waited for.

        Where time passes with SYNC it is the wall clock: the drive answers at once, and its time stands still.
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

    def record_telemetry(self) -> None:
        """Keep all telemetry frames from now on, dropping those kept before."""
        self._frames = []
        self._recording = True

    def recorded_telemetry(self, start_nm: tuple[int, int]) -> Telemetry:
        """Stop keeping telemetry and unpack it; `start_nm` is a position within 8 mm of the first one recorded."""
        self._recording = False
        function = np.array([f for f, _ in self._frames], dtype=np.int64)
        payload = np.frombuffer(b"".join(d for _, d in self._frames), dtype=np.uint8).reshape(-1, 8)
        return wire.unpack_telemetry(function, payload, start_nm)

    def _round(self) -> None:
        goal_ms = self._tick_ms + self._sync_ms
        self._rounds += 1
        wait_s = 0.0 if self._rounds % _ASK_EACH == 0 or self.node.nmt.state != "OPERATIONAL" else _ROUND_S
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
                self.send(wire.SYNC, b"")  # the one before was lost
            else:
                self._tick_ms = tick_ms
            ask_s = time.monotonic() + wait_s

    def _see_tick(self, tick_ms: int) -> None:
        if tick_ms == (self._tick_ms + self._sync_ms) & 0xFFFF:
            self._tick_ms += self._sync_ms

    def _ask_tick(self) -> int | None:
        """Tick of the drive; None when the answer is lost, or is not to be believed.

        It is asked twice, with another question in between: a corrupted answer that is believed parts the two clocks.
        """
        try:
            answers = [self.node.sdo.upload(*address) for address in (_TICK_OBJECT, _ERROR_REGISTER, _TICK_OBJECT)]
        except (SdoAbortedError, SdoCommunicationError):
            return None
        if answers[0] != answers[2]:
            return None
        tick_ms = int.from_bytes(answers[0], "little")
        return tick_ms if 0 <= tick_ms - self._tick_ms <= _AHEAD_MS else None

    def _on_emergency(self, emcy: Any) -> None:
        self.emergencies.append((emcy.code, emcy.register, bytes(emcy.data)))
        if emcy.code not in self.reported:
            self.reported.append(emcy.code)

    def _on_status(self, _cob_id: int, data: bytearray, _timestamp: float) -> None:
        if len(data) == 8:
            before, self.status = self.status, wire.unpack_status(bytes(data))
            self.status_count += 1
            if before is not None and before.statusword == self.status.statusword:
                self.statuswords = self.status.statusword


class _PolledNode(canopen.RemoteNode):  # type: ignore[misc]  # the library is not typed
    """A remote node whose SDO client pumps the link while it waits."""

    def __init__(self, link: Link, node_id: int, eds: str) -> None:
        self._link = link
        super().__init__(node_id, eds)

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
        """An answer about another object is late, repeated or corrupted: the right one is waited for."""
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
