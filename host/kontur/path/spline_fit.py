# SPDX-License-Identifier: Apache-2.0
"""The quintic spline within a tolerance of a path: where its knots are, and its fit by weighted least squares.

A sample's weight grows as long as the curve is too far from it, and falls where it is near. The knots are as dense as
the turning of the path needs: their spacing h times the turning within h is in proportion to the tolerance. A motion is
slow where h is small, as in a corner. There |p'''|^2 counts less, since the jerk is p''' times the cube of the speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline
from scipy.linalg import solveh_banded

from kontur.path.geometry import FloatArray
from kontur.path.polyline import Polyline

_DEGREE = 5
_SAMPLES = 4  # in a span of the spline
_DENSITY = 2.0  # knots: spacing times turning, in tolerances
_GROWTH = 0.25  # of the spacing of the knots along the path
_SPACING_MAX_M = 5e-3
_SLOWING = 1.5  # power of the spacing, by which the third derivative counts: where it is small, the motion is slow
_SPANS_MIN = 6
_LADDER = 1.25  # ratio of the spacings that are tried
_AIM = 0.85  # of the tolerance
_HELD = 0.99  # of the tolerance, at the samples
_RELAXING, _TIGHTENING = 8, 14  # rounds
_WEIGHT_RANGE = (1e-4, 1e4)
_WEIGHT_RATIO = 4.0  # from span to span

_Index = npt.NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class SmoothPath:
    """A smoothed path of one or more stretches, by the distance along the file's path (Segment of kontur.path.geometry,
    but for that). `stops_m` (k + 1,): its ends and where it rests between them. `deviation_m`: from the file's path,
    `rapid_deviation_m`: from rapid moves of that.
    """

    spline: BSpline
    grid_m: FloatArray
    stops_m: FloatArray
    deviation_m: float
    rapid_deviation_m: float = 0.0

    @property
    def length_m(self) -> float:
        return float(self.stops_m[-1])

    def until(self, length_m: float) -> SmoothPath:
        """The beginning of a path without stops on its way."""
        grid = np.append(self.grid_m[self.grid_m < length_m - 1e-9], length_m)
        return replace(self, grid_m=grid, stops_m=np.array([0.0, length_m]))

    def since(self, length_m: float) -> SmoothPath:
        """The end of a path without stops on its way, from there on."""
        t, coefficients, degree = self.spline.tck
        grid = np.append(length_m, self.grid_m[self.grid_m > length_m + 1e-9]) - length_m
        spline = BSpline(t - length_m, coefficients, degree)
        return replace(self, spline=spline, grid_m=grid, stops_m=np.array([0.0, self.length_m - length_m]))

    def derivative(self, s_m: FloatArray, order: int) -> FloatArray:
        """Derivative (n, 2) by the distance along the file's path; order 0 is the point."""
        return np.asarray(self.spline(np.clip(s_m, 0.0, self.stops_m[-1]), order))

    def point(self, s_m: FloatArray) -> FloatArray:
        return self.derivative(s_m, 0)

    def tangent(self, s_m: FloatArray) -> FloatArray:
        first = self.derivative(s_m, 1)
        return np.asarray(first / np.hypot(first[:, 0], first[:, 1])[:, None])

    def curvature(self, s_m: FloatArray) -> FloatArray:
        first, second = self.derivative(s_m, 1), self.derivative(s_m, 2)
        cross = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
        return np.asarray(cross / np.hypot(first[:, 0], first[:, 1]) ** 3)


def fitted(
    polyline: Polyline,
    first: list[int],
    last: int,
    within: Within,
    head: FloatArray | None = None,
    spacing: float = 1.0,
) -> tuple[Fit, npt.NDArray[np.bool_]]:
    """The fit to stretches that begin with the moves `first` and follow one another up to `last`, and which of them are
    within the tolerance of each move of the path. `head` (5, 2): point and derivatives with which a
    single stretch begins. `spacing`: of the knots, as a share of what is usual.
    """
    stops = polyline.edge_m[[*first, last + 1]]
    at, turn = polyline.features(first[0], last)
    inside = ~np.isin(at, stops)
    at, turn = at[inside], turn[inside]
    within = within.part(first[0], last)
    fit = Fit(polyline, _knots(at, turn, stops, spacing * within.between(at, at)), at, within, head)
    fit.relax()
    late = np.flatnonzero(fit.late())
    for _ in range(_TIGHTENING):
        if not late.size:
            break
        part = fit.part(late)
        part.tighten()
        fit.take(part, late)
        late = late[part.late()]
    good = np.ones(len(first), dtype=bool)
    good[late] = False
    return fit, good


