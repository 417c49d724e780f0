# SPDX-License-Identifier: Apache-2.0
"""Columns of the moves of a program, whether these are a MoveTable or a tuple; and how such a table is made."""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence
from typing import cast

import numpy as np
import numpy.typing as npt

from kontur.path.arc_columns import ArcColumns
from kontur.path.geometry import Arc, Dwell, FloatArray, Line, Move, MoveTable, Point, Segment


class Builder:
    """Makes a MoveTable of items that come one after the other, the first from `start_m` on."""

    def __init__(self, start_m: Point) -> None:
        self._x, self._y = array("d", start_m[:1]), array("d", start_m[1:])
        self._feed, self._line, self._tolerance = array("d"), array("q"), array("d")
        self._arc_at, self._arc = array("q"), array("d")
        self._at: list[int] = []
        self._others: list[Move | Dwell] = []
        self.moves = 0

    def __len__(self) -> int:
        return len(self._feed)

    def lines(
        self,
        x_m: FloatArray,
        y_m: FloatArray,
        feed_mps: FloatArray,
        line: npt.NDArray[np.int64],
        within_m: float | None,
    ) -> None:
        """Lines that end at `x_m`, `y_m` (n,)."""
        tolerance = np.full(len(x_m), math.nan if within_m is None else within_m)
        columns = (
            (self._x, x_m),
            (self._y, y_m),
            (self._feed, feed_mps),
            (self._line, line),
            (self._tolerance, tolerance),
        )
        for column, values in columns:
            column.frombytes(values.tobytes())
        self.moves += len(x_m)

    def wait(self, rows: npt.NDArray[np.int64], duration_s: FloatArray) -> None:
        """Dwells of `duration_s` (k,) in place of the lines in `rows` (k,), which end where they begin."""
        lines = (self._line[row] for row in rows.tolist())
        self._at += rows.tolist()
        self._others += map(Dwell, duration_s.tolist(), lines)
        self.moves -= len(rows)

    def bend(self, rows: npt.NDArray[np.int64], arcs: FloatArray, others: dict[int, Segment]) -> None:
        """Arcs, or by their numbers `others`, in place of the lines in `rows` (k,), the last ones. `arcs` (5, k): as
        ArcColumns has them."""
        for i, segment in others.items():
            row = int(rows[i])
            within = self._tolerance[row]
            self._at.append(row)
            tolerance_m = None if within != within else within
            self._others.append(Move(segment, self._feed[row], line=self._line[row], tolerance_m=tolerance_m))
        if others:
            rows, arcs = np.delete(rows, list(others)), np.delete(arcs, list(others), axis=1)
        self._arc_at.frombytes(rows.astype(np.int64).tobytes())
        self._arc.frombytes(arcs.T.tobytes())

    def add(self, item: Move | Dwell, end_m: Point) -> None:
        """Any item, which ends at `end_m`; lines begin where the one before ends."""
        is_move = isinstance(item, Move)
        segment = item.segment if isinstance(item, Move) else None
        if isinstance(segment, Arc):
            self._arc_at.append(len(self))
            self._arc.extend((*segment.center_m, segment.radius_m, segment.start_rad, segment.sweep_rad))
        elif not isinstance(segment, Line):
            self._at.append(len(self))
            self._others.append(item)
        within = item.tolerance_m if isinstance(item, Move) else None
        self._x.append(end_m[0])
        self._y.append(end_m[1])
        self._feed.append(item.feed_mps if isinstance(item, Move) else math.inf)
        self._line.append(item.line or 0)
        self._tolerance.append(math.nan if within is None else within)
        self.moves += is_move

    def table(self) -> MoveTable[Move | Dwell]:
        x, y, feed, tolerance = (np.frombuffer(c) for c in (self._x, self._y, self._feed, self._tolerance))
        arcs = ArcColumns(np.frombuffer(self._arc_at, np.int64), np.frombuffer(self._arc).reshape(-1, 5).T)
        order = np.argsort(np.array(self._at, np.int64), kind="stable").tolist()
        at, others = [self._at[i] for i in order], [self._others[i] for i in order]
        return MoveTable(x, y, feed, np.frombuffer(self._line, np.int64), tolerance, arcs, at, others)


