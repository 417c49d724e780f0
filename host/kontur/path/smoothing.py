# SPDX-License-Identifier: Apache-2.0
"""A smooth curve within a tolerance of a path of many short pieces, such as CAM programs consist of.

The path is cut where the motion stops: at dwells, at true corners, and where the tolerance changes. Between two stops
the curve is a quintic B-spline p(s), whose parameter is the distance s along the file's path q(s). Of all such splines
it is nearly the one with the least integral of |p'''|^2 among those with |p(s) - q(s)| <= tolerance for all s. As s is
the same in both, neither path is further from the other than the tolerance.

The spline is found by weighted least squares: a sample's weight grows as long as the curve is too far from it, and
falls where it is near. Its knots are as dense as the turning of the path needs: h times the turning within h is in
proportion to the tolerance.

A program without joints of lines that turn, other than corners, is not smoothed at all; in others, arcs between stops
and what the spline does not fit within the tolerance stay exact.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline
from scipy.linalg import solveh_banded

from kontur.path.geometry import Arc, Dwell, FloatArray, Line, Move, Program
from kontur.path.line_arc import LineArcPath

TOLERANCE_M = 10e-6
"""How far a smoothed path may be from the file's, unless something else is said."""
CORNER_RAD = 0.6
"""A joint of pieces that turns by more is a true corner and stays a stop."""
EXACT_RAD = 2e-3  # a joint that turns by less counts as tangent
_EVEN_RAD = 1e-6  # lines that turn by less are one line
_CORNER_REACH = 4.0  # tolerances from a corner over which its turn is measured, too
_DEGREE = 5
_SAMPLES = 4  # in a span of the spline
_DENSITY = 2.0  # knots: spacing times turning, in tolerances
_GROWTH = 0.4  # of the spacing of the knots along the path
_SPACING_MAX_M = 5e-3
_SPANS_MIN = 6
_LADDER = 1.25  # ratio of the spacings that are tried
_AIM = 0.85  # of the tolerance
_RELAXING, _TIGHTENING = 8, 14  # rounds
_WEIGHT_RANGE = (1e-4, 1e4)
_WEIGHT_RATIO = 4.0  # from span to span
_MOVES = 20_000  # about as many are smoothed at once, to bound memory
_TURN_STEP_RAD = 0.05
_SHORT_S = 3.0

_Index = npt.NDArray[np.intp]


def toleranced(program: Program, tolerance_m: float | None) -> Program:
    """`program` with this tolerance for all moves, whatever it says itself; None: as it says."""
    if tolerance_m is None:
        return program
    items = [replace(item, tolerance_m=tolerance_m) if isinstance(item, Move) else item for item in program.items]
    return replace(program, items=tuple(items))


@dataclass(frozen=True, eq=False)
class SmoothPath:
    """A smoothed path of one or more stretches, by the distance along the file's path (Segment of kontur.path.geometry,
    but for that). `stops_m` (k + 1,): its ends and where it rests between them. `deviation_m`: from the file's path.
    """

    spline: BSpline
    grid_m: FloatArray
    stops_m: FloatArray
    deviation_m: float

    @property
    def length_m(self) -> float:
        return float(self.stops_m[-1])

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


@dataclass(frozen=True)
class Exact:
    """Items of a program that are driven as they are."""

    items: tuple[Move | Dwell, ...]

    @property
    def moves(self) -> tuple[Move, ...]:
        return tuple(item for item in self.items if isinstance(item, Move))


@dataclass(frozen=True)
class Smooth:
    """Moves of a program that are driven along `path`, smoothed or exact, with a dwell of `dwell_s` (k + 1,) at each of
    its stops."""

    moves: tuple[Move, ...]
    path: SmoothPath | LineArcPath
    dwell_s: FloatArray


@dataclass
class _Stretch:
    """Moves from one stop to the next, `first` to `last`, after the items `before` at rest."""

    first: int
    last: int
    smooth: bool
    tolerance_m: float
    before: tuple[Dwell, ...]


