#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What bounds the designs of `kontur experiment machines --json`: the least error of any linear controller.

    tools/linear_bound.py MACHINES.json [--orders 30 20]

For each axis of each machine in the file, in µm, the error that `kontur design` minimises: the root mean square over
0.1 s after Coulomb friction has reversed (loop.reversal_error(), with loop.screw_error() where it counts). Besides, for
axes with a motor encoder only, the same at the table, less the static deflection, which the drive is told. Columns:

- ccu, cascade: the designs of the file.
- reached: a linear controller that keeps what `kontur design` keeps: Ms on all variants of the machine, all of them
  stable, and the force step, shared between the axes as one of the two designs does.
- bound: no linear controller has less. It keeps Ms on the machine as it is only, and has the force step alone.

Controllers are C = R / S, where R = C S is a stable filter (D. C. Youla, J. J. Bongiorno Jr. and H. A. Jabr, IEEE
Trans. Autom. Control 21 (1976) 319), a sum of fixed stable ones. S, the errors and the force change are affine in its
coefficients, so the least error is a convex problem: S. Boyd and C. Barratt, Linear Controller Design (1991). The
method is the logarithmic barrier: S. Boyd and L. Vandenberghe, Convex Optimization (2004), 11.3. The bound is as good
as the filters are rich: more of them (--orders: real poles, taps) must not change it much.

Ms of a variant is |S| <= Ms |D| with D = S - R P', P' the plant of the variant. It is not convex. |D| is replaced by
its part along the D of the last solution, which is less, and this is repeated. D never becomes 0 on the way, so a
variant that was stable stays so.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kontur.design import loop
from kontur.design.loop import Complex, Floats
from kontur.design.search import Problem
from kontur.experiments import machines
from kontur.machine import FULL, Axis, Machine

LAWS = ("ccu", "cascade")
MS, FORCE_STEP_N = 2.0, 2.0
ALONE_N = FORCE_STEP_N * math.sqrt(math.pi / 2.0)  # largest force change of an axis beside one that has none
_REPEATS = 4
_GAP = 1e-2  # of the square of the error, to its least


@dataclass(frozen=True, eq=False)
class Affine:
    """a x + b, one row a frequency."""

    a: Complex | Floats
    b: Complex | Floats

    def __call__(self, x: Floats) -> Complex:
        return np.asarray(self.a @ x + self.b)

    def __add__(self, other: Affine) -> Affine:
        return Affine(self.a + other.a, self.b + other.b)

    def times(self, factor: Complex | Floats) -> Affine:
        return Affine(np.asarray(self.a * factor[:, None]), np.asarray(self.b * factor))

    def plus(self, constant: Complex | Floats | float) -> Affine:
        return Affine(self.a, self.b + constant)


def stacked(parts: Sequence[Affine]) -> Affine:
    """All rows of `parts`."""
    return Affine(np.concatenate([part.a for part in parts]), np.concatenate([part.b for part in parts]))


# --- the convex problem -----------------------------------------------------------------------------------------------
def least(
    error: Affine, effort: Affine, limit: float, size: Affine, most: Affine, x: Floats, centre: bool = False
) -> Floats:
    """The x with the least norm of `error`, where the norm of `effort` < limit and |size| < most, row by row.

    `x` keeps the limits. `centre`: an x far from all limits instead, whatever the error.
    """
    goal, effort = in_reals(error), in_reals(effort)
    first, second, bound = size.a.real, size.a.imag, most.a.real
    terms = 2 * len(size.b) + 2
    weight = (1e-3 if centre else 1.0) * terms / _square(goal, x)

    def value(x: Floats) -> float:
        high, left = most(x).real, limit**2 - _square(effort, x)
        free = high**2 - np.abs(size(x)) ** 2
        if np.min(high) <= 0.0 or np.min(free) <= 0.0 or left <= 0.0:
            return math.inf
        return float(weight * _square(goal, x) - np.sum(np.log(free)) - math.log(left))

    if not math.isfinite(value(x)):
        raise ValueError("the first x does not keep the limits")
    while True:
        for _ in range(60):
            here, high, left = size(x), most(x).real, limit**2 - _square(effort, x)
            free = high**2 - np.abs(here) ** 2
            slope = 2.0 * (high[:, None] * bound - here.real[:, None] * first - here.imag[:, None] * second)
            slope /= free[:, None]
            pull = 2.0 * effort.a.T @ effort(x) / left
            gradient = 2.0 * weight * goal.a.T @ goal(x) - slope.sum(axis=0) + pull
            root = np.sqrt(2.0 / free)[:, None]
            hessian = 2.0 * weight * goal.a.T @ goal.a + slope.T @ slope + np.outer(pull, pull)
            hessian += (first * root).T @ (first * root) + (second * root).T @ (second * root)
            hessian += 2.0 / left * effort.a.T @ effort.a - (bound * root).T @ (bound * root)
            hessian += 1e-12 * np.trace(hessian) / len(x) * np.eye(len(x))
            step = -np.linalg.solve(hessian, gradient)
            gain, share, now = float(-gradient @ step), 1.0, value(x)
            while share > 1e-9 and not value(x + share * step) <= now - 0.1 * share * gain:
                share *= 0.5
            if gain < 1e-2 or share <= 1e-9:
                break
            x = x + share * step
        if centre or terms / weight < _GAP * _square(goal, x):
            return x
        weight *= 8.0


