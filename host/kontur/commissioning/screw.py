# SPDX-License-Identifier: Apache-2.0
"""Fits of scans at constant speed: what goes by the angle of the screw, and what a scale shows between motor and table.

A cogging force is the same in both directions, and ripple, which is a share of the force, changes its sign with that of
the friction. A gap is there at each speed, and the stretch of the spring grows with the friction.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from kontur.commissioning.fit import Dynamics, Value
from kontur.commissioning.recording import Scan
from kontur.commissioning.response import Complex, Floats

ORDERS = (1, 2, 6)
"""Periods a turn of what the drive cancels (object 2106h)."""
_BESIDE = (0.6, 1.4, 2.6, 3.4, 4.6, 5.4, 6.6, 7.4)  # orders that nothing goes by: what is there is scatter
_INERTIA_ERROR = 0.05  # of the force that accelerates the axis at a harmonic
_MODEL_ERROR = 0.03  # of a figure, for what the model does not have
_SEEN = 1.5  # times its uncertainty
_STILL = 0.1
_SECTIONS = 10  # of a scan, whose scatter is the uncertainty of its means
_POINTS = 64  # of a map (2109h)
_SHARE_PRIOR = 0.3  # standard deviation of the table's share of the friction, around one half


@dataclass(frozen=True)
class Harmonics:
    """A sum of the harmonics ORDERS of the angle: cosine and sine part of each. `uncertainty`: of the peak."""

    cos: tuple[float, ...]
    sin: tuple[float, ...]
    uncertainty: float

    @property
    def peak(self) -> Value:
        """The sum of all amplitudes, which is what a machine file has."""
        return Value(float(np.sum(np.hypot(self.cos, self.sin))), self.uncertainty)

    def at(self, angle: Floats) -> Floats:
        orders = np.outer(angle, ORDERS)
        return np.asarray(np.cos(orders) @ np.array(self.cos) + np.sin(orders) @ np.array(self.sin))

    @property
    def seen(self) -> bool:
        return self.peak.value > _SEEN * self.uncertainty


@dataclass(frozen=True)
class Screw:
    """Forces by the angle of the screw, `lead_m` a turn; the angle is 0 at count 0. None: not seen.

    `cogging`: N. `ripple`: relative change of the motor's force.
    """

    lead_m: float
    cogging: Harmonics | None
    ripple: Harmonics | None

    def acting(self, scan: Scan) -> Scan:
        """The scan with the force that acts, in place of the demand."""
        angle = 2.0 * np.pi * scan.first_m / self.lead_m
        force_N = scan.force_N
        if self.ripple is not None:
            force_N = force_N * (1.0 + self.ripple.at(angle))
        if self.cogging is not None:
            force_N = force_N + self.cogging.at(angle)
        return dataclasses.replace(scan, force_N=force_N)


@dataclass(frozen=True)
class Transmission:
    """What a scale shows of what lies between the first encoder and the table.

    `lead_error`: m per m of travel. `lead_once`: once a turn, of screw and encoder on it together, m, by the angle that
    is 0 at the user's position 0; None where the lead is not known. `backlash_m`: whole gap. `friction_share`: at the
    table, None where no first mode says how stiff the spring is. `lead_map`: rows of user's position and error, m.
    """

    lead_error: Value
    lead_once: Harmonics | None
    backlash_m: Value
    friction_share: Value | None
    lead_map: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Load:
    """What a demand for force moves: the mass by frequency, as of mass_at(); by how much the friction rises with speed,
    N per m/s, at the speed of the scans; and the delay of the force behind its demand. Damping and delay turn the phase
    the one way up and the other way down, as ripple does."""

    mass_kg: Callable[[Floats], Floats]
    damping_Nspm: float = 0.0
    delay_s: float = 0.0


def mass_at(found: Dynamics) -> Callable[[Floats], Floats]:
    """The mass that a force at the motor moves at the place of the encoder, kg, by frequencies in Hz.

    Of two masses on a spring without damping. Near the motor's antiresonance, where nothing moves, it is limited.
    """

    def mass_kg(hz: Floats) -> Floats:
        resonance_Hz = found.resonance_Hz.value
        if resonance_Hz == 0.0:
            return np.full_like(hz, found.mass_kg.value)
        ratio = 1.0 - (hz / resonance_Hz) ** 2
        if found.encoder_at == "motor":
            still = 1.0 - (hz / resonance_Hz) ** 2 / found.motor_share.value
            ratio = ratio / np.where(np.abs(still) < _STILL, np.copysign(_STILL, still), still)
        return np.asarray(found.mass_kg.value * ratio)

    return mass_kg


# --- forces by angle --------------------------------------------------------------------------------------------------
def screw(scans: Sequence[Scan], load: Load, leads_m: Sequence[float]) -> Screw | None:
    """Cogging and ripple from scans in both directions, for the most likely of `leads_m`; None: neither is seen."""
    fits = {lead_m: [_by_angle(scan, lead_m, load) for scan in scans] for lead_m in leads_m}
    lead_m = min(fits, key=lambda lead_m: sum(one.left for one in fits[lead_m]))
    force_N = np.array([np.mean(scan.force_N) for scan in scans])
    basis = np.column_stack([np.ones_like(force_N), force_N])
    parts = np.empty((2, len(ORDERS)), dtype=np.complex128)
    sigma2 = np.empty((2, len(ORDERS)))
    for k in range(len(ORDERS)):
        sigma = np.array([one.sigma[k] for one in fits[lead_m]])
        weighed = basis / sigma[:, None]
        parts[:, k] = np.linalg.lstsq(weighed, np.array([-one.part[k] for one in fits[lead_m]]) / sigma, rcond=None)[0]
        sigma2[:, k] = np.diag(np.linalg.pinv(weighed.T @ weighed))
    cogging, ripple = (_harmonics(part, float(np.sum(s))) for part, s in zip(parts, sigma2, strict=True))
    if not (cogging.seen or ripple.seen):
        return None
    return Screw(lead_m, cogging if cogging.seen else None, ripple if ripple.seen else None)


@dataclass(frozen=True, eq=False)
class _ByAngle:
    """`part` (3,): of the force, Re(part exp(i order angle)), less what accelerates the axis; `sigma` (3,): its
    scatter. `left`: share of the force's variance that is left."""

    part: Complex
    sigma: Floats
    left: float


