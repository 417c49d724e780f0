# SPDX-License-Identifier: Apache-2.0
"""The first moves of an axis that nobody knows: direction, breakaway, rough mass, lost motion, length of an encoder
count, free travel.

Each is small at first, and checks before it goes on. What is wrong with the axis is said as a Diagnosis.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from kontur.can.link import HEARTBEAT_S
from kontur.commissioning import encoder, response
from kontur.commissioning.bias import Mover
from kontur.commissioning.recording import Recorder, ScopeRecorder
from kontur.commissioning.response import Floats, Setup
from kontur.drive.device import Device
from kontur.drive.pdos import TELEMETRY
from kontur.drive.single_axis import jog
from kontur.errors import DeviceError, EmcyError

_UNKNOWN_KG = 30.0  # of an axis whose mass nobody has told
_CAREFUL = {"cascade.position_gain": 10.0, "cascade.velocity_gain": 15.0, "cascade.integral_gain": 1.0}
FIRM = {"cascade.position_gain": 25.0, "cascade.velocity_gain": 60.0, "cascade.integral_gain": 15.0}
_RUNAWAY_NM, _ROUGH_NM, MEASURE_NM = 500_000, 5_000_000, 3_000_000  # following window of each step
_SHARES = (0.05, 0.15, 0.45, 1.0)  # of the force that is allowed, for the ramp, one after the other
_SEEN_COUNTS = 4  # a movement this large shows that the encoder counts
_BROKEN_M = 1.2e-4  # beyond presliding
_MOST_BREAKAWAY = 0.75  # of the force that is allowed
_RAMP_S, _SWING_MS = 2.0, 5000
_SLOW, _FAST = 1, 40  # periods in _SWING_MS: 0.2 Hz, 8 Hz
_WATCH_S = 0.002
_TRAVEL_MPS, _OFF_SWITCH_M = 0.03, 3e-3
_LENGTH_ERROR = 0.005  # of a count, relative, that may be
_ROUGH_HZ = 8.0
_REVERSALS, _LOST_MPS, _LOST_M, _SETTLE_S = 4, 4e-3, 3e-3, 0.3
_STEP_M, _TAKEN_ALONG, _LOOSE_M = 1e-4, 0.75, 3e-4  # beyond presliding and the stretch of a stiff transmission
_GAUGED_M, _GAUGED_MPS, _GAUGE_ERROR = 0.02, 0.01, 0.02
_GENTLE, _GENTLE_N = 3.0, 20.0  # force on the way to a switch: times what the axis breaks away at, and least
_CATCH_UP_S = 20.0
_DISAGREE = 0x7306  # two encoders of an axis: docs/faults.md
HOST_FAULTS = (0x8130, 0xFF10)
"""Of a host or a bus that was too slow: no heartbeat, no knots. They say nothing of the axes."""
_NO_RUNAWAY = (_DISAGREE, *HOST_FAULTS)  # faults that say nothing of the direction of the force
_ENDS, _SWITCHES = {"max": "upper", "min": "lower"}, {"max": 2, "min": 1}  # names, and bits of digital_inputs
_RISE_UM = 200.0  # of the reference, over which the feedforward of the friction turns
_NM = 1e-9


class Diagnosis(DeviceError):
    """What is wrong with an axis, in words; nothing was saved. `kind` is one word for it."""

    def __init__(self, kind: str, text: str) -> None:
        self.kind = kind
        super().__init__(text)


class Gauge(Protocol):
    """A gauge at the table, which the user reads."""

    def ready(self, axis: str) -> None:
        """Let the user set it to zero."""

    def distance_m(self, axis: str, counted_m: float) -> float:
        """What it shows after a move of which the drive has counted so much."""


@dataclass(frozen=True)
class Agreed:
    """What was agreed: the largest force and speed. The travel is that of the drive's soft limits.

    `index_m`: distance of index pulses, 0: not known. By it the length of a count is checked, or found where it is not
    `encoder_known`. Without it a `gauge` that the user reads does. With neither the length is taken as it is.
    """

    force_N: float
    speed_mps: float = 0.2
    index_m: float = 0.0
    encoder_known: bool = True
    gauge: Gauge | None = None


@contextmanager
def explained(axis: str, what: str, say: Callable[[str], None]) -> Iterator[None]:
    """Say `what` is done with the axis; a fault of the drive meanwhile becomes a Diagnosis that says so, too."""
    say(f"{axis}: {what}")
    try:
        yield
    except EmcyError as error:
        if error.code == _DISAGREE:
            raise Diagnosis(
                "encoder",
                f"axis {axis}: its encoder and its scale do not agree: the length of a count of one of them is wrong "
                f"(plant_{axis}.encoder, second_encoder_{axis}.length), one counts the other way "
                f"(wiring_{axis}.invert_encoder, second_encoder_{axis}.invert), or what is between them slips. {error}",
            ) from error
        if error.code in HOST_FAULTS:
            raise Diagnosis("host", f"axis {axis} was stopped at this step: {what}. {error}") from error
        raise Diagnosis(
            "blocked",
            f"axis {axis} has stopped at this step: {what}. Is it blocked on its way, did it meet an end stop whose "
            f"switch does not close, is a coupling loose, or the length of an encoder count wrong? {error}",
        ) from error


def prepare(device: Device, axis: str) -> None:
    """No knowledge of the axis, and gains that hold it softly whatever its mass is. What a commissioning before has
    found would hide what is to be found. The other axis, which is held at rest, is held softly until it is known."""
    other = "y" if axis == "x" else "x"
    unknown = device.read(f"plant_{other}.mass") == device.parameters[f"plant_{other}.mass"].default
    groups = tuple(f"{name}_{axis}." for name in ("friction", "screw", "transmission", "lead_map"))
    device.parameters.set(
        {name: device.parameters[name].default for name in device.parameters if name.startswith(groups)}
        | _CAREFUL
        | {f"friction_{axis}.presliding": _RISE_UM,
           "observer.bandwidth": 3300.0, f"plant_{axis}.mass": _UNKNOWN_KG, f"plant_{axis}.coulomb": 0.0,
           f"plant_{axis}.viscous": 0.0,
           f"following_window_{axis}": _RUNAWAY_NM, f"following_timeout_{axis}": 0}
        | ({f"plant_{other}.mass": _UNKNOWN_KG} if unknown else {})
    )  # fmt: skip


def catch_up(device: Device) -> None:
    """Handle what the drive, whose axes are off, has sent while this program computed or a user read a gauge: an answer
    would stand behind all that."""
    end_s = time.monotonic() + _CATCH_UP_S
    busy = True
    while busy and time.monotonic() < end_s:
        began_s = time.monotonic()
        device.link.handle_pending()
        busy = time.monotonic() - began_s >= HEARTBEAT_S


@contextmanager
def moving(device: Device, axis: str, stop_requested: Callable[[], bool]) -> Iterator[Mover]:
    """The axis with power and telemetry; without both afterwards, since this program may compute for long then, and an
    answer would stand behind all that was sent meanwhile."""
    with device.axes.enabled(also=TELEMETRY):
        yield Mover(device, axis, stop_requested)
    device.pdos.restore()
    device.faults.check()  # of the last moment


# --- direction --------------------------------------------------------------------------------------------------------
def direction(device: Device, axis: str, agreed: Agreed, stop_requested: Callable[[], bool]) -> float:
    """The breakaway force. Raises Diagnosis.

    Until the encoder has counted, the force swings at 8 Hz, so that an axis whose encoder is dead moves by
    F / (m w^2) at most, some millimetres, and not through its whole travel.
    """
    counts = False
    for share in _SHARES:
        force_N = share * agreed.force_N
        counts = counts or _counts(device, axis, force_N, stop_requested)
        found = _ramp(device, axis, force_N, stop_requested) if counts else None
        if found is not None and found > _MOST_BREAKAWAY * agreed.force_N:
            raise Diagnosis(
                "force",
                f"axis {axis} breaks away at {found:.0f} N, and {agreed.force_N:.0f} N are allowed, which is too "
                f"little to measure it: allow {found / _MOST_BREAKAWAY:.0f} N or more with --force",
            )
        if found is not None:
            return found
    raise Diagnosis(
        "jammed",
        f"axis {axis} does not move with {_SHARES[-1] * agreed.force_N:.0f} N: is it jammed or clamped, is its "
        "amplifier on and its force output connected, is its coupling tight, does its encoder count?",
    )


def _counts(device: Device, axis: str, force_N: float, stop_requested: Callable[[], bool]) -> bool:
    """Whether the encoder counts while the force swings fast, with a growing amplitude up to `force_N`."""
    least_m = _SEEN_COUNTS * encoder.count_m(device, axis)
    try:
        with moving(device, axis, stop_requested) as mover:
            return _swing(mover, force_N, _FAST, lambda moved_m, _: abs(moved_m) > least_m)
    except EmcyError as error:
        if error.code in _NO_RUNAWAY:
            raise
        return True  # it runs away


def _ramp(device: Device, axis: str, force_N: float, stop_requested: Callable[[], bool]) -> float | None:
    """Let the force swing slowly up to `force_N`; the force at which the axis broke away, None where it did not."""
    enough_m = max(_BROKEN_M, 20.0 * encoder.count_m(device, axis))
    work_J, last_m, largest_N = 0.0, 0.0, 0.0  # of what is loose, the place says nothing: the movement does

    def broken(moved_m: float, now_N: float) -> bool:
        nonlocal work_J, last_m, largest_N
        largest_N = max(largest_N, abs(now_N))
        if abs(moved_m - last_m) > 0.25 * enough_m:  # the loop may shake by less
            work_J += (moved_m - last_m) * now_N
            last_m = moved_m
        return abs(moved_m) > enough_m

    try:
        with moving(device, axis, stop_requested) as mover:
            broke = _swing(mover, force_N, _SLOW, broken)
    except EmcyError as error:
        if error.code in _NO_RUNAWAY:
            raise
        if work_J == 0.0:
            raise Diagnosis("unknown", f"axis {axis}: {error}") from error
        broke = True
    if broke and work_J < 0.0:
        raise Diagnosis(
            "polarity",
            f"axis {axis} moves against its force: encoder and force have opposite directions. Set "
            f"wiring_{axis}.invert_force=1, or wiring_{axis}.invert_encoder=1 if it counts down in the positive "
            "direction. Where it is the same with either setting, what is between motor and encoder is loose",
        )
    return largest_N if broke else None


def _swing(mover: Mover, force_N: float, periods: int, enough: Callable[[float, float], bool]) -> bool:
    """Let the force swing with a growing amplitude until `enough` of movement and force, m and N, is True; whether it
    was. Raises Diagnosis where the other axis moves more."""
    device, axis, i = mover.device, mover.axis, "xy".index(mover.axis)
    start_m = device.position_m()
    _begin_ramp(device, axis, force_N, periods)
    end_s = device.link.time_s + _RAMP_S + 2.0
    try:
        while device.link.time_s < end_s and int(device.read("excitation.state")) == 1:
            now_m = device.position_m()
            now_N = float(device.read(f"telemetry.force_{axis}"))
            moved_m, other_m = now_m[i] - start_m[i], now_m[1 - i] - start_m[1 - i]
            if abs(other_m) > max(_BROKEN_M, abs(moved_m)):  # whose own loop may move this one
                raise Diagnosis(
                    "swapped", f"the force of axis {axis} moves the other axis: motors or encoders are swapped"
                )
            if enough(moved_m, now_N):
                return True
            mover.pause(_WATCH_S)
    finally:
        device.write("excitation.command", 0)
    return False


def bind(device: Device, axis: str, agreed: Agreed, mass_kg: float, breakaway_N: float) -> None:
    """From now on the drive's own limit is the agreed force, and speed changes take half of what friction leaves."""
    force_N = min(agreed.force_N, float(device.read(f"plant_{axis}.force_limit")))
    most_umps2 = 0.5e6 * (force_N - breakaway_N) / mass_kg
    rates = {name: float(device.read(name)) for name in (f"profile_{way}eleration_{axis}" for way in ("acc", "dec"))}
    device.parameters.set(
        {f"plant_{axis}.force_limit": round(force_N, 3)}
        | {name: round(most_umps2) for name, rate in rates.items() if rate > most_umps2}
    )


