# SPDX-License-Identifier: Apache-2.0
"""Identification of an axis with its own drive: direction, friction, mass, first mode, lag, cogging.

Every step moves little at first and checks before it goes on: a slow ramp of the force finds the direction, a sine of a
few Hz the mass roughly. Then the loop is fast enough to move at constant speeds, which give friction and cogging, and
to hold the axis while its frequency response is measured.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from kontur.commissioning import encoder, fit, response
from kontur.commissioning.bias import Mover
from kontur.commissioning.fit import Cogging, Dynamics, Friction, Value
from kontur.commissioning.recording import Recorder, record
from kontur.commissioning.response import Floats, Response, Setup
from kontur.drive.device import Device
from kontur.drive.single_axis import jog
from kontur.errors import DeviceError, EmcyError
from kontur.machine import Axis

_CAREFUL = {"cascade.position_gain": 10.0, "cascade.velocity_gain": 15.0, "cascade.integral_gain": 1.0}
_FIRM = {"cascade.position_gain": 25.0, "cascade.velocity_gain": 60.0, "cascade.integral_gain": 15.0}
_RUNAWAY_NM, _ROUGH_NM, _MEASURE_NM = 500_000, 5_000_000, 3_000_000  # following window of each step
_SHARES = (0.05, 0.15, 0.45, 1.0)  # of the force that is allowed, for the ramp, one after the other
_SEEN_M, _SEEN_COUNTS = 6e-6, 4  # a movement this large shows the direction
_BROKEN_M = 1.2e-4  # beyond presliding
_RAMP_S = 2.0
_WATCH_S = 0.002
_TRAVEL_MPS, _OFF_SWITCH_M = 0.03, 3e-3
_LENGTH_ERROR = 0.005  # of a count, relative, that may be
_ROUGH_HZ = 8.0
_SPEEDS_MPS = (0.0015, 0.003, 0.006, 0.012, 0.025, 0.05, 0.1, 0.2)
_LEADS_M = (0.002, 0.0025, 0.004, 0.005, 0.006, 0.008, 0.01, 0.012, 0.016, 0.02, 0.025, 0.03, 0.032, 0.04)
_SCAN_MPS = 0.02
_REVERSAL_MPS = 2e-4
_BIAS_MPS = 0.0873  # no whole number of Hz by common leads
_NM = 1e-9


class Diagnosis(DeviceError):
    """What is wrong with an axis, in words; nothing was saved. `kind` is one word for it."""

    def __init__(self, kind: str, text: str) -> None:
        self.kind = kind
        super().__init__(text)


@dataclass(frozen=True)
class Agreed:
    """What was agreed: the largest force and speed. The travel is that of the drive's soft limits.

    `index_m`: distance of index pulses, 0: not known. By it the length of a count is checked, or found where it is not
    `encoder_known`.
    """

    force_N: float
    speed_mps: float = 0.2
    index_m: float = 0.0
    encoder_known: bool = True


@dataclass(frozen=True, eq=False)
class Identified:
    """What was found of an axis. `cogging` and `presliding_m` are None where none was seen.

    `encoder_m`: length of a count. `noise_N`: scatter of the force demand. `speeds`: rows of speed and friction.
    """

    breakaway_N: float
    encoder_m: float
    friction: Friction
    dynamics: Dynamics
    cogging: Cogging | None
    noise_N: float
    presliding_m: Value | None
    response: Response
    speeds: tuple[tuple[float, float], ...]
    drive_s: float = 0.0


def identify(
    device: Device,
    axis: str,
    agreed: Agreed,
    say: Callable[[str], None] = lambda text: None,
    stop_requested: Callable[[], bool] = lambda: False,
) -> Identified:
    """Identify `axis` of a drive whose axes are off, which keeps the parameters that it gets meanwhile.

    Raises Diagnosis for what is wrong with the axis; KeyboardInterrupt at a requested stop.
    """
    began_s = device.link.time_s
    device.select_controller("cascade")
    _prepare(device, axis)
    say(f"{axis}: the force grows slowly until the axis moves: direction, breakaway")
    breakaway_N = _direction(device, axis, agreed, stop_requested)
    say(f"{axis}: a slow sine of a millimetre: mass, roughly")
    mass_kg, coulomb_N = _rough(device, axis, min(agreed.force_N, 2.5 * breakaway_N), stop_requested)
    device.parameters.set(
        {f"plant_{axis}.mass": round(mass_kg, 3), f"plant_{axis}.coulomb": round(0.8 * coulomb_N, 3)}
        | _FIRM | {f"following_window_{axis}": _MEASURE_NM}
    )  # fmt: skip
    if agreed.index_m > 0.0:
        say(f"{axis}: from one index pulse to the next: length of an encoder count")
        mass_kg *= _check_encoder(device, axis, agreed, stop_requested)
        device.parameters.set({f"plant_{axis}.mass": round(mass_kg, 3)})
    if not agreed.encoder_known:
        say(f"{axis}: to the limit switches: free travel")
        _find_travel(device, axis, agreed, stop_requested)
    say(f"{axis}: constant speeds both ways: friction, cogging")
    with _moving(device, axis, stop_requested) as mover:
        steps, runs, noise_N = _speeds(mover, agreed)
        reversals = _reversals(mover)
    found = fit.friction([v for v, _, _ in steps], [f for _, f, _ in steps], [s for _, _, s in steps])
    cogging = fit.cogging(runs, mass_kg, _LEADS_M)
    device.parameters.set(_friction_parameters(axis, found) | cogging_parameters(axis, cogging))
    say(f"{axis}: a small multisine on a constant speed: mass, first mode, lag and delay")
    with _moving(device, axis, stop_requested) as mover:
        measured = _response(mover, agreed, mass_kg)
    base = _base(device, axis, found)
    dynamics = fit.dynamics(measured, int(device.read("clock.control_hz")), base)
    if cogging is not None:  # by the mass as it is known now
        cogging = fit.cogging(runs, dynamics.mass_kg.value, (cogging.lead_m,))
    return Identified(
        breakaway_N=breakaway_N,
        encoder_m=base.encoder_m,
        friction=found,
        dynamics=dynamics,
        cogging=cogging,
        noise_N=noise_N,
        presliding_m=fit.presliding(reversals, _stretch_m(dynamics, found)),
        response=measured,
        speeds=tuple((v, f) for v, f, _ in steps),
        drive_s=device.link.time_s - began_s,
    )


def _prepare(device: Device, axis: str) -> None:
    """No knowledge of the axis, and gains that hold it softly whatever its mass is."""
    device.parameters.set(
        _CAREFUL
        | {"observer.bandwidth": 3300.0, f"plant_{axis}.mass": 30.0, f"plant_{axis}.coulomb": 0.0,
           f"plant_{axis}.viscous": 0.0,
           f"following_window_{axis}": _RUNAWAY_NM, f"following_timeout_{axis}": 0}
    )  # fmt: skip


@contextmanager
def _moving(device: Device, axis: str, stop_requested: Callable[[], bool]) -> Iterator[Mover]:
    with device.axes.enabled():
        yield Mover(device, axis, stop_requested)


# --- direction --------------------------------------------------------------------------------------------------------
def _direction(device: Device, axis: str, agreed: Agreed, stop_requested: Callable[[], bool]) -> float:
    """The breakaway force. Raises Diagnosis."""
    for share in _SHARES:
        found = _ramp(device, axis, share * agreed.force_N, stop_requested)
        if found is not None:
            return found
    raise Diagnosis(
        "jammed",
        f"axis {axis} does not move with {_SHARES[-1] * agreed.force_N:.0f} N: is it jammed or clamped, is its "
        "amplifier on and its force output connected, does its encoder count?",
    )


def _ramp(device: Device, axis: str, force_N: float, stop_requested: Callable[[], bool]) -> float | None:
    """Let the force swing slowly up to `force_N`; the force at which the axis broke away, None where it did not."""
    count_m = float(device.read(f"plant_{axis}.encoder")) * 1e-6
    i = "xy".index(axis)
    work, largest_N = 0.0, 0.0
    broke = False
    try:
        with _moving(device, axis, stop_requested) as mover:
            start_m = device.position_m()
            _begin_ramp(device, axis, force_N)
            end_s = device.link.time_s + _RAMP_S + 2.0
            try:
                while device.link.time_s < end_s and int(device.read("excitation.state")) == 1:
                    now_m = device.position_m()
                    now_N = float(device.read(f"telemetry.force_{axis}"))
                    moved_m, other_m = now_m[i] - start_m[i], now_m[1 - i] - start_m[1 - i]
                    largest_N = max(largest_N, abs(now_N))
                    if abs(moved_m) > _SEEN_COUNTS * count_m:
                        work += moved_m * now_N
                    if abs(moved_m) > max(_BROKEN_M, 20.0 * count_m):
                        broke = True
                        break
                    if abs(other_m) > 2.0 * _BROKEN_M:
                        raise Diagnosis(
                            "swapped",
                            f"the force of axis {axis} moves the other axis: motors or encoders are swapped",
                        )
                    mover.pause(_WATCH_S)
            finally:
                device.write("excitation.command", 0)
    except EmcyError as error:
        if work == 0.0:
            raise Diagnosis("unknown", f"axis {axis}: {error}") from error
        broke = True
    if broke and work < 0.0:
        raise Diagnosis(
            "polarity",
            f"axis {axis} moves against its force: encoder and force have opposite directions. Set "
            f"wiring_{axis}.invert_force=1, or wiring_{axis}.invert_encoder=1 if it counts down in the positive "
            "direction",
        )
    return largest_N if broke else None


def _begin_ramp(device: Device, axis: str, force_N: float) -> None:
    for name, value in (
        ("axis", "xy".index(axis)), ("amplitude", round(force_N, 3)), ("window", 5000),
        ("settle", round(_RAMP_S * 1e3)), ("windows", 1),
    ):  # fmt: skip
        device.write(f"excitation.{name}", value)
    for k in range(response.LINES):
        device.write(f"excitation_periods.entry_{k + 1}", 1 if k == 0 else 0)
    device.write("excitation.command", 1)


# --- mass, roughly ----------------------------------------------------------------------------------------------------
def _rough(device: Device, axis: str, force_N: float, stop_requested: Callable[[], bool]) -> tuple[float, float]:
    """Mass and Coulomb friction from one sine at rest: with Y the position and U the force, -Re(U/Y) / w^2 is the mass,
    whatever the friction, and Im(U/Y) |Y| the friction's part, 4/pi of Coulomb friction."""
    device.parameters.set({f"following_window_{axis}": _ROUGH_NM})
    limit_N = 0.5 * float(device.read(f"plant_{axis}.force_limit"))
    setup = Setup((_ROUGH_HZ,), min(force_N, limit_N), 0.0, 0.5, 2, 0.4)
    control_hz = float(device.read("clock.control_hz"))
    count_m = float(device.read(f"plant_{axis}.encoder")) * 1e-6
    with _moving(device, axis, stop_requested) as mover:
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


