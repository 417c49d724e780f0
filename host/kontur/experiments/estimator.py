# SPDX-License-Identifier: Apache-2.0
"""The firmware's estimate of the contour error against the exact one, on the B-spline that the drive sees.

No search is needed for the exact foot point: it is chosen, and the axes are put at a known distance from it along the
normal of the spline (SciPy, double precision). The reference is a known time ahead of it or behind. So the only thing
measured is the estimator: knots are rounded to 1 nm as on the wire, but both sides see the rounded ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from kontur.drive.target import Target, open_drive
from kontur.machine import Machine
from kontur.path import shapes
from kontur.path.geometry import KNOT_S, Arc, Curve, FloatArray, Move, Program, Segment
from kontur.planning import knots
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.sim.library import estimate

SPEEDS_MPS = (0.001, 0.005, 0.02, 0.05, 0.1, 0.2)
LAG_M = 1e-3
PLANNED = ("circle 4 mm", "eight 20 mm", "NURBS")
PLANNED_SUFFIX = ", planned"
PLANNED_MPS = 0.1
OFFSETS_M = (-50e-6, -10e-6, 0.0, 10e-6, 50e-6)
BINS = (0.05, 0.1, 0.2, np.inf)
"""Upper ends of the bins of lag over the smallest radius of curvature between foot point and reference."""

_MARGIN = 12  # knots at either end of a stretch of path, after which its ends are forgotten
_ROWS = 40  # a stretch: positions of the axes


@dataclass(frozen=True)
class Cell:
    """Worst |e_n2 - exact| in nm of `rows` positions (NaN: of none).

    `newton_nm` with the Newton step, `paper_nm` by the paper's (6) alone, `drive_nm` with the Newton step in the drive
    as it is, which looks no further than `contour.lag_max`.
    """

    curve: str
    speed_mps: float
    lag_over_radius: float
    rows: int
    newton_nm: float
    paper_nm: float
    drive_nm: float


def curves() -> dict[str, Segment]:
    """The closed curves of the experiment by name."""
    named: dict[str, Segment] = {
        f"circle {mm} mm": Arc((0.0, 0.0), mm * 1e-3, 0.0, 2.0 * np.pi) for mm in (2, 4, 10, 20)
    }
    named["ellipse 30 x 5 mm"] = shapes.ellipse(0.030, 0.005, 0.1).moves[0].segment
    named["eight 20 mm"] = shapes.eight(0.020, 0.1).moves[0].segment
    named["NURBS"] = nurbs()
    return named


def nurbs() -> Curve:
    """A closed rational cubic of eight control points: radii of curvature from 1.9 mm up, bending both ways."""
    corner_mm = np.array([[0, 0], [12, -3], [14, 4], [8, 4], [7, 12], [0, 14], [-8, 9], [-6, 3.0]])
    weight = np.array([1.0, 2.0, 1.0, 0.5, 1.0, 4.0, 1.0, 0.7])
    control = np.column_stack([corner_mm * 1e-3, np.ones(8)]) * weight[:, None]
    closed = BSpline(np.arange(15.0) - 3.0, np.vstack([control, control[:3]]), 3)
    return Curve(partial(_rational, closed), np.arange(9.0))


def _rational(spline: BSpline, u: FloatArray, order: int) -> FloatArray:
    p, *more = (np.asarray(spline(u, nu=k)) for k in range(order + 1))
    point = p[:, :2] / p[:, 2:]
    if order == 0:
        return point
    first: FloatArray = (more[0][:, :2] - more[0][:, 2:] * point) / p[:, 2:]
    if order == 1:
        return first
    return np.asarray((more[1][:, :2] - 2.0 * more[0][:, 2:] * first - more[1][:, 2:] * point) / p[:, 2:])


def experiment(
    machine: Machine,
    num: str = "f32",
    speeds_mps: Iterable[float] = SPEEDS_MPS,
    seed: int = 1,
    stretches: int = 100,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[dict[str, Any], list[Cell]]:
    """Compare on every curve at every speed, at `stretches` random places of each with lags up to 1 mm; and on some
    curves as the planner drives them, from rest to rest within the machine's limits, with lags up to the drive's
    longest. Returns what was measured (build, back end, the drive's longest lag in ms, greatest difference of the
    spline to each ideal curve in nm) and the table.

    Half of the places are random, half where the curve bends most or the speed changes. Raises LibraryError.
    """
    with open_drive(Target(machine=machine, num=num)) as device:
        head = {name: device.read(name) for name in ("build_id", "num_backend", "contour.lag_max")}
    drive_ms = round(head["contour.lag_max"])
    named = curves()
    grid = [(name, speed_mps, False) for name in named for speed_mps in speeds_mps]
    grid += [(name, PLANNED_MPS, True) for name in PLANNED if name in named]
    cells: list[Cell] = []
    spline_nm: dict[str, float] = {}
    for i, (name, speed_mps, planned) in enumerate(grid):
        rng = np.random.default_rng((seed, i))
        if planned:
            pieces = _planned(named[name], speed_mps, machine, drive_ms, stretches, rng)
            found = _compare(pieces, drive_ms, (drive_ms, drive_ms), num, rng)
            name += PLANNED_SUFFIX
        else:
            lag_ms = LAG_M / speed_mps * 1e3
            pieces = _steady(named[name], speed_mps, lag_ms, stretches, rng)
            beyond_ms = max(drive_ms, min(1000, math.ceil(2.0 * lag_ms)))
            found = _compare(pieces, lag_ms, (beyond_ms, drive_ms), num, rng)
        spline_nm[name] = max(spline_nm.get(name, 0.0), found.spline_nm)
        cells += found.cells(name, speed_mps)
        progress((i + 1) / len(grid))
    return head | {"spline_nm": spline_nm}, cells


def worst(cells: Iterable[Cell], lag_over_radius: float = 0.2) -> float:
    """Greatest error in nm with the Newton step where the lag is at most so many radii of curvature."""
    return max(cell.newton_nm for cell in cells if cell.rows and cell.lag_over_radius <= lag_over_radius)


@dataclass(frozen=True)
class _Found:
    """Lag over radius (n,), and errors (n, 3) in nm: Newton step, paper, drive."""

    ratio: FloatArray
    error_nm: FloatArray
    spline_nm: float

    def cells(self, curve: str, speed_mps: float) -> list[Cell]:
        out = []
        for low, high in zip((-1.0, *BINS), BINS, strict=False):
            rows = (self.ratio > low) & (self.ratio <= high)
            worst = np.max(self.error_nm[rows], axis=0) if rows.any() else np.full(3, np.nan)
            out.append(Cell(curve, speed_mps, high, int(rows.sum()), *map(float, worst)))
        return out


@dataclass(frozen=True)
class _Stretch:
    """A piece of a path: where it is on the curve (n,) at 0, 1, 2 ... ms, and its knots (n, 2)."""

    curve: Segment
    path_m: FloatArray
    knots_nm: NDArray[np.int32]

    def path_at(self, time_ms: FloatArray) -> FloatArray:
        """Distance along the curve at times of any shape."""
        return np.asarray(np.interp(time_ms.ravel(), np.arange(len(self.path_m)), self.path_m)).reshape(time_ms.shape)


def _steady(
    curve: Segment, speed_mps: float, lag_ms: float, stretches: int, rng: np.random.Generator
) -> Iterator[_Stretch]:
    """At constant speed, long enough for the lag."""
    time_s = np.arange(math.ceil(lag_ms) + 2 * _MARGIN) * KNOT_S
    grid_m = np.linspace(0.0, curve.length_m, 4000, endpoint=False)
    weight = curve.curvature(grid_m) ** 2
    bent_m = rng.choice(grid_m, stretches // 2, p=weight / weight.sum())
    middle_m = np.append(rng.uniform(0.0, curve.length_m, stretches - stretches // 2), bent_m)
    path_m = middle_m[:, None] + speed_mps * (time_s - 0.5 * time_s[-1])
    position_m = curve.point(path_m.ravel() % curve.length_m).reshape(*path_m.shape, 2)
    for along, position in zip(path_m, position_m, strict=True):
        yield _Stretch(curve, along, knots.to_nm(knots.control_points(position)))


def _planned(
    curve: Segment, feed_mps: float, machine: Machine, lag_ms: int, stretches: int, rng: np.random.Generator
) -> Iterator[_Stretch]:
    """Out of a whole planned path; every other stretch where it speeds up or slows down."""
    x, y = curve.point(np.zeros(1))[0]
    trajectory = plan(Program("curve", (Move(curve, feed_mps),), (float(x), float(y))), limits(machine))
    count = lag_ms + 2 * _MARGIN
    speed = np.diff(trajectory.path_s_m)
    changes = np.flatnonzero(np.abs(np.diff(speed)) > 1e-4 * speed.max())
    last = len(trajectory.path_s_m) - count
    for i in range(stretches):
        first = int(rng.choice(changes) - count // 2 if i % 2 else rng.integers(0, last))
        rows = slice(min(max(first, 0), last), min(max(first, 0), last) + count)
        yield _Stretch(curve, trajectory.path_s_m[rows], trajectory.knots_nm[rows])


def _compare(
    stretches: Iterable[_Stretch], lag_ms: float, limits_ms: tuple[int, int], num: str, rng: np.random.Generator
) -> _Found:
    """With lags up to `lag_ms`; `limits_ms`: lag_max of the estimator by itself, and of the drive."""
    alone_ms, drive_ms = limits_ms
    ratio, error_nm, spline_nm = [], [], 0.0
    for piece in stretches:
        spline, length_m = _spline(piece.knots_nm), piece.curve.length_m
        behind_ms = np.append(rng.uniform(-lag_ms, lag_ms, _ROWS - 2), [-lag_ms, lag_ms])
        foot_ms = 0.5 * (len(piece.path_m) - 1.0 - behind_ms) + rng.uniform(-0.5, 0.5, _ROWS)
        between_ms = foot_ms[:, None] + behind_ms[:, None] * np.linspace(0.0, 1.0, 17)
        slow_nm = np.min(np.linalg.norm(spline(between_ms, nu=1), axis=2), axis=1)  # per ms
        moving = slow_nm > 0.9 * min(SPEEDS_MPS) * 1e6
        if not moving.any():
            continue
        behind_ms, foot_ms, between_ms = behind_ms[moving], foot_ms[moving], between_ms[moving]
        exact_nm = rng.choice(OFFSETS_M, len(foot_ms)) * 1e9
        normal = _normal(spline, foot_ms)
        axes_m = (spline(foot_ms) + exact_nm[:, None] * normal) * 1e-9
        at_s = (foot_ms + behind_ms) * 1e-3
        estimated = [
            estimate(piece.knots_nm, at_s, axes_m, newton=newton, lag_max_ms=limit_ms, num=num)[:, 1]
            for newton, limit_ms in ((True, alone_ms), (False, alone_ms), (True, drive_ms))
        ]
        error_nm.append(np.abs(np.column_stack(estimated) * 1e9 - exact_nm[:, None]))
        between_m = piece.path_at(between_ms)
        bend = np.abs(piece.curve.curvature(between_m.ravel() % length_m)).reshape(between_m.shape)
        ratio.append(np.abs(between_m[:, -1] - between_m[:, 0]) * bend.max(axis=1))
        off_nm = spline(foot_ms) - piece.curve.point(between_m[:, 0] % length_m) * 1e9
        spline_nm = max(spline_nm, float(np.max(np.abs(np.sum(off_nm * normal, axis=1)))))
    return _Found(np.concatenate(ratio), np.concatenate(error_nm), spline_nm)


def _spline(knots_nm: NDArray[np.int32]) -> BSpline:
    """The drive's curve in nm over path time in ms."""
    control = np.vstack([knots_nm[:1], knots_nm, knots_nm[-1:]]).astype(np.float64)
    return BSpline(np.arange(len(control) + 4) - 3.0, control, 3)


def _normal(spline: BSpline, time_ms: FloatArray) -> FloatArray:
    along = spline(time_ms, nu=1)
    return np.asarray(np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(along[:, 0], along[:, 1])[:, None])
