# SPDX-License-Identifier: Apache-2.0
"""A smooth curve within a tolerance of a path of many short pieces, such as CAM programs consist of.

The path is cut where the motion stops: at dwells, where it begins to be exact, and at true corners beside exact pieces.
Between two stops the curve is a quintic B-spline p(s), whose parameter is the distance s along the file's path q(s). Of
all such splines it is nearly the one with the least integral of |p'''|^2, weighted, among those with |p(s) - q(s)| <=
tolerance for all s. As s is the same in both, neither path is further from the other than the tolerance.
kontur.path.spline_fit finds it. It goes round true corners, too, where the pieces before and behind them are smoothed
or lines.

Arcs between stops and corners, and what the spline does not fit within the tolerance, stay exact, and so does a program
without joints of lines that turn, up to _LONG times _MOVES of tangent lines and arcs.

The parts of a program come one after the other, about _WINDOWS_S of motion in each, so that who plans them can begin
with the first one.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from kontur.path.geometry import Arc, Dwell, FloatArray, Line, Move, MoveTable, Program
from kontur.path.line_arc import LineArcPath
from kontur.path.moves import dwells_in, feeds_mps, is_scheduled, tolerances_m
from kontur.path.polyline import Polyline
from kontur.path.spline_fit import SmoothPath, Within, fitted

TOLERANCE_M = 10e-6
"""How far a smoothed path may be from the file's, unless something else is said."""
_RAPID, _RAPID_MAX_M = 10.0, 100e-6  # tolerances of rapid moves: so many of the others, unless that is too much
EXACT_RAD = 2e-3  # a joint that turns by less counts as tangent
_EVEN_RAD = 1e-6  # lines that turn by less are one line
_CORNER_REACH = 4.0  # tolerances from a corner over which its turn is measured, too
_SHORT_S = 3.0
_MOVES = 20_000  # about as many are smoothed at once, or exact, to bound memory
_WINDOWS_S = (2.0, 4.0, 8.0, 16.0)  # of motion in the first parts, and in all that follow
_LONG = 1.5  # of the greatest windows: a stretch that takes more is cut where the motion does not stop
_AHEAD_S, _AHEAD_M = 1.0, 2e-3  # of path behind a window that its curve is fitted to, too
_CLOSER = (1.0, 0.5, 0.25, 0.125)  # spacings of the knots that are tried in a window
_SPEED_MPS, _STOP_S = 1.0, 0.05  # a guess of what a rapid move has, and of what a stop takes


def toleranced(program: Program, tolerance_m: float | None) -> Program:
    """`program` with this tolerance for all moves, whatever it says itself; None: as it says."""
    if tolerance_m is None:
        return program
    if isinstance(program.items, MoveTable):
        return replace(program, items=program.items.within(tolerance_m))
    items = [replace(item, tolerance_m=tolerance_m) if isinstance(item, Move) else item for item in program.items]
    return replace(program, items=tuple(items))


@dataclass(frozen=True)
class Exact:
    """Items of a program that are driven as they are."""

    items: Sequence[Move | Dwell]

    @property
    def moves(self) -> tuple[Move, ...]:
        return tuple(item for item in self.items if isinstance(item, Move))


@dataclass(frozen=True)
class Smooth:
    """Moves of a program that are driven along `path`, smoothed or exact, with a dwell of `dwell_s` (k + 1,) at each of
    its stops. It `continues` the part before it, or `goes_on` in the next one, without a stop if that is possible."""

    moves: Sequence[Move]
    path: SmoothPath | LineArcPath
    dwell_s: FloatArray
    continues: bool = False
    goes_on: bool = False


