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

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from kontur.errors import KonturError, PathError, shown
from kontur.path import smoothing
from kontur.path.geometry import DURATION_MAX_S, KNOT_S, Arc, Curve, FloatArray, Line, Move, Program
from kontur.path.smoothing import Exact, SmoothPath
from kontur.planning import knots, time_law
from kontur.planning.bounds import Limits, Piece, pieces_of, planned, sampled
from kontur.planning.feed import Feed, reached
from kontur.planning.knots import POSITION_RANGE_M

__all__ = ["Limits", "PlannerError", "Trajectory", "plan"]

_STOP_S = 2.0 * KNOT_S  # a stop: three equal control points in a row, so that the spline is at rest there
_RING = 16  # knots after which the spline's response to a step in acceleration has decayed


@dataclass(frozen=True)
class Trajectory:
    """A planned program, a row each millisecond of path time.

    `knots_nm` (n, 2): control points for the wire. `position_m` (n, 2): points of the path that the spline passes
    through. `path_s_m` (n,): distance travelled along the whole program, never falling. `digest`: SHA-256 of the knots.
    `driven`: the moves as they are driven, by the same distance; `deviation_m` is the most by which they are off the
    program's. `feed`: what of the programmed feeds is reached; None where the program has none, but times.
    """

    program: Program
    knots_nm: npt.NDArray[np.int32]
    position_m: FloatArray
    path_s_m: FloatArray
    digest: str
    driven: tuple[Move, ...]
    feed: Feed | None = None
    deviation_m: float = 0.0

    @property
    def duration_s(self) -> float:
        return (len(self.knots_nm) - 1) * KNOT_S

    @property
    def smoothed(self) -> str:
        """That the path is smoothed, in words; empty where it is exact."""
        if not self.deviation_m > 0.0:
            return ""
        return f"smoothed within the tolerance: at most {self.deviation_m * 1e6:.1f} µm from the program's"


class PlannerError(KonturError):
    """The planner's own check failed: a defect of kontur, not of the input."""


def plan(
    program: Program,
    limits: Limits,
    progress: Callable[[float], None] | None = None,
    travel_m: tuple[tuple[float, float], tuple[float, float]] = POSITION_RANGE_M,
    tolerance_m: float = 0.0,
) -> Trajectory:
    """Plan `program` for axes that stand at its start.

    `progress` is called with the share done, 0 to 1. `travel_m` is ((x least, x greatest), (y least, y greatest)).
    `tolerance_m`: how far the motion may be from moves that have no tolerance of their own.

    Raises PathError: a program without motion, not connected, longer than DURATION_MAX_S, beyond `travel_m`, or with a
    time law of its own that exceeds the limits; the message names file and line. PlannerError: the result is not within
    the limits, which is a defect of kontur.
    """
    report = progress or (lambda share: None)
    moves = program.moves
    if not moves:
        raise PathError(f"{program.name}: there is no motion in it")
    _check_connected(program)
    _check_travel(program, travel_m)
    report(0.0)
    feed = None
    if any(move.schedule for move in moves):
        s, position = _scheduled(program)
        control = knots.control_points(position)
        _check_schedule(program, limits, control)
        driven, deviation_m = moves, 0.0
    else:
        s, pieces, driven, deviation_m = _planned(program, limits, tolerance_m, report)
        position = positions(driven, s, report)
        if deviation_m > 0.0:
            _check_smoothed(program, position, travel_m)
        control = knots.control_points(position)
        _check(limits, control, s, pieces)
        travelled = np.hypot(*np.diff(position, axis=0).T) if deviation_m > 0.0 else np.diff(s)
        feed = reached(program, pieces, s, travelled / KNOT_S)
    knots_nm = knots.to_nm(control)
    report(1.0)
    return Trajectory(program, knots_nm, position, s, knots.digest(knots_nm), driven, feed, deviation_m)


