# SPDX-License-Identifier: Apache-2.0
"""How fast a planned program goes, compared with its feeds, and what makes it slower than they are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kontur.path.geometry import KNOT_S, FloatArray, Program
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


def reached(program: Program, pieces: list[Piece], path_s_m: FloatArray, speed: FloatArray) -> Feed | None:
    """What `program`, planned as `pieces` and with the distances `path_s_m` (n,) at each millisecond, makes of its
    feeds; `speed` (n-1,) between these. None: all its moves are rapid."""
    moves = program.moves
    feed = np.array([math.inf if move.rapid else move.feed_mps for move in moves])
    asked = np.isfinite(feed)
    if not np.any(asked):
        return None
    greatest = float(np.max(feed[asked]))
    length_m = np.array([move.segment.length_m for move in moves])
    end_m = np.cumsum(length_m)
    first = np.maximum(np.searchsorted(path_s_m, end_m - length_m, side="right") - 1, 0)
    last = np.maximum(np.searchsorted(path_s_m, end_m, side="left"), first + 1)
    ranges = np.minimum(np.stack([first, last], axis=1), len(speed)).ravel()
    top = np.maximum.reduceat(np.append(speed, 0.0), ranges)[::2]
    limited = np.flatnonzero(asked & (top < _REACHED * feed))
    if not limited.size:
        return Feed(greatest, greatest, int(np.sum(asked)))
    lost_s = (last - first) * KNOT_S - length_m / feed
    ends_m = np.cumsum([piece.length for piece in pieces])

    def slow(i: int) -> SlowMove:
        k = first[i] + int(np.argmax(speed[first[i] : last[i]]))
        by = _limit(pieces, ends_m, 0.5 * float(path_s_m[k] + path_s_m[k + 1]), float(top[i]))
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


def _limit(pieces: list[Piece], ends_m: FloatArray, at_m: float, speed: float) -> str:
    """What keeps the speed at `at_m` along the path from being higher; `ends_m` (n,) of the pieces."""
    i = min(int(np.searchsorted(ends_m, at_m)), len(pieces) - 2)
    if pieces[i].limit and speed >= _AT_BOUND * pieces[i].v:
        return pieces[i].limit
    entries = [p.entry for p in pieces[i : i + 2] if 0.0 < p.entry < math.inf]
    return STEP if any(speed >= _AT_BOUND * entry for entry in entries) else SHORT