def feeds_mps(moves: Sequence[Move]) -> FloatArray:
    """The feeds (n,), infinite where a move is rapid."""
    if isinstance(moves, MoveTable):
        return moves.feed_mps
    return np.fromiter((move.feed_mps for move in moves), float, len(moves))


def lengths_m(items: Sequence[Move | Dwell]) -> FloatArray:
    """The lengths (n,), 0 of a dwell."""
    if isinstance(items, MoveTable):
        return items.lengths_m()
    return np.array([item.segment.length_m if isinstance(item, Move) else 0.0 for item in items])


def tolerances_m(moves: Sequence[Move], default_m: float) -> FloatArray:
    """The tolerances (n,), with a default for moves that have none of their own."""
    if isinstance(moves, MoveTable):
        return np.where(np.isnan(moves.tolerance_m), default_m, moves.tolerance_m)
    given = (default_m if move.tolerance_m is None else move.tolerance_m for move in moves)
    return np.fromiter(given, float, len(moves))


def arcs(moves: Sequence[Move]) -> ArcColumns:
    """Those of the moves that are arcs."""
    if isinstance(moves, MoveTable):
        return moves.arcs
    found = [(row, move.segment) for row, move in enumerate(moves) if isinstance(move.segment, Arc)]
    values = [(*arc.center_m, arc.radius_m, arc.start_rad, arc.sweep_rad) for _, arc in found]
    return ArcColumns(np.array([row for row, _ in found], np.int64), np.array(values, float).reshape(-1, 5).T)


def others(moves: Sequence[Move]) -> list[int]:
    """Which of the moves are neither lines nor arcs."""
    if isinstance(moves, MoveTable):
        return moves.at
    return [row for row, move in enumerate(moves) if not isinstance(move.segment, (Line, Arc))]


def straight(moves: Sequence[Move]) -> npt.NDArray[np.bool_]:
    """Which of the moves (n,) are lines."""
    if not isinstance(moves, MoveTable):
        return np.fromiter((isinstance(move.segment, Line) for move in moves), np.bool_, len(moves))
    out = np.ones(len(moves), np.bool_)
    out[moves.arcs.at] = False
    out[moves.at] = False
    return out


def ends_m(moves: Sequence[Move]) -> FloatArray:
    """Where the moves begin and end (n, 4): x, y, x, y."""
    if not isinstance(moves, MoveTable):
        return np.array([_ends_m(move) for move in moves]).reshape(len(moves), 4)
    out = np.stack([moves.x_m[:-1], moves.y_m[:-1], moves.x_m[1:], moves.y_m[1:]], axis=1)
    out[moves.arcs.at] = moves.arcs.ends_m()
    for row, item in zip(moves.at, moves.others, strict=True):
        out[row] = _ends_m(cast(Move, item))
    return out


def _ends_m(move: Move) -> tuple[float, ...]:
    segment = move.segment
    if isinstance(segment, Line):
        return segment.start_m + segment.end_m
    return tuple(segment.point(np.array([0.0, segment.length_m])).ravel().tolist())


def is_scheduled(moves: Sequence[Move]) -> bool:
    """Whether a move has a time law of its own."""
    if isinstance(moves, MoveTable):
        return False
    return any(move.schedule is not None for move in moves)


def dwells_in(items: Sequence[Move | Dwell]) -> list[tuple[int, Dwell]]:
    """The dwells and where they stand."""
    pairs = zip(items.at, items.others, strict=True) if isinstance(items, MoveTable) else enumerate(items)
    return [(row, item) for row, item in pairs if isinstance(item, Dwell)]
