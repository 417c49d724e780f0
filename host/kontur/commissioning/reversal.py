# SPDX-License-Identifier: Apache-2.0
"""Fit of slow reversals: the distance over which friction builds up, and how large it is at rest.

Friction is that of Maxwell's slip elements, as the drive (firmware/core/friction.h) and the simulated machine have it:
a share of it acts at the motor, and the rest at the table, behind a gap and a spring. So slowly the spring is in
equilibrium. Each run is one branch that begins where all elements slip, so the force is a function of the distance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from kontur.commissioning.fit import Dynamics, Friction, Value
from kontur.commissioning.recording import Scan
from kontur.commissioning.response import Floats

ELEMENTS = 10  # of the simulated machine's friction
_BLOCK = 8  # frames, of which the mean is taken
_LONGEST_M = 3e-4  # of the way that is looked at
_STARTS_M = (4e-6, 12e-6, 36e-6)
_GAPS_M = (0.0, 10e-6)
_LEAST_M, _MOST_M = 1e-6, 1.5e-4
_GAP_PRIOR_M, _GAP_MAX_M = 3e-5, 1e-4
_SHARE_PRIOR = 0.15  # standard deviation of the table's share of the friction, around one half
_BEFORE_MAX_M = 1e-5  # by which an axis that sticks may have come back before it is recorded
_BEYOND_PRIOR_M = 1e-6  # by which its table, which swings, has come back more or less than the motor
_FORCE_ERROR = 0.01  # of the friction: what the model does not have
_SPEED_ERROR = 0.5  # of what the friction falls with the speed
_INERTIA_ERROR = 0.3
_ALIKE = 10.0  # points with one error in common
_CROSSING = 0.01  # of the table's friction, within which the gap is crossed
_MODEL_ERROR, _GAP_ERROR, _GAP_LEAST_M, _SHARE_ERROR, _REST_ERROR = 0.1, 0.1, 5e-7, 0.05, 0.05  # what the model lacks
_SEEN = 1.5  # times its uncertainty
_SLIPS, _STICKS, _MOST = 2.0, 0.5, 0.8  # times the mean velocity, of an axis that has most of its force
_SLIP_ERROR = 0.02  # of the force at which an axis slips
_UNEXPLAINED = 0.05  # share of the force's variance that a fit may leave


@dataclass(frozen=True)
class Presliding:
    """`distance_m`: over which friction builds up. `rest_N`: friction at rest. `backlash_m`: whole gap.
    `friction_share`: at the table. The last two are None where they do not show."""

    distance_m: Value
    rest_N: Value
    backlash_m: Value | None
    friction_share: Value | None


@dataclass(frozen=True, eq=False)
class _Run:
    """From a reversal on: distances of motor and table (None: not seen), force, its standard deviation, what is left of
    the friction at rest at this speed; (n,) each. `slip_N`: the force at which it slipped, where it sticks again."""

    motor_m: Floats | None
    table_m: Floats | None
    force_N: Floats
    sigma_N: Floats
    left: Floats
    slip_N: float | None


def presliding(scans: Sequence[Scan], dynamics: Dynamics, friction: Friction) -> Presliding | None:
    """From slow reversals, the first one to the positive direction, and each next one back. None: there is no such
    curve in them.

    The gap shows beside an encoder at the motor as a way with constant force, that of the motor's part of the friction.
    """
    runs = [_run(scan, 1.0 if k % 2 == 0 else -1.0, dynamics, friction) for k, scan in enumerate(scans)]
    force_N = np.concatenate([run.force_N for run in runs])
    sigma_N = np.concatenate([run.sigma_N for run in runs])
    offsets = np.concatenate([np.full((len(run.force_N), 1), float(k)) for k, run in enumerate(runs)])
    offsets = (offsets == np.arange(len(runs))).astype(np.float64)
    # An axis slips with its friction at rest: where a run ends with that, most of its curve is not seen
    slips = [k for k, run in enumerate(runs) if run.slip_N is not None]
    slip_N = np.array([runs[k].slip_N for k in slips], dtype=np.float64)
    at_slip = np.column_stack([np.ones(len(slips)), np.eye(len(runs))[slips]])
    force_N, sigma_N = np.append(force_N, slip_N), np.append(sigma_N, _SLIP_ERROR * slip_N)
    rest_N = friction.coulomb_N.value * friction.breakaway.value
    stretch_m = rest_N / dynamics.stiffness_Npm if dynamics.stiffness_Npm > 0.0 else 0.0

    def parts(vector: Floats) -> tuple[Floats, Floats]:
        """Level and offsets of the best fit, and its residual."""
        whole_m, share, gap_m = math.exp(float(vector[0])), float(vector[1]), float(vector[2])
        shape = [
            _shape(run, before_m, beyond_m, whole_m, share, gap_m, stretch_m)
            for run, (before_m, beyond_m) in zip(runs, vector[3:].reshape(-1, 2), strict=True)
        ]
        basis = np.vstack([np.column_stack([np.concatenate(shape), offsets]), at_slip]) / sigma_N[:, None]
        x = np.linalg.lstsq(basis, force_N / sigma_N, rcond=None)[0]
        return x, basis @ x - force_N / sigma_N

    def residual(vector: Floats) -> Floats:
        prior = [(vector[1] - 0.5) / _SHARE_PRIOR, vector[2] / _GAP_PRIOR_M, *vector[4::2] / _BEYOND_PRIOR_M]
        return np.concatenate([parts(vector)[1] / math.sqrt(_ALIKE), prior])

    low = [math.log(_LEAST_M), 0.0, 0.0] + [0.0, -_BEFORE_MAX_M] * len(runs)
    high = [math.log(_MOST_M), 1.0, _GAP_MAX_M] + [_BEFORE_MAX_M] * 2 * len(runs)
    scale = np.array([0.3, 0.2, 5e-6] + [1e-6, 1e-6] * len(runs))
    fits = [
        least_squares(
            residual, [math.log(start_m), 0.5, gap_m + 1e-7] + [1e-7, 0.0] * len(runs), bounds=(low, high),
            x_scale=scale, loss="soft_l1", max_nfev=30,
        )
        for start_m in _STARTS_M for gap_m in _GAPS_M
    ]  # fmt: skip
    best = min(fits, key=lambda one: float(one.cost))
    x, off = parts(best.x)
    if float(np.sum((off * sigma_N) ** 2)) > _UNEXPLAINED * float(np.sum((force_N - np.mean(force_N)) ** 2)):
        return None
    jacobian = np.asarray(best.jac) * scale
    misfit = max(1.0, 2.0 * float(best.cost) / len(force_N) * _ALIKE)
    error = 2.0 * scale * np.sqrt(np.abs(np.diag(np.linalg.pinv(jacobian.T @ jacobian))) * misfit)
    whole_m, share, gap_m = math.exp(float(best.x[0])), float(best.x[1]), float(best.x[2])
    rest_N = float(x[0])
    backlash = Value(gap_m, math.hypot(float(error[2]), _GAP_ERROR * gap_m, _GAP_LEAST_M))
    behind = stretch_m > 0.0 and dynamics.encoder_at == "motor"
    return Presliding(
        Value(whole_m, whole_m * math.hypot(float(error[0]), _MODEL_ERROR)),
        Value(rest_N, _REST_ERROR * rest_N),
        backlash if behind and gap_m > _SEEN * backlash.uncertainty else None,
        Value(share, math.hypot(float(error[1]), _SHARE_ERROR)) if behind else None,
    )


def _run(scan: Scan, sign: float, dynamics: Dynamics, friction: Friction) -> _Run:
    """From the turn on, less what accelerates the axis and its viscous friction.

    Where the force falls with the speed, an axis this slow sticks and slips in turns. While it sticks, its friction is
    what pulls it, and no longer a function of the distance: what comes after the first slip is left out.
    """
    time_s = _means(scan.time_s)
    first_m = sign * _means(scan.first_m)
    delayed_N = np.interp(scan.time_s - dynamics.lag_delay_s.value, scan.time_s, scan.force_N)
    velocity = np.gradient(first_m, time_s)
    inertia_N = dynamics.mass_kg.value * np.gradient(velocity, time_s)
    force_N = sign * _means(delayed_N) - inertia_N - friction.viscous_Nspm.value * velocity
    excess = friction.breakaway.value - 1.0
    left = (1.0 + excess * np.exp(-np.abs(velocity) / friction.stribeck_mps.value)) / (1.0 + excess)
    whole_N = friction.coulomb_N.value * friction.breakaway.value
    sigma_N = np.sqrt(
        (_FORCE_ERROR * whole_N) ** 2 + (_SPEED_ERROR * whole_N * (1.0 - left)) ** 2 + (_INERTIA_ERROR * inertia_N) ** 2
    )
    turn = int(np.argmin(first_m))
    distance_m = np.maximum.accumulate(first_m[turn:] - first_m[turn])
    mean_mps = distance_m[-1] / (time_s[-1] - time_s[turn])
    slipped = (velocity[turn:] > _SLIPS * mean_mps) & (force_N[turn:] > _MOST * np.max(force_N))
    sticks = np.flatnonzero(np.maximum.accumulate(slipped) & (velocity[turn:] < _STICKS * mean_mps))
    of = slice(turn, turn + min([int(np.searchsorted(distance_m, _LONGEST_M)), *sticks[:1]]))
    motor_m: Floats | None = distance_m[: of.stop - turn]
    table_m = None
    if dynamics.encoder_at == "table":
        motor_m, table_m = None, motor_m
    elif scan.second_m is not None:
        second_m = sign * _means(scan.second_m)[of]
        table_m = np.maximum.accumulate(second_m - second_m[0])
    slip_N = float(np.max(force_N[of])) if len(sticks) and turn + sticks[0] == of.stop else None
    return _Run(motor_m, table_m, force_N[of], sigma_N[of], left[of], slip_N)


def _means(values: Floats) -> Floats:
    return np.asarray(np.mean(values[: len(values) // _BLOCK * _BLOCK].reshape(-1, _BLOCK), axis=1))


def _shape(
    run: _Run, before_m: float, beyond_m: float, whole_m: float, share: float, gap_m: float, stretch_m: float
) -> Floats:
    """Friction of motor and table over that at rest. `before_m`: by how much the axis had come back when the run
    begins, its table by `beyond_m` more. `stretch_m`: of the spring under all of the friction."""
    grid_m = np.geomspace(1e-8, 1e-3, 600) - 1e-8
    of_table = _slip(grid_m, whole_m)
    crossed = np.clip(of_table / _CROSSING + 0.5, 0.0, 1.0)  # the spring is in the gap while it has no force
    behind_m = grid_m + gap_m * crossed + stretch_m * share * (of_table + 1.0)  # the motor's distance
    if run.motor_m is None:
        assert run.table_m is not None
        table_m, motor_m = run.table_m + before_m, np.interp(run.table_m + before_m, grid_m, behind_m)
    else:
        motor_m = run.motor_m + before_m
        table_m = np.interp(motor_m + beyond_m, behind_m, grid_m) if run.table_m is None else run.table_m + before_m
    return np.asarray(((1.0 - share) * _slip(motor_m, whole_m) + share * _slip(table_m, whole_m)) * run.left)


def _slip(distance_m: Floats, whole_m: float) -> Floats:
    """Share of the friction, -1 before a reversal and 1 when all elements slip: element k slips after k / N of it."""
    k = np.arange(1, ELEMENTS + 1)[:, None]
    return np.asarray(np.mean(np.minimum(2.0 * ELEMENTS * distance_m[None, :] / (k * whole_m), 2.0), axis=0) - 1.0)
