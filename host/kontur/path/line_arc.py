# SPDX-License-Identifier: Apache-2.0
"""Lines and arcs one after the other, with a stop at each end of them, as one path by distance."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from kontur.path.geometry import FloatArray, Move

_SPANS, _SPAN_RAD = 8, 0.2  # of the grid: so many in a segment at least, and no longer than this of an arc


class LineArcPath:
    """The path of `moves`, which are lines and arcs (Segment of kontur.path.geometry). Nothing of it is smoothed.

    A line and an arc are the same here: a start, a heading and a constant curvature. `stops_m` (n + 1,): the ends of
    all moves. `grid_m`: distances that are close together where the path bends.
    """

    deviation_m = rapid_deviation_m = 0.0

    def __init__(self, moves: Sequence[Move]) -> None:
        segments = [move.segment for move in moves]
        zero = np.zeros(1)
        length = [segment.length_m for segment in segments]
        self.stops_m = np.append(0.0, np.cumsum(length))
        self._start = np.concatenate([segment.point(zero) for segment in segments])
        tangent = np.concatenate([segment.tangent(zero) for segment in segments])
        self._heading = np.arctan2(tangent[:, 1], tangent[:, 0])
        self._bend = np.concatenate([segment.curvature(zero) for segment in segments])
        counts = [max(_SPANS, math.ceil(abs(b) * s / _SPAN_RAD)) for b, s in zip(self._bend, length, strict=True)]
        steps = [a + s * np.arange(n) / n for a, s, n in zip(self.stops_m, length, counts, strict=False)]
        self.grid_m = np.append(np.concatenate(steps), self.stops_m[-1])

    @property
    def length_m(self) -> float:
        return float(self.stops_m[-1])

    def derivative(self, s_m: FloatArray, order: int) -> FloatArray:
        """Derivative (n, 2) by the distance; order 0 is the point."""
        i = np.clip(np.searchsorted(self.stops_m, s_m, side="right") - 1, 0, len(self._bend) - 1)
        along, bend = s_m - self.stops_m[i], self._bend[i]
        if order == 0:
            half = 0.5 * bend * along
            middle = self._heading[i] + half
            chord = along * np.sinc(half / np.pi)
            return np.asarray(self._start[i] + chord[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1))
        angle = self._heading[i] + bend * along + (order - 1) * 0.5 * np.pi
        return np.asarray((bend ** (order - 1))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))

    def point(self, s_m: FloatArray) -> FloatArray:
        return self.derivative(s_m, 0)
