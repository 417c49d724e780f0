# SPDX-License-Identifier: Apache-2.0
"""Scoring: the true distance of a simulated machine from the programmed path.

Measured against the lines, arcs and ideal shapes of the program itself, in double precision. Nothing here comes from
the firmware, the planner or its spline, so their errors show in the score.

The foot point of a true position q is the closest point of the path in a neighbourhood of the expected path position s,
so that it is not on the other branch of a crossing or on the lap before. With d = |q - c(s)| the foot is at most
2 d away from c(s); the search covers 4 d of path on either side, which allows for bends up to an arc of twice its chord
without a distance to be chosen by anyone.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from kontur.errors import PathError
from kontur.path.geometry import Curve, Program
from kontur.path.moves import arcs, ends_m, feeds_mps, lengths_m, others
from kontur.path.spline_fit import SmoothPath

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_REACH = 4.0  # path searched on either side of the expected position, in distances to it
_NEWTON_M = 1e-11  # a foot point is found when it moves less; the distance errs by the square of it
_NEWTON_MAX = 80
_STRAIGHT, _LOOKS = 0.99, 33  # chord over length of a curve that may have one foot point only; where others are sought
_REST = 1e-9  # a curve rests where its formula moves less, in m per unit of its parameter
_BESIDE_M = 1e-9
_TABLE_M = 20e-6  # spacing of a curve's table of arc length, at most; interpolated it is right to far below 1 pm
_TABLE_MIN = 1 << 14
_PART, _PARTS, _MARGIN = 1 << 15, 4, 4  # nodes of a part of the table, parts that are kept, nodes on either side of one


@dataclass(frozen=True)
class ContourError:
    """True error of n positions, each (n,) in m.

    `normal_m`: distance to the programmed path, positive on its left. `tangential_m`: path position of the foot minus
    the expected one, negative when the machine lags. `foot_s_m`: path position of the foot from the program's start.
    """

    normal_m: Array
    tangential_m: Array
    foot_s_m: Array


@dataclass(frozen=True)
class Score:
    """Size of the true contour error over a run: absolute values in um; where the greatest was; scored from when."""

    mean_um: float
    rms_um: float
    max_um: float
    tangential_mean_um: float
    max_time_s: float
    max_x_mm: float
    max_y_mm: float
    from_s: float


class Scorer:
    """Scores the true positions of a run against `program` as they come, from `from_s` on.

    Raises PathError: the program has no piece of any length.
    """

    def __init__(self, program: Program, from_s: float = 0.0) -> None:
        self._pieces = _Pieces(program)
        self._from_s = from_s
        self._all, self._scored = _Sums(), _Sums()

    def add(self, time_s: Array, position_m: Array, path_s_m: Array, force_N: Array) -> ContourError:
        """The error of the next positions (n, 2) at `time_s` (n,), expected at `path_s_m` (n,); `force_N` (n, 2)."""
        error = self._pieces.error(position_m, path_s_m)
        self._all.add(time_s, position_m, error, force_N)
        if self._from_s > 0.0:
            rows = time_s >= self._from_s
            scored = ContourError(error.normal_m[rows], error.tangential_m[rows], error.foot_s_m[rows])
            self._scored.add(time_s[rows], position_m[rows], scored, force_N[rows])
        return error

    def score(self) -> Score | None:
        """The score so far; a run that ended before `from_s` is scored from its start. None: nothing to score."""
        sums, from_s = (self._scored, self._from_s) if self._scored.count else (self._all, 0.0)
        return sums.score(from_s) if sums.count else None

    def effort(self) -> tuple[float, float]:
        """Greatest force of an axis, and mean length of its change from one row to the next, in N."""
        sums = self._scored if self._scored.count else self._all
        return sums.force_max_N, sums.step_sum_N / sums.steps if sums.steps else 0.0


class _Sums:
    """Sums and greatest values of the rows so far."""

    def __init__(self) -> None:
        self.count, self.steps = 0, 0
        self.force_max_N, self.step_sum_N = 0.0, 0.0
        self._sum = self._squares = self._along = 0.0
        self._worst = (-1.0, 0.0, 0.0, 0.0)  # size in um, time, x, y
        self._last_N = np.empty((0, 2))

    def add(self, time_s: Array, position_m: Array, error: ContourError, force_N: Array) -> None:
        if not time_s.size:
            return
        normal_um = np.abs(error.normal_m) * 1e6
        worst = int(np.argmax(normal_um))
        if normal_um[worst] > self._worst[0]:
            x, y = position_m[worst]
            self._worst = (float(normal_um[worst]), float(time_s[worst]), float(x), float(y))
        self._sum += float(np.sum(normal_um))
        self._squares += float(np.sum(normal_um**2))
        self._along += float(np.sum(np.abs(error.tangential_m)))
        self.count += time_s.size
        step_N = _length(np.diff(np.concatenate([self._last_N, force_N]), axis=0))
        self.force_max_N = max(self.force_max_N, float(np.max(np.abs(force_N))))
        self.step_sum_N += float(np.sum(step_N))
        self.steps += step_N.size
        self._last_N = force_N[-1:].copy()

    def score(self, from_s: float) -> Score:
        max_um, time_s, x_m, y_m = self._worst
        return Score(
            mean_um=self._sum / self.count,
            rms_um=float(np.sqrt(self._squares / self.count)),
            max_um=max_um,
            tangential_mean_um=self._along / self.count * 1e6,
            max_time_s=time_s,
            max_x_mm=x_m * 1e3,
            max_y_mm=y_m * 1e3,
            from_s=from_s,
        )


class Rapids:
    """Which parts of `program` are rapid moves."""

    def __init__(self, program: Program) -> None:
        self._ends_m = np.cumsum(lengths_m(program.moves))
        self._rapid = np.isinf(feeds_mps(program.moves))

    def at(self, path_s_m: Array) -> NDArray[np.bool_]:
        """Whether the move at each path position `path_s_m` (n,) is a rapid one."""
        move = np.clip(np.searchsorted(self._ends_m, path_s_m), 0, len(self._ends_m) - 1)
        return np.asarray(self._rapid[move])


def contour_error(program: Program, position_m: Array, path_s_m: Array) -> ContourError:
    """True contour error of `position_m` (n, 2), expected at path position `path_s_m` (n,): the distance travelled
    along the program, clipped to its length.

    Corners: beyond the end of a piece the neighbouring piece counts, or the corner point itself if that is nearest.

    Raises PathError: the program has no piece of any length. ValueError: the shapes do not fit.
    """
    if position_m.ndim != 2 or position_m.shape != (path_s_m.size, 2):
        raise ValueError(f"positions {position_m.shape} and path positions {path_s_m.shape} do not fit")
    return _Pieces(program).error(position_m, path_s_m)


class _Best:
    """The nearest foot point found so far, for each row."""

    def __init__(self, rows: int) -> None:
        self.distance = np.full(rows, np.inf)
        self.normal = np.zeros(rows)
        self.foot_s = np.zeros(rows)

    def offer(self, rows: Index, q_m: Array, pieces: _Pieces, piece: Index, foot: Array) -> None:
        point, tangent = pieces.evaluate(piece, foot)
        off = q_m - point
        distance = _length(off)
        nearer = distance < self.distance[rows]
        rows, piece, foot, distance = rows[nearer], piece[nearer], foot[nearer], distance[nearer]
        side = _cross(pieces.side_tangent(piece, foot, tangent[nearer]), off[nearer])
        self.distance[rows] = distance
        self.normal[rows] = np.copysign(distance, side)
        self.foot_s[rows] = pieces.start_s[piece] + foot


class _Pieces:
    """The pieces of a program that have a length, evaluated and searched for many rows at once.

    A line and an arc are the same here: a start, a tangent and a constant curvature.
    """

    def __init__(self, program: Program) -> None:
        moves = program.moves
        self.length = lengths_m(moves)
        if not np.all(self.length > 0.0):
            moves = tuple(move for move in moves if move.segment.length_m > 0.0)
            self.length = lengths_m(moves)
        if not moves:
            raise PathError(f"{program.name}: there is no motion in it, so there is nothing to score")
        start, count = np.zeros(1), len(moves)
        self.end_s = np.cumsum(self.length)
        self.start_s = np.concatenate([start, self.end_s[:-1]])
        ends = ends_m(moves)
        self.point_in = ends[:, :2].copy()
        self.tangent_in = (ends[:, 2:] - self.point_in) / self.length[:, None]
        self.tangent_out = self.tangent_in.copy()
        self.bend = np.zeros(count)
        self.curves: dict[int, _FastCurve] = {}
        bent, everything = arcs(moves), slice(None)
        self.tangent_in[bent.at] = bent.tangent(everything, np.zeros(len(bent)))
        self.tangent_out[bent.at] = bent.tangent(everything, bent.length_m)
        self.bend[bent.at] = bent.curvature
        for i in others(moves):
            segment = moves[i].segment
            self.point_in[i], self.tangent_in[i] = segment.point(start)[0], segment.tangent(start)[0]
            self.tangent_out[i] = segment.tangent(self.length[i : i + 1])[0]
            self.bend[i] = segment.curvature(start)[0]
            if isinstance(segment, Curve):
                self.curves[i] = _FastCurve(segment)
            elif isinstance(segment, SmoothPath):
                self.curves[i] = _SmoothCurve(segment)
        self.bend[list(self.curves)] = 0.0

    def error(self, position_m: Array, path_s_m: Array) -> ContourError:
        """contour_error() of positions on these pieces."""
        expected_s = np.clip(path_s_m, 0.0, self.end_s[-1])
        home = np.clip(np.searchsorted(self.end_s, expected_s, side="left"), 0, len(self.end_s) - 1)
        point, _ = self.evaluate(home, expected_s - self.start_s[home])
        reach = _REACH * _length(position_m - point)
        low_s, high_s = expected_s - reach, expected_s + reach

        best = _Best(expected_s.size)
        everything = np.arange(expected_s.size)
        for step in (1, -1):
            rows, piece = everything, home if step == 1 else home - 1
            while True:
                inside = (piece >= 0) & (piece < len(self.end_s))
                rows, piece = rows[inside], piece[inside]
                reached = (self.start_s[piece] <= high_s[rows]) & (self.end_s[piece] >= low_s[rows])
                reached |= piece == home[rows]
                rows, piece = rows[reached], piece[reached]
                if not rows.size:
                    break
                start_s = self.start_s[piece]
                low = np.clip(low_s[rows] - start_s, 0.0, self.length[piece])
                high = np.clip(high_s[rows] - start_s, 0.0, self.length[piece])
                guess_s = np.clip(expected_s[rows] - start_s, low, high)
                foot = self.foot(piece, position_m[rows], low, high, guess_s)
                best.offer(rows, position_m[rows], self, piece, foot)
                piece = piece + step
        return ContourError(best.normal, best.foot_s - expected_s, best.foot_s)

    def evaluate(self, piece: Index, s: Array) -> tuple[Array, Array]:
        """Points and unit tangents (n, 2) at `s` (n,) from the start of `piece` (n,)."""
        half = 0.5 * self.bend[piece] * s
        along, across = np.sinc(half / np.pi) * np.cos(half), np.sinc(half / np.pi) * np.sin(half)
        point = self.point_in[piece] + _turned(self.tangent_in[piece], s * along, s * across)
        tangent = _turned(self.tangent_in[piece], np.cos(2.0 * half), np.sin(2.0 * half))
        for rows, curve in self._curved(piece):
            point[rows], tangent[rows], _ = curve.evaluate(s[rows])
        return point, tangent

    def foot(self, piece: Index, q_m: Array, low: Array, high: Array, guess: Array) -> Array:
        """Foot points of `q_m` (n, 2) on `piece` between `low` and `high`, for an arc within half a lap of `guess`."""
        point, tangent = self.evaluate(piece, guess)
        bend = self.bend[piece]
        along = np.sum((q_m - point) * tangent, axis=1)
        angle = np.arctan2(bend * along, 1.0 - bend * _cross(tangent, q_m - point))
        foot = guess + np.divide(angle, bend, out=along, where=bend != 0.0)
        for rows, curve in self._curved(piece):
            foot[rows] = curve.foot(q_m[rows], low[rows], high[rows], guess[rows])
        return np.asarray(np.clip(foot, low, high))

    def side_tangent(self, piece: Index, s: Array, tangent: Array) -> Array:
        """The direction whose left side is positive: the tangent, at a corner the middle of both tangents."""
        before = self.tangent_out[piece - 1] * ((s <= 0.0) & (piece > 0))[:, None]
        last = len(self.length) - 1
        after = self.tangent_in[np.minimum(piece + 1, last)] * ((s >= self.length[piece]) & (piece < last))[:, None]
        return np.asarray(tangent + before + after)

    def _curved(self, piece: Index) -> Iterator[tuple[Index, _FastCurve]]:
        for i in np.unique(piece) if self.curves else ():
            if i in self.curves:
                yield np.flatnonzero(piece == i), self.curves[i]


class _FastCurve:
    """A curve by its formula, with a table from arc length to the formula's parameter: points are exact, arc lengths
    right to far below 1 pm. Of a long curve only the parts of the table are kept that are in use."""

    def __init__(self, curve: Curve) -> None:
        self.formula = curve.formula
        self._curve: Curve | SmoothPath = curve
        self._ends = curve.parameter(np.array([0.0, curve.length_m]))
        self._nodes = max(_TABLE_MIN, int(curve.length_m / _TABLE_M))
        self._arc_length = curve.arc_length
        self._edge_s = curve.arc_length(self._node(np.arange(_PART, self._nodes, _PART)))  # between two parts
        self._part = functools.lru_cache(_PARTS)(self._table)

    def evaluate(self, s: Array) -> tuple[Array, Array, Array]:
        """Points and unit tangents (n, 2) and curvatures (n,) at `s` (n,).

        Where the formula rests it has no direction: tangent and curvature are those beside it.
        """
        u = self._parameter(s)
        point, first, second = (self.formula(u, order) for order in (0, 1, 2))
        rests = np.flatnonzero(_length(first) < _REST)
        if rests.size:
            beside = s[rests] + np.where(s[rests] < 0.5 * self._curve.length_m, _BESIDE_M, -_BESIDE_M)
            u_beside = self._parameter(beside)
            first[rests], second[rests] = self.formula(u_beside, 1), self.formula(u_beside, 2)
        speed = np.maximum(_length(first), _REST)
        return point, first / speed[:, None], _cross(first, second) / speed**3

    def _parameter(self, s: Array) -> Array:
        part = np.searchsorted(self._edge_s, s, side="right")
        u = np.empty_like(s)
        for number in np.unique(part):
            rows = part == number
            u[rows] = self._part(int(number))(s[rows])
        return u

    def _table(self, part: int) -> PchipInterpolator:
        """The table of a part; a few nodes more on either side make it the same as that of the whole curve."""
        last = min((part + 1) * _PART + _MARGIN, self._nodes)
        u = self._node(np.arange(max(0, part * _PART - _MARGIN), last))
        s, first = np.unique(self._arc_length(u), return_index=True)
        return PchipInterpolator(s, u[first])

    def _node(self, number: Index) -> Array:
        """Parameter of the nodes `number` (n,), evenly spaced over the curve."""
        low, high = self._ends
        step = (high - low) / (self._nodes - 1)
        return np.asarray(np.where(number == self._nodes - 1, high, low + number * step))

    def foot(self, q_m: Array, low: Array, high: Array, guess: Array) -> Array:
        """The foot point that is found from `guess`; where the curve bends much between `low` and `high`, as round a
        corner, the nearest one there."""
        s = self._root(q_m, low, high, guess)
        bent = np.flatnonzero(_length(self._point(high) - self._point(low)) < _STRAIGHT * (high - low))
        if bent.size:
            q_m, low, high = q_m[bent], low[bent], high[bent]
            step = (high - low) / (_LOOKS - 1)
            at = low + step * np.arange(_LOOKS)[:, None]
            off = self._point(at.ravel()).reshape(*at.shape, 2) - q_m
            near = low + step * np.argmin(np.hypot(off[..., 0], off[..., 1]), axis=0)
            other = self._root(q_m, np.maximum(near - step, low), np.minimum(near + step, high), near)
            nearer = _length(self._point(other) - q_m) < _length(self._point(s[bent]) - q_m)
            s[bent[nearer]] = other[nearer]
        return s

    def _point(self, s: Array) -> Array:
        return self.formula(self._parameter(s), 0)

    def _root(self, q_m: Array, low: Array, high: Array, guess: Array) -> Array:
        """Root of (q - c(s)) . c'(s) by Newton from `guess`, confined between `low` and `high` by bisection."""
        s, low, high = guess.copy(), low.copy(), high.copy()
        active = np.arange(s.size)
        for turn in range(_NEWTON_MAX):
            now = s[active]
            point, tangent, bend = self.evaluate(now)
            off = q_m[active] - point
            gap = np.sum(off * tangent, axis=1)
            low[active] = np.where(gap > 0.0, now, low[active])
            high[active] = np.where(gap > 0.0, high[active], now)
            fall = 1.0 - bend * _cross(tangent, off)  # -d gap / ds
            new = now + gap / np.where(fall > 0.0, fall, 1.0)
            if turn == 0:  # the foot may be an end itself
                new = np.clip(new, low[active], high[active])
            wild = (fall <= 0.0) | (new < low[active]) | (new > high[active])
            new = np.where(wild, 0.5 * (low[active] + high[active]), new)
            s[active] = new
            active = active[np.abs(new - now) > _NEWTON_M]
            if not active.size:
                break
        return s


class _SmoothCurve(_FastCurve):
    """A smoothed path, by the distance along the file's path, which is nearly its own arc length."""

    def __init__(self, path: SmoothPath) -> None:
        self.formula = path.derivative
        self._curve = path

    def _parameter(self, s: Array) -> Array:
        return s


def _length(vector: Array) -> Array:
    return np.hypot(vector[:, 0], vector[:, 1])


def _cross(a: Array, b: Array) -> Array:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _turned(tangent: Array, along: Array, across: Array) -> Array:
    """Vectors (n, 2) that go `along` the tangent and `across` to its left."""
    x, y = tangent[:, 0], tangent[:, 1]
    return np.stack([along * x - across * y, along * y + across * x], axis=1)
