# SPDX-License-Identifier: Apache-2.0
"""The scope inside the drive: up to eight of its signals at the control rate, around a trigger (docs/scope.md).

From power-on the scope is armed for faults. The capture of a fault can be read by `held` until the fault is reset.
`arm` arms the scope with another setup, `wait` waits for its trigger, `read` reads the capture, and `release` arms the
scope for faults again.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kontur.can import emcy
from kontur.can.signals import CHANNELS, DEFAULT_SIGNALS, RECORDED, Signal
from kontur.drive.device import Device
from kontur.drive.objects import refused_in_this_state
from kontur.errors import DeviceError, ParameterError

Floats = NDArray[np.float64]

OFF, WAITING, TRIGGERED, DONE = range(4)

_ARM, _DEFAULTS = 1, 2
_NOW, _FAULT, _RISING, _FALLING = range(4)
_POLL_S = 0.02
_AFTER_S = 10.0  # longer than the recording after a trigger takes, except at very long intervals
_LEVEL_MAX = 2**31 - 1  # counts of a signal
_VERSION, _HEADER = 1, struct.Struct("<BBHIIIII8s")
_LEVEL = re.compile(r"\s*(\w+)\s*([<>])\s*([^<>\s]+)\s*")


_BY_NUMBER = {signal.number: signal for signal in RECORDED.values()}


@dataclass(frozen=True)
class Trigger:
    """What the capture is around: 'now', 'fault', or `source` crossing (> up, < down) `level`, in its unit."""

    kind: str = "fault"
    source: str = ""
    level: float = 0.0

    def __str__(self) -> str:
        return f"{self.source}{self.kind}{self.level:g}" if self.source else self.kind


def trigger(text: str) -> Trigger:
    """The trigger of a text: 'now', 'fault', 'NAME>LEVEL' or 'NAME<LEVEL'. Raises ParameterError."""
    if text in ("now", "fault"):
        return Trigger(text)
    match = _LEVEL.fullmatch(text)
    try:
        if match:
            signal, level = _signal(match[1]), float(match[3])
            if abs(level) <= (greatest := _LEVEL_MAX * signal.factor):
                return Trigger(match[2], signal.name, level)
            raise ParameterError(
                f"trigger {text!r}: the level is out of range; "
                f"it must be {-greatest:g}..{greatest:g} {signal.unit}".rstrip()
            )
    except ValueError:
        pass
    raise ParameterError(f"trigger {text!r}: it is now, fault, NAME>LEVEL or NAME<LEVEL, e.g. 'contour_error>5'")


@dataclass(frozen=True)
class Setup:
    """What to record. `pre`: share of the frames before the trigger; `divider`: control periods from frame to frame."""

    signals: tuple[str, ...] = DEFAULT_SIGNALS
    trigger: Trigger = Trigger()
    pre: float = 0.5
    divider: int = 1

    def __post_init__(self) -> None:
        if not 1 <= len(self.signals) <= CHANNELS:
            raise ParameterError(f"{len(self.signals)} signals: the scope records 1 to {CHANNELS} at a time")
        for name in self.signals:
            _signal(name)
        if not 0.0 <= self.pre <= 1.0:
            raise ParameterError(f"pre is the share of the capture before the trigger, 0 to 1, not {self.pre:g}")


def names(text: str) -> tuple[str, ...]:
    """Signal names from a list with commas. Raises ParameterError."""
    return tuple(_signal(name.strip()).name for name in text.split(","))


@dataclass(frozen=True)
class Capture:
    """What the scope recorded: `values` (frames, signals) in their units, one frame every `periods` control periods.

    `first_period`, `trigger_period`: control periods since power-on, of the first frame and of the trigger;
    `trigger_frame` is the first frame at or after the trigger; `fault`: EMCY code of the fault or warning that
    triggered, or 0.
    """

    signals: tuple[Signal, ...]
    values: Floats
    control_hz: int
    periods: int
    first_period: int
    trigger_period: int
    trigger_frame: int
    fault: int

    @cached_property
    def time_s(self) -> Floats:
        """(frames,), from the trigger."""
        since = self.first_period + self.periods * np.arange(len(self.values)) - self.trigger_period
        return np.asarray(since / self.control_hz)

    def __getitem__(self, name: str) -> Floats:
        """(frames,) of the signal `name`."""
        return np.asarray(self.values[:, [signal.name for signal in self.signals].index(name)])


def arm(device: Device, setup: Setup) -> None:
    """Let the drive wait for the trigger of `setup`; a capture that its scope held is discarded.

    Raises ParameterError; DeviceError while the drive holds the capture of a fault.
    """
    interval_us = -(-setup.divider * 1_000_000 // int(device.read("clock.control_hz")))
    kind = {"now": _NOW, "fault": _FAULT, ">": _RISING, "<": _FALLING}[setup.trigger.kind]
    with _unless_fault_held():
        for i in range(CHANNELS):
            number = _number(setup.signals[i]) if i < len(setup.signals) else 0
            device.write(f"scope_channels.entry_{i + 1}", number)
        device.write("scope.interval", interval_us)
        device.write("scope.pre", setup.pre)
        device.write("scope.trigger", kind)
        if setup.trigger.source:
            source = _signal(setup.trigger.source)
            device.write("scope.source", _number(source.name))
            device.write("scope.level", setup.trigger.level / source.factor)
        device.write("scope.command", _ARM)


def release(device: Device) -> None:
    """Arm the drive for faults, as at power-on; its capture is discarded. Raises DeviceError as `arm` does."""
    with _unless_fault_held():
        device.write("scope.command", _DEFAULTS)


@contextmanager
def _unless_fault_held() -> Iterator[None]:
    try:
        yield
    except DeviceError as error:
        if not refused_in_this_state(error):
            raise
        raise DeviceError(
            "the drive's scope holds the capture of a fault: read it with `kontur scope --last`, then reset the fault "
            "(the next `kontur run`, `jog` or `home` does)"
        ) from error


def wait(device: Device, timeout_s: float, stop_requested: Callable[[], bool] = lambda: False) -> bool:
    """Wait for the capture; False when no trigger comes within `timeout_s`, or when `stop_requested` returns True."""
    end_s = device.link.time_s + timeout_s
    while True:
        state = int(device.read("scope.state"))
        if state == DONE:
            return True
        if stop_requested() or state == OFF:
            return False
        if device.link.time_s > end_s + (_AFTER_S if state == TRIGGERED else 0.0):
            return False
        device.link.wait(lambda: False, _POLL_S)


def held(device: Device, progress: Callable[[float], None] = lambda share: None) -> Capture | None:
    """The capture that the drive holds or is recording; None when its scope has not been triggered."""
    if int(device.read("scope.state")) in (OFF, WAITING) or not wait(device, 0.0):
        return None
    return read(device, progress)


def read(device: Device, progress: Callable[[float], None] = lambda share: None) -> Capture:
    """The capture, by block upload; `progress` is called with the share read. Raises DeviceError."""
    data = device.read_domain("scope_data", progress)
    if len(data) < _HEADER.size or data[0] != _VERSION:
        raise DeviceError("the drive's capture is of another version: use the kontur that belongs to its firmware")
    _, channels, periods, frames, frame, first, at, cause, numbers = _HEADER.unpack_from(data)
    if not (1 <= channels <= CHANNELS and frames >= 1 and len(data) == _HEADER.size + 4 * frames * channels):
        raise DeviceError("the drive's capture is damaged: record it again")
    known = [_BY_NUMBER.get(n, Signal(n, f"signal_{n}", "", 1.0, "unknown here")) for n in numbers[:channels]]
    counts = np.frombuffer(data, dtype="<i4", offset=_HEADER.size).reshape(frames, channels)
    return Capture(
        signals=tuple(known),
        values=counts * np.array([signal.factor for signal in known]),
        control_hz=int(device.read("clock.control_hz")),
        periods=periods,
        first_period=first,
        trigger_period=at,
        trigger_frame=frame,
        fault=_cause(device, cause),
    )


def _cause(device: Device, bits: int) -> int:
    """EMCY code of the trigger; of several faults, the one that the drive names (`error_code_x`, `error_code_y`)."""
    codes = [code for code, fault in emcy.faults().items() if fault.bit is not None and bits >> fault.bit & 1]
    named = int(device.read("error_code_x") or device.read("error_code_y"))
    return named if named in codes or (bits and not codes) else next(iter(codes), 0)


def _signal(name: str) -> Signal:
    if name not in RECORDED:
        raise ParameterError(_unknown(name))
    return RECORDED[name]


def _number(name: str) -> int:
    number = _signal(name).number
    assert number is not None  # RECORDED has no other
    return number


def _unknown(name: str, known: Sequence[str] = tuple(RECORDED)) -> str:
    import difflib

    close = difflib.get_close_matches(name, known, n=3)
    hint = f"did you mean {', '.join(close)}?" if close else "`kontur scope --list` has them all"
    return f"signal {name!r} is unknown; {hint}"