@dataclass
class _Stretch:
    """Moves from one stop to the next, `first` to `last`, with the dwells at rest `before` and `after` them. It takes
    about `duration_s`. `starts`: the first moves of its pieces between true corners."""

    first: int
    last: int
    smooth: bool
    before: tuple[Dwell, ...]
    after: tuple[Dwell, ...]
    duration_s: float
    starts: tuple[int, ...]

    @property
    def long(self) -> bool:
        """Whether it is smoothed window by window."""
        many = self.last - self.first > _LONG * _MOVES or self.duration_s > _LONG * _WINDOWS_S[-1]
        return self.smooth and self.last > self.first and many

    def pieces(self) -> list[_Stretch]:
        """The same with a stop at each corner."""
        ends = [*self.starts[1:], self.last + 1]
        out = [
            replace(self, first=first, last=end - 1, before=(), after=(), starts=(first,))
            for first, end in zip(self.starts, ends, strict=True)
        ]
        out[0].before, out[-1].after = self.before, self.after
        return out


def parts(
    program: Program, tolerance_m: float, polyline: Polyline | None = None, corner_m: float = 0.0
) -> Iterator[Exact | Smooth]:
    """`program` in parts, each from standstill to standstill. `tolerance_m`: of moves that have none of their own.
    `polyline`: that of its moves, if there is one already. `corner_m`: the least tolerance with which the curve goes
    round true corners; with a smaller one it stops there."""
    moves = program.moves
    tolerance = tolerances_m(moves, tolerance_m)
    exact = not np.any(tolerance > 0.0)
    if (exact and len(moves) <= _MOVES) or is_scheduled(moves):
        yield Exact(program.items)
        return
    polyline = polyline or Polyline(moves)
    rapid = np.isinf(feeds_mps(moves))
    free = rapid & ~_tied(program, rapid)
    tolerance = np.where(free, np.maximum(tolerance, np.minimum(_RAPID * tolerance, _RAPID_MAX_M)), tolerance)
    within = Within(polyline.edge_m, tolerance, rapid)
    for batch in _batches(_stretches(program, polyline, tolerance, corner_m)):
        if batch[0].long:
            yield from _in_windows(program, polyline, within, batch[0])
        elif batch[0].smooth:
            yield from _smoothed(moves, polyline, within, batch)
        else:
            yield from _unsmoothed(moves, within, batch)