class Within:
    """The tolerance of the moves (n,) that end at the distances `edge_m` (n + 1,), the first of which is a start, and
    which of them are rapid."""

    def __init__(self, edge_m: FloatArray, tolerance_m: FloatArray, rapid: npt.NDArray[np.bool_]) -> None:
        self._edge_m, self.tolerance_m, self._rapid = edge_m, tolerance_m, rapid

    def part(self, first: int, last: int) -> Within:
        """That of the moves from `first` to `last`."""
        moves = slice(first, last + 1)
        return Within(self._edge_m[first : last + 2], self.tolerance_m[moves], self._rapid[moves])

    def between(self, low_m: FloatArray, high_m: FloatArray) -> FloatArray:
        """The least tolerance (n,) between two distances; where moves meet, that of both of them."""
        most = len(self.tolerance_m) - 1
        first = np.clip(np.searchsorted(self._edge_m, low_m, side="left") - 1, 0, most)
        last = np.clip(np.searchsorted(self._edge_m, high_m, side="right") - 1, 0, most)
        rows = np.stack([first, last + 1], axis=1).ravel()
        return np.asarray(np.minimum.reduceat(np.append(self.tolerance_m, math.inf), rows)[::2])

    def rapid(self, at_m: FloatArray) -> npt.NDArray[np.bool_]:
        """Whether the moves at distances (n,) are rapid."""
        return np.asarray(self._rapid[np.clip(np.searchsorted(self._edge_m, at_m) - 1, 0, len(self._rapid) - 1)])


def _knots(at: FloatArray, turn: FloatArray, stops: FloatArray, tolerance_m: FloatArray) -> list[FloatArray]:
    """The knots of each stretch. The path turns by `turn` (n,) at the distances `at`, within a tolerance (n,)."""
    total = np.append(0.0, np.cumsum(turn))
    most = np.minimum(np.diff(stops) / _SPANS_MIN, _SPACING_MAX_M)
    spacing = most[np.clip(np.searchsorted(stops, at, side="right") - 1, 0, len(most) - 1)]
    open_rows, h = np.arange(len(at)), float(np.max(most))
    while open_rows.size and h > 0.05 * np.min(tolerance_m):
        s = at[open_rows]
        inside = total[np.searchsorted(at, s + h, side="right")] - total[np.searchsorted(at, s - h, side="left")]
        done = h * inside <= _DENSITY * tolerance_m[open_rows]
        spacing[open_rows] = np.minimum(spacing[open_rows], h)
        open_rows, h = open_rows[~done], h / _LADDER
    return [
        _graded(
            np.concatenate([[a], at[(rows := slice(*np.searchsorted(at, [a, b], side="right")))], [b]]),
            np.concatenate([[h_most], spacing[rows], [h_most]]),
            float(h_most),
        )
        for a, b, h_most in zip(stops[:-1], stops[1:], most, strict=True)
    ]


def _graded(s: FloatArray, h: FloatArray, most: float) -> FloatArray:
    """Knots from the first to the last `s` (n,) with the spacing `h` (n,) there, which grows at most by _GROWTH."""
    h = np.minimum.accumulate(h - _GROWTH * s) + _GROWTH * s
    h = np.minimum.accumulate((h + _GROWTH * s)[::-1])[::-1] - _GROWTH * s
    middle = np.clip(0.5 * (s[1:] + s[:-1]) + (h[1:] - h[:-1]) / (2.0 * _GROWTH), s[:-1], s[1:])
    nodes, spacing = np.empty(2 * len(s) - 1), np.empty(2 * len(s) - 1)
    nodes[::2], nodes[1::2], spacing[::2] = s, middle, h
    spacing[1::2] = np.minimum(most, h[:-1] + _GROWTH * (middle - s[:-1]))
    spacing = np.maximum(spacing, 1e-9)
    length, change = np.diff(nodes), np.diff(spacing)
    even = np.abs(change) < 1e-6 * spacing[1:]
    rate = np.where(even | (length <= 0.0), 0.0, change / np.maximum(length, 1e-300))
    spans = np.where(
        rate == 0.0, length / spacing[:-1], np.log(spacing[1:] / spacing[:-1]) / np.where(rate == 0.0, 1.0, rate)
    )
    number = np.append(0.0, np.cumsum(spans))
    count = max(math.ceil(number[-1]), _SPANS_MIN)
    want = np.linspace(0.0, number[-1], count + 1)
    cell = np.clip(np.searchsorted(number, want, side="right") - 1, 0, len(spans) - 1)
    over, r = want - number[cell], rate[cell]
    knots = nodes[cell] + spacing[:-1][cell] * np.where(r == 0.0, over, np.expm1(r * over) / np.where(r == 0.0, 1.0, r))
    knots[[0, -1]] = s[[0, -1]]
    return np.asarray(knots)


