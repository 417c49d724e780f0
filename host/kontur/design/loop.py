# SPDX-License-Identifier: Apache-2.0
"""The control loop of one axis in the frequency domain: the firmware's law, the machine, and their margins.

The loop is L = -C z^-d P, summed over the encoders of the axis. C is the response of the firmware's own servo tick to
an impulse of an encoder, so there is no second model of the law. P is the machine with its zero-order hold: exact, of
motor, spring, table and the lag of the force. S = 1 / (1 + L) is the sensitivity, and Ms = max |S| the inverse of the
modulus margin.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete
from scipy.sparse import csr_array
from scipy.special import ellipe

from kontur.machine import Axis
from kontur.sim import library

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]

RESONANCES = (1.0, 0.9, 1.1)
MASSES = (1.0, 0.8, 1.2)
VARIANTS = tuple((resonance, mass) for resonance in RESONANCES for mass in MASSES)
"""Factors on the resonance and the mass that the margins hold for; the first are the machine as it is."""
GAPS = tuple((resonance, 1.0) for resonance in (0.8, 0.65, 0.5, 0.35, 0.2))
"""The same of an axis with a gap, as motions of some sizes see it. In the gap is no spring, so the first harmonic of a
motion sees the spring times a real factor between 0 and 1, which is 1 for large motions and 0 for those inside:
the describing function of a dead zone (A. Gelb and W. E. Vander Velde, Multiple-Input Describing Functions, 1968)."""
GAP_AT_TABLE = 0.5
"""Least factor on the resonance in GAPS of an axis with a sensor at the table. docs/adr/0090."""
GAP_MS = 1.25
"""Times the largest sensitivity that is allowed in a gap. docs/adr/0090."""
REVERSAL_MPS2 = 1.0  # acceleration of the reversal whose friction is to be balanced
SCREW_MPS = 0.1
REVERSAL_S = 0.1  # over which its error is averaged
_PERIODS = 1024  # of the response that is simulated; what comes after is a constant and an exponential
_IMPULSE_M = 0.4e-6  # within the boundary layers
LEAST_HZ = 1.0


class UnstableLawError(Exception):
    """The law alone, without a machine, does not come to rest."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Frequencies `hz` (f,) up to half the control rate, and what is computed once for them: `interpolation` (f, even
    frequencies) is the kernel of _sum()."""

    hz: Floats
    control_hz: int
    z_inverse: Complex
    interpolation: csr_array

    @classmethod
    def around(cls, axes: Sequence[Axis], control_hz: int, points: int = 160, near: int = 25) -> Grid:
        """A logarithmic grid of `points`, and `near` more around each resonance that may be there."""
        hz = [np.geomspace(LEAST_HZ, control_hz / 2, points)]
        for axis in axes:
            for factor in RESONANCES if axis.resonance_Hz > 0.0 else ():
                width = 6.0 * max(axis.resonance_damping, 1e-3)
                hz.append(axis.resonance_Hz * factor * (1.0 + width * np.linspace(-1.0, 1.0, near) ** 3))
        all_hz = np.unique(np.concatenate(hz))
        all_hz = all_hz[(all_hz >= LEAST_HZ) & (all_hz <= control_hz / 2)]
        return cls.at(all_hz, control_hz)

    @classmethod
    def at(cls, hz: Floats, control_hz: int) -> Grid:
        return cls(hz, control_hz, np.exp(-2j * np.pi * hz / control_hz), _interpolation(hz / control_hz, _PERIODS))


# --- the law ----------------------------------------------------------------------------------------------------------
# A sum over the periods at each frequency would take nine tenths of a search. So the transform is computed at twice as
# many even frequencies as there are periods, and interpolated with a Kaiser-Bessel kernel of this width, to 1e-9 of the
# largest value: J. A. Fessler and B. P. Sutton, IEEE Trans. Signal Process. 51 (2003) 560. The package finufft does it
# for millions of points; these few are not worth a package.
_WIDTH = 12
_SHAPE = 0.75 * np.pi * _WIDTH


def _interpolation(frequency: Floats, periods: int) -> csr_array:
    """The kernel (f, even frequencies) at these shares of the control rate."""
    place = frequency * 2 * periods
    index = np.ceil(place - _WIDTH / 2)[:, None] + np.arange(_WIDTH)
    distance = index - place[:, None]
    kernel = np.i0(_SHAPE * np.sqrt(np.maximum(0.0, 1.0 - (2.0 * distance / _WIDTH) ** 2)))
    phase = np.exp(0.5j * np.pi * distance)  # the kernel wants the response's middle at 0
    rows = np.repeat(np.arange(len(frequency)), _WIDTH)
    even = np.mod(index, 2 * periods).astype(np.int64)
    return csr_array(((kernel * phase).ravel(), (rows, even.ravel())), shape=(len(frequency), 2 * periods))


@cache
def _correction(periods: int) -> tuple[Floats, Floats]:
    """What a response of so many periods is multiplied with, and divided by, before it is transformed."""
    from_middle = np.arange(periods) / periods - 0.5
    root = np.sqrt(_SHAPE**2 - (0.5 * np.pi * _WIDTH * from_middle) ** 2)
    return root, _WIDTH * np.sinh(root)


def _sum(grid: Grid, h: Floats) -> Complex:
    """Sum of h_k z^-k at the frequencies of the grid."""
    times, by = _correction(len(h))
    return np.asarray(grid.interpolation @ np.fft.fft(h * times / by, 2 * len(h)))


def impulse_counts(encoder_m: float) -> int:
    """Counts of an impulse that is small, and long enough to be computed with."""
    return max(1, round(_IMPULSE_M / encoder_m))


@dataclass(frozen=True, eq=False)
class Law:
    """C (2, f) of an axis, N/m, from its first and its second encoder to the force; and whether it integrates."""

    force: Complex
    integrates: bool


def laws(
    grid: Grid,
    objects: Sequence[tuple[int, int, int]],
    controller: int,
    encoder_m: Sequence[float],
    second_m: Sequence[float] = (0.0, 0.0),
) -> tuple[Law, Law]:
    """The law of both axes: x is along the path, and y normal to it. Lengths of the counts; 0: no second encoder.

    Raises UnstableLawError; ValueError for objects that the firmware refuses.
    """
    counts = impulse_counts(max(encoder_m))
    force_N = library.response(objects, controller, counts, _PERIODS)
    first = [_transformed(grid, force_N[:, i] / (counts * encoder_m[i])) for i in range(2)]
    second = [(np.zeros_like(grid.z_inverse), False)] * 2
    if max(second_m) > 0.0:
        counts = impulse_counts(max(second_m))
        force_N = library.response(objects, controller, counts, _PERIODS, second=True)
        for i in (i for i in range(2) if second_m[i] > 0.0):
            second[i] = _transformed(grid, force_N[:, i] / (counts * second_m[i]))
    x, y = (Law(np.array([a[0], b[0]]), a[1] or b[1]) for a, b in zip(first, second, strict=True))
    return x, y


def _transformed(grid: Grid, h: Floats) -> tuple[Complex, bool]:
    """Z transform of a response whose end is a constant and a decaying exponential; whether there is a constant."""
    quarter, window, largest = _PERIODS // 4, _PERIODS // 16, float(np.max(np.abs(h)))
    first, second, third = (float(np.mean(h[i * quarter - window : i * quarter])) for i in (2, 3, 4))
    change, later = second - first, third - second
    grows = abs(later) > max(1.05 * abs(change), 1e-3 * largest)
    if grows or not np.max(np.abs(h[2 * quarter :])) < np.max(np.abs(h[:quarter])):
        raise UnstableLawError
    ratio = later / change if abs(change) > 1e-7 * largest else 0.0
    if 0.0 < ratio < 0.999:
        pole = ratio ** (1.0 / quarter)
        constant = first - change / (ratio - 1.0)
        rest = (third - constant) * pole ** ((window + 1) / 2)
    else:  # it has settled
        pole, constant, rest = 0.0, third, 0.0
    after = constant / (1.0 - grid.z_inverse) + rest / (1.0 - pole * grid.z_inverse)
    return _sum(grid, h) + grid.z_inverse**_PERIODS * after, abs(constant) > 1e-5 * largest


# --- the machine ------------------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Plant:
    """Variants of an axis on a grid (v, 2, f), m/N, to its first encoder, and to the table, where the second one is:
    `force` from the force demand, delay included, and `friction` from the friction force."""

    force: Complex
    friction: Complex


def variants_of(axis: Axis) -> tuple[tuple[float, float], ...]:
    """VARIANTS, and GAPS behind them where the axis has a gap and a spring.

    Of GAPS only the stiffer ones where a sensor is at the table: nothing there goes by a spring that is all but gone.
    """
    if axis.backlash_m == 0.0 or axis.resonance_Hz == 0.0:
        return VARIANTS
    at_table = axis.encoder_at == "table" or axis.scale_m > 0.0
    return VARIANTS + tuple(gap for gap in GAPS if gap[0] >= GAP_AT_TABLE or not at_table)


def plant(grid: Grid, axis: Axis, delay_periods: int, variants: Sequence[tuple[float, float]] = VARIANTS) -> Plant:
    """The axis with each of the factors on resonance and mass."""
    found = [_encoders(grid, _varied(axis, *variant), delay_periods) for variant in variants]
    return Plant(np.array([force for force, _ in found]), np.array([friction for _, friction in found]))


def _varied(axis: Axis, resonance: float, mass: float) -> Axis:
    return dataclasses.replace(axis, resonance_Hz=axis.resonance_Hz * resonance, mass_kg=axis.mass_kg * mass)


def _encoders(grid: Grid, axis: Axis, delay_periods: int) -> tuple[Complex, Complex]:
    """From force and friction of one axis to its encoders (2, f)."""
    response = np.moveaxis(_response(grid, axis), 0, -1)
    response = response[[1 if axis.encoder_at == "table" else 0, 1]]
    friction = (1.0 - axis.friction_share) * response[:, 1] + axis.friction_share * response[:, 2]
    return response[:, 0] * grid.z_inverse**delay_periods, friction


def _response(grid: Grid, axis: Axis) -> Complex:
    """(f, 2, 3): positions of motor and table, from force demand, force on the motor, and force on the table."""
    a, b = _equations(axis)
    c = np.array([[1.0, 0, 0, 0, 0], [0, 0, 1.0, 0, 0]])
    discrete = cont2discrete((a, b, c, np.zeros((2, 3))), 1.0 / grid.control_hz)
    a_d, b_d = np.asarray(discrete[0]), np.asarray(discrete[1])
    resolvent = np.linalg.solve(np.eye(5) / grid.z_inverse[:, None, None] - a_d, b_d[None])
    result: Complex = c @ resolvent
    return result


def _equations(axis: Axis) -> tuple[Floats, Floats]:
    """State: position and speed of the motor, of the table, and the force. A rigid axis has both at one place."""
    a, b = np.zeros((5, 5)), np.zeros((5, 3))
    lag_s = max(axis.current_lag_s, 1e-7)
    a[4, 4], b[4, 0] = -1.0 / lag_s, 1.0 / lag_s
    a[0, 1] = a[2, 3] = 1.0
    if axis.resonance_Hz == 0.0:
        for speed in (1, 3):
            a[speed, speed], a[speed, 4] = -axis.viscous_Nspm / axis.mass_kg, 1.0 / axis.mass_kg
            b[speed, 1:] = 1.0 / axis.mass_kg
        return a, b
    motor_kg, table_kg = axis.mass_kg * axis.motor_share, axis.mass_kg * (1.0 - axis.motor_share)
    omega = 2.0 * np.pi * axis.resonance_Hz
    reduced_kg = motor_kg * table_kg / axis.mass_kg
    spring = reduced_kg * np.array([omega**2, 2.0 * axis.resonance_damping * omega])  # by stretch, by its speed
    pull = np.array([*spring, *-spring])
    a[1, :4], a[3, :4] = -pull / motor_kg, pull / table_kg
    a[1, 1] -= (1.0 - axis.friction_share) * axis.viscous_Nspm / motor_kg
    a[3, 3] -= axis.friction_share * axis.viscous_Nspm / table_kg
    a[1, 4] = b[1, 1] = 1.0 / motor_kg
    b[3, 2] = 1.0 / table_kg
    return a, b


# --- the loop ---------------------------------------------------------------------------------------------------------
def transfer(law: Law, plant_of_axis: Plant) -> Complex:
    """L (v, f) of one axis."""
    return np.asarray(-np.sum(law.force * plant_of_axis.force, axis=1))


def largest_sensitivity(open_loop: Complex) -> float:
    """Largest |S| of the loops (v, f) of variants_of() an axis; those in a gap count for 1 / GAP_MS of theirs."""
    size = np.max(1.0 / np.abs(1.0 + open_loop), axis=1)
    size[len(VARIANTS) :] /= GAP_MS
    return float(np.max(size))


def stable(grid: Grid, axis: Axis, law: Law, open_loop: Complex) -> bool:
    """Whether all loops (v, f) close to stable ones: Nyquist's criterion for laws that are stable themselves.

    (1 + L) (1 - 1/z)^n has no pole on or outside the unit circle, where n is the number of integrators in L, and so it
    must not encircle 0.
    """
    integrators = int(law.integrates) + (1 if axis.viscous_Nspm > 0.0 else 2)
    closed = (1.0 + open_loop) * (1.0 - grid.z_inverse) ** integrators
    turned = np.angle(closed[:, 0]) + np.sum(np.angle(closed[:, 1:] * np.conj(closed[:, :-1])), axis=-1)
    return bool(np.all(np.abs(turned) < 0.25 * np.pi))


def force_change(grid: Grid, counts_m: tuple[float, float], law: Law, s: Complex) -> float:
    """Change of the force from period to period, N, root mean square, which counts of this length make in motion."""
    noise = np.sum(np.abs(law.force * np.array(counts_m)[:, None]) ** 2, axis=0) / 12.0
    spectrum = np.abs((1.0 - grid.z_inverse) * s) ** 2 * noise
    return float(np.sqrt(2.0 / grid.control_hz * np.trapezoid(spectrum, grid.hz)))


def force_step(x_N: float, y_N: float) -> float:
    """Mean length of the change of the force, N, as runs report it, for the force_change() of both axes."""
    least, greatest = sorted((x_N, y_N))
    return float(np.sqrt(2.0 / np.pi) * greatest * ellipe(1.0 - (least / max(greatest, 1e-12)) ** 2))


def reversal_error(grid: Grid, axis: Axis, at: int, law: Law, plant_of_axis: Plant, s: Complex) -> float:
    """Error at the first or second encoder, m, root mean square over REVERSAL_S, after Coulomb friction has reversed.

    It builds up over the time in which an axis that reverses with REVERSAL_MPS2 moves by its presliding distance. `at`:
    0 at the first encoder, 1 at the table.
    """
    rise_s = np.sqrt(2.0 * axis.presliding_m / REVERSAL_MPS2)
    omega = 2.0 * np.pi * grid.hz
    jump = 2.0 * axis.coulomb_N / (omega * np.hypot(1.0, omega * rise_s))
    friction, force = plant_of_axis.friction[0], plant_of_axis.force[0]
    answer = np.sum(law.force * friction, axis=0) * s
    energy = 2.0 * np.trapezoid(np.abs((friction[at] + force[at] * answer) * jump) ** 2, grid.hz)
    return float(np.sqrt(energy / REVERSAL_S))


def screw_error(grid: Grid, axis: Axis, law: Law, plant_of_axis: Plant, s: Complex) -> float:
    """Error at the table, m, root mean square, of the screw's error once a turn, at speeds up to SCREW_MPS.

    The first encoder does not see it, so the second one corrects it as far as its part of the loop is fast.
    """
    if axis.lead_once_m == 0.0:
        return 0.0
    slow = grid.hz <= max(SCREW_MPS / axis.screw_m, 2.0 * LEAST_HZ)
    left = np.abs(1.0 + plant_of_axis.force[0, 0] * law.force[1] * s)[slow] ** 2
    mean = np.trapezoid(left, grid.hz[slow]) / (grid.hz[slow][-1] - grid.hz[0])
    return float(axis.lead_once_m * np.sqrt(mean / 2.0))


@dataclass(frozen=True)
class Margins:
    """Margins of one axis: the worst over all VARIANTS, the rest of the machine as it is, and its gap closed.

    `ms_at_Hz`, `resonance`, `mass`: where Ms is reached. `gain`: factor on the loop to instability, upwards.
    `phase_deg` and `delay_s` at the crossovers. `crossover_Hz`: the highest frequency with |L| = 1. `bandwidth_Hz`: up
    to it disturbances are halved.
    """

    ms: float
    ms_at_Hz: float
    resonance: float
    mass: float
    gain: float
    phase_deg: float
    delay_s: float
    crossover_Hz: float
    bandwidth_Hz: float


def margins(grid: Grid, open_loop: Complex, variants: Sequence[tuple[float, float]] = VARIANTS) -> Margins:
    """Margins of the loops (v, f) of one axis; of those in a gap there are none."""
    open_loop = open_loop[: len(variants)]
    size = 1.0 / np.abs(1.0 + open_loop)
    worst, at = np.unravel_index(int(np.argmax(size)), size.shape)
    gain = phase_deg = delay_s = math.inf
    for loop in open_loop:
        angle = np.angle(loop)
        crossed = np.nonzero((np.abs(loop[:-1]) - 1.0) * (np.abs(loop[1:]) - 1.0) <= 0.0)[0]
        for k in crossed:
            margin = float(np.mod(angle[k] + np.pi, 2.0 * np.pi))
            phase_deg = min(phase_deg, math.degrees(min(margin, 2.0 * math.pi - margin)))
            delay_s = min(delay_s, margin / (2.0 * math.pi * float(grid.hz[k])))
        imaginary = loop.imag
        for k in np.nonzero((imaginary[:-1] * imaginary[1:] <= 0.0) & (loop.real[:-1] < 0.0))[0]:
            if -1.0 < loop.real[k] < 0.0:
                gain = min(gain, -1.0 / float(loop.real[k]))
    above = grid.hz[np.abs(open_loop[0]) >= 1.0]
    small = np.nonzero(size[0] > 0.5)[0]
    return Margins(
        ms=float(size[worst, at]),
        ms_at_Hz=float(grid.hz[at]),
        resonance=variants[int(worst)][0],
        mass=variants[int(worst)][1],
        gain=gain,
        phase_deg=phase_deg,
        delay_s=delay_s,
        crossover_Hz=float(above[-1]) if len(above) else 0.0,
        bandwidth_Hz=float(grid.hz[small[0] - 1]) if len(small) and small[0] > 0 else 0.0,
    )