# --- length of a count ------------------------------------------------------------------------------------------------
def _check_encoder(device: Device, axis: str, agreed: Agreed, stop_requested: Callable[[], bool]) -> float:
    """What the mass is to be multiplied with, by the length of a count as it is now."""
    before_m = float(device.read(f"plant_{axis}.encoder")) * 1e-6
    device.parameters.set({f"homing_method_{axis}": encoder.method_of(device, axis)})
    with device.axes.enabled():
        found_m = encoder.length_m(device, axis, agreed.index_m, stop_requested)
    if found_m is None:
        raise Diagnosis(
            "index",
            f"axis {axis} has found no two index pulses; leave out the index distance, or check the index input",
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


def _find_travel(device: Device, axis: str, agreed: Agreed, stop_requested: Callable[[], bool]) -> None:
    """Set the soft limits within the limit switches, where these come before them."""
    speed_mps = min(_TRAVEL_MPS, agreed.speed_mps)
    for end, sign in (("max", 1.0), ("min", -1.0)):
        with device.axes.enabled():
            limits_m = [float(device.read(f"position_limit_{axis}.{name}")) * _NM for name in ("min", "max")]
            longest_s = (limits_m[1] - limits_m[0]) / speed_mps + 2.0
            jog(device, {axis: sign * speed_mps}, longest_s, stop_requested)
            if stop_requested():
                raise KeyboardInterrupt
            on_switch = int(device.read(f"digital_inputs_{axis}")) & 3 != 0
            here_m = float(device.read(f"position_actual_{axis}")) * _NM
            if on_switch:  # off it again, so that nothing stops there any more
                jog(device, {axis: -sign * speed_mps}, 2.0 * _OFF_SWITCH_M / speed_mps, stop_requested)
        if on_switch:
            device.parameters.set({f"position_limit_{axis}.{end}": round((here_m - sign * _OFF_SWITCH_M) / _NM)})


# --- friction and cogging ---------------------------------------------------------------------------------------------
def _speeds(
    mover: Mover, agreed: Agreed
) -> tuple[list[tuple[float, float, float]], list[tuple[Floats, Floats, float]], float]:
    """Rows of speed, mean friction of both directions and its standard deviation; the runs of the scan for cogging; the
    scatter of the force."""
    steps, runs, noise_N = [], [], 0.0
    for speed in _SPEEDS_MPS:
        if speed > agreed.speed_mps:
            break
        both = []
        for sign in (1.0, -1.0):
            duration_s = min(1.6, max(0.8, 0.05 / speed))
            if mover.longest_s(speed, sign) < min(duration_s, 0.6):
                middle_m = 0.5 * (mover.low_m + mover.high_m)
                mover.go(middle_m - sign * 0.45 * (mover.high_m - mover.low_m), min(0.05, agreed.speed_mps))
            duration_s = min(duration_s, mover.longest_s(speed, sign))
            if duration_s < 0.25:
                break
            with mover.moving(sign * speed, 0.3 if speed < 0.05 else 0.15):
                found = record(mover, duration_s)
            half = len(found.force_N) // 2
            both.append((found.velocity_mps, float(np.mean(found.force_N)), _deviation(found.force_N), half))
        if len(both) == 2:
            (up, up_N, up_s, _), (down, down_N, down_s, _) = both
            steps.append((0.5 * (up - down), 0.5 * (up_N - down_N), 0.5 * float(np.hypot(up_s, down_s))))
    for sign in (1.0, -1.0):
        if mover.longest_s(_SCAN_MPS, sign) < 3.0:
            mover.go(mover.low_m if sign > 0.0 else mover.high_m, 0.05)
        with mover.moving(sign * _SCAN_MPS, 0.3):
            found = record(mover, min(4.0, mover.longest_s(_SCAN_MPS, sign)))
        runs.append((found.position_m, found.force_N, found.velocity_mps))
        noise_N = float(np.std(np.diff(found.force_N)) / np.sqrt(2.0))
    if len(steps) < 4:
        raise Diagnosis(
            "travel",
            f"axis {mover.axis} has too little travel or speed for its friction: {len(steps)} speeds were measured; "
            f"widen position_limit_{mover.axis} or allow more speed",
        )
    return steps, runs, noise_N


def _reversals(mover: Mover) -> list[tuple[Floats, Floats]]:
    """Distance since the reversal, and the force by that of both senses, of slow reversals."""
    found = []
    for k in range(4):
        sign = 1.0 if k % 2 == 0 else -1.0
        recorder = Recorder(mover)
        with mover.moving(-sign * _REVERSAL_MPS, 0.8):
            recorder.start()
            mover.pause(0.2)
            mover.run(sign * _REVERSAL_MPS)
            mover.pause(0.8)
            recording = recorder.stop()
        position_m, force_N = sign * recording.position_m, sign * recording.force_N
        turn = int(np.argmin(position_m))
        before, after = float(np.mean(force_N[: max(3, turn // 2)])), float(np.mean(force_N[-20:]))
        if after - before > 0.0 and turn < len(position_m) - 20:
            share = 2.0 * (force_N - before) / (after - before) - 1.0
            found.append((position_m[turn:] - position_m[turn], share[turn:]))
    return found


def _deviation(force_N: Floats) -> float:
    """Standard deviation of the mean, by the means of ten parts."""
    parts = [float(np.mean(part)) for part in np.array_split(force_N, min(10, len(force_N)))]
    return float(np.std(parts) / np.sqrt(len(parts)))


def _friction_parameters(axis: str, found: Friction) -> dict[str, float]:
    return {
        f"plant_{axis}.viscous": round(found.viscous_Nspm.value, 3),
        f"plant_{axis}.coulomb": round(found.coulomb_N.value, 3),
    }


def _stretch_m(dynamics: Dynamics, found: Friction) -> float:
    """How far half of the friction stretches the spring between motor and table."""
    if dynamics.resonance_Hz.value == 0.0:
        return 0.0
    share = dynamics.motor_share.value
    stiffness_Npm = dynamics.mass_kg.value * share * (1.0 - share) * (2.0 * np.pi * dynamics.resonance_Hz.value) ** 2
    return float(0.5 * found.coulomb_N.value * found.breakaway.value / stiffness_Npm)


def cogging_parameters(axis: str, found: Cogging | None) -> dict[str, float]:
    """What cancels it in the drive (object 2106h)."""
    if found is None:
        return {}
    values = {f"screw_{axis}.lead": round(found.lead_m * 1e6, 3)}
    for n, (cos_N, sin_N) in enumerate(zip(found.cos_N, found.sin_N, strict=True), 1):
        values |= {f"screw_{axis}.cogging_cos_{n}": round(cos_N, 3), f"screw_{axis}.cogging_sin_{n}": round(sin_N, 3)}
    return values


# --- frequency response -----------------------------------------------------------------------------------------------
def _response(mover: Mover, agreed: Agreed, mass_kg: float) -> Response:
    """Small enough that the table does not leave a flank of its backlash: 0.15 N/kg, at a speed with much friction."""
    speed_mps = min(_BIAS_MPS, agreed.speed_mps, 0.2 * (mover.high_m - mover.low_m))
    force_N = min(agreed.force_N, max(8.0, 0.15 * mass_kg))
    low = Setup(response.lines(8.0, 60.0, 8, 1.0), force_N, speed_mps, 1.0, 1, 0.3)
    high = Setup(response.lines(24.0, 900.0, 24, 0.5), force_N, speed_mps, 0.5, 1, 0.2)
    parts = [response.measure(mover.device, mover.axis, setup, stop_requested=lambda: False) for setup in (low, high)]
    return response.joined(parts)


def _base(device: Device, axis: str, found: Friction) -> Axis:
    """What the fit of the response takes as known."""
    encoder_m = float(device.read(f"plant_{axis}.encoder")) * 1e-6
    low, high = (float(device.read(f"position_limit_{axis}.{end}")) * _NM for end in ("min", "max"))
    return Axis(
        mass_kg=1.0,
        viscous_Nspm=found.viscous_Nspm.value,
        coulomb_N=found.coulomb_N.value,
        force_limit_N=float(device.read(f"plant_{axis}.force_limit")),
        encoder_m=encoder_m,
        travel_m=(low, high),
        soft_limit_m=(low, high),
        velocity_mps=0.3,
        acceleration_mps2=5.0,
        jerk_mps3=100.0,
        breakaway=max(1.0, found.breakaway.value),
        stribeck_mps=found.stribeck_mps.value,
        friction_share=0.5,
        scale_m=float(device.read(f"second_encoder_{axis}.length")) * 1e-6,
    )