def _begin_ramp(device: Device, axis: str, force_N: float, periods: int) -> None:
    for name, value in (
        ("axis", "xy".index(axis)), ("amplitude", round(force_N, 3)), ("window", _SWING_MS),
        ("settle", round(_RAMP_S * 1e3)), ("windows", 1),
    ):  # fmt: skip
        device.write(f"excitation.{name}", value)
    for k in range(response.LINES):
        device.write(f"excitation_periods.entry_{k + 1}", periods if k == 0 else 0)
    device.write("excitation.command", 1)


# --- mass, roughly ----------------------------------------------------------------------------------------------------
def rough(device: Device, axis: str, force_N: float, stop_requested: Callable[[], bool]) -> tuple[float, float]:
    """Mass and Coulomb friction from one sine at rest: with Y the position and U the force, -Re(U/Y) / w^2 is the mass,
    whatever the friction, and Im(U/Y) |Y| the friction's part, 4/pi of Coulomb friction."""
    device.parameters.set({f"following_window_{axis}": _ROUGH_NM})
    limit_N = 0.5 * float(device.read(f"plant_{axis}.force_limit"))
    setup = Setup((_ROUGH_HZ,), min(force_N, limit_N), 0.0, 0.5, 2, 0.4)
    control_hz = float(device.read("clock.control_hz"))
    count_m = encoder.count_m(device, axis)
    with moving(device, axis, stop_requested) as mover:
        windows = response.excite(mover, setup.hz, setup.force_N, setup, setup.windows, False)
    force, moved = np.mean(windows, axis=0)[:2, 0]
    position = moved * count_m / (1.0 - np.exp(-2j * np.pi * _ROUGH_HZ / control_hz))
    ratio = complex(force / position)
    mass_kg = -ratio.real / (2.0 * np.pi * _ROUGH_HZ) ** 2
    if not 0.3 < mass_kg < 1e5 or abs(position) < 5.0 * count_m:
        raise Diagnosis(
            "mass",
            f"axis {axis} moves by {abs(position) * 1e6:.1f} µm under {setup.force_N:.0f} N at {_ROUGH_HZ:g} Hz, which "
            "no mass does: is a coupling loose, or the length of an encoder count wrong?",
        )
    return mass_kg, max(0.0, ratio.imag * abs(position) * np.pi / 4.0)


