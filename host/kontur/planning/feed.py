# SPDX-License-Identifier: Apache-2.0
"""How fast a planned program goes, compared with its feeds, and what makes it slower than they are."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass

import numpy as np

from kontur.path.geometry import KNOT_S, FloatArray, Move, Program
from kontur.planning.bounds import Piece

SHORT = "the acceleration and the jerk along the path, which is too short to gain more speed"
STEP = "the step of acceleration where the curvature jumps (centripetal_step_mps2)"
_REACHED = 0.99  # of a feed
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


def reached(program: Program, pieces: list[Piece], path_s_m: FloatArray) -> Feed | None:
    """What `program`, planned as `pieces` and with the distances `path_s_m` (n,) at each millisecond, makes of its
    feeds. None: all its moves are rapid."""
    speed = np.diff(path_s_m) / KNOT_S
    start_m = 0.0
    greatest: float | None = None
    moves = 0
    limited: list[tuple[float, float, float, float, Move]] = []  # share reached, speed, where, time lost
    for move in program.moves:
        end_m = start_m + move.segment.length_m
        if not move.rapid and math.isfinite(move.feed_mps):
            moves += 1
            first = max(int(np.searchsorted(path_s_m, start_m, side="right")) - 1, 0)
            last = max(int(np.searchsorted(path_s_m, end_m, side="left")), first + 1)
            top = float(np.max(speed[first:last], initial=0.0))
            greatest = max(greatest or 0.0, move.feed_mps)
            if top < _REACHED * move.feed_mps:
                at_m = 0.5 * float(np.sum(path_s_m[[k := first + int(np.argmax(speed[first:last])), k + 1]]))
                lost_s = (last - first) * KNOT_S - move.segment.length_m / move.feed_mps
                limited.append((top / move.feed_mps, top, at_m, lost_s, move))
        start_m = end_m
    if greatest is None:
        return None
    if not limited:
        return Feed(greatest, greatest, moves)
    ends_m = np.cumsum([piece.length for piece in pieces])

    def slow(found: tuple[float, float, float, float, Move]) -> SlowMove:
        _, top, at_m, lost_s, move = found
        return SlowMove(program.where(move.line), move.feed_mps, top, _limit(pieces, ends_m, at_m, top), lost_s)

    worst = slow(min(limited, key=lambda found: found[0]))
    slowest = tuple(map(slow, heapq.nlargest(_SLOWEST, limited, key=lambda found: found[3])))
    return Feed(worst.asked_mps, worst.reached_mps, moves, len(limited), worst.place, worst.by, slowest)


def _limit(pieces: list[Piece], ends_m: FloatArray, at_m: float, speed: float) -> str:
    """What keeps the speed at `at_m` along the path from being higher; `ends_m` (n,) of the pieces."""
    i = min(int(np.searchsorted(ends_m, at_m)), len(pieces) - 2)
    if pieces[i].limit and speed >= _AT_BOUND * pieces[i].v:
        return pieces[i].limit
    entries = [p.entry for p in pieces[i : i + 2] if 0.0 < p.entry < math.inf]
    return STEP if any(speed >= _AT_BOUND * entry for entry in entries) else SHORT
