# SPDX-License-Identifier: Apache-2.0
"""Identification of an axis with its own drive: direction, friction, mass, first mode, lag, cogging.

Every step moves little at first and checks before it goes on: a slow ramp of the force finds the direction, a sine of a
few Hz the mass roughly. Then the loop is fast enough to move at constant speeds, which give friction and cogging, and
to hold the axis while its frequency response is measured.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from kontur.commissioning import first_moves, fit, response, reversal, screw
from kontur.commissioning.bias import Mover
from kontur.commissioning.encoder import count_m
from kontur.commissioning.first_moves import Agreed, Diagnosis, explained
from kontur.commissioning.fit import Dynamics, Friction, Value
from kontur.commissioning.recording import Recording, Scan, ScopeRecorder, record, scan
from kontur.commissioning.response import Floats, Response, Setup
from kontur.commissioning.reversal import Presliding
from kontur.commissioning.screw import ORDERS, Harmonics, Screw, Transmission
from kontur.drive.device import Device
from kontur.machine import Axis

_SPEEDS_MPS = (0.0015, 0.003, 0.006, 0.012, 0.025, 0.05, 0.1, 0.2)
_LEADS_M = (0.002, 0.0025, 0.004, 0.005, 0.006, 0.008, 0.01, 0.012, 0.016, 0.02, 0.025, 0.03, 0.032, 0.04)
_SCAN_MPS = 0.02
_FAST_MPS, _FAST_S = 0.2, 8.0  # of a scan of the whole travel
_FAST_LEAST_S = 1.5  # that the travel takes
_NOISE_S = 0.15
_REVERSAL_MPS, _REVERSAL_S = 2e-4, 2.4
_SLIDE_MPS, _SLIDE_S = 2e-3, 0.5  # until all of the friction slips
_REVERSAL_ROOM_M = 5e-3
_ROUGH, _MOST = 0.9, 0.8  # of the force that is allowed: the slow sine, and the friction at most
_BIAS_MPS = 0.0873  # no whole number of Hz by common leads
_WINDOWS = 3  # of each line and direction: their scatter is the uncertainty of a point
_LOOSE_HZ = 20.0  # a first mode below is that of a loose coupling
_NM = 1e-9


@dataclass(frozen=True, eq=False)
class Identified:
    """What was found of an axis. `screw` and `presliding` are None where none was seen, `transmission` without scale.

    `encoder_m`: length of a count. `encoder_noise_m`: standard deviation of encoder and scale at rest without power.
    `noise_N`: scatter of the force demand. `speeds`: rows of speed and friction. `steps_s`: of each step,
    the drive's time.
    """

    breakaway_N: float
    encoder_m: float
    friction: Friction
    dynamics: Dynamics
    screw: Screw | None
    transmission: Transmission | None
    encoder_noise_m: tuple[Value, Value | None]
    noise_N: float
    presliding: Presliding | None
    response: Response
    speeds: tuple[tuple[float, float], ...]
    drive_s: float = 0.0
    steps_s: Mapping[str, float] = field(default_factory=dict)


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
    steps_s: dict[str, float] = {}

    @contextmanager
    def step(name: str, what: str) -> Iterator[None]:
        step_s = device.link.time_s
        with explained(axis, what, say):
            yield
        steps_s[name] = round(device.link.time_s - step_s, 3)

    if any(device.read(f"error_code_{one}") for one in "xy"):  # as where the bus was lost before
        device.axes.reset_faults()
    device.select_controller("cascade")
    first_moves.prepare(device, axis)
    with step("noise", "without power: noise of the encoder"):
        encoder_noise_m = _noise(device, axis)
    with step("direction", "the force grows slowly until the axis moves: direction, breakaway"):
        breakaway_N = first_moves.direction(device, axis, agreed, stop_requested)
    with step("rough", "a slow sine of a millimetre: mass, roughly"):
        sine_N = min(_ROUGH * agreed.force_N, 2.5 * breakaway_N)
        mass_kg, coulomb_N = first_moves.rough(device, axis, sine_N, stop_requested)
    first_moves.bind(device, axis, agreed, mass_kg, breakaway_N)
    device.parameters.set(
        {f"plant_{axis}.mass": round(mass_kg, 3), f"plant_{axis}.coulomb": round(0.8 * coulomb_N, 3)}
        | first_moves.FIRM | {f"following_window_{axis}": first_moves.MEASURE_NM}
    )  # fmt: skip
    if agreed.index_m > 0.0:
        with step("length", "from one index pulse to the next: length of an encoder count"):
            mass_kg *= first_moves.length_factor(device, axis, agreed, stop_requested)
        device.parameters.set({f"plant_{axis}.mass": round(mass_kg, 3)})
    elif agreed.gauge is not None:
        with step("length", "a slow move that you measure: length of an encoder count"):
            first_moves.check_by_gauge(device, axis, agreed.gauge, stop_requested)
    with step("lost_motion", "to and fro by some millimetres: lost motion"):
        first_moves.lost_motion(device, axis, stop_requested)
    if not agreed.encoder_known:
        with step("travel", "to the limit switches: free travel"):
            first_moves.find_travel(device, axis, agreed, breakaway_N, stop_requested)
    with (
        step("speeds", "constant speeds both ways, and reversals: friction, presliding, backlash"),
        first_moves.moving(device, axis, stop_requested) as mover,
    ):
        steps = _speeds(mover, agreed)
        agreed = replace(agreed, speed_mps=min(agreed.speed_mps, 1.05 * steps[-1][0]))
        reversals = _reversals(mover)
    with (
        step("scans", "one speed for long: cogging, ripple, and what a scale shows"),
        first_moves.moving(device, axis, stop_requested) as mover,
    ):
        pairs = _scans(mover, agreed)
    found = _friction(steps, None)
    damping_Nspm = fit.slope_Nspm(found, abs(pairs[0][0].velocity_mps))
    rough = screw.Load(lambda hz: np.full_like(hz, mass_kg), damping_Nspm)
    by_angle = screw.screw(pairs[0], rough, _LEADS_M)
    first_moves.catch_up(device)
    device.parameters.set(_friction_parameters(axis, found) | screw_parameters(axis, by_angle))
    with (
        step("response", "a small multisine on a constant speed: mass, first mode, lag and delay"),
        first_moves.moving(device, axis, stop_requested) as mover,
    ):
        measured = _response(mover, agreed, mass_kg)
    base = _base(device, axis, found)
    dynamics = fit.dynamics(measured, int(device.read("clock.control_hz")), base)
    first_moves.catch_up(device)
    if 0.0 < dynamics.resonance_Hz.value < _LOOSE_HZ:
        raise Diagnosis(
            "coupling",
            f"axis {axis} swings at {dynamics.resonance_Hz.value:.1f} Hz against its motor: a coupling, a belt or the "
            "nut of the screw is loose",
        )
    if by_angle is not None:  # by the machine as it is known now
        load = screw.Load(screw.mass_at(dynamics), damping_Nspm, dynamics.lag_delay_s.value)
        by_angle = screw.screw(pairs[0], load, (by_angle.lead_m,))
    if by_angle is not None:
        reversals = [by_angle.acting(one) for one in reversals]
    transmission = screw.transmission(pairs, dynamics, by_angle.lead_m if by_angle else None)
    presliding = reversal.presliding(reversals, dynamics, found)
    if presliding is not None:  # again, with the friction at rest
        found = _friction(steps, presliding.rest_N)
        presliding = reversal.presliding(reversals, dynamics, found) or presliding
    return Identified(
        breakaway_N=breakaway_N,
        encoder_m=base.encoder_m,
        friction=found,
        dynamics=dynamics,
        screw=by_angle,
        transmission=transmission,
        encoder_noise_m=encoder_noise_m,
        noise_N=float(np.std(np.diff(pairs[0][1].force_N)) / np.sqrt(2.0)),
        presliding=presliding,
        response=measured,
        speeds=tuple((v, f) for v, f, _ in steps),
        drive_s=device.link.time_s - began_s,
        steps_s=steps_s,
    )


# --- at rest ----------------------------------------------------------------------------------------------------------
def _noise(device: Device, axis: str) -> tuple[Value, Value | None]:
    """Noise of encoder and scale of an axis without power; below a fraction of a count nothing shows."""
    recorder = ScopeRecorder(device, axis, _NOISE_S)
    recorder.start()
    found = recorder.read()
    first_m, second_m = recorder.counts_m
    return fit.noise(found.first_m, first_m), None if found.second_m is None else fit.noise(found.second_m, second_m)


# --- friction, and what goes by the angle of the screw ----------------------------------------------------------------
def _speeds(mover: Mover, agreed: Agreed) -> list[tuple[float, float, float]]:
    """Rows of speed, mean friction of both directions and its standard deviation."""
    steps: list[tuple[float, float, float]] = []
    for speed in _SPEEDS_MPS:
        if speed > agreed.speed_mps or _expected_N(steps, speed) > _MOST * agreed.force_N:
            break
        both = []
        for sign in (1.0, -1.0):
            found = mover.steadily(partial(_at_speed, mover, sign * speed, agreed))
            if found is None:
                break
            half = len(found.force_N) // 2
            both.append((found.velocity_mps, float(np.mean(found.force_N)), _deviation(found.force_N), half))
        if len(both) == 2:
            (up, up_N, up_s, _), (down, down_N, down_s, _) = both
            steps.append((0.5 * (up - down), 0.5 * (up_N - down_N), 0.5 * float(np.hypot(up_s, down_s))))
    if len(steps) < 4:
        raise Diagnosis(
            "travel",
            f"axis {mover.axis} has too little travel or speed for its friction: {len(steps)} speeds were measured; "
            f"widen position_limit_{mover.axis} or allow more speed",
        )
    return steps


def _expected_N(steps: Sequence[tuple[float, float, float]], speed_mps: float) -> float:
    """The friction at a speed, from the line through the last two."""
    if len(steps) < 2:
        return 0.0
    (slow, slow_N, _), (fast, fast_N, _) = steps[-2:]
    return fast_N + (speed_mps - fast) * max(0.0, fast_N - slow_N) / (fast - slow)


def _at_speed(mover: Mover, velocity_mps: float, agreed: Agreed) -> Recording | None:
    """None: there is too little travel."""
    speed, sign = abs(velocity_mps), math.copysign(1.0, velocity_mps)
    duration_s = min(1.0, max(0.7, 0.05 / speed))
    if mover.longest_s(speed, sign) < min(duration_s, 0.6):
        middle_m = 0.5 * (mover.low_m + mover.high_m)
        mover.go(middle_m - sign * 0.45 * (mover.high_m - mover.low_m), min(0.05, agreed.speed_mps))
    duration_s = min(duration_s, mover.longest_s(speed, sign))
    if duration_s < 0.25:
        return None
    with mover.moving(velocity_mps, 0.3 if speed < 0.05 else 0.15):
        return record(mover, duration_s)


def _scans(mover: Mover, agreed: Agreed) -> list[tuple[Scan, Scan]]:
    """Up and down at a slow speed; where there is a scale, along the whole travel at a high one, too."""
    if mover.longest_s(_SCAN_MPS, 1.0) < 3.0:
        mover.go(mover.low_m, min(0.05, agreed.speed_mps))
    speed_mps = min(_SCAN_MPS, agreed.speed_mps)
    up, down = (scan(mover, sign * speed_mps, 4.0, 0.3) for sign in (1.0, -1.0))
    if up.second_m is None:
        return [(up, down)]
    fast_mps = min(_FAST_MPS, agreed.speed_mps, (mover.high_m - mover.low_m) / _FAST_LEAST_S)
    mover.go(mover.low_m, min(0.1, agreed.speed_mps))
    return [(up, down), (scan(mover, fast_mps, _FAST_S, 0.3), scan(mover, -fast_mps, _FAST_S, 0.3))]


def _reversals(mover: Mover) -> list[Scan]:
    """Slow reversals, the first one to the positive direction. The feedforward of the friction builds up slowly
    there (first_moves.prepare): one that jumps would be a blow."""
    found = []
    if mover.room_m(-1.0) < _REVERSAL_ROOM_M:
        mover.go(mover.low_m + 2.0 * _REVERSAL_ROOM_M, _SCAN_MPS)
    recorder = ScopeRecorder(mover.device, mover.axis, _REVERSAL_S)
    with mover.moving(-_SLIDE_MPS, _SLIDE_S):
        mover.run(-_REVERSAL_MPS)
        mover.pause(_SLIDE_S)
        for k in range(2):
            recorder.start()
            mover.pause(0.05)
            mover.run(_REVERSAL_MPS if k % 2 == 0 else -_REVERSAL_MPS)
            recorder.wait(mover)
            found.append(recorder.read())
    return found


def _friction(steps: list[tuple[float, float, float]], rest_N: Value | None) -> Friction:
    """Of the speeds, and of what the reversals have shown at rest."""
    rows = steps if rest_N is None else [(0.0, rest_N.value, 0.5 * rest_N.uncertainty), *steps]
    return fit.friction([v for v, _, _ in rows], [f for _, f, _ in rows], [s for _, _, s in rows])


def _deviation(force_N: Floats) -> float:
    """Standard deviation of the mean, by the means of ten parts."""
    parts = [float(np.mean(part)) for part in np.array_split(force_N, min(10, len(force_N)))]
    return float(np.std(parts) / np.sqrt(len(parts)))


def _friction_parameters(axis: str, found: Friction) -> dict[str, float]:
    return {
        f"plant_{axis}.viscous": round(found.viscous_Nspm.value, 3),
        f"plant_{axis}.coulomb": round(found.coulomb_N.value, 3),
    }


def screw_parameters(axis: str, found: Screw | None) -> dict[str, float]:
    """What cancels it in the drive (object 2106h)."""
    if found is None:
        return {}
    values = {f"screw_{axis}.lead": round(found.lead_m * 1e6, 3)}
    nothing = Harmonics((0.0,) * len(ORDERS), (0.0,) * len(ORDERS), 0.0)
    for name, one, digits in (("cogging", found.cogging, 3), ("ripple", found.ripple, 6)):
        for n, (cos, sin) in enumerate(zip((one or nothing).cos, (one or nothing).sin, strict=True), 1):
            values |= {f"screw_{axis}.{name}_cos_{n}": round(cos, digits)}
            values |= {f"screw_{axis}.{name}_sin_{n}": round(sin, digits)}
    return values


# --- frequency response -----------------------------------------------------------------------------------------------
def _response(mover: Mover, agreed: Agreed, mass_kg: float) -> Response:
    """Small enough that the table does not leave a flank of its backlash: 0.15 N/kg, at a speed with much friction."""
    speed_mps = min(_BIAS_MPS, agreed.speed_mps, 0.2 * (mover.high_m - mover.low_m))
    force_N = min(0.5 * agreed.force_N, max(8.0, 0.15 * mass_kg))
    low = Setup(response.lines(8.0, 60.0, 8, 1.0), force_N, speed_mps, 1.0, _WINDOWS, 0.3)
    high = Setup(response.lines(24.0, 900.0, 24, 0.5), force_N, speed_mps, 0.5, _WINDOWS, 0.2)
    parts = [
        response.measure(mover.device, mover.axis, setup, stop_requested=mover.stop_requested) for setup in (low, high)
    ]
    return response.joined(parts)


def _base(device: Device, axis: str, found: Friction) -> Axis:
    """What the fit of the response takes as known."""
    low, high = (float(device.read(f"position_limit_{axis}.{end}")) * _NM for end in ("min", "max"))
    return Axis(
        mass_kg=1.0,
        viscous_Nspm=found.viscous_Nspm.value,
        coulomb_N=found.coulomb_N.value,
        force_limit_N=float(device.read(f"plant_{axis}.force_limit")),
        encoder_m=count_m(device, axis),
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
