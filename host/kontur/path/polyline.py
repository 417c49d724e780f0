# SPDX-License-Identifier: Apache-2.0
"""The file's path with all its moves as arrays, by the distance from its start."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from kontur.path.geometry import FloatArray, Move
from kontur.path.moves import arcs, ends_m, others, straight

CORNER_RAD = 0.6
"""A joint of pieces that turns by more is a true corner and stays a stop."""
_TURN_STEP_RAD = 0.05
_CONNECTED_M = 1e-9
_MOVES = 1 << 15  # handled at once, to bound memory


class Polyline:
    """`moves` by the distance along them: `edge_m` (n + 1,) of their ends, which are at `ends_m` (n + 1, 2). `straight`
    (n,): which are lines. `gaps_m`: the moves that do not begin where the one before them ends, and how far from there.
    `turn` (n - 1,): how much the path turns at each joint, in rad."""

    def __init__(self, moves: Sequence[Move]) -> None:
        self._moves = moves
        count = len(moves)
        self.straight = straight(moves)
        self._arcs, self._others = arcs(moves), np.array(others(moves), np.int64)
        self.edge_m, self.ends_m = np.zeros(count + 1), np.empty((count + 1, 2))
        self.gaps_m: list[tuple[int, float]] = []
        self.turn = np.empty(count)
        heading = 0.0  # at the end of the move before
        for first in range(0, count, _MOVES):
            rows = slice(first, min(first + _MOVES, count))
            after = slice(first + 1, rows.stop + 1)
            start, self.ends_m[after], self.edge_m[after], turn_in, turn_out = _of(moves[rows])
            if first == 0:
                self.ends_m[0] = start[0]
            gap = np.max(np.abs(start - self.ends_m[rows]), axis=1)
            self.gaps_m += [(first + int(i), float(gap[i])) for i in np.flatnonzero(~(gap <= _CONNECTED_M))]
            self.turn[rows] = np.abs(_wrapped(turn_in - np.append(heading, turn_out[:-1])))
            heading = turn_out[-1]
        np.cumsum(self.edge_m, out=self.edge_m)
        self.turn = self.turn[1:]

    def corners(self, reach_m: FloatArray) -> npt.NDArray[np.bool_]:
        """Which of the joints are true corners: they turn by more than CORNER_RAD, and so does the path from
        `reach_m` before to as much behind them."""
        corner = self.turn > CORNER_RAD
        at = np.flatnonzero(corner)
        s = self.edge_m[1:-1][at]
        here = self.point(s)
        before, after = here - self.point(s - reach_m[at]), self.point(s + reach_m[at]) - here
        turn = np.arctan2(after[:, 1], after[:, 0]) - np.arctan2(before[:, 1], before[:, 0])
        corner[at] = np.abs(_wrapped(turn)) > CORNER_RAD
        return corner

    def point(self, s_m: FloatArray) -> FloatArray:
        """Points (n, 2) at `s_m` (n,), clipped to the path."""
        edge = self.edge_m
        s = np.clip(s_m, 0.0, edge[-1])
        move = np.clip(np.searchsorted(edge, s, side="right") - 1, 0, len(self._moves) - 1)
        length = edge[move + 1] - edge[move]
        share = np.divide(s - edge[move], length, out=np.zeros_like(s), where=length > 0.0)[:, None]
        out = (1.0 - share) * self.ends_m[move] + share * self.ends_m[move + 1]
        if len(self._arcs):
            rows = np.flatnonzero(~self.straight[move])
            arc = np.minimum(np.searchsorted(self._arcs.at, move[rows]), len(self._arcs) - 1)
            of_arc = self._arcs.at[arc] == move[rows]
            rows, arc = rows[of_arc], arc[of_arc]
            out[rows] = self._arcs.point(arc, s[rows] - edge[move[rows]])
        if self._others.size:
            rows = np.flatnonzero(np.isin(move, self._others))
            rows = rows[np.argsort(move[rows], kind="stable")]
            for group in np.split(rows, np.flatnonzero(np.diff(move[rows])) + 1):
                if group.size:
                    i = int(move[group[0]])
                    out[group] = self._moves[i].segment.point(s[group] - edge[i])
        return np.asarray(out)

    def features(self, first: int, last: int) -> tuple[FloatArray, FloatArray]:
        """Distances (n,), rising, at which the moves `first` to `last` turn, and by how much (n,)."""
        at, turn = [self.edge_m[first + 1 : last + 1]], [self.turn[first:last]]
        found = self._arcs.part(first, last + 1)
        length, bend = found.length_m, np.abs(found.curvature)
        counts = 1 + np.ceil(bend * length / _TURN_STEP_RAD).astype(np.int64)
        of = np.repeat(np.arange(len(found)), counts)
        number = np.arange(len(of)) - (np.cumsum(counts) - counts)[of]
        step = (length / counts)[of]
        at.append(self.edge_m[first + found.at[of]] + (number + 0.5) * step)
        turn.append(bend[of] * step)
        for i in self._others[(self._others >= first) & (self._others <= last)].tolist():
            segment = self._moves[i].segment
            most = np.max(np.abs(segment.curvature(np.linspace(0.0, segment.length_m, 9))))
            count = 1 + math.ceil(float(most) * segment.length_m / _TURN_STEP_RAD)
            one = segment.length_m / count
            middle = (np.arange(count) + 0.5) * one
            at.append(self.edge_m[i] + middle)
            turn.append(np.abs(segment.curvature(middle)) * one)
        order = np.argsort(np.concatenate(at), kind="stable")
        return np.concatenate(at)[order], np.concatenate(turn)[order]


def _of(moves: Sequence[Move]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Starts and ends (n, 2) of moves, their lengths (n,), and the headings (n,) at their starts and ends."""
    ends = ends_m(moves)
    start, end = ends[:, :2], ends[:, 2:]
    chord = end - start
    length = np.hypot(chord[:, 0], chord[:, 1])
    heading_in = np.arctan2(chord[:, 1], chord[:, 0])
    heading_out = heading_in.copy()
    bent, everything = arcs(moves), slice(None)
    length[bent.at] = bent.length_m
    heading_in[bent.at] = bent.heading(everything, np.zeros(len(bent)))
    heading_out[bent.at] = bent.heading(everything, bent.length_m)
    for i in others(moves):
        segment = moves[i].segment
        length[i] = segment.length_m
        tangent = segment.tangent(np.array([0.0, segment.length_m]))
        heading_in[i], heading_out[i] = np.arctan2(tangent[:, 1], tangent[:, 0])
    return start, end, length, heading_in, heading_out


def _wrapped(angle: FloatArray) -> FloatArray:
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)
