# SPDX-License-Identifier: Apache-2.0
"""The integers of the wire and their units: the only place where the host scales them (docs/protocol.md).

All functions work on arrays, so that a trajectory or the telemetry of a run is converted in one call.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kontur.can import signals
from kontur.errors import PathError

Floats: TypeAlias = NDArray[np.float64]

M_PER_NM = 1e-9
TICK_PERIOD_S = 1e-3

NMT, NMT_START, NMT_PRE_OPERATIONAL = 0x000, 1, 128
RPDO1, RPDO2, RPDO5 = 0x200, 0x300, 0x500
SYNC = 0x080
TPDO1, TPDO2, TPDO3, TPDO4, TPDO5, TPDO6 = 0x180, 0x280, 0x380, 0x480, 0x680, 0x6A0
TELEMETRY = (TPDO2, TPDO3, TPDO4, TPDO5, TPDO6)
HEARTBEAT = 0x700
HOST_NODE_ID = 127

DIFFERENCE_MAX_NM = 2**23 - 1
_PACKED = 1 << 16  # knots at once


def _crc_table() -> NDArray[np.uint8]:
    crc = np.arange(256)
    for _ in range(8):
        crc = ((crc << 1) ^ (crc >> 7) * 0x2F) & 0xFF
    return crc.astype(np.uint8)


_CRC = _crc_table()


def crc8(data: ArrayLike) -> NDArray[np.uint8]:
    """CRC-8/AUTOSAR over the last axis of `data` (..., n) uint8; returns (...)."""
    octets = np.asarray(data, dtype=np.uint8)
    crc = np.full(octets.shape[:-1], 0xFF, dtype=np.uint8)
    for i in range(octets.shape[-1]):
        crc = _CRC[crc ^ octets[..., i]]
    return crc ^ np.uint8(0xFF)


def pack_knots(knots_nm: NDArray[np.int32], start_nm: tuple[int, int], number: int = 0) -> bytearray:
    """The knot frames (RPDO2) of a trajectory, or of its part from knot `number` on.

    `knots_nm` (N, 2); `start_nm` is the position that the first is a difference to. Returns N payloads of 8 bytes in
    one.
    Raises PathError when a step between knots does not fit into the 24 bits of the wire.
    """
    packed = bytearray(8 * len(knots_nm))
    frames = np.frombuffer(packed, dtype=np.uint8).reshape(-1, 8)
    for first in range(0, len(knots_nm), _PACKED):  # in parts, to bound memory
        rows = slice(first, first + _PACKED)
        _pack(frames[rows], knots_nm[rows], start_nm if first == 0 else knots_nm[first - 1], number + first)
    return packed


def _pack(frames: NDArray[np.uint8], knots_nm: NDArray[np.int32], before_nm: ArrayLike, number: int) -> None:
    """pack_knots() of knots from `number` on, which follow `before_nm`, into `frames`."""
    absolute = np.vstack([np.asarray(before_nm, dtype=np.int64), knots_nm.astype(np.int64)])
    difference = np.diff(absolute, axis=0)
    too_far = np.flatnonzero(np.abs(difference).max(axis=1) > DIFFERENCE_MAX_NM)
    if too_far.size:
        i = int(too_far[0])
        raise PathError(
            f"knot {number + i}: a step of {np.abs(difference[i]).max() * M_PER_NM * 1e3:.3f} mm in 1 ms does not fit "
            f"the wire (at most {DIFFERENCE_MAX_NM * M_PER_NM * 1e3:.3f} mm); lower the feed"
        )
    frames[:, 0] = (number + np.arange(len(knots_nm))) & 0xFF
    frames[:, 2:5] = (difference[:, :1] >> np.array([0, 8, 16])) & 0xFF
    frames[:, 5:8] = (difference[:, 1:] >> np.array([0, 8, 16])) & 0xFF
    frames[:, 1] = crc8(frames[:, [0, 2, 3, 4, 5, 6, 7]])


def pack_controlwords(x: int, y: int) -> bytes:
    """The frame RPDO1."""
    return struct.pack("<HH", x, y)


@dataclass(frozen=True)
class Status:
    """TPDO1: both statuswords, free slots of the knot queue, and the count of accepted knots modulo 2**16."""

    statusword: tuple[int, int]
    free: int
    accepted: int


def unpack_status(data: bytes) -> Status:
    """Read a TPDO1. Raises struct.error when `data` is not 8 bytes long."""
    x, y, free, accepted = struct.unpack("<HHHH", data)
    return Status((x, y), free, accepted)


@dataclass(frozen=True)
class Telemetry:
    """Telemetry of a run, one row a device tick (1 ms). Rows that were lost are absent; see `tick`.

    `tick` (n,) unwrapped milliseconds since power-on modulo 2**16 at the first row; `values`: a column (n,) for each
    signal that the TPDOs carry, by name, in SI units (kontur.can.signals). A signal that comes less often has the
    latest value at or before the row, NaN before the first. `frames_lost`: frames of any of these PDOs missing
    between the first and the last.
    """

    tick: NDArray[np.int64]
    values: Mapping[str, Floats]
    frames_lost: int

    def columns(self, *names: str) -> Floats:
        """The signals `names` side by side, (n, len(names))."""
        return np.column_stack([self.values[name] for name in names])

    @property
    def position_m(self) -> Floats:
        """Positions (n, 2)."""
        return self.columns(*_POSITIONS)


_TICK_STEP_MAX, _POSITION_STEP_MAX_NM = 16, 500_000  # ms; nm in a millisecond or two
_TELEMETRY_PERIOD = {place.cob_id: place.period_ms for place in signals.TELEMETRY.values()}
_SETTLED_MS, _CONTEXT = 64, 512  # no frame is later than that; frames that are read again with those after them
_DATED = (TPDO2, TPDO3)  # their first two bytes are the tick
_POSITIONS = ("position_x", "position_y")  # the low bits of the position, which wrap


def unpack_telemetry(function: NDArray[np.int64], payload: NDArray[np.uint8], start_nm: tuple[int, int]) -> Telemetry:
    """Telemetry from frames in the order of their arrival.

    `function` (m,) COB-ID without node id, one of TELEMETRY or TPDO1; `payload` (m, 8); `start_nm` is any position
    within 8 mm of the first one reported, to complete the 24 bits of the wire. Frames that arrived twice or out of
    order are put in order. Frames with an impossible tick or position are corrupted and left out.
    """
    stream = TelemetryStream(start_nm)
    rows = stream.add(function, payload, last=True)
    return Telemetry(rows.tick, rows.values, stream.frames_lost)


class TelemetryStream:
    """unpack_telemetry() for frames that come in pieces: each row once, as soon as it cannot change any more.

    A frame that comes more than _SETTLED_MS after a newer one is too late. `frames_lost` counts the rows so far.

    `path_began` is the tick of the first row in which path time runs, None as long as no TPDO1 says so: the drive sends
    it at once, before the telemetry of this tick. If this one is lost, the next one comes 10 ms later.
    """

    def __init__(self, start_nm: tuple[int, int]) -> None:
        self._frames = (np.empty(0, dtype=np.int64), np.empty((0, 8), dtype=np.uint8))  # the latest, still needed
        self.path_began: int | None = None
        self._done: int | None = None  # tick up to which rows were returned
        self._at: tuple[int, tuple[int, int]] | None = None  # tick and position of the latest row
        self._start_nm = start_nm
        self._latest: dict[str, float] = {}
        self._seen: dict[int, tuple[int, int, int]] = {}  # COB-ID to first tick, last tick and number of its frames

    @property
    def frames_lost(self) -> int:
        """Frames of any of these PDOs missing between the first and the last."""
        periods = ((_TELEMETRY_PERIOD[cob], *seen) for cob, seen in self._seen.items())
        return sum(max(0, (last - first) // period + 1 - count) for period, first, last, count in periods)

    def add(self, function: NDArray[np.int64], payload: NDArray[np.uint8], last: bool = False) -> Telemetry:
        """The rows that are complete with these frames; all that are left with the `last` ones."""
        function = np.concatenate([self._frames[0], function])
        payload = np.concatenate([self._frames[1], payload])
        tick, sound, data = _in_order(function, payload)
        if not len(tick):
            self._frames = (function, payload)
            return Telemetry(tick, dict.fromkeys(signals.TELEMETRY, np.empty(0)), self.frames_lost)
        if self._done is not None:  # the same count of ticks as before
            tick += round((self._done - int(tick[len(tick) // 2])) / 0x10000) * 0x10000
        if self.path_began is None and (began := _path_began(function, payload)) is not None:
            self.path_began = int(tick[0]) + int(_signed(began - tick[:1], 16)[0])
        until = int(tick[-1]) - (0 if last else _SETTLED_MS)
        done = int(tick[0]) - 1 if self._done is None else self._done
        found = self._rows(tick, sound, data)
        new = (found.tick > done) & (found.tick <= until)
        values = {name: self._held(name, value[new]) for name, value in found.values.items()}
        found = Telemetry(found.tick[new], values, 0)

        self._count(tick, sound, done, until)
        self._done = max(done, until)
        if len(found.tick):
            self._at = int(found.tick[-1]), (_nm(found.values[_POSITIONS[0]]), _nm(found.values[_POSITIONS[1]]))
        self._latest.update((name, value[-1]) for name, value in values.items() if len(value))
        self._frames = (function[-_CONTEXT:], payload[-_CONTEXT:])
        return Telemetry(found.tick, values, self.frames_lost)

    def _rows(self, tick: NDArray[np.int64], function: NDArray[np.int64], payload: NDArray[np.uint8]) -> Telemetry:
        of = {cob: function == cob for cob in TELEMETRY}
        rows, at2, at3 = np.intersect1d(tick[of[TPDO2]], tick[of[TPDO3]], assume_unique=True, return_indices=True)
        at_row = {TPDO2: at2, TPDO3: at3}
        positions = [signals.TELEMETRY[name] for name in _POSITIONS]
        position = np.column_stack([_counts(payload[of[place.cob_id]], place) for place in positions])
        known = tick[of[positions[0].cob_id]]
        unwrapped = dict(zip(_POSITIONS, self._unwrap(position, known).T, strict=True))
        values: dict[str, Floats] = {}
        for name, place in signals.TELEMETRY.items():
            counts = unwrapped[name] if name in unwrapped else _counts(payload[of[place.cob_id]], place)
            value = counts.astype(np.float64) * place.factor
            if place.cob_id in at_row:
                values[name] = value[at_row[place.cob_id]]
            else:
                values[name] = _hold(value, np.searchsorted(tick[of[place.cob_id]], rows, side="right") - 1)
        return Telemetry(rows, values, 0)

    def _unwrap(self, position: NDArray[np.int64], tick: NDArray[np.int64]) -> NDArray[np.int64]:
        """Complete positions (n, 2) at `tick` (n,), by where the axes were at the latest row, or at the start."""
        if self._at is None:
            return unwrap_position(position, self._start_nm)
        at_tick, at_nm = self._at
        unwrapped = unwrap_position(position, self._start_nm)
        same = int(np.clip(np.searchsorted(tick, at_tick), 0, len(tick) - 1))
        turns = np.rint((np.array(at_nm) - unwrapped[same]) / (1 << 24)).astype(np.int64)
        return np.asarray(unwrapped + turns * (1 << 24))

    def _held(self, name: str, value: Floats) -> Floats:
        """A value that has come before these frames holds until the next one."""
        return np.where(np.isnan(value), self._latest.get(name, np.nan), value)

    def _count(self, tick: NDArray[np.int64], function: NDArray[np.int64], done: int, until: int) -> None:
        for cob in TELEMETRY:
            at = tick[(function == cob) & (tick > done) & (tick <= until)]
            if len(at):
                first, _, count = self._seen.get(cob, (int(at[0]), 0, 0))
                self._seen[cob] = (first, int(at[-1]), count + len(at))


def _nm(values: Floats) -> int:
    return round(float(values[-1]) / M_PER_NM)


def _in_order(
    function: NDArray[np.int64], payload: NDArray[np.uint8]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.uint8]]:
    """Unwrapped tick, function and payload of the frames that are sound, each once, in the order of their ticks."""
    dated = np.isin(function, _DATED)
    wrong = np.zeros(len(function), dtype=bool)
    wrong[dated] = _outliers(_ticks(payload[dated]), _TICK_STEP_MAX, 16)
    for name in _POSITIONS:
        place = signals.TELEMETRY[name]
        at = np.flatnonzero(function == place.cob_id)
        wrong[at] |= _outliers(_counts(payload[at], place), _POSITION_STEP_MAX_NM, place.bits)
    function, payload, dated = function[~wrong], payload[~wrong], dated[~wrong]
    first = int(np.argmax(dated)) if dated.any() else len(function)
    function, payload, dated = function[first:], payload[first:], dated[first:]

    # Every frame gets the unwrapped tick of the latest dated one.
    tick_of_dated = unwrap_tick(_ticks(payload[dated]))
    tick = tick_of_dated[np.cumsum(dated) - 1] if len(function) else tick_of_dated
    order = np.argsort(tick, kind="stable")
    tick, function, payload = tick[order], function[order], payload[order]
    again = np.zeros(len(tick), dtype=bool)
    for cob in TELEMETRY:
        at = np.flatnonzero(function == cob)
        again[at[1:]] = np.diff(tick[at]) == 0
    return tick[~again], function[~again], payload[~again]


def unwrap_tick(tick: NDArray[np.int64]) -> NDArray[np.int64]:
    """16-bit ticks (n,) of frames nearly in order, continued past their wrap; the first keeps its value."""
    if not len(tick):
        return tick
    return np.cumsum(np.concatenate([tick[:1], _signed(np.diff(tick), 16)]))


def unwrap_position(position_nm: NDArray[np.int64], start_nm: tuple[int, int]) -> NDArray[np.int64]:
    """24-bit positions (n, 2) in order, continued past their wrap from `start_nm`, at most 8 mm each."""
    if not len(position_nm):
        return position_nm
    steps = np.diff(position_nm, axis=0, prepend=np.asarray([start_nm], dtype=np.int64))
    return np.asarray(start_nm, dtype=np.int64) + np.cumsum(_signed(steps, 24), axis=0)


def _ticks(payload: NDArray[np.uint8]) -> NDArray[np.int64]:
    return payload[:, 0].astype(np.int64) | payload[:, 1].astype(np.int64) << 8


def _path_began(function: NDArray[np.int64], payload: NDArray[np.uint8]) -> int | None:
    """The tick after the first TPDO1 in which both statuswords say by bit 12 that path time runs."""
    runs = np.flatnonzero((function == TPDO1) & (payload[:, [1, 3]] & 0x10).all(axis=1))
    if not len(runs):
        return None
    after = slice(int(runs[0]), None)
    ticks = _ticks(payload[after][np.isin(function[after], _DATED)])
    return int(ticks[0]) if len(ticks) else None


def _signed(value: NDArray[np.int64], bits: int) -> NDArray[np.int64]:
    half = 1 << (bits - 1)
    return ((value + half) & (2 * half - 1)) - half


def _outliers(value: NDArray[np.int64], step_max: int, bits: int) -> NDArray[np.bool_]:
    """Which of `value` (n,), modulo 2**bits, are further than `step_max` from both neighbours, while these are not."""
    found = np.zeros(len(value), dtype=bool)
    if len(value) >= 3:
        far = np.abs(_signed(np.diff(value), bits)) > step_max
        close = np.abs(_signed(value[2:] - value[:-2], bits)) <= step_max
        found[1:-1] = far[:-1] & far[1:] & close
    return found


def _counts(payload: NDArray[np.uint8], place: signals.Place) -> NDArray[np.int64]:
    """The integers (m,) at `place` in the frames `payload` (m, 8)."""
    octets = payload[:, place.bit // 8 : (place.bit + place.bits) // 8].astype(np.int64)
    counts = np.asarray(octets @ (1 << 8 * np.arange(place.bits // 8)))
    return _signed(counts, place.bits) if place.signed else counts


def _hold(values: Floats, at: NDArray[np.int64]) -> Floats:
    """`values[at]`, NaN where `at` is -1 (no value yet)."""
    padded = np.concatenate([values, np.full((1, *values.shape[1:]), np.nan)])
    return padded[at]