def parts(program: Program, tolerance_m: float) -> list[Exact | Smooth]:
    """`program` in parts, each from standstill to standstill. `tolerance_m`: of moves that have none of their own."""
    moves = program.moves
    if not any(_tolerance(move, tolerance_m) > 0.0 for move in moves) or any(move.schedule for move in moves):
        return [Exact(program.items)]
    polyline = _Polyline(moves)
    stretches, after = _stretches(program, polyline, tolerance_m)
    out: list[Exact | Smooth] = []
    for batch in _batches(stretches):
        if not batch[0].smooth:
            _add_unsmoothed(out, moves, batch)
            continue
        fit, good = _smoothed(polyline, batch)
        for run in _runs(batch, good):
            if good[run[0]]:
                begin, end = run[0], run[-1] + 1
                chosen = moves[batch[begin].first : batch[end - 1].last + 1]
                out.append(Smooth(chosen, fit.path(begin, end), _dwells(batch[begin:end])))
            else:
                _add_exact(out, moves, [batch[i] for i in run])
    if after:
        last = out[-1]
        if isinstance(last, Smooth):
            last.dwell_s[-1] += sum(dwell.duration_s for dwell in after)
        else:
            out[-1] = Exact((*last.items, *after))
    return out


def _tolerance(move: Move, otherwise_m: float) -> float:
    return otherwise_m if move.tolerance_m is None else move.tolerance_m


def _dwells(batch: list[_Stretch]) -> FloatArray:
    return np.array([*(sum(one.duration_s for one in stretch.before) for stretch in batch), 0.0])


def _add_unsmoothed(out: list[Exact | Smooth], moves: tuple[Move, ...], batch: list[_Stretch]) -> None:
    """Add stretches that are not smoothed. Arcs that stand alone between stops are optimised, with the lines there."""
    alone = np.array([s.tolerance_m > 0.0 and s.first == s.last and _short(moves[s.first]) for s in batch])
    for run in _runs(batch, alone):
        chosen = [batch[i] for i in run]
        part = moves[chosen[0].first : chosen[-1].last + 1]
        if alone[run[0]] and any(isinstance(move.segment, Arc) for move in part):
            out.append(Smooth(part, LineArcPath(part), _dwells(chosen)))
        else:
            _add_exact(out, moves, chosen)


def _short(move: Move) -> bool:
    """Whether it is worth while to optimise a line or an arc: not where it goes at its feed for a long time."""
    return isinstance(move.segment, (Line, Arc)) and move.segment.length_m <= _SHORT_S * min(move.feed_mps, 1.0)


def _add_exact(out: list[Exact | Smooth], moves: tuple[Move, ...], batch: list[_Stretch]) -> None:
    items: list[Move | Dwell] = []
    for one in batch:
        items += [*one.before, *moves[one.first : one.last + 1]]
    if out and isinstance(out[-1], Exact):
        items = [*out.pop().items, *items]  # type: ignore[union-attr]
    out.append(Exact(tuple(items)))


def _runs(batch: list[_Stretch], good: npt.NDArray[np.bool_]) -> Iterator[list[int]]:
    """Neighbours in `batch` that are alike in `good`."""
    edges = np.flatnonzero(np.diff(good)) + 1
    for run in np.split(np.arange(len(batch)), edges):
        yield run.tolist()


def _batches(stretches: list[_Stretch]) -> Iterator[list[_Stretch]]:
    """Neighbouring stretches that are exact, or smoothed with one tolerance, of about _MOVES at most."""
    batch: list[_Stretch] = []
    for stretch in stretches:
        if batch and (
            stretch.smooth != batch[0].smooth
            or stretch.tolerance_m != batch[0].tolerance_m
            or (stretch.smooth and stretch.last - batch[0].first >= _MOVES)
        ):
            yield batch
            batch = []
        batch.append(stretch)
    yield batch


def _stretches(program: Program, polyline: _Polyline, tolerance_m: float) -> tuple[list[_Stretch], tuple[Dwell, ...]]:
    """The stretches of the program, and its dwells at the end."""
    moves = program.moves
    tolerance = np.array([_tolerance(move, tolerance_m) for move in moves])
    dwells: dict[int, list[Dwell]] = {}
    count = 0
    for item in program.items:
        if isinstance(item, Dwell):
            dwells.setdefault(count, []).append(item)
        else:
            count += 1
    stop = (polyline.turn > EXACT_RAD) & (tolerance[1:] <= 0.0)
    stop |= tolerance[1:] != tolerance[:-1]
    stop |= polyline.corners(_CORNER_REACH * np.minimum(tolerance[1:], tolerance[:-1]))
    stop[[i - 1 for i in dwells if 0 < i < count]] = True
    bends = (polyline.turn > EXACT_RAD) | ((polyline.turn > _EVEN_RAD) & polyline.straight[1:] & polyline.straight[:-1])
    bends &= ~stop
    first = np.append(0, np.flatnonzero(stop) + 1)
    last = np.append(first[1:] - 1, count - 1)
    joints = np.append(0, np.cumsum(bends))
    smooth = (joints[last] > joints[first]) & (tolerance[first] > 0.0)
    if np.any(smooth):  # lines between corners are splines, too: exact ones, and the parts are fewer
        bent = np.append(0, np.cumsum(~polyline.straight))
        smooth |= (bent[last + 1] == bent[first]) & (tolerance[first] > 0.0)
    found = [
        _Stretch(int(a), int(b), bool(c), float(tolerance[a]), tuple(dwells.get(int(a), ())))
        for a, b, c in zip(first, last, smooth, strict=True)
    ]
    return found, tuple(dwells.get(count, ()))