# --- lost motion ------------------------------------------------------------------------------------------------------
def lost_motion(device: Device, axis: str, stop_requested: Callable[[], bool]) -> None:
    """Reverse the axis some times. Raises Diagnosis where the motor moves far before it takes the table along.

    Until then it has its own part of the friction alone, which shows in the force where there is no scale.
    """
    device.parameters.set({f"following_window_{axis}": _ROUGH_NM})
    with moving(device, axis, stop_requested) as mover:
        if float(device.read(f"second_encoder_{axis}.length")) > 0.0:  # a scale shows it at once
            shown = ScopeRecorder(device, axis, 2.0 * _LOST_M / _LOST_MPS)
            with mover.moving(-_LOST_MPS, _SETTLE_S):
                shown.start()
                _turn(mover, _LOST_MPS)
            lost = float(np.ptp(shown.read().ahead_m))
        else:
            lost_m = []
            for k in range(_REVERSALS):
                sign = 1.0 if k % 2 == 0 else -1.0
                recorder = Recorder(mover)
                with mover.moving(-sign * _LOST_MPS, _SETTLE_S):
                    recorder.start()
                    _turn(mover, sign * _LOST_MPS)
                    recording = recorder.stop()
                lost_m.append(_lost_m(sign * recording.position_m, sign * recording.force_N))
            lost = min(lost_m)  # cogging, too, lowers the force, but in one sense only
    if lost >= _LOOSE_M:
        raise Diagnosis(
            "coupling",
            f"the motor of axis {axis} moves {lost * 1e3:.1f} mm before it takes the table along: a coupling, a belt "
            "or the nut of the screw is loose",
        )