def _by_angle(scan: Scan, lead_m: float, moved: Load) -> _ByAngle:
    """What accelerates the axis at each harmonic, and what overcomes its friction there, is put back: its deviation
    from uniform motion is known."""
    angle = 2.0 * np.pi * scan.first_m[:, None] / lead_m * np.array(ORDERS)
    cos, sin = np.cos(angle), np.sin(angle)
    free = _even(np.hstack([cos, sin]))
    swing = np.linalg.lstsq(free, _even(scan.first_m), rcond=None)[0]
    n = len(ORDERS)
    along, across = swing[:n], swing[n:]  # of cos and of sin
    omega = 2.0 * np.pi * scan.velocity_mps / lead_m * np.array(ORDERS)  # its sign is that of the direction
    spring_Npm = moved.mass_kg(np.abs(omega) / (2.0 * np.pi)) * omega**2
    inertia_N = -cos @ (spring_Npm * along) - sin @ (spring_Npm * across)
    damping_N = moved.damping_Nspm * (cos @ (omega * across) - sin @ (omega * along))
    acting_N = np.interp(scan.time_s - moved.delay_s, scan.time_s, scan.force_N)
    load = _even(acting_N - inertia_N - damping_N)
    x = np.linalg.lstsq(free, load, rcond=None)[0]
    left = load - free @ x
    sigma = np.hypot(_beside(angle[:, 0], left), _INERTIA_ERROR * spring_Npm * np.hypot(along, across))
    force_N = _even(acting_N)
    return _ByAngle(x[:n] - 1j * x[n:], sigma, float(left @ left) / float(force_N @ force_N))


def _beside(angle: Floats, left: Floats) -> float:
    """Root of the mean square amplitude of what goes by no whole order."""
    amplitude = 2.0 / len(left) * (np.exp(-1j * np.outer(_BESIDE, angle)) @ left)
    return float(np.sqrt(np.mean(np.abs(amplitude) ** 2)))


def _even(values: Floats) -> Floats:
    """Columns (or one) without what changes slowly: constant, linear and quadratic."""
    t = np.linspace(-1.0, 1.0, len(values))
    slow = np.column_stack([np.ones_like(t), t, t * t])
    return np.asarray(values - slow @ np.linalg.lstsq(slow, values, rcond=None)[0])


def _harmonics(part: Complex, sigma2: float) -> Harmonics:
    """Of amplitudes whose errors have the mean squares `sigma2` in all; half of that is along the amplitude."""
    uncertainty = math.hypot(math.sqrt(2.0 * sigma2), _MODEL_ERROR * float(np.sum(np.abs(part))))
    return Harmonics(tuple(float(c) for c in part.real), tuple(float(-c) for c in part.imag), uncertainty)