class _Polyline:
    """The file's path with all its moves, by distance from its start."""

    def __init__(self, moves: tuple[Move, ...]) -> None:
        self._moves = moves
        self.straight = np.array([isinstance(move.segment, Line) for move in moves])
        self.edge = np.append(0.0, np.cumsum([move.segment.length_m for move in moves]))
        zero = np.zeros(1)
        ends = np.empty((len(moves) + 1, 2))
        ends[:-1] = [
            move.segment.start_m if isinstance(move.segment, Line) else move.segment.point(zero)[0] for move in moves
        ]
        tail = moves[-1].segment
        ends[-1] = tail.point(np.array([tail.length_m]))[0]
        self.ends = ends
        chord = np.diff(ends, axis=0)
        heading_in = np.arctan2(chord[:, 1], chord[:, 0])
        heading_out = heading_in.copy()
        self._bent = np.flatnonzero(~self.straight)
        for i in self._bent:
            segment = moves[i].segment
            tangent = segment.tangent(np.array([0.0, segment.length_m]))
            heading_in[i], heading_out[i] = np.arctan2(tangent[:, 1], tangent[:, 0])
        self.turn = np.abs(_wrapped(heading_in[1:] - heading_out[:-1]))

    def corners(self, reach_m: FloatArray) -> npt.NDArray[np.bool_]:
        """Which of the joints are true corners: they turn by more than CORNER_RAD, and so does the path from
        `reach_m` before to as much behind them."""
        corner = self.turn > CORNER_RAD
        at = np.flatnonzero(corner)
        s = self.edge[1:-1][at]
        here = self.point(s)
        before, after = here - self.point(s - reach_m[at]), self.point(s + reach_m[at]) - here
        turn = np.arctan2(after[:, 1], after[:, 0]) - np.arctan2(before[:, 1], before[:, 0])
        corner[at] = np.abs(_wrapped(turn)) > CORNER_RAD
        return corner

    def point(self, s_m: FloatArray) -> FloatArray:
        """Points (n, 2) at `s_m` (n,), clipped to the path."""
        s = np.clip(s_m, 0.0, self.edge[-1])
        out = np.stack([np.interp(s, self.edge, self.ends[:, axis]) for axis in (0, 1)], axis=1)
        if self._bent.size:
            move = np.clip(np.searchsorted(self.edge, s, side="right") - 1, 0, len(self._moves) - 1)
            rows = np.flatnonzero(~self.straight[move])
            rows = rows[np.argsort(move[rows], kind="stable")]
            for group in np.split(rows, np.flatnonzero(np.diff(move[rows])) + 1):
                if group.size:
                    i = int(move[group[0]])
                    out[group] = self._moves[i].segment.point(s[group] - self.edge[i])
        return out

    def features(self, first: int, last: int) -> tuple[FloatArray, FloatArray]:
        """Distances (n,), rising, at which the moves `first` to `last` turn, and by how much (n,)."""
        at, turn = [self.edge[first + 1 : last + 1]], [self.turn[first:last]]
        for i in self._bent[(self._bent >= first) & (self._bent <= last)]:
            segment = self._moves[i].segment
            bend = np.abs(segment.curvature(np.linspace(0.0, segment.length_m, 9)))
            count = 1 + math.ceil(float(np.max(bend)) * segment.length_m / _TURN_STEP_RAD)
            step = segment.length_m / count
            middle = (np.arange(count) + 0.5) * step
            at.append(self.edge[i] + middle)
            turn.append(np.abs(segment.curvature(middle)) * step)
        order = np.argsort(np.concatenate(at), kind="stable")
        return np.concatenate(at)[order], np.concatenate(turn)[order]


def _wrapped(angle: FloatArray) -> FloatArray:
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


# --- the fit ----------------------------------------------------------------------------------------------------------