def _turn(mover: Mover, velocity_mps: float) -> None:
    mover.pause(_SETTLE_S)
    mover.run(velocity_mps)
    mover.pause(_LOST_M / _LOST_MPS)


def _lost_m(position_m: Floats, force_N: Floats) -> float:
    """How far the axis moves with a force well below that at the end, after the reversal at its least position."""
    way_m = position_m - np.min(position_m)
    way_m, force_N = way_m[np.argmin(way_m) :], force_N[np.argmin(way_m) :]
    enough_N = _TAKEN_ALONG * float(np.mean(force_N[way_m > 0.7 * way_m[-1]]))
    starts = np.arange(0.0, 0.7 * _LOST_M, _STEP_M)
    steps = [force_N[(way_m >= start) & (way_m < start + _STEP_M)] for start in starts]
    return _STEP_M * sum(len(step) > 0 and float(np.mean(step)) < enough_N for step in steps)


# --- length of a count ------------------------------------------------------------------------------------------------
def length_factor(device: Device, axis: str, agreed: Agreed, stop_requested: Callable[[], bool]) -> float:
    """What the mass is to be multiplied with, by the length of a count as it is now."""
    before_m = encoder.count_m(device, axis)
    device.parameters.set({f"homing_method_{axis}": encoder.method_of(device, axis)})
    with device.axes.enabled():
        found_m = encoder.length_m(device, axis, agreed.index_m, stop_requested)
    if found_m is None:
        raise Diagnosis(
            "index",
            f"axis {axis} has found no two index pulses; check the index input. Without index pulses leave out "
            "--index-distance, write index_m = 0 in the machine file, and measure a move with a gauge",
        )
    factor = found_m / before_m
    if abs(factor - 1.0) < _LENGTH_ERROR:
        return 1.0
    if agreed.encoder_known:
        raise Diagnosis(
            "encoder",
            f"axis {axis}: the length of an encoder count is wrong by a factor of {factor:.4g}: index pulses are "
            f"{agreed.index_m * 1e3:g} mm apart, the drive counts {agreed.index_m / factor * 1e3:.4g} mm. Set "
            f"plant_{axis}.encoder={found_m * 1e6:.6g}",
        )
    device.parameters.set({f"plant_{axis}.encoder": round(found_m * 1e6, 8)})
    return 1.0 / factor


