# SPDX-License-Identifier: Apache-2.0
"""The planner: jerk-limited motion along a program, one spline knot a millisecond.

The path is cut at its corners, where the motion stops. Each stretch between stops is cut into pieces with constant
bounds of speed, tangential acceleration and tangential jerk, tight enough that both axes stay within their limits
whatever the direction. Speeds at the ends of the pieces follow from looking ahead and back over the stretch; within a
piece the motion is an S-curve (jerk up, hold, down, cruise, and the same to the end speed) whose tangential
acceleration is zero at both ends. This gives the distance travelled, s(t); its values each millisecond are taken as
control points of a cubic B-spline, which keeps every bound, as averages do, and makes s(t) smooth where the jerk of the
S-curve switches between two milliseconds. The path at s(i ms) is what the streamed spline passes through.

With a tolerance, parts with many short pieces become smooth curves (kontur.path.smoothing), along which
kontur.planning.time_law moves.

Where an axis has a first mode, s(t) is averaged over its period besides. A step of jerk, which would let the mode ring,
becomes a ramp that takes a period and excites it least, and the path stays what it is. Stops last as much longer.

Limits hold for the spline at each millisecond before its knots are rounded to 1 nm; rounding adds up to 0.5 um/s,
2 mm/s2 and 4 m/s3. The jerk limit holds along smooth pieces; where curvature or direction jumps, the step of
acceleration is limited.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from kontur.errors import PathError
from kontur.path import smoothing
from kontur.path.geometry import DURATION_MAX_S, KNOT_S, FloatArray, Move, Program
from kontur.path.moves import feeds_mps, is_scheduled
from kontur.path.polyline import Polyline
from kontur.path.smoothing import Exact, Smooth
from kontur.path.spline_fit import SmoothPath
from kontur.planning import joined, knots, s_curve, time_law
from kontur.planning.bounds import Limits, Piece, pieces_of, planned
from kontur.planning.checks import (
    RING,
    PlannerError,
    Travel,
    away_from_jumps,
    check_connected,
    check_duration,
    check_motion,
    check_schedule,
    check_smoothed,
    check_travel,
    jumps_m,
)
from kontur.planning.feed import Bounds, Feed, reached
from kontur.planning.heat import HEAT, Heat
from kontur.planning.joined import Windows
from kontur.planning.knots import POSITION_RANGE_M

__all__ = ["Limits", "PlannerError", "Trajectory", "plan"]


@dataclass(frozen=True)
class Trajectory:
    """A planned program, a row each millisecond of path time.

    `knots_nm` (n, 2): control points for the wire. `position_m` (n, 2): points of the path that the spline passes
    through. `path_s_m` (n,): distance travelled along the whole program, never falling. `digest`: SHA-256 of the knots.
    `driven`: the moves as they are driven, by the same distance; `deviation_m` is the most by which they are off the
    program's, and `rapid_deviation_m` off its rapid moves. `feed`: what of the programmed feeds is reached; None where
    the program has none, but times.
    """

    program: Program
    knots_nm: npt.NDArray[np.int32]
    position_m: FloatArray
    path_s_m: FloatArray
    digest: str
    driven: tuple[Move, ...]
    feed: Feed | None = None
    deviation_m: float = 0.0
    rapid_deviation_m: float = 0.0

    @property
    def duration_s(self) -> float:
        return (len(self.knots_nm) - 1) * KNOT_S

    @property
    def smoothed(self) -> str:
        """That the path is smoothed, in words; empty where it is exact."""
        if not self.is_smoothed:
            return ""
        rapid = f", {self.rapid_deviation_m * 1e6:.1f} µm on rapid moves" if self.rapid_deviation_m > 0.0 else ""
        return f"smoothed within the tolerance: at most {self.deviation_m * 1e6:.1f} µm from the program's{rapid}"

    @property
    def is_smoothed(self) -> bool:
        return self.deviation_m > 0.0 or self.rapid_deviation_m > 0.0


def plan(
    program: Program,
    limits: Limits,
    progress: Callable[[float], None] | None = None,
    travel_m: Travel = POSITION_RANGE_M,
    tolerance_m: float = 0.0,
) -> Trajectory:
    """Plan `program` for axes that stand at its start.

    `progress` is called with the share done, 0 to 1. `travel_m` is ((x least, x greatest), (y least, y greatest)).
    `tolerance_m`: how far the motion may be from moves that have no tolerance of their own.

    Raises PathError: a program without motion, not connected, longer than DURATION_MAX_S, beyond `travel_m`, or with a
    time law of its own that exceeds the limits; the message names file and line. PlannerError: the result is not within
    the limits, which is a defect of kontur.
    """
    planning = Planning(program, limits, progress, travel_m, tolerance_m)
    for _ in planning.steps():
        pass
    return planning.trajectory()


class Planning:
    """The planning of a program, step by step: what is planned first can be driven while the rest is planned.

    Arguments and exceptions are those of plan(). Whether the program is connected, and inside the travel, is checked at
    once. `rows`: what is planned so far. `length_m`: of the program. `top_mps`: no motion is faster.
    """

    def __init__(
        self,
        program: Program,
        limits: Limits,
        progress: Callable[[float], None] | None = None,
        travel_m: Travel = POSITION_RANGE_M,
        tolerance_m: float = 0.0,
    ) -> None:
        self.program = program
        self.deviation_m = self.rapid_deviation_m = 0.0
        self._limits, self._travel_m, self._tolerance_m = limits, travel_m, tolerance_m
        self._report = progress or (lambda share: None)
        if not program.moves:
            raise PathError(f"{program.name}: there is no motion in it")
        self._polyline = Polyline(program.moves)
        check_connected(program, self._polyline)
        check_travel(program, self._polyline, travel_m)
        self._report(0.0)
        self.length_m = float(self._polyline.edge_m[-1])
        self.top_mps = math.hypot(*limits.velocity_mps)
        self.rows = Rows()
        self._driven: list[Move] = []
        self._bounds = Bounds()
        self._count = 0  # rows, with those that have no knots yet
        self._jumps_m = np.empty(0)  # of what has no knots yet

    def steps(self) -> Iterator[None]:
        """Plan; after each step there are more rows."""
        if is_scheduled(self.program.moves):
            self._add_scheduled()
            return
        knots_of = _Knots(self._limits, self.rows)
        for s, position in self._parts():
            knots_of.add(s, position, self._jumps_m)
            self._jumps_m = self._jumps_m[self._jumps_m >= knots_of.from_m]
            yield
        knots_of.add(np.empty(0), np.empty((0, 2)), self._jumps_m, last=True)

    def trajectory(self) -> Trajectory:
        """The trajectory, after the last step."""
        del self._polyline  # its memory is needed elsewhere
        knots_nm, position_m, s = self.rows.planned()
        feed = None
        if not is_scheduled(self.program.moves):
            feed = reached(self.program, self._bounds, s, _speed(position_m if self._smooth else s))
        self._report(1.0)
        driven = tuple(self._driven)
        off = self.deviation_m, self.rapid_deviation_m
        return Trajectory(self.program, knots_nm, position_m, s, knots.digest(knots_nm), driven, feed, *off)

    def _add_scheduled(self) -> None:
        s, position = _scheduled(self.program)
        control = knots.control_points(position)
        check_schedule(self.program, self._limits, control)
        self._driven += self.program.moves
        self.rows.add(knots.to_nm(control), position, s)

    def _parts(self) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Distances (n,) and points (n, 2) at each millisecond, part by part."""
        edge_m = self._polyline.edge_m
        inside, done = planned(self._limits), 0
        windows, heat = Windows(inside, self._limits), Heat(inside.force)
        corner_m = time_law.corner_m(inside)
        for part in smoothing.parts(self.program, self._tolerance_m, self._polyline, corner_m):
            at_m = float(edge_m[done])
            ends = edge_m[done + 1 : done + len(part.moves) + 1] - at_m
            share = partial(self._share, done, len(part.moves))
            if isinstance(part, Smooth):
                self.deviation_m = max(self.deviation_m, part.path.deviation_m)
                self.rapid_deviation_m = max(self.rapid_deviation_m, part.path.rapid_deviation_m)
            self._driven += _driven(part)
            pieces, motion, windows = self._cool(heat, windows, partial(self._planned, part, ends, at_m, share))
            self._bounds.add([replace(piece, v=0.0, limit=HEAT) for piece in pieces] if heat.share < 1.0 else pieces)
            self._jumps_m = np.append(self._jumps_m, at_m + jumps_m(pieces))
            yield from self._moved(motion)
            if not (isinstance(part, Smooth) and part.goes_on):
                heat.faster()
            done += len(part.moves)
        yield from self._moved(windows.rest())

    def _cool(
        self,
        heat: Heat,
        windows: Windows,
        plan_part: Callable[[Limits, Windows], tuple[list[Piece], list[joined.Rows]]],
    ) -> tuple[list[Piece], list[joined.Rows], Windows]:
        """A part, planned as fast as `heat` allows: its pieces, its motion, and the windows behind it."""
        while True:
            tried = copy.copy(windows)
            pieces, motion = plan_part(planned(self._limits.slower(heat.share)), tried)
            if not heat.counts:
                return pieces, motion, tried
            points = [position for _, position in _points(motion)]
            over = heat.over([*points, *(position for _, position in _points(tried.tail()))])
            if over <= 1.0:
                heat.add(points)
                return pieces, motion, tried
            if not heat.slower(over):
                raise PathError(
                    f"{self.program.name}: even slowly the force of an axis stays above its continuous one; see "
                    "continuous_force_N, coulomb_N and viscous_Nspm in the machine file"
                )

    def _planned(
        self,
        part: Exact | Smooth,
        ends: FloatArray,
        at_m: float,
        share: Callable[[float], None],
        limits: Limits,
        windows: Windows,
    ) -> tuple[list[Piece], list[joined.Rows]]:
        """The pieces of a part, which begins at the distance `at_m`, and the motion up to its end, or up to a place in
        it that its window gives."""
        moves = _driven(part)
        if isinstance(part, Exact):
            pieces = pieces_of(replace(self.program, items=part.items), limits, share)
            control = s_curve.distance(pieces, self._limits.average_s, self._check_more, share)
            return pieces, [*windows.rest(), (control, moves, at_m)]
        feed = feeds_mps(part.moves)
        self._check_more(float(np.sum(np.diff(ends, prepend=0.0) / feed)))
        pieces = time_law.pieces(part.path, feed, ends, limits)
        windows.limits = limits
        if part.continues or part.goes_on:
            return pieces, list(windows.add(part, moves[0], feed, ends, at_m, share))
        law = time_law.distances(part.path, part.dwell_s, feed, ends, limits, self._limits, share)
        return pieces, [*windows.rest(), (np.pad(law, 1, mode="edge"), moves, at_m)]

    def _moved(self, motion: Iterable[joined.Rows]) -> Iterator[tuple[FloatArray, FloatArray]]:
        for rows in motion:
            self._count += len(rows[0]) - 2
            self._check_more(0.0)
            for s, position in _points([rows]):
                if self._smooth:
                    check_smoothed(self.program, position, self._travel_m)
                yield s, position

    @property
    def _smooth(self) -> bool:
        return self.deviation_m > 0.0 or self.rapid_deviation_m > 0.0

    def _share(self, done: int, more: int, of_part: float) -> None:
        self._report((done + 0.9 * of_part * more) / len(self.program.moves))

    def _check_more(self, duration_s: float) -> None:
        check_duration(self.program, self._count * KNOT_S + duration_s)


