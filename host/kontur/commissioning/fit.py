# SPDX-License-Identifier: Apache-2.0
"""Fits: a machine to its frequency response, friction to speed steps."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from kontur.commissioning.response import Complex, Floats, Response
from kontur.design import loop
from kontur.machine import Axis


@dataclass(frozen=True)
class Value:
    """An estimate and its uncertainty: the half width of an interval that holds the truth in 95 % of cases."""

    value: float
    uncertainty: float


# --- the machine ------------------------------------------------------------------------------------------------------
_MODES_HZ = np.geomspace(22.0, 420.0, 30)
_SHARES = (0.3, 0.5, 0.7)
_MODEL_ERROR = 0.01  # relative error of a point that the model does not explain
_DAMPING_ERROR = 0.15  # relative, of the mode's damping: the friction at both masses damps it, too
_LEAST_MODE = 3.0  # a mode must lower the cost of a fit by this factor to be one
_DELAYS = (1, 2)
_ROUGH_EVALUATIONS = 12
_LAG_S, _LAG_MAX_S = 1e-4, 5e-3  # unit of the lag in a fit, and its largest value


@dataclass(frozen=True)
class Dynamics:
    """What the frequency response tells. `resonance_Hz` is 0, and the next two mean nothing, where no mode was seen.

    `lag_delay_s`: of force loop and control periods together. `encoder_at`: "motor" or "table".
    """

    mass_kg: Value
    resonance_Hz: Value
    resonance_damping: Value
    motor_share: Value
    lag_delay_s: Value
    current_lag_s: float
    delay_periods: int
    encoder_at: str
    misfit: float

    @property
    def stiffness_Npm(self) -> float:
        """Of the spring between two free masses m_1, m_2: (2 pi f)^2 = k (1/m_1 + 1/m_2). 0: no mode was seen."""
        share = self.motor_share.value
        return self.mass_kg.value * share * (1.0 - share) * (2.0 * math.pi * self.resonance_Hz.value) ** 2


def dynamics(found: Response, control_hz: int, base: Axis) -> Dynamics:
    """Fit motor, spring, table, lag and delay to a response. `base` has what is known: friction, lengths."""
    use = found.coherence > 0.5
    hz, plant = found.hz[use], found.plant[:, use]
    rows = [0, 1] if np.any(plant[1]) else [0]
    sigma = np.hypot(found.plant_sigma[:, use] / np.maximum(np.abs(plant), 1e-30), _MODEL_ERROR)
    grid = loop.Grid.at(hz, control_hz)
    omega2 = (2.0 * np.pi * hz) ** 2
    low = hz < 1.5 * hz[0]
    mass_kg = float(np.median(1.0 / (np.abs(plant[0, low]) * omega2[low])))
    places = ("motor", "table") if len(rows) == 1 else ("motor",)
    problems = [_Problem(grid, plant[rows], sigma[rows], base, delay) for delay in _DELAYS]
    rough = [
        problems[0].solve(start, True, place, _ROUGH_EVALUATIONS)
        for place in places
        for start in problems[0].starts(mass_kg, place)
    ]
    start, nearest = min(rough, key=lambda one: one[1].misfit)
    modes = [problem.solve(start, True, nearest.encoder_at)[1] for problem in problems]
    rigid = [problem.solve(np.array([math.log(mass_kg), 3.0]), False, "motor")[1] for problem in problems]
    mode, none = (min(found, key=lambda one: one.misfit) for found in (modes, rigid))
    return mode if mode.misfit * _LEAST_MODE < none.misfit else none


class _Problem:
    """A response, and what is known, to fit an axis to.

    Vectors: log of mass, lag in _LAG_S, logs of frequency and damping of the mode, logit of the share.
    """

    def __init__(self, grid: loop.Grid, plant: Complex, sigma: Floats, base: Axis, delay: int) -> None:
        self.grid, self.plant, self.sigma, self.base, self.delay = grid, plant, sigma, base, delay

    def axis(self, vector: Floats, elastic: bool, encoder_at: str) -> Axis:
        mass_kg, lag_s = math.exp(float(vector[0])), _LAG_S * float(vector[1])
        axis = dataclasses.replace(self.base, mass_kg=mass_kg, current_lag_s=lag_s, encoder_at=encoder_at)
        if not elastic:
            return dataclasses.replace(axis, resonance_Hz=0.0)
        share = 0.02 + 0.96 / (1.0 + math.exp(-float(vector[4])))
        return dataclasses.replace(
            axis,
            resonance_Hz=float(np.exp(vector[2])),
            resonance_damping=float(np.exp(vector[3])),
            motor_share=share,
        )

    def residual(self, vector: Floats, elastic: bool, encoder_at: str) -> Floats:
        axis = self.axis(vector, elastic, encoder_at)
        model = loop.plant(self.grid, axis, self.delay, ((1.0, 1.0),)).force[0][: len(self.plant)]
        off = np.log(self.plant / model) / self.sigma  # both in size and in phase
        return np.concatenate([off.real.ravel(), off.imag.ravel()])

    def cost(self, vector: Floats, encoder_at: str) -> float:
        return float(np.sum(np.log1p(self.residual(vector, True, encoder_at) ** 2)))

    def starts(self, mass_kg: float, encoder_at: str) -> list[Floats]:
        """The best of a coarse grid of modes, apart from each other."""
        trials = [
            np.array([math.log(mass_kg), 3.0, math.log(hz), math.log(0.03), math.log(share / (1.0 - share))])
            for hz in _MODES_HZ
            for share in _SHARES
        ]
        trials.sort(key=lambda vector: self.cost(vector, encoder_at))
        chosen: list[Floats] = []
        for vector in trials:
            if all(abs(vector[2] - other[2]) > 0.15 for other in chosen):
                chosen.append(vector)
        return chosen[:2]

    def solve(self, start: Floats, elastic: bool, encoder_at: str, evaluations: int = 40) -> tuple[Floats, Dynamics]:
        """Where a fit from `start` ends, and what it means."""
        low = [math.log(0.1), 0.0] + ([math.log(10.0), math.log(1e-3), -6.0] if elastic else [])
        high = [math.log(1e5), _LAG_MAX_S / _LAG_S] + ([math.log(1000.0), math.log(0.5), 6.0] if elastic else [])
        found = least_squares(
            self.residual, np.clip(start, np.array(low) + 1e-6, np.array(high) - 1e-6), bounds=(low, high),
            loss="soft_l1", args=(elastic, encoder_at), max_nfev=evaluations,
        )  # fmt: skip
        axis = self.axis(found.x, elastic, encoder_at)
        count = max(1, len(found.fun) - len(found.x))
        misfit = 2.0 * float(found.cost) / count
        try:
            jacobian = np.asarray(found.jac)
            covariance = np.linalg.inv(jacobian.T @ jacobian) * max(1.0, misfit)
        except np.linalg.LinAlgError:
            covariance = np.full((len(found.x),) * 2, math.inf)
        error = 2.0 * np.sqrt(np.abs(np.diag(covariance)))
        share = axis.motor_share
        lag_delay_s = axis.current_lag_s + self.delay / self.grid.control_hz
        return found.x, Dynamics(
            mass_kg=Value(axis.mass_kg, axis.mass_kg * math.hypot(float(error[0]), 0.02)),
            resonance_Hz=Value(
                axis.resonance_Hz, axis.resonance_Hz * math.hypot(float(error[2]), 0.01) if elastic else 0.0
            ),
            resonance_damping=Value(
                axis.resonance_damping,
                axis.resonance_damping * math.hypot(float(error[3]), _DAMPING_ERROR) if elastic else 0.0,
            ),
            motor_share=Value(share, share * (1.0 - share) * float(error[4]) + 0.02 if elastic else 0.0),
            lag_delay_s=Value(lag_delay_s, math.hypot(_LAG_S * float(error[1]), 3e-5)),
            current_lag_s=axis.current_lag_s,
            delay_periods=self.delay,
            encoder_at=encoder_at,
            misfit=misfit,
        )


# --- friction ---------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Friction:
    """Coulomb, viscous, breakaway over Coulomb, Stribeck velocity: F = L (1 + (b - 1) exp(-v / v_s)) + C v."""

    coulomb_N: Value
    viscous_Nspm: Value
    breakaway: Value
    stribeck_mps: Value


def friction(speed_mps: Sequence[float], force_N: Sequence[float], sigma_N: Sequence[float]) -> Friction:
    """Fit mean friction forces at speeds, both directions averaged, with their standard deviations."""
    v, f, sigma = (np.asarray(x, dtype=np.float64) for x in (speed_mps, force_N, sigma_N))
    sigma = np.hypot(sigma, 0.01 * np.abs(f))
    found = []
    for stribeck in np.geomspace(3e-4, 20e-3, 60):
        basis = np.column_stack([np.ones_like(v), v, np.exp(-v / stribeck)]) / sigma[:, None]
        x, *_ = np.linalg.lstsq(basis, f / sigma, rcond=None)
        if x[2] < 0.0:
            basis = basis[:, :2]
            x = np.append(np.linalg.lstsq(basis, f / sigma, rcond=None)[0], 0.0)
        off = basis @ x[: basis.shape[1]] - f / sigma
        found.append((float(off @ off), stribeck, x, basis))
    cost, stribeck, x, basis = min(found, key=lambda one: one[0])
    scale = max(1.0, cost / max(1, len(v) - 4))
    error = 2.0 * np.sqrt(scale * np.diag(np.linalg.pinv(basis.T @ basis)))
    # What else would fit: all Stribeck velocities whose cost is near the least
    near = [one for one in found if one[0] < cost + 4.0 * scale]
    spread = [max(abs(one[2][k] - x[k]) for one in near) for k in range(3)]
    coulomb_N = max(float(x[0]), 0.0)
    excess = float(x[2]) / max(coulomb_N, 1e-9)
    excess_error = (float(spread[2]) + (float(error[2]) if len(error) > 2 else 0.0)) / max(coulomb_N, 1e-9)
    return Friction(
        Value(coulomb_N, math.hypot(float(error[0]), float(spread[0]), 0.03 * coulomb_N)),
        Value(max(float(x[1]), 0.0), math.hypot(float(error[1]), float(spread[1]), 0.03 * abs(float(x[1])))),
        Value(1.0 + excess, excess_error + 0.05),
        Value(float(stribeck) if excess > 0.01 else 1e-3, max(abs(one[1] - stribeck) for one in near)),
    )


def slope_Nspm(found: Friction, speed_mps: float) -> float:
    """By how much the friction rises with the speed, N per m/s."""
    falling_N = found.coulomb_N.value * (found.breakaway.value - 1.0) * math.exp(-speed_mps / found.stribeck_mps.value)
    return found.viscous_Nspm.value - falling_N / found.stribeck_mps.value


# --- at rest ----------------------------------------------------------------------------------------------------------
_QUANTUM = 1.0 / math.sqrt(12.0)


def noise(position_m: Floats, count_m: float) -> Value:
    """Standard deviation of an encoder at rest. What stays within a count does not show."""
    t = np.linspace(-1.0, 1.0, len(position_m))
    left = position_m - np.polyval(np.polyfit(t, position_m, 1), t)
    value = float(np.std(left))
    return Value(value, math.hypot(2.0 * value / math.sqrt(len(left)), _QUANTUM * count_m))