def check_by_gauge(device: Device, axis: str, gauge: Gauge, stop_requested: Callable[[], bool]) -> None:
    """Move slowly, and compare what the drive counts with what the user has measured. Raises Diagnosis."""
    gauge.ready(axis)
    catch_up(device)
    with moving(device, axis, stop_requested) as mover:
        sign = 1.0 if mover.room_m(1.0) > mover.room_m(-1.0) else -1.0
        way_m = min(_GAUGED_M, 0.5 * mover.room_m(sign))
        start_m = mover.position_m()
        with mover.moving(sign * _GAUGED_MPS, 0.0):
            mover.pause(way_m / _GAUGED_MPS)
        mover.pause(_SETTLE_S)
        counted_m = abs(mover.position_m() - start_m)
    found_m = gauge.distance_m(axis, counted_m)
    catch_up(device)
    factor = found_m / counted_m
    if abs(factor - 1.0) > _GAUGE_ERROR:
        length_um = float(device.read(f"plant_{axis}.encoder"))
        raise Diagnosis(
            "encoder",
            f"axis {axis}: the length of an encoder count is wrong by a factor of {factor:.4g}: you have measured "
            f"{found_m * 1e3:.4g} mm, the drive has counted {counted_m * 1e3:.4g} mm. Set "
            f"plant_{axis}.encoder={length_um * factor:.6g}, and measure again",
        )