def in_reals(of: Affine) -> Affine:
    a, b = np.asarray(of.a), np.asarray(of.b)
    return Affine(np.vstack([a.real, a.imag]), np.concatenate([b.real, b.imag]))


def _square(of: Affine, x: Floats) -> float:
    return float(np.sum(np.abs(of(x)) ** 2))


def norm(of: Affine, x: Floats) -> float:
    return math.sqrt(_square(of, x))


# --- controllers ------------------------------------------------------------------------------------------------------
def filters(grid: loop.Grid, axis: Axis, orders: tuple[int, int]) -> tuple[Complex, Floats]:
    """Stable filters (f, n), and their gains (n,) at 0 Hz: real poles, taps, and pairs of poles about the mode of the
    axis and that of its table, in all variants."""
    z, period_s = grid.z_inverse, 1.0 / grid.control_hz
    found, gains = [z**k for k in range(orders[1])], [1.0] * orders[1]
    for hz in np.geomspace(loop.LEAST_HZ, 0.15 * grid.control_hz, orders[0]):
        pole = math.exp(-2.0 * math.pi * hz * period_s)
        found.append((1.0 - pole) * z / (1.0 - pole * z))
        gains.append(1.0)
    modes = (axis.resonance_Hz, axis.resonance_Hz * math.sqrt(axis.motor_share)) if axis.resonance_Hz > 0.0 else ()
    for hz in (factor * mode for mode in modes for factor in loop.RESONANCES):
        for damping in (axis.resonance_damping, 0.15, 0.5):
            turn = complex(-damping, math.sqrt(1.0 - damping**2))
            pair = np.exp(2.0 * math.pi * hz * period_s * turn)
            below = 1.0 - 2.0 * pair.real * z + abs(pair) ** 2 * z**2
            scale = float(np.min(np.abs(below)))
            found += [scale / below, scale * z / below]
            gains += [scale / (1.0 - 2.0 * pair.real + abs(pair) ** 2)] * 2
    return np.array(found).T, np.array(gains)


class Measures:
    """What R (one Affine for each encoder) makes of an axis: S, and rows whose norms are the error in m, and the change
    of the force in N, as `loop` has them. `at`: 0 at the first encoder, 1 at the table."""

    def __init__(self, grid: loop.Grid, plant: loop.Plant, axis: Axis, counts_m: tuple[float, float], at: int,
                 r: Sequence[Affine]) -> None:  # fmt: skip
        hz, force, friction = grid.hz, plant.force[0], plant.friction[0]
        weight = weights(hz)
        omega = 2.0 * np.pi * hz
        rise_s = math.sqrt(2.0 * axis.presliding_m / loop.REVERSAL_MPS2)
        jump = 2.0 * axis.coulomb_N / (omega * np.hypot(1.0, omega * rise_s)) * np.sqrt(2.0 * weight / loop.REVERSAL_S)
        answer = (r[0].times(friction[0]) + r[1].times(friction[1])).times(force[at])
        known = _static_deflection(axis) if at == 1 and counts_m[1] == 0.0 else 0.0
        error = [answer.plus(friction[at] - known).times(jump)]
        if counts_m[1] > 0.0 and axis.lead_once_m > 0.0:
            slow = hz <= max(loop.SCREW_MPS / axis.screw_m, 2.0 * loop.LEAST_HZ)
            share = weights(hz[slow]) / (2.0 * (hz[slow][-1] - hz[slow][0]))
            left = r[1].times(force[0]).plus(1.0)
            error.append(Affine(left.a[slow], left.b[slow]).times(axis.lead_once_m * np.sqrt(share)))
        change = np.abs(1.0 - grid.z_inverse) * np.sqrt(weight / (6.0 * grid.control_hz))
        self.s = (r[0].times(force[0]) + r[1].times(force[1])).plus(1.0)
        self.error = stacked(error)
        self.change = stacked([part.times(m * change) for part, m in zip(r, counts_m, strict=True)])