class Rows:
    """The rows of a trajectory so far. There is room for the longest one; the system gives memory as it is used."""

    def __init__(self) -> None:
        room = round(DURATION_MAX_S / KNOT_S) + 2 * RING + 1
        self._knots_nm = np.empty((room, 2), dtype="<i4")
        self._position_m, self._s = np.empty((room, 2)), np.empty(room)
        self.count = 0

    def add(self, knots_nm: npt.NDArray[np.int32], position_m: FloatArray, path_s_m: FloatArray) -> None:
        begin, end = self.count, self.count + len(knots_nm)
        self._knots_nm[begin:end], self._position_m[begin:end], self._s[begin:end] = knots_nm, position_m, path_s_m
        self.count = end

    def planned(self) -> tuple[npt.NDArray[np.int32], FloatArray, FloatArray]:
        """The columns knots_nm, position_m and path_s_m of Trajectory, as far as they are planned."""
        return self._knots_nm[: self.count], self._position_m[: self.count], self._s[: self.count]


class _Knots:
    """Makes knots of points of a path as these come, checks them, and adds them to `rows`. Knots depend on some points
    behind them, which are waited for."""

    def __init__(self, limits: Limits, rows: Rows) -> None:
        self._limits, self._rows = limits, rows
        self._s, self._position = np.empty(0), np.empty((0, 2))
        self._begin = 0  # the first of the points that are kept without a knot yet
        self._before = np.empty((0, 2))  # the last knots

    @property
    def from_m(self) -> float:
        """The distance from which on points are kept."""
        return float(self._s[0])

    def add(self, s: FloatArray, position: FloatArray, jumps_m: FloatArray, last: bool = False) -> None:
        """Take in the next distances (n,) and points (n, 2), the `last` ones, or not."""
        self._s = np.maximum.accumulate(np.append(self._s, s))
        self._position = np.concatenate([self._position, position])
        begin, end = self._begin, len(self._s) if last else len(self._s) - knots.OVERLAP
        if end <= begin:
            return
        control = np.concatenate([self._before, knots.control_points(self._position)[begin:end]])
        before = len(self._before)
        smooth = away_from_jumps(self._s, jumps_m)[begin - before : end]
        check_motion(self._limits, control, smooth, self._rows.count - before)
        self._rows.add(knots.to_nm(control)[before:], self._position[begin:end], self._s[begin:end])
        self._before = control[-3:]
        kept = max(0, end - knots.OVERLAP)
        self._s, self._position, self._begin = self._s[kept:], self._position[kept:], end - kept