# --- travel -----------------------------------------------------------------------------------------------------------
def find_travel(
    device: Device, axis: str, agreed: Agreed, breakaway_N: float, stop_requested: Callable[[], bool]
) -> None:
    """Set the soft limits within the limit switches, where these come before them.

    The force is held small, so that an axis that meets its end stop, since a switch does not close, pushes gently.
    Raises Diagnosis then.
    """
    speed_mps = min(_TRAVEL_MPS, agreed.speed_mps)
    name = f"plant_{axis}.force_limit"
    limit_N = float(device.read(name))
    device.parameters.set({name: round(min(limit_N, max(_GENTLE_N, _GENTLE * breakaway_N)), 3)})
    for end, other in (("max", "min"), ("min", "max")):
        with device.axes.enabled():
            last_m = _last_m(device, axis, end, other, speed_mps, stop_requested)
        if last_m is not None:
            device.parameters.set({f"position_limit_{axis}.{end}": round(last_m / _NM)})
    device.parameters.set({name: limit_N})


def _last_m(
    device: Device, axis: str, end: str, other: str, speed_mps: float, stop_requested: Callable[[], bool]
) -> float | None:
    """Go to the limit switch of this end, and off it again; the last position before it, None where the soft limit
    comes first. Raises Diagnosis."""
    velocity_mps = speed_mps if end == "max" else -speed_mps
    limits_m = [float(device.read(f"position_limit_{axis}.{name}")) * _NM for name in ("min", "max")]
    longest_s = (limits_m[1] - limits_m[0]) / speed_mps + 2.0
    begun = _switches(device, axis)  # an axis may begin on one

    def wrong() -> bool:
        """Whether the switch of the other end has closed, which does not stop the drive."""
        return bool(_switches(device, axis) & ~begun & _SWITCHES[other])

    try:
        jog(device, {axis: velocity_mps}, longest_s, lambda: stop_requested() or wrong())
        if stop_requested():
            raise KeyboardInterrupt
        if wrong():
            raise Diagnosis(
                "direction",
                f"axis {axis} has met its {_ENDS[other]} limit switch on its way to the {_ENDS[end]} one: its positive "
                f"direction is reversed, or its switches are swapped. Set both wiring_{axis}.invert_force and "
                f"wiring_{axis}.invert_encoder to what they are not now, or swap the wires of the switches",
            )
        here_m = float(device.read(f"position_actual_{axis}")) * _NM
        if not _switches(device, axis):
            return None
        # off it, so that nothing stops there any more
        jog(device, {axis: -velocity_mps}, 2.0 * _OFF_SWITCH_M / speed_mps, stop_requested)
    except EmcyError as error:
        here_m = float(device.read(f"position_actual_{axis}")) * _NM
        raise Diagnosis(
            "switch",
            f"axis {axis} was stopped at {here_m * 1e3:.1f} mm on its way to the {_ENDS[end]} limit switch, and no "
            "switch has closed: it has met its end stop, or something is in its way. Check the switch and its "
            f"cable: digital_inputs_{axis} shows it ({error})",
        ) from error
    return here_m - math.copysign(_OFF_SWITCH_M, velocity_mps)


def _switches(device: Device, axis: str) -> int:
    return int(device.read(f"digital_inputs_{axis}")) & sum(_SWITCHES.values())