def weights(hz: Floats) -> Floats:
    """Of the trapezoidal rule."""
    weight: Floats = np.gradient(hz)
    weight[[0, -1]] *= 0.5
    return weight


def _static_deflection(axis: Axis) -> float:
    """Of the table against the motor, m/N, by the friction on the table."""
    if axis.resonance_Hz == 0.0:
        return 0.0
    reduced_kg = axis.mass_kg * axis.motor_share * (1.0 - axis.motor_share)
    return axis.friction_share / (reduced_kg * (2.0 * math.pi * axis.resonance_Hz) ** 2)


class Controllers:
    """All linear controllers of an axis, as far as the filters go, by a vector x."""

    def __init__(self, grid: loop.Grid, axis: Axis, delay_periods: int, counts_m: tuple[float, float], at: int,
                 orders: tuple[int, int]) -> None:  # fmt: skip
        self.grid, self.axis, self.counts_m, self.at = grid, axis, counts_m, at
        self.plant = loop.plant(grid, axis, delay_periods)
        base, gains = filters(grid, axis, orders)
        encoders = 2 if counts_m[1] > 0.0 else 1
        # R has the factor 1 - 1/z for each encoder, and S(1) = 0: so all loops are stable, though the plant integrates.
        one = (1.0 - grid.z_inverse)[:, None] * base
        none, zero = np.zeros_like(one), np.zeros_like(grid.z_inverse)
        self.r = [
            Affine(np.hstack([one if i == j else none for j in range(encoders)]), zero)
            for i in range(2)
        ]  # fmt: skip
        rate_gains = np.tile(gains, encoders) / (grid.control_hz * axis.viscous_Nspm)
        self._scale(-rate_gains / (rate_gains @ rate_gains))
        measures = self._measures(self.r)
        self.s, self.error, self.change = measures.s, measures.error, measures.change
        self.spread = [self.s + self.r[0].times(-p[0]) + self.r[1].times(-p[1]) for p in self.plant.force]

    def _measures(self, r: Sequence[Affine]) -> Measures:
        return Measures(self.grid, self.plant, self.axis, self.counts_m, self.at, r)

    def _scale(self, x: Floats) -> None:
        """Coordinates in which S(1) = 0, as at `x`, and all measures together change as much along each."""
        along = np.linalg.svd(x[None])[2][1:].T
        of = self._measures(self.r)
        level = float(np.linalg.norm(of.error.b))
        parts = (of.error.a / level, of.s.a / math.sqrt(len(of.s.b)), of.change.a / ALONE_N)
        rows = np.vstack([part for all_parts in parts for part in (all_parts.real, all_parts.imag)])
        left, sizes, right = np.linalg.svd(rows @ along, full_matrices=False)
        large = sizes > 1e-10 * sizes[0]
        to_x = along @ (right[large].T / sizes[large])
        x = x - to_x @ (left[:, large].T @ (rows @ x))
        self.r = [Affine(r.a @ to_x, r(x)) for r in self.r]

    def design(self, law: loop.Law) -> tuple[float, Floats]:
        """The error of a law of the firmware, in m, and the x that is nearest to it."""
        s = 1.0 / (1.0 + loop.transfer(law, self.plant)[0])
        r = law.force * s
        error = self._measures([Affine(np.zeros((len(s), 0)), part) for part in r]).error
        scale = 1.0 / (np.abs(r).sum(axis=0) + 0.02 * np.max(np.abs(r)))
        distance = [self.s.plus(-s).times(1.0 / (0.05 + np.abs(s)))]
        distance += [of.plus(-to).times(scale) for of, to in zip(self.r, r, strict=True)]
        rows = in_reals(stacked(distance))
        size = rows.a.shape[1]
        x = np.linalg.lstsq(np.vstack([rows.a, 1e-6 * np.eye(size)]), -np.concatenate([rows.b, np.zeros(size)]))[0]
        return float(np.linalg.norm(error.b)), np.asarray(x)

    def ms(self, x: Floats) -> float:
        """Of all variants; infinite where one is not stable."""
        size, worst = np.abs(self.s(x)), 0.0
        for d in (spread(x) for spread in self.spread):
            turned = np.unwrap(np.angle(np.concatenate([[1.0], d])))[-1]  # D has no zero outside the unit circle
            worst = max(worst, float(np.max(size / np.abs(d))) if abs(turned) < 0.25 * math.pi else math.inf)
        return worst

    def reach(self, x: Floats, limit_N: float) -> Floats:
        """A controller with little error that keeps all limits, from one that is stable on all variants."""
        limit_N = max(limit_N, 1.01 * norm(self.change, x))
        while (ms := self.ms(x)) >= MS:
            if not math.isfinite(ms):
                raise ValueError("a variant is not stable")
            x = self._least(x, 1.02 * ms, limit_N, centre=True)
        for _ in range(_REPEATS):
            step = self._least(x, MS, limit_N) - x
            while self.ms(x + step) > MS:  # the grid does not show all of a large step: a variant has become unstable
                step *= 0.5
            x = x + step
        return x

    def _least(self, x: Floats, ms: float, limit_N: float, centre: bool = False) -> Floats:
        along = [d.times(ms * np.conj(d(x)) / np.abs(d(x))) for d in self.spread]
        most = stacked([Affine(d.a.real, d.b.real) for d in along])
        return least(self.error, self.change, limit_N, stacked([self.s] * len(along)), most, x, centre)

    def bound(self, x: Floats) -> Floats:
        """The least error, from a controller that keeps all limits."""
        most = Affine(np.zeros_like(self.s.a.real), np.full(len(self.s.b), MS))
        return least(self.error, self.change, ALONE_N, self.s, most, x)


