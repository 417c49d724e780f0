# SPDX-License-Identifier: Apache-2.0
"""How fast a planned program goes, compared with its feeds, and what makes it slower than they are."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from kontur.path.geometry import KNOT_S, FloatArray, Program
from kontur.path.moves import feeds_mps, lengths_m
from kontur.planning.bounds import Piece

SHORT = "the acceleration and the jerk along the path, which is too short to gain more speed"
STEP = "the step of acceleration where the curvature jumps (centripetal_step_mps2)"
_REACHED = 0.99  # of a feed
_MOVES = 1 << 16  # handled at once, to bound memory
_SLOWEST = 5
_AT_BOUND = 0.97  # of the bound of a piece


@dataclass(frozen=True)
class SlowMove:
    """A move that does not reach its feed, at the `place` in the program, by the limit `by`; it takes `lost_s` longer
    than at its feed."""

    place: str
    asked_mps: float
    reached_mps: float
    by: str
    lost_s: float


@dataclass(frozen=True)
class Feed:
    """The feeds of a program: of its `moves` with a feed, so many are `limited`, that is, they do not reach it.

    `asked_mps`, `reached_mps`: of the limited move that stays furthest below its feed, at the `place` in the program
    and by the limit `by`; where none is limited, the greatest feed, twice.
    """

    asked_mps: float
    reached_mps: float
    moves: int
    limited: int = 0
    place: str = ""
    by: str = ""
    slowest: tuple[SlowMove, ...] = ()

    def __str__(self) -> str:
        asked, reached = (f"{v * 1e3:.4g}" for v in (self.asked_mps, self.reached_mps))
        if not self.limited:
            return f"feed {asked} mm/s"
        most = "" if self.moves == 1 else f" in {self.limited} of {self.moves} moves; the least in {self.place}"
        return f"feed {asked} mm/s is not reached{most}: {reached} mm/s, limited by {self.by}"


@dataclass
class Bounds:
    """What bounds the speed of pieces of path, in a few bytes for each of them: their length, speed, entry and limit,
    as in Piece."""

    _columns: list[tuple[FloatArray, FloatArray, FloatArray, npt.NDArray[np.object_]]] = field(default_factory=list)

    def add(self, pieces: list[Piece]) -> None:
        length, v, entry = (np.array([getattr(piece, name) for piece in pieces]) for name in ("length", "v", "entry"))
        self._columns.append((length, v, entry, np.array([piece.limit for piece in pieces], dtype=object)))

    def columns(self) -> tuple[FloatArray, FloatArray, FloatArray, npt.NDArray[np.object_]]:
        """Ends (n,) by distance, speeds, entries and limits of all pieces."""
        length, v, entry, limit = (np.concatenate(column) for column in zip(*self._columns, strict=True))
        return np.cumsum(length), v, entry, limit


def reached(program: Program, bounds: Bounds, path_s_m: FloatArray, speed: FloatArray) -> Feed | None:
    """What `program`, planned within `bounds` and with the distances `path_s_m` (n,) at each millisecond, makes of its
    feeds; `speed` (n-1,) between these. None: all its moves are rapid."""
    moves = program.moves
    feed = feeds_mps(moves)
    asked = np.isfinite(feed)
    if not np.any(asked):
        return None
    greatest = float(np.max(feed[asked]))
    top, lost_s = np.empty(len(moves)), np.empty(len(moves))
    first, last = np.empty(len(moves), dtype=np.int32), np.empty(len(moves), dtype=np.int32)
    speed, at_m = np.append(speed, 0.0), 0.0
    for begin in range(0, len(moves), _MOVES):
        rows = slice(begin, begin + _MOVES)
        length_m = lengths_m(moves[rows])
        end_m = at_m + np.cumsum(length_m)
        at_m = float(end_m[-1])
        first[rows] = np.maximum(np.searchsorted(path_s_m, end_m - length_m, side="right") - 1, 0)
        last[rows] = np.maximum(np.searchsorted(path_s_m, end_m, side="left"), first[rows] + 1)
        lost_s[rows] = (last[rows] - first[rows]) * KNOT_S - length_m / feed[rows]
        ranges = np.minimum(np.stack([first[rows], last[rows]], axis=1), len(speed) - 1).ravel()
        top[rows] = np.maximum.reduceat(speed, ranges)[::2]
    limited = np.flatnonzero(asked & (top < _REACHED * feed))
    if not limited.size:
        return Feed(greatest, greatest, int(np.sum(asked)))
    ends_m, v, entry, limit = bounds.columns()

    def limited_by(at_m: float, top: float) -> str:
        """What keeps the speed at `at_m` along the path from being higher than `top`."""
        k = min(int(np.searchsorted(ends_m, at_m)), len(v) - 2)
        if limit[k] and top >= _AT_BOUND * v[k]:
            return str(limit[k])
        entries = entry[k : k + 2]
        near = (entries > 0.0) & np.isfinite(entries) & (top >= _AT_BOUND * entries)
        return STEP if np.any(near) else SHORT

    def slow(i: int) -> SlowMove:
        k = first[i] + int(np.argmax(speed[first[i] : last[i]]))
        by = limited_by(0.5 * float(path_s_m[k] + path_s_m[k + 1]), float(top[i]))
        return SlowMove(program.where(moves[i].line), moves[i].feed_mps, float(top[i]), by, float(lost_s[i]))

    worst = slow(limited[np.argmin(top[limited] / feed[limited])])
    slowest = tuple(slow(i) for i in limited[np.argsort(-lost_s[limited], kind="stable")[:_SLOWEST]])
    return Feed(
        worst.asked_mps,
        worst.reached_mps,
        int(np.sum(asked)),
        len(limited),
        worst.place,
        worst.by,
        slowest,
    )