def _smoothed(polyline: _Polyline, batch: list[_Stretch]) -> tuple[_Fit, npt.NDArray[np.bool_]]:
    """The fit to a batch, and which of its stretches are within their tolerance."""
    stops = polyline.edge[[*(stretch.first for stretch in batch), batch[-1].last + 1]]
    at, turn = polyline.features(batch[0].first, batch[-1].last)
    inside = ~np.isin(at, stops)
    tolerance = batch[0].tolerance_m
    fit = _Fit(polyline, _knots(at[inside], turn[inside], stops, tolerance), at[inside], tolerance)
    fit.relax()
    late = np.flatnonzero(fit.late())
    for _ in range(_TIGHTENING):
        if not late.size:
            break
        part = fit.part(late)
        part.tighten()
        fit.take(part, late)
        late = late[part.late()]
    good = np.ones(len(batch), dtype=bool)
    good[late] = False
    return fit, good


def _knots(at: FloatArray, turn: FloatArray, stops: FloatArray, tolerance_m: float) -> list[FloatArray]:
    """The knots of each stretch."""
    total = np.append(0.0, np.cumsum(turn))
    most = np.minimum(np.diff(stops) / _SPANS_MIN, _SPACING_MAX_M)
    spacing = most[np.clip(np.searchsorted(stops, at, side="right") - 1, 0, len(most) - 1)]
    open_rows, h = np.arange(len(at)), float(np.max(most))
    while open_rows.size and h > 0.05 * tolerance_m:
        s = at[open_rows]
        inside = total[np.searchsorted(at, s + h, side="right")] - total[np.searchsorted(at, s - h, side="left")]
        done = h * inside <= _DENSITY * tolerance_m
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


class _Fit:
    """Splines for stretches of a path at once. Their parameter is the distance along them, one after the other; stops
    are knots of full multiplicity."""

    def __init__(self, polyline: _Polyline, knots: list[FloatArray], joints: FloatArray, tolerance_m: float) -> None:
        k = _DEGREE
        self._polyline, self._knots, self._joints, self._tolerance_m = polyline, knots, joints, tolerance_m
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
        self._joint_span = np.searchsorted(low, joints, side="right") - 1
        self._joint_point = polyline.point(joints)
        at = low + ((np.arange(_SAMPLES) + 0.5) / _SAMPLES)[:, None] * self._h
        values = BSpline.design_matrix((at - self._shift[self._stretch]).T.ravel(), self._t, k).data
        self._basis = np.ascontiguousarray(values.reshape(len(low), _SAMPLES, k + 1).transpose(2, 1, 0))
        greville = np.mean([self._t[1 + i : 1 + i + self._n] for i in range(k)], axis=0)
        owner = np.searchsorted(self._first, np.arange(self._n), side="right") - 1
        self._start = polyline.point(greville + self._shift[owner])
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
        off = self._off()[self._span[begin] : self._span[end]]
        grid = np.concatenate([*(g[:-1] for g in knots), knots[-1][-1:]]) - start
        stops = np.array([*(g[0] for g in knots), knots[-1][-1]]) - start
        return SmoothPath(spline, grid, stops, float(np.max(off)))

    def part(self, stretches: _Index) -> _Fit:
        """A fit of some of the stretches, with the weights up to now."""
        inside = np.isin(self._stretch[self._joint_span], stretches)
        out = _Fit(self._polyline, [self._knots[i] for i in stretches], self._joints[inside], self._tolerance_m)
        spans, rows = self._rows(stretches)
        out._weight = self._weight[:, spans]
        out._step = self._step[rows]
        return out

    def take(self, part: _Fit, stretches: _Index) -> None:
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
        """Which of the stretches are beyond the tolerance."""
        return np.asarray(np.maximum.reduceat(self._off(), self._span[:-1]) > self._tolerance_m)

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
        size = (t[6 : n + 3] - t[3:n]) / 3.0
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
        weight = self._weight * (self._h**-5.0 / _SAMPLES)
        band, right = self._smooth_band.copy(), self._smooth_right.copy()
        for i, basis in enumerate(self._basis):
            weighted = weight * basis
            for axis in (0, 1):
                right[self._base + i, axis] += np.sum(weighted * self._rest[axis], axis=0)
            for j in range(i, _DEGREE + 1):
                band[j - i, self._base + i] += np.sum(weighted * self._basis[j], axis=0)
        ends = np.concatenate([self._first[:-1], self._first[1:] - 1])
        band[0, ends] *= 1e9  # they stay where they are
        right[ends] = 0.0
        self._step = np.asarray(solveh_banded(band, right, lower=True, check_finite=False))
