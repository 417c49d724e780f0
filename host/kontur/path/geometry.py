# SPDX-License-Identifier: Apache-2.0
"""The programmed path: lines, arcs and smooth curves by arc length, and programs made of them. Metres throughout.

This is the ideal geometry that a run is scored against; the planner only decides when to be where on it.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol, TypeVar, cast, overload

import numpy as np
import numpy.typing as npt

from kontur.path.arc_columns import ArcColumns
from kontur.path.events import Events
from kontur.path.rows import Rows

FloatArray = npt.NDArray[np.float64]
Point = tuple[float, float]

KNOT_S = 1e-3
"""Path time from one knot of the trajectory to the next (kontur.planning.knots)."""
_ROWS = 1 << 12  # of which objects are made at once
DURATION_MAX_S = 3600.0  # of a path: 3.6 million knots, which bounds memory


class Segment(Protocol):
    """A smooth piece of path by arc length: `s_m` (n,) runs from 0 to `length_m`."""

    @property
    def length_m(self) -> float: ...

    def point(self, s_m: FloatArray) -> FloatArray:
        """Positions (n, 2) in m."""

    def tangent(self, s_m: FloatArray) -> FloatArray:
        """Unit tangents (n, 2)."""

    def curvature(self, s_m: FloatArray) -> FloatArray:
        """Signed curvatures (n,) in 1/m, positive where the path bends to the left."""


@dataclass(frozen=True, slots=True)
class Line:
    """A straight piece from `start_m` to `end_m`, which must differ."""

    start_m: Point
    end_m: Point

    @property
    def length_m(self) -> float:
        return math.dist(self.start_m, self.end_m)

    def point(self, s_m: FloatArray) -> FloatArray:
        share = np.asarray(s_m)[:, None] / self.length_m
        return np.asarray((1.0 - share) * np.array(self.start_m) + share * np.array(self.end_m))

    def tangent(self, s_m: FloatArray) -> FloatArray:
        direction = (np.array(self.end_m) - np.array(self.start_m)) / self.length_m
        return np.tile(direction, (np.size(s_m), 1))

    def curvature(self, s_m: FloatArray) -> FloatArray:
        return np.zeros(np.size(s_m))


@dataclass(frozen=True, slots=True)
class Arc:
    """A circular piece from the angle `start_rad` (from the x axis) on, turning by `sweep_rad`.

    A positive sweep is counter-clockwise; it may be more than a full turn.
    """

    center_m: Point
    radius_m: float
    start_rad: float
    sweep_rad: float

    @property
    def length_m(self) -> float:
        return self.radius_m * abs(self.sweep_rad)

    def _angle(self, s_m: FloatArray) -> FloatArray:
        return self.start_rad + math.copysign(1.0 / self.radius_m, self.sweep_rad) * np.asarray(s_m)

    def point(self, s_m: FloatArray) -> FloatArray:
        angle = self._angle(s_m)
        return np.array(self.center_m) + self.radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def tangent(self, s_m: FloatArray) -> FloatArray:
        angle = self._angle(s_m)
        return math.copysign(1.0, self.sweep_rad) * np.stack([-np.sin(angle), np.cos(angle)], axis=1)

    def curvature(self, s_m: FloatArray) -> FloatArray:
        return np.full(np.size(s_m), math.copysign(1.0 / self.radius_m, self.sweep_rad))


class Curve:
    """A smooth curve given by a formula of some parameter u, offered by arc length.

    `formula(u, order)` returns the curve (order 0, in m) or its first or second derivative by u, for u (n,) as (n, 2);
    SciPy's splines have this form. `breaks` (rising) are the ends of the pieces in which the formula is smooth, the
    first and last of them the ends of the curve. Where the speed along u vanishes the curve has no tangent of its own;
    that of a point next to it is given.
    """

    _NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
    _ROUND_M = 1e-13
    _TINY = 1e-100  # where a curve stands still for a while its tangent is zero
    _ROWS = 1 << 16  # evaluated at once, to bound memory

    def __init__(self, formula: Callable[[FloatArray, int], FloatArray], breaks: FloatArray) -> None:
        self.formula = formula
        parts = math.ceil(256 / (len(breaks) - 1))
        steps = np.arange(parts) / parts
        self._u = np.append((breaks[:-1, None] + np.diff(breaks)[:, None] * steps).ravel(), breaks[-1])
        self._s = np.append(0.0, np.cumsum(self._distance(self._u[:-1], self._u[1:])))
        self._still = 1e-9 * float(np.max(self._speed(self._u)))

    @property
    def length_m(self) -> float:
        return float(self._s[-1])

    @property
    def edges_m(self) -> FloatArray:
        """Distances (n,) from the start, `breaks` among them, between which the curve is smooth; more than 256."""
        return self._s

    def point(self, s_m: FloatArray) -> FloatArray:
        return self.formula(self.parameter(s_m), 0)

    def tangent(self, s_m: FloatArray) -> FloatArray:
        first = self.formula(self._moving(self.parameter(s_m)), 1)
        return first / np.maximum(np.hypot(first[:, 0], first[:, 1]), self._TINY)[:, None]

    def curvature(self, s_m: FloatArray) -> FloatArray:
        u = self._moving(self.parameter(s_m))
        first, second = self.formula(u, 1), self.formula(u, 2)
        cross = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
        return np.asarray(cross / np.maximum(np.hypot(first[:, 0], first[:, 1]), self._TINY) ** 3)

    def arc_length(self, u: FloatArray) -> FloatArray:
        """Distance (n,) in m from the start of the curve to its parameter `u` (n,)."""
        panel = self._panel(self._u, u)
        return np.asarray(self._s[panel] + self._distance(self._u[panel], np.asarray(u)))

    def parameter(self, s_m: FloatArray) -> FloatArray:
        """Parameter u (n,) at the distance `s_m` (n,) from the start, clipped to the curve.

        Newton's method, kept inside its panel by bisection.
        """
        s = np.clip(np.asarray(s_m, dtype=np.float64), 0.0, self._s[-1])
        panel = self._panel(self._s, s)
        low, high, s_low = self._u[panel], self._u[panel + 1], self._s[panel]
        width = self._s[panel + 1] - s_low
        u = low + np.divide(s - s_low, width, out=np.zeros_like(s), where=width > 0.0) * (high - low)
        open_rows = np.arange(s.size)
        for _ in range(60):
            now = u[open_rows]
            over = s_low[open_rows] + self._distance(self._u[panel[open_rows]], now) - s[open_rows]
            off = np.abs(over) > self._ROUND_M
            open_rows, now, over = open_rows[off], now[off], over[off]
            if not open_rows.size:
                break
            low[open_rows] = np.where(over < 0.0, now, low[open_rows])
            high[open_rows] = np.where(over > 0.0, now, high[open_rows])
            speed = self._speed(now)
            new = now - np.divide(over, speed, out=np.full_like(now, np.inf), where=speed > 0.0)
            inside = (new >= low[open_rows]) & (new <= high[open_rows])
            u[open_rows] = np.where(inside, new, 0.5 * (low[open_rows] + high[open_rows]))
        return np.asarray(u)

    @staticmethod
    def _panel(edges: FloatArray, value: FloatArray) -> npt.NDArray[np.intp]:
        return np.clip(np.searchsorted(edges, value, side="right") - 1, 0, len(edges) - 2)

    def _speed(self, u: FloatArray) -> FloatArray:
        first = self.formula(u, 1)
        return np.hypot(first[:, 0], first[:, 1])

    def _distance(self, u_from: FloatArray, u_to: FloatArray) -> FloatArray:
        """Arc length from `u_from` to `u_to` (n,), by quadrature; both within one panel."""
        half, middle = 0.5 * (u_to - u_from), 0.5 * (u_to + u_from)
        mean = np.empty_like(half)
        for first in range(0, half.size, self._ROWS):
            rows = slice(first, first + self._ROWS)
            at = middle[rows, None] + half[rows, None] * self._NODES
            mean[rows] = self._speed(at.ravel()).reshape(at.shape) @ self._WEIGHTS
        return np.asarray(half * mean)

    def _moving(self, u: FloatArray) -> FloatArray:
        """`u`, moved a millionth of the curve inwards where the speed along u vanishes."""
        first, last = self._u[0], self._u[-1]
        step = np.where(u < 0.5 * (first + last), 1e-6, -1e-6) * (last - first)
        return np.where(self._speed(u) > self._still, u, u + step)


@dataclass(frozen=True, eq=False)
class Schedule:
    """A time law fixed by a file: `distance_m` (n,) travelled along the segment at 0, 1, 2 ... ms, and the `line` (n,)
    of the file that rules at that time.
    """

    distance_m: FloatArray
    line: npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Move:
    """Follow `segment` at `feed_mps`, or as fast as the machine allows when `rapid` (the feed is then infinite).

    `line` is the line of the file it comes from. With a `schedule` the feed is not used. `tolerance_m`: how far the
    driven path may be from this one, 0: not at all; None: the program does not say.
    """

    segment: Segment
    feed_mps: float
    rapid: bool = False
    line: int | None = None
    schedule: Schedule | None = None
    tolerance_m: float | None = None


@dataclass(frozen=True)
class Dwell:
    """Stand still for `duration_s`."""

    duration_s: float
    line: int | None = None


Item = TypeVar("Item", bound="Move | Dwell")


class MoveTable(Rows[Item]):
    """A sequence of moves and dwells like a tuple, with its lines as rows of numbers: 40 bytes a line in place of 275.

    Each of the rows (n,) begins where the one before it ends; `x_m`, `y_m` (n + 1,) are these places. Moves have their
    `feed_mps`, infinite for a rapid one, their `line` in the file and a tolerance, NaN for none of their own. Some rows
    are `arcs`, with 48 bytes more. The rows `at` are `others`: dwells, curves and so on. A Move is made as it is asked
    for.
    """

    def __init__(
        self,
        x_m: FloatArray,
        y_m: FloatArray,
        feed_mps: FloatArray,
        line: npt.NDArray[np.int64],
        tolerance_m: FloatArray,
        arcs: ArcColumns,
        at: list[int],
        others: list[Move | Dwell],
    ) -> None:
        self.x_m, self.y_m = x_m, y_m
        self.feed_mps, self.line, self.tolerance_m = feed_mps, line, tolerance_m
        self.arcs, self.at, self.others = arcs, at, others

    def __len__(self) -> int:
        return len(self.feed_mps)

    @overload
    def __getitem__(self, index: int) -> Item: ...
    @overload
    def __getitem__(self, index: slice) -> MoveTable[Item]: ...
    def __getitem__(self, index: int | slice) -> Item | MoveTable[Item]:
        if not isinstance(index, slice):
            row = range(len(self))[index]
            return next(iter(self[row : row + 1]))
        first, last, step = index.indices(len(self))
        if step != 1:
            raise ValueError("a MoveTable is cut into neighbouring rows only")
        last = max(first, last)
        rows, ends = slice(first, last), slice(first, last + 1)
        some = slice(bisect_left(self.at, first), bisect_left(self.at, last))
        at = [row - first for row in self.at[some]]
        columns = self.feed_mps[rows], self.line[rows], self.tolerance_m[rows], self.arcs.part(first, last)
        return MoveTable(self.x_m[ends], self.y_m[ends], *columns, at, self.others[some])

    def __iter__(self) -> Iterator[Item]:
        others = dict(zip(self.at, self.others, strict=True))
        for first in range(0, len(self), _ROWS):
            rows, ends = slice(first, first + _ROWS), slice(first, first + _ROWS + 1)
            points = list(zip(self.x_m[ends].tolist(), self.y_m[ends].tolist(), strict=True))
            arcs = self.arcs.part(first, first + _ROWS)
            bent = dict(zip(arcs.at.tolist(), arcs.values.T.tolist(), strict=True))
            columns = (column[rows].tolist() for column in (self.feed_mps, self.line, self.tolerance_m))
            for row, (feed, line, within) in enumerate(zip(*columns, strict=True)):
                item = others.get(first + row)
                if item is None:
                    arc = bent.get(row)
                    segment = Line(points[row], points[row + 1]) if arc is None else Arc((arc[0], arc[1]), *arc[2:])
                    item = Move(segment, feed, feed == math.inf, line, None, None if within != within else within)
                yield cast(Any, item)

    def moves(self) -> MoveTable[Move]:
        """The same without dwells."""
        if not any(isinstance(item, Dwell) for item in self.others):
            return cast("MoveTable[Move]", self)
        kept = np.ones(len(self), np.bool_)
        kept[[row for row, item in zip(self.at, self.others, strict=True) if isinstance(item, Dwell)]] = False
        ends = np.append(True, kept)
        behind = np.cumsum(kept) - 1
        pairs = [(int(behind[row]), item) for row, item in zip(self.at, self.others, strict=True) if kept[row]]
        at, others = [row for row, _ in pairs], [item for _, item in pairs]
        arcs = ArcColumns(behind[self.arcs.at], self.arcs.values)
        columns = self.feed_mps[kept], self.line[kept], self.tolerance_m[kept]
        return MoveTable(self.x_m[ends], self.y_m[ends], *columns, arcs, at, others)

    def lengths_m(self) -> FloatArray:
        """The lengths (n,), 0 of a dwell."""
        length = np.hypot(np.diff(self.x_m), np.diff(self.y_m))
        length[self.arcs.at] = self.arcs.length_m
        for row, item in zip(self.at, self.others, strict=True):
            length[row] = item.segment.length_m if isinstance(item, Move) else 0.0
        return np.asarray(length)

    def within(self, tolerance_m: float) -> MoveTable[Item]:
        """The same with this tolerance for all moves."""
        others = [replace(item, tolerance_m=tolerance_m) if isinstance(item, Move) else item for item in self.others]
        tolerance = np.full(len(self), tolerance_m)
        return MoveTable(self.x_m, self.y_m, self.feed_mps, self.line, tolerance, self.arcs, self.at, others)


@dataclass(frozen=True)
class Program:
    """A connected path: each move starts where the one before it ends, the first one at `start_m`.

    `notes`: sentences on what a user may not expect of the file. `events`: in the order of the path.
    """

    name: str
    items: Sequence[Move | Dwell]
    start_m: Point
    notes: tuple[str, ...] = ()
    events: Events = field(default_factory=Events)

    @cached_property
    def moves(self) -> Sequence[Move]:
        if isinstance(self.items, MoveTable):
            return self.items.moves()
        return tuple(item for item in self.items if isinstance(item, Move))

    @property
    def length_m(self) -> float:
        if isinstance(self.items, MoveTable):
            return math.fsum(self.items.lengths_m())
        return math.fsum(move.segment.length_m for move in self.moves)

    def where(self, line: int | None) -> str:
        """The name, with the line if there is one: how a message begins."""
        return self.name if line is None else f"{self.name}:{line}"