def _driven(part: Exact | Smooth) -> tuple[Move, ...]:
    """The moves of a part as they are driven."""
    if isinstance(part, Smooth) and isinstance(part.path, SmoothPath):
        return (Move(part.path, math.inf, line=part.moves[0].line),)
    return tuple(part.moves)


def _points(motion: Iterable[joined.Rows]) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Distances (n,) and points (n, 2) at each millisecond."""
    for control, moves, from_m in motion:
        edge = np.append(0.0, np.cumsum([move.segment.length_m for move in moves]))
        for first in range(0, len(control) - 2, knots.ROWS):
            s = s_curve.spline_values(control[first : first + knots.ROWS + 2])
            yield from_m + s, positions(moves, s, edge)


def positions(moves: tuple[Move, ...], s: FloatArray, edge: FloatArray | None = None) -> FloatArray:
    """Points (n, 2) of the path at the distances `s` (n,) in m, which never fall. `edge` (k + 1,): the ends of the
    `moves`, if they are known."""
    if edge is None:
        edge = np.append(0.0, np.cumsum([move.segment.length_m for move in moves]))
    row = np.searchsorted(s, edge, side="left")
    row[0], row[-1] = 0, len(s)
    position = np.empty((len(s), 2))
    for i in np.flatnonzero(np.diff(row)):
        for first in range(row[i], row[i + 1], knots.ROWS):
            rows = slice(first, min(first + knots.ROWS, row[i + 1]))
            position[rows] = moves[i].segment.point(np.clip(s[rows] - edge[i], 0.0, moves[i].segment.length_m))
    return position


def _speed(of: FloatArray) -> FloatArray:
    """Speeds (n - 1,) between distances (n,) or points (n, 2)."""
    speed = np.empty(len(of) - 1)
    for first in range(0, len(speed), knots.ROWS):
        step = np.diff(of[first : first + knots.ROWS + 1], axis=0)
        speed[first : first + knots.ROWS] = (step if step.ndim == 1 else np.hypot(step[:, 0], step[:, 1])) / KNOT_S
    return speed


def _scheduled(program: Program) -> tuple[FloatArray, FloatArray]:
    """Distances (n,) and points (n, 2) of a program that is one move with its own time law, with stops around it."""
    if len(program.items) != 1 or program.moves[0].schedule is None:
        raise PathError(f"{program.name}: a move with a time law of its own must stand alone in its program")
    move = program.moves[0]
    s = np.pad(program.moves[0].schedule.distance_m, RING, mode="edge")
    return s, move.segment.point(s)