def _planned(
    program: Program, limits: Limits, tolerance_m: float, report: Callable[[float], None]
) -> tuple[FloatArray, list[Piece], tuple[Move, ...], float]:
    """Distance travelled (n,) at each millisecond, the pieces, the moves as they are driven and how far these are off
    the program's."""
    inside = planned(limits)
    parts = smoothing.parts(program, tolerance_m)
    control: list[FloatArray] = []
    pieces: list[Piece] = []
    driven: list[Move] = []
    deviation_m = 0.0
    start_m, done, total = 0.0, 0, len(program.moves)
    for part in parts:

        def share(of_part: float, done: int = done, count: int = len(part.moves)) -> None:
            report(0.5 * (done + of_part * count) / total)

        if isinstance(part, Exact):
            items = replace(program, items=part.items)
            found = pieces_of(items, inside, share)
            control.append(start_m + _distance(items, found, limits.average_s, share))
            driven += part.moves
        else:
            feed = np.array([move.feed_mps for move in part.moves])
            ends = np.cumsum([move.segment.length_m for move in part.moves])
            _check_duration(program, float(np.sum(np.diff(np.append(0.0, ends)) / feed)))
            found = time_law.pieces(part.path, feed, ends, inside)
            law = time_law.distances(part.path, part.dwell_s, feed, ends, inside, limits, share)
            control.append(start_m + np.pad(law, 1, mode="edge"))
            if isinstance(part.path, SmoothPath):
                driven.append(Move(part.path, math.inf, line=part.moves[0].line))
            else:
                driven += part.moves
            deviation_m = max(deviation_m, part.path.deviation_m)
        pieces += found
        start_m += math.fsum(move.segment.length_m for move in part.moves)
        done += len(part.moves)
    whole = control[0] if len(control) == 1 else _joined(control)
    _check_duration(program, len(whole) * KNOT_S)
    return _spline_values(whole), pieces, tuple(driven), deviation_m


def _joined(control: list[FloatArray]) -> FloatArray:
    """Control points (n,) with the first and the last once more, of parts that have theirs, too."""
    out = np.pad(np.concatenate([part[1:-1] for part in control]), 1, mode="edge")
    return np.asarray(np.maximum.accumulate(out))


def _check_duration(program: Program, total_s: float) -> None:
    if total_s > DURATION_MAX_S:
        raise PathError(
            f"{program.name}: it takes {shown(total_s / 3600.0, 1)} h; at most {DURATION_MAX_S / 3600.0:.0f} h can be "
            "planned: raise the feed or the limits, or split it"
        )


# --- the time law -----------------------------------------------------------------------------------------------------