class Fit:
    """Splines for stretches of a path at once. Their parameter is the distance along them, one after the other; stops
    are knots of full multiplicity."""

    def __init__(
        self,
        polyline: Polyline,
        knots: list[FloatArray],
        joints: FloatArray,
        within: Within,
        head: FloatArray | None = None,
    ) -> None:
        k = _DEGREE
        self._polyline, self._knots, self._joints, self._within = polyline, knots, joints, within
        self._head = head
        spans = np.array([len(g) - 1 for g in knots])
        start = np.array([g[0] for g in knots])
        length = np.array([g[-1] - g[0] for g in knots])
        edge = np.append(0.0, np.cumsum(length))
        self._shift = start - edge[:-1]  # of the distance along the file's path, for each stretch
        moved = [g - shift for g, shift in zip(knots, self._shift, strict=True)]
        self._t = np.concatenate(
            [*(np.append(np.full(k + 1, e), g[1:-1]) for e, g in zip(edge, moved, strict=False)), [edge[-1]] * (k + 1)]
        )
        self._n = len(self._t) - k - 1
        self._first = np.append(0, np.cumsum(spans + k))  # coefficient of each stretch
        self._span = np.append(0, np.cumsum(spans))  # of each stretch
        self._stretch = np.repeat(np.arange(len(knots)), spans)  # of each span
        self._base = np.arange(len(self._stretch)) + k * self._stretch  # first coefficient of each span
        low = np.concatenate([g[:-1] for g in knots])
        self._h = np.concatenate([np.diff(g) for g in knots])
        self._tolerance_m = within.between(low, low + self._h)
        self._middle = low + 0.5 * self._h
        self._joint_span = np.searchsorted(low, joints, side="right") - 1
        self._joint_point = polyline.point(joints)
        at = low + ((np.arange(_SAMPLES) + 0.5) / _SAMPLES)[:, None] * self._h
        values = BSpline.design_matrix((at - self._shift[self._stretch]).T.ravel(), self._t, k).data
        self._basis = np.ascontiguousarray(values.reshape(len(low), _SAMPLES, k + 1).transpose(2, 1, 0))
        greville = np.mean([self._t[1 + i : 1 + i + self._n] for i in range(k)], axis=0)
        owner = np.searchsorted(self._first, np.arange(self._n), side="right") - 1
        self._start = polyline.point(greville + self._shift[owner])
        self._fixed = np.concatenate([self._first[:-1], self._first[1:] - 1])  # coefficients
        if head is not None:
            self._fixed = np.append(np.arange(k), self._fixed[1:])
            basis = BSpline(self._t[: 2 * k + 2], np.eye(k + 1), k)
            slopes = np.stack([basis(self._t[k], order)[:k] for order in range(k)])
            self._start[:k] = np.linalg.solve(slopes, head)
        self._step = np.zeros_like(self._start)
        self._rest = polyline.point(at.ravel()).T.reshape(2, *at.shape) - self._values(self._start)
        self._weight = np.ones_like(at)
        self._prepare(owner)

    def path(self, begin: int, end: int) -> SmoothPath:
        """The fit to the stretches from `begin` until before `end`, which follow one another in the file."""
        first, last = self._first[begin], self._first[end]
        knots = self._knots[begin:end]
        start = knots[0][0]
        spline = BSpline(
            self._t[first : last + _DEGREE + 1] + (self._shift[begin] - start),
            (self._start + self._step)[first:last],
            _DEGREE,
        )
        spans = slice(self._span[begin], self._span[end])
        off = self._off()[spans]
        rapid = self._within.rapid(self._middle[spans])
        grid = np.concatenate([*(g[:-1] for g in knots), knots[-1][-1:]]) - start
        stops = np.array([*(g[0] for g in knots), knots[-1][-1]]) - start
        worst = (float(np.max(off, where=of, initial=0.0)) for of in (~rapid, rapid))
        return SmoothPath(spline, grid, stops, *worst)

    def part(self, stretches: _Index) -> Fit:
        """A fit of some of the stretches, with the weights up to now."""
        inside = np.isin(self._stretch[self._joint_span], stretches)
        out = Fit(self._polyline, [self._knots[i] for i in stretches], self._joints[inside], self._within, self._head)
        spans, rows = self._rows(stretches)
        out._weight = self._weight[:, spans]
        out._step = self._step[rows]
        return out

    def take(self, part: Fit, stretches: _Index) -> None:
        """Take over the result of part(stretches)."""
        spans, rows = self._rows(stretches)
        self._weight[:, spans] = part._weight
        self._step[rows] = part._step

    def _rows(self, stretches: _Index) -> tuple[_Index, _Index]:
        """Spans and coefficients of some stretches."""
        spans = np.concatenate([np.arange(self._span[i], self._span[i + 1]) for i in stretches])
        return spans, np.concatenate([np.arange(self._first[i], self._first[i + 1]) for i in stretches])

    def relax(self) -> None:
        """Let the curve have what the tolerance allows."""
        for turn in range(_RELAXING):
            self._solve()
            if turn < _RELAXING - 1:
                off = self._sample_off() / self._tolerance_m
                self._set_weight(self._weight * np.clip((off / _AIM) ** 2, 0.2, 10.0))

    def tighten(self) -> None:
        """Draw the curve to the path where it is beyond the tolerance."""
        worst = self._off() / self._tolerance_m
        wide = worst.copy()
        wide[1:], wide[:-1] = np.maximum(wide[1:], worst[:-1]), np.maximum(wide[:-1], worst[1:])
        self._set_weight(self._weight * np.where(wide > 0.97, np.clip(wide / _AIM, 1.2, 3.0) ** 2, 1.0))
        self._solve()

    def late(self) -> npt.NDArray[np.bool_]:
        """Which of the stretches are beyond the tolerance, or so near to it that they may be between the samples."""
        return np.asarray(np.maximum.reduceat(self._off() / self._tolerance_m, self._span[:-1]) > _HELD)

    def _set_weight(self, weight: FloatArray) -> None:
        """Set the weights, kept in their range and even enough from span to span."""
        weight = np.clip(weight, *_WEIGHT_RANGE)
        slope = np.arange(len(self._h)) * math.log(_WEIGHT_RATIO)
        size = np.log(np.max(weight, axis=0))
        up, down = np.maximum.accumulate(size + slope) - slope, np.maximum.accumulate((size - slope)[::-1])[::-1]
        self._weight = np.maximum(weight, np.exp(np.maximum(up, down + slope)) / _WEIGHT_RATIO)

    def _sample_off(self) -> FloatArray:
        """Distance (_SAMPLES, spans) from the file's path."""
        x, y = self._rest - self._values(self._step)
        return np.asarray(np.hypot(x, y))

    def _off(self) -> FloatArray:
        """Greatest distance (spans,) from the file's path in each span."""
        off = np.max(self._sample_off(), axis=0)
        at = self._joints - self._shift[self._stretch[self._joint_span]]
        gap = self._joint_point - BSpline(self._t, self._start + self._step, _DEGREE)(at)
        np.maximum.at(off, self._joint_span, np.hypot(gap[:, 0], gap[:, 1]))
        return np.asarray(off)

    def _values(self, coefficients: FloatArray) -> FloatArray:
        """Values (2, _SAMPLES, spans) at the samples."""
        out = np.zeros((2, *self._basis.shape[1:]))
        for axis in (0, 1):
            column = np.ascontiguousarray(coefficients[:, axis])
            for i, basis in enumerate(self._basis):
                out[axis] += basis * column[self._base + i]
        return out

    def _prepare(self, owner: _Index) -> None:
        """The part of the equations that comes from the integral of |p'''|^2. `owner` (n,): stretch of each
        coefficient."""
        n, t, k = self._n, self._t, _DEGREE
        third = np.ones((n, 1))
        for order in range(3):
            degree, rows = k - order, len(third) - 1
            inner = t[order : len(t) - order]
            width = inner[1 + degree : 1 + degree + rows] - inner[1 : 1 + rows]
            factor = np.divide(degree, width, out=np.zeros(rows), where=width > 0.0)
            new = np.zeros((rows, third.shape[1] + 1))
            new[:, 1:] += third[1:]
            new[:, :-1] -= third[:-1]
            third = factor[:, None] * new
        third[owner[: n - 3] != owner[3:]] = 0.0
        size = ((t[6 : n + 3] - t[3:n]) / 3.0) ** (1.0 + _SLOWING)
        self._smooth_band = np.zeros((k + 1, n))
        self._smooth_right = np.zeros((n, 2))
        now = np.zeros((n - 3, 2))
        for i in range(4):
            now += third[:, i, None] * self._start[i : i + n - 3]
        for i in range(4):
            self._smooth_right[i : i + n - 3] -= (size * third[:, i])[:, None] * now
            for j in range(i, 4):
                self._smooth_band[j - i, i : i + n - 3] += size * third[:, i] * third[:, j]

    def _solve(self) -> None:
        """The spline of least squares with the weights."""
        weight = self._weight * (self._h ** (_SLOWING - 5.0) / _SAMPLES)
        band, right = self._smooth_band.copy(), self._smooth_right.copy()
        for i, basis in enumerate(self._basis):
            weighted = weight * basis
            for axis in (0, 1):
                right[self._base + i, axis] += np.sum(weighted * self._rest[axis], axis=0)
            for j in range(i, _DEGREE + 1):
                band[j - i, self._base + i] += np.sum(weighted * self._basis[j], axis=0)
        band[0, self._fixed] *= 1e9  # they stay where they are
        right[self._fixed] = 0.0
        self._step = np.asarray(solveh_banded(band, right, lower=True, check_finite=False))