# --- what a scale shows -----------------------------------------------------------------------------------------------
def transmission(pairs: Sequence[tuple[Scan, Scan]], dynamics: Dynamics, lead_m: float | None) -> Transmission | None:
    """From pairs of scans up and down, each at one speed, the slowest first and the longest last. None: there is no
    second encoder, or it is not at the table."""
    if pairs[0][0].second_m is None or dynamics.encoder_at == "table":
        return None
    fits = [_apart(pair, lead_m) for pair in pairs]
    backlash_m, stretch_mpN = _gap(fits, dynamics)
    share = None
    if dynamics.resonance_Hz.value > 0.0:
        half_Npm = 0.5 * dynamics.stiffness_Npm
        share = Value(stretch_mpN.value * half_Npm, math.hypot(stretch_mpN.uncertainty * half_Npm, 0.05))
    slow, long = fits[0], fits[-1]
    return Transmission(long.lead_error, slow.once, backlash_m, share, long.map)


@dataclass(frozen=True)
class _Apart:
    """Of one speed: `lag_m`, by how much the table lags more in the one direction than in the other; `force_N`."""

    lag_m: Value
    force_N: float
    lead_error: Value
    once: Harmonics | None
    map: tuple[tuple[float, float], ...]


def _apart(pair: tuple[Scan, Scan], lead_m: float | None) -> _Apart:
    x = np.concatenate([scan.user_m for scan in pair])
    ahead = np.concatenate([scan.ahead_m for scan in pair])
    sign = np.concatenate([np.full(len(scan.first_m), math.copysign(1.0, scan.velocity_mps)) for scan in pair])
    columns = [np.ones_like(x), sign, x]
    angle = 2.0 * np.pi * x / (lead_m or 1.0)
    if lead_m is not None:
        columns += [np.cos(angle), np.sin(angle)]
    basis = np.column_stack(columns)
    found = np.linalg.lstsq(basis, ahead, rcond=None)[0]
    left = ahead - basis @ found
    sections = [float(np.mean(part)) for one in (left[sign > 0.0], left[sign < 0.0]) for part in _split(one)]
    sigma_m = float(np.std(sections))
    mean_m = sigma_m / math.sqrt(len(sections))
    lag = Value(-2.0 * float(found[1]), 4.0 * mean_m)
    slope = Value(float(found[2]), 2.0 * math.sqrt(12.0) * mean_m / float(np.ptp(x)))
    once = None
    if lead_m is not None:
        part = np.array([found[3] - 1j * found[4], 0.0, 0.0])
        once = _harmonics(part, _beside(angle, left) ** 2)
    force_N = 0.5 * abs(float(np.mean(pair[0].force_N) - np.mean(pair[1].force_N)))
    return _Apart(lag, force_N, slope, once, _map(x, left + float(found[2]) * x))


def _split(values: Floats) -> list[Floats]:
    return np.array_split(values, _SECTIONS)


def _map(x: Floats, error_m: Floats) -> tuple[tuple[float, float], ...]:
    """Means of both directions at even distances."""
    edges = np.linspace(float(np.min(x)), float(np.max(x)), _POINTS + 1)
    at = np.clip(np.digitize(x, edges) - 1, 0, _POINTS - 1)
    return tuple(
        (float(0.5 * (edges[i] + edges[i + 1])), float(np.mean(error_m[at == i])))
        for i in range(_POINTS)
        if np.any(at == i)
    )


def _gap(fits: Sequence[_Apart], dynamics: Dynamics) -> tuple[Value, Value]:
    """Gap, and stretch of the spring for each N of friction, from lag = gap + stretch * force at each speed.

    Where the first mode is known, the stretch is 2 share / stiffness, and the share is about one half.
    """
    rows = [(1.0, one.force_N, one.lag_m.value, 0.5 * one.lag_m.uncertainty + 1e-9) for one in fits]
    if dynamics.resonance_Hz.value > 0.0:
        compliance_mpN = 1.0 / dynamics.stiffness_Npm
        rows.append((0.0, 1.0, compliance_mpN, 2.0 * _SHARE_PRIOR * compliance_mpN))
    table = np.array(rows)
    weighed = table[:, :2] / table[:, 3:]
    gap_m, stretch_mpN = np.linalg.lstsq(weighed, table[:, 2] / table[:, 3], rcond=None)[0]
    error = 2.0 * np.sqrt(np.diag(np.linalg.pinv(weighed.T @ weighed)))
    model_m = _MODEL_ERROR * abs(fits[0].lag_m.value)
    return (
        Value(max(0.0, float(gap_m)), math.hypot(float(error[0]), model_m)),
        Value(float(stretch_mpN), float(error[1])),
    )