def _ramp(change: FloatArray, a: FloatArray, j: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Durations of a jerk phase and of the phase between the two, of an S-curve that changes the speed by `change`."""
    full = change * j >= a**2
    jerk = np.where(full, a / j, np.sqrt(change / j))
    return jerk, np.where(full, change / a - a / j, 0.0)


def _ramp_length(v0: FloatArray, v1: FloatArray, a: FloatArray, j: FloatArray) -> FloatArray:
    jerk, hold = _ramp(np.abs(v1 - v0), a, j)
    return np.asarray(0.5 * (v0 + v1) * (2.0 * jerk + hold))


def _reach(v0: float, bound: float, piece: Piece) -> float:
    """Greatest speed up to `bound` that can be reached from `v0` over the piece."""

    def over(v1: float) -> float:
        change = v1 - v0
        time = (
            change / piece.a + piece.a / piece.j
            if change * piece.j >= piece.a**2
            else 2.0 * math.sqrt(change / piece.j)
        )
        return 0.5 * (v0 + v1) * time - piece.length

    if bound <= v0 or over(bound) <= 0.0:
        return bound
    return float(brentq(over, v0, bound, xtol=1e-15, rtol=1e-14))


def _entries(pieces: list[Piece]) -> FloatArray:
    """Speed at the start of each piece, by looking back from every stop and ahead from it."""
    v = [0.0, *(min(b.entry, a.v, b.v) for a, b in itertools.pairwise(pieces))]
    for i in range(len(pieces) - 2, 0, -1):
        if v[i] > 0.0:
            v[i] = _reach(v[i + 1], v[i], pieces[i])
    for i in range(len(pieces) - 1):
        if v[i + 1] > 0.0:
            v[i + 1] = _reach(v[i], v[i + 1], pieces[i])
    return np.array(v)


def _distance(program: Program, pieces: list[Piece], average_s: float, report: Callable[[float], None]) -> FloatArray:
    """Control points (n,) of the distance travelled, with the first and the last once more."""
    v0 = _entries(pieces)
    v1 = np.append(v0[1:], 0.0)
    length, top, a, j, dwell = (np.array([getattr(p, k) for p in pieces]) for k in ("length", "v", "a", "j", "dwell"))
    report(0.5)

    def short(peak: FloatArray) -> npt.NDArray[np.bool_]:
        return _ramp_length(v0, peak, a, j) + _ramp_length(peak, v1, a, j) <= length

    low, high = np.maximum(v0, v1), top.copy()
    for _ in range(60):
        middle = 0.5 * (low + high)
        fits = short(middle)
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    peak = np.where(short(top), top, low)
    cruise = np.maximum(length - _ramp_length(v0, peak, a, j) - _ramp_length(peak, v1, a, j), 0.0)
    cruise = np.divide(cruise, peak, out=np.zeros_like(cruise), where=peak > 0.0)
    up, up_hold = _ramp(peak - v0, a, j)
    down, down_hold = _ramp(peak - v1, a, j)
    zero = np.zeros_like(j)
    duration = np.stack([zero, up, up_hold, up, cruise, down, down_hold, down], axis=1)
    jerk = np.stack([zero, j, zero, -j, zero, -j, zero, j], axis=1)
    _add_stops(duration, np.flatnonzero(v0 == 0.0), dwell, average_s)
    _check_duration(program, float(np.sum(duration)))

    state = np.zeros((*duration.shape, 3))  # distance, speed, acceleration at the start of each phase
    state[:, 0, 0] = np.append(0.0, np.cumsum(length)[:-1])
    state[:, 0, 1] = v0
    for phase in range(1, duration.shape[1]):
        state[:, phase] = _advanced(state[:, phase - 1], duration[:, phase - 1], jerk[:, phase - 1])
    start = np.append(0.0, np.cumsum(duration.ravel()))
    count = round(start[-1] / KNOT_S) + 1
    control = np.empty(count + 2)  # with its first and last value once more
    for first in range(0, count, knots.ROWS):
        t = np.arange(first, min(first + knots.ROWS, count)) * KNOT_S
        now = np.minimum(np.searchsorted(start, t, side="right") - 1, duration.size - 1)
        distance = _advanced(state.reshape(-1, 3)[now], t - start[now], jerk.ravel()[now])[:, 0]
        control[1 + first : 1 + first + len(t)] = np.clip(distance, 0.0, np.sum(length))
    control[0], control[-1] = control[1], control[-2]
    control = _averaged(control, round(average_s / KNOT_S))
    np.maximum.accumulate(control, out=control)
    return control


def _spline_values(control: FloatArray) -> FloatArray:
    """Values (n,) of the cubic spline of `control` (n + 2,), which is overwritten."""
    for first in range(0, len(control) - 2, knots.ROWS):
        part = control[first : first + knots.ROWS + 2]
        control[first : first + len(part) - 2] = (part[:-2] + 4.0 * part[1:-1] + part[2:]) / 6.0
    return control[:-2]


def _advanced(state: FloatArray, t: FloatArray, jerk: FloatArray) -> FloatArray:
    """Distance, speed and acceleration (n, 3) a time `t` (n,) later at constant `jerk` (n,)."""
    s, v, a = state.T
    return np.stack([s + t * (v + t * (a + t * jerk / 3.0) / 2.0), v + t * (a + t * jerk / 2.0), a + t * jerk], axis=1)


def _averaged(values: FloatArray, width: int) -> FloatArray:
    """Moving averages (n,) of `values` (n,) over `width` intervals around each, by the trapezoidal rule."""
    if width == 0:
        return values
    weight = np.full(width + 1, 1.0 / width)
    weight[[0, -1]] *= 0.5
    before, after = width // 2, width - width // 2
    padded = np.pad(values, (before, after), mode="edge")
    averages = np.empty_like(values)
    for first in range(0, len(values), knots.ROWS):
        part = padded[first : first + knots.ROWS + width]
        averages[first : first + knots.ROWS] = np.convolve(part, weight, mode="valid")
    return averages


def _add_stops(duration: FloatArray, stops: npt.NDArray[np.intp], dwell: FloatArray, average_s: float) -> None:
    """Fill in the time of the stop before each piece that starts with one; all stops end at a multiple of 1 ms."""
    moving = np.add.reduceat(np.sum(duration, axis=1), stops)
    moving_before = np.append(0.0, moving[:-1]) / KNOT_S
    pad = np.ceil(moving_before - 1e-9) - moving_before
    duration[stops, 0] = (np.ceil(dwell[stops] / KNOT_S - 1e-9) + pad) * KNOT_S + _STOP_S + average_s


def positions(
    moves: tuple[Move, ...], s: FloatArray, report: Callable[[float], None] = lambda share: None
) -> FloatArray:
    """Points (n, 2) of the path at the distances `s` (n,) in m, which never fall. `report` gets 0.5 to 0.9."""
    edge = np.append(0.0, np.cumsum([move.segment.length_m for move in moves]))
    row = np.searchsorted(s, edge, side="left")
    row[0], row[-1] = 0, len(s)
    position = np.empty((len(s), 2))
    for i, move in enumerate(moves):
        for first in range(row[i], row[i + 1], knots.ROWS):
            rows = slice(first, min(first + knots.ROWS, row[i + 1]))
            position[rows] = move.segment.point(np.clip(s[rows] - edge[i], 0.0, move.segment.length_m))
        if i % 256 == 0:
            report(0.5 + 0.4 * i / len(moves))
    return position


def _scheduled(program: Program) -> tuple[FloatArray, FloatArray]:
    """Distances (n,) and points (n, 2) of a program that is one move with its own time law, with stops around it."""
    if len(program.items) != 1 or program.moves[0].schedule is None:
        raise PathError(f"{program.name}: a move with a time law of its own must stand alone in its program")
    move = program.moves[0]
    s = np.pad(program.moves[0].schedule.distance_m, _RING, mode="edge")
    return s, move.segment.point(s)


# --- checks -----------------------------------------------------------------------------------------------------------


def _ends(moves: tuple[Move, ...]) -> FloatArray:
    """Where each move starts and ends (n, 2, 2)."""
    out = np.empty((len(moves), 2, 2))
    for i, move in enumerate(moves):
        segment = move.segment
        if isinstance(segment, Line):
            out[i] = segment.start_m, segment.end_m
        else:
            out[i] = segment.point(np.array([0.0, segment.length_m]))
    return out


def _check_connected(program: Program) -> None:
    moves = program.moves
    for move in moves:
        if not move.segment.length_m > 0.0 or not move.feed_mps > 0.0:
            raise PathError(f"{program.where(move.line)}: a move needs a length and a feed above zero")
    ends = _ends(moves)
    here = np.concatenate([[program.start_m], ends[:-1, 1]])
    gap = np.max(np.abs(ends[:, 0] - here), axis=1)
    wrong = np.flatnonzero(~(gap <= 1e-9))
    if wrong.size:
        raise PathError(
            f"{program.where(moves[wrong[0]].line)}: the move starts {shown(float(gap[wrong[0]]) * 1e3, 6)} mm from "
            "where the one before it ends"
        )


def _extent(move: Move, where: str) -> FloatArray:
    """Points (n, 2) among which are the outermost of the move, for a Curve to about a micrometre."""
    segment = move.segment
    s = np.array([0.0, segment.length_m])
    if move.schedule is not None:
        s = move.schedule.distance_m
    elif isinstance(segment, Arc):
        turn = math.copysign(1.0, segment.sweep_rad)
        quarter = np.arange(4) * 0.5 * np.pi - segment.start_rad
        s = np.append(s, segment.radius_m * (turn * quarter % (2.0 * np.pi)))
        s = s[s <= segment.length_m]
    elif isinstance(segment, Curve):
        s, _ = sampled(segment, where)
    return segment.point(s)


def extent_m(program: Program) -> FloatArray:
    """The least and the greatest (2, 2) x and y that the path reaches."""
    moves = program.moves
    bent = [_extent(move, program.where(move.line)) for move in moves if not isinstance(move.segment, Line)]
    points = np.concatenate([_ends(moves).reshape(-1, 2), *bent])
    return np.stack([np.min(points, axis=0), np.max(points, axis=0)])


def _check_travel(program: Program, travel_m: tuple[tuple[float, float], tuple[float, float]]) -> None:
    moves = program.moves
    least_m, greatest_m = np.transpose(travel_m)
    ends = _ends(moves)
    inside = np.all((ends >= least_m - 1e-9) & (ends <= greatest_m + 1e-9), axis=(1, 2))
    for i, move in enumerate(moves):
        if inside[i] and isinstance(move.segment, Line):
            continue
        points = _extent(move, program.where(move.line))
        for axis, (least, greatest) in enumerate(travel_m):
            beyond = np.maximum(least - points[:, axis], points[:, axis] - greatest)
            row = int(np.argmax(beyond))
            if beyond[row] > 1e-9:
                line = move.line if move.schedule is None else int(move.schedule.line[row])
                raise PathError(
                    f"{program.where(line)}: the path reaches {'xy'[axis]} = {shown(points[row, axis] * 1e3)} mm, "
                    f"outside the travel of {least * 1e3:.3f} .. {greatest * 1e3:.3f} mm; move or shrink the part"
                )


def _check_smoothed(
    program: Program, position_m: FloatArray, travel_m: tuple[tuple[float, float], tuple[float, float]]
) -> None:
    """The path itself is inside, but the tolerance may lead outside."""
    for axis, (least, greatest) in enumerate(travel_m):
        beyond = max(least - np.min(position_m[:, axis]), np.max(position_m[:, axis]) - greatest)
        if beyond > 1e-9:
            raise PathError(
                f"{program.name}: within its tolerance the path leaves the travel in {'xy'[axis]} by "
                f"{shown(beyond * 1e6)} µm; move the part, or use --tolerance 0"
            )


def _motion(control: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Speed and acceleration (n-2, 2) at the inner knots, jerk (n-3, 2) between two of them."""
    return (
        (control[2:] - control[:-2]) / (2.0 * KNOT_S),
        np.diff(control, 2, axis=0) / KNOT_S**2,
        np.diff(control, 3, axis=0) / KNOT_S**3,
    )


def _check(limits: Limits, control: FloatArray, s: FloatArray, pieces: list[Piece]) -> None:
    """Check the planned motion against the limits, independently of the planner."""
    edge = np.cumsum([piece.length for piece in pieces])[:-1]
    jumps = np.searchsorted(s, edge[[piece.jump for piece in pieces[1:]]])
    smooth = np.ones(len(s), dtype=bool)
    for offset in range(-_RING, _RING + 1):
        smooth[np.clip(jumps + offset, 0, len(s) - 1)] = False
    for first in range(0, max(1, len(control) - 3), knots.ROWS):
        rows = slice(first, first + knots.ROWS + 3)
        _check_part(limits, control[rows], smooth[rows], first)


def _check_part(limits: Limits, control: FloatArray, smooth: npt.NDArray[np.bool_], first: int) -> None:
    speed, acceleration, jerk = _motion(control)
    jerk = jerk * smooth[1:-2, None]
    for name, values, limit in (
        ("velocity", speed, limits.velocity_mps),
        ("acceleration", acceleration, limits.acceleration_mps2),
        ("jerk", jerk, limits.jerk_mps3),
    ):
        excess = np.abs(values) / np.array(limit)
        if not np.all(excess <= 1.0 + 1e-6):
            row, axis = np.unravel_index(np.argmax(excess), excess.shape)
            raise PlannerError(
                f"planner defect: {name} of axis {'xy'[axis]} is {excess[row, axis]:.4f} of its limit at "
                f"{first + row + 1} ms; nothing is moved; please report this with the file and the limits"
            )


def _check_schedule(program: Program, limits: Limits, control: FloatArray) -> None:
    speed, acceleration, _ = _motion(control)
    schedule = program.moves[0].schedule
    assert schedule is not None
    for name, unit, values, limit in (
        ("velocity", "m/s", speed, limits.velocity_mps),
        ("acceleration", "m/s2", acceleration, limits.acceleration_mps2),
    ):
        excess = np.abs(values) / np.array(limit)
        if not np.all(excess <= 1.0):
            row, axis = np.unravel_index(np.argmax(excess), excess.shape)
            time = int(np.clip(row + 1 - _RING, 0, len(schedule.line) - 1))
            raise PathError(
                f"{program.where(int(schedule.line[time]))}: {time * KNOT_S:.3f} s after its start the {name} in "
                f"{'xy'[axis]} is {abs(values[row, axis]):.4g} {unit}, the limit is {limit[axis]:.4g}; "
                "slow it down, and let it start and end at rest"
            )