def _tied(program: Program, rapid: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """The moves (n,) at one of whose ends there is a cut, or something happens beside the path."""
    tied = np.zeros(len(rapid), np.bool_)
    tied[1:] |= ~rapid[:-1]
    tied[:-1] |= ~rapid[1:]
    before = program.events.before
    move = before - np.searchsorted([row for row, _ in dwells_in(program.items)], before)
    tied[np.maximum(move - 1, 0)] = True
    tied[move[move < len(tied)]] = True
    return tied


def _smoothed(
    moves: Sequence[Move], polyline: Polyline, within: Within, batch: list[_Stretch]
) -> Iterator[Exact | Smooth]:
    fit, good = fitted(polyline, [stretch.first for stretch in batch], batch[-1].last, within)
    for begin, end in _runs(good):
        chosen = batch[begin:end]
        if good[begin]:
            yield Smooth(moves[chosen[0].first : chosen[-1].last + 1], fit.path(begin, end), _dwells(chosen))
        elif any(len(stretch.starts) > 1 for stretch in chosen):
            yield from _smoothed(moves, polyline, within, [piece for stretch in chosen for piece in stretch.pieces()])
        else:
            yield _exact(moves, chosen)


def _in_windows(program: Program, polyline: Polyline, within: Within, stretch: _Stretch) -> Iterator[Exact | Smooth]:
    """A long stretch. The curve of each window goes on as that of the one before ends, up to its fourth derivative.
    Where none goes on within the tolerance, the one before is driven as far as it was fitted, and ends in a stop."""
    moves, edge_m = program.moves, polyline.edge_m
    last, windows, most_s = stretch.last, iter(_WINDOWS_S), 0.0
    time_s = np.append(0.0, np.cumsum(_durations(moves[stretch.first : last + 1], edge_m[stretch.first : last + 2])))
    first, head, rest = stretch.first, None, None
    while first <= last:
        most_s = next(windows, most_s)
        now = first - stretch.first
        end = stretch.first + min(int(np.searchsorted(time_s, time_s[now] + most_s)), now + _MOVES, len(time_s) - 1)
        if time_s[-1] - time_s[end - stretch.first] < most_s:
            end = last + 1
        ahead = stretch.first + int(np.searchsorted(time_s, time_s[end - stretch.first] + _AHEAD_S))
        ahead = min(last + 1, max(ahead, int(np.searchsorted(edge_m, edge_m[end] + _AHEAD_M))))
        for spacing in _CLOSER:
            fit, good = fitted(polyline, [first], ahead - 1, within, head, spacing)
            if good[0]:
                break
        path, goes_on = None, False
        if good[0]:
            whole, at_m = fit.path(0, 1), float(edge_m[end] - edge_m[first])
            path, goes_on = whole.until(at_m), end <= last
            rest = (whole.since(at_m), ahead) if goes_on else None
        elif rest is not None:
            (path, end), rest = rest, None
        window = replace(stretch, first=first, last=end - 1)
        window.before = stretch.before if first == stretch.first else ()
        window.after = stretch.after if end == last + 1 else ()
        if path is not None:
            yield Smooth(moves[first:end], path, _dwells([window]), head is not None, goes_on)
        else:
            yield _exact(moves, [window])
        head = None
        if path is not None and goes_on:
            head = np.concatenate([path.derivative(path.stops_m[1:], order) for order in range(5)])
        first = end


def _durations(moves: Sequence[Move], edge_m: FloatArray) -> FloatArray:
    """About what moves (n,) between the distances `edge_m` (n + 1,) take."""
    return np.asarray(np.diff(edge_m) / np.minimum(feeds_mps(moves), _SPEED_MPS))


def _unsmoothed(moves: Sequence[Move], within: Within, batch: list[_Stretch]) -> Iterator[Exact | Smooth]:
    """Stretches that are not smoothed. Arcs that stand alone between stops are optimised, with the lines there."""
    begin = batch[0].first
    of_batch = list(moves[begin : batch[-1].last + 1])
    alone = np.array(
        [within.tolerance_m[s.first] > 0.0 and s.first == s.last and _short(of_batch[s.first - begin]) for s in batch]
    )
    time_s = np.cumsum([stretch.duration_s for stretch in batch])
    soon = np.cumsum(_WINDOWS_S[:-1] if begin == 0 and len(moves) > _MOVES else ())
    late = soon[-1] if soon.size else 0.0
    window = np.where(time_s < late, np.searchsorted(soon, time_s), soon.size + (time_s - late) // _WINDOWS_S[-1])
    exact: list[_Stretch] = []
    for begin, end in _runs(np.where(alone, window, -1.0)):
        chosen = batch[begin:end]
        part = moves[chosen[0].first : chosen[-1].last + 1]
        if not (alone[begin] and any(isinstance(move.segment, Arc) for move in part)):
            exact += chosen
            continue
        if exact:
            yield _exact(moves, exact)
            exact = []
        yield Smooth(part, LineArcPath(part), _dwells(chosen))
    if exact:
        yield _exact(moves, exact)


def _short(move: Move) -> bool:
    """Whether it is worth while to optimise a line or an arc: not where it goes at its feed for a long time."""
    return isinstance(move.segment, (Line, Arc)) and move.segment.length_m <= _SHORT_S * min(move.feed_mps, _SPEED_MPS)


def _dwells(batch: list[_Stretch]) -> FloatArray:
    waits = [*(stretch.before for stretch in batch), batch[-1].after]
    return np.array([math.fsum(dwell.duration_s for dwell in wait) for wait in waits])


def _exact(moves: Sequence[Move], batch: list[_Stretch]) -> Exact:
    items: list[Move | Dwell] = []
    for one in batch:
        items += [*one.before, *moves[one.first : one.last + 1], *one.after]
    return Exact(tuple(items))


def _runs(kind: npt.NDArray[np.float64] | npt.NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Begin and end of each run of equal values in `kind` (n,)."""
    edges = [0, *(np.flatnonzero(kind[1:] != kind[:-1]) + 1).tolist(), len(kind)]
    yield from itertools.pairwise(edges)


def _batches(stretches: Iterator[_Stretch]) -> Iterator[list[_Stretch]]:
    """Neighbouring stretches that are exact, of about _MOVES at most, or smoothed, of about _WINDOWS_S of motion
    besides."""
    batch: list[_Stretch] = []
    windows, duration_s = iter(_WINDOWS_S), 0.0
    most_s = next(windows)
    for stretch in stretches:
        full = batch and (
            stretch.long
            or batch[0].long
            or stretch.last - batch[0].first >= _MOVES
            or (batch[0].smooth and duration_s + stretch.duration_s > most_s)
        )
        if batch and (full or stretch.smooth != batch[0].smooth):
            yield batch
            batch, duration_s = [], 0.0
            most_s = next(windows, most_s)
        batch.append(stretch)
        duration_s += stretch.duration_s
    yield batch


def _stretches(program: Program, polyline: Polyline, tolerance: FloatArray, corner_m: float) -> Iterator[_Stretch]:
    """The stretches between stops. Neighbours that meet in a corner are one, as long as it is no longer than a window:
    so there is a stop where windows meet."""
    count = len(program.moves)
    dwells = _dwells_before(program)
    windows = iter(_WINDOWS_S)
    most_s, whole = next(windows), None
    for first, last, smooth, round_, duration_s in zip(
        *_cut(program, polyline, tolerance, corner_m, dwells), strict=True
    ):
        after = dwells.get(count, ()) if last == count - 1 else ()
        one = _Stretch(first, last, smooth, dwells.get(first, ()), after, duration_s, (first,))
        if whole is None:
            whole = one
        elif round_ and whole.duration_s + duration_s <= most_s and last - whole.first < _MOVES:
            whole.last, whole.after = last, after
            whole.duration_s += duration_s
            whole.starts += (first,)
        else:
            if round_:
                most_s = next(windows, most_s)
            yield whole
            whole = one
    if whole is not None:
        yield whole


def _cut(
    program: Program,
    polyline: Polyline,
    tolerance: FloatArray,
    corner_m: float,
    dwells: dict[int, tuple[Dwell, ...]],
) -> tuple[list[int], list[int], list[bool], list[bool], list[float]]:
    """The first and the last move of each piece between stops and corners, whether it is smoothed, whether the curve
    may go round the corner at its start, and the time it may take."""
    moves = program.moves
    count = len(moves)
    within_m = np.minimum(tolerance[1:], tolerance[:-1])  # where two moves meet
    stop = (within_m <= 0.0) & ((polyline.turn > EXACT_RAD) | (tolerance[1:] != tolerance[:-1]))
    stop[[i - 1 for i in dwells if 0 < i < count]] = True
    corner = polyline.corners(_CORNER_REACH * within_m) & ~stop
    bends = (polyline.turn > EXACT_RAD) | ((polyline.turn > _EVEN_RAD) & polyline.straight[1:] & polyline.straight[:-1])
    bends &= ~(stop | corner)
    first = np.append(0, np.flatnonzero(stop | corner) + 1)
    last = np.append(first[1:] - 1, count - 1)
    many = last - first > _LONG * _MOVES  # an exact stretch of so many would be planned at once
    smooth = (many | np.logical_or.reduceat(np.append(bends, False), first)) & (tolerance[first] > 0.0)
    straight = np.logical_and.reduceat(polyline.straight, first) & (tolerance[first] > 0.0)
    may = smooth | straight
    round_ = np.append(False, corner & (within_m >= corner_m))[first] & may & np.append(False, may[:-1])
    if np.any(smooth) or np.any(round_):  # all lines between corners are splines, too: the parts are fewer
        smooth |= straight
    duration = np.add.reduceat(_durations(moves, polyline.edge_m), first) + _STOP_S
    return first.tolist(), last.tolist(), smooth.tolist(), round_.tolist(), duration.tolist()


def _dwells_before(program: Program) -> dict[int, tuple[Dwell, ...]]:
    """The dwells of the program, by the number of moves before them."""
    found: dict[int, tuple[Dwell, ...]] = {}
    for number, (row, dwell) in enumerate(dwells_in(program.items)):
        found[row - number] = (*found.get(row - number, ()), dwell)
    return found