# --- the table --------------------------------------------------------------------------------------------------------
def rows(machine: Machine, designs: dict[str, dict[str, float]], orders: tuple[int, int]) -> Iterator[str]:
    """A line of the table for each axis and place of the error."""
    problems = {name: Problem(machine, name, FULL, MS, FORCE_STEP_N) for name in designs}
    problem = next(iter(problems.values()))
    grid = loop.Grid.around(machine.axes, problem.control_hz)
    laws = {name: problems[name].loops(grid, gains) for name, gains in designs.items()}
    limits_N = {name: _limits_N(machine, problem, grid, of_axes) for name, of_axes in laws.items()}
    for i, axis in enumerate(machine.axes):
        for at in (problem.at, 1) if problem.at == 0 and axis.resonance_Hz > 0.0 else (problem.at,):
            controllers = Controllers(grid, axis, machine.delay_periods, problem.counts_m[i], at, orders)
            made = [controllers.design(law[i]) for law in laws.values()]
            near = {name: x for name, (_, x) in zip(laws, made, strict=True)}
            name, start = min(near.items(), key=lambda item: controllers.ms(item[1]))
            x = controllers.reach(start, limits_N[name][i])
            cells = [error for error, _ in made] + [norm(controllers.error, x)]
            cells.append(norm(controllers.error, controllers.bound(x)))
            where = "table" if at == 1 else "encoder"
            yield (
                f"| {machine.name} | {'xy'[i]} | {where} | " + " | ".join(f"{1e6 * cell:.3g}" for cell in cells) + " |"
            )


def _limits_N(machine: Machine, problem: Problem, grid: loop.Grid, laws: Sequence[loop.Law]) -> list[float]:
    """Force change of each axis of a design, times what is left to the limit of the force step."""
    change_N = []
    for law, axis, counts_m in zip(laws, machine.axes, problem.counts_m, strict=True):
        s = 1.0 / (1.0 + loop.transfer(law, loop.plant(grid, axis, machine.delay_periods))[0])
        change_N.append(loop.force_change(grid, counts_m, law, s))
    return [one * FORCE_STEP_N / loop.force_step(*change_N) for one in change_N]


def of_name(name: str) -> Machine:
    """A machine of `kontur experiment machines`. Raises KeyError."""
    drawn = name.removeprefix("draw ")
    return machines.draw(int(drawn)) if drawn != name else {one.name: one for one in machines.packaged()}[name]


Work = list[tuple[Machine, dict[str, dict[str, float]]]]


def read(file: Path) -> Work:
    """Each machine that `kontur experiment machines --json` wrote, with its gains by law. Raises ValueError."""
    try:
        found = json.loads(file.read_text())["machines"]
        return [(of_name(one["name"]), {n: one["designs"][f"{n} {FULL}"]["gains"] for n in LAWS}) for one in found]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{file}: {error!r}; give what `kontur experiment machines --json` wrote") from error


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="what `kontur experiment machines --json` wrote")
    parser.add_argument("--orders", type=int, nargs=2, default=(30, 20), help="number of real poles, and of taps")
    given = parser.parse_args(arguments)
    try:
        work = read(given.file)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    print("| machine | axis | error at | " + " | ".join(LAWS) + " | reached | bound |\n|---|---|---|" + "---|" * 4)
    for machine, designs in work:
        for row in rows(machine, designs, tuple(given.orders)):
            print(row, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
