# SPDX-License-Identifier: Apache-2.0
"""Motions along the windows of a stretch without stops, joined without a stop.

Each window is planned to a stop at its end. The next one is planned from a stop further back, so that both motions pass
the same piece of path. In its middle both are what the limits allow there, whatever was before and comes after, and
nearly the same: one turns into the other where they differ least. Where they nowhere fit within the limits, the motion
stops between the windows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from kontur.path.geometry import KNOT_S, FloatArray, Move
from kontur.path.smoothing import Smooth
from kontur.path.spline_fit import SmoothPath
from kontur.planning import time_law
from kontur.planning.bounds import Limits

_SETTLED = 6.0  # times to gain the greatest speed, after which a motion does not know its start or end any more
_MIXED_MS = (240, 120, 60)  # over which one motion turns into the other
_STEP_MS = 20  # between two places that are tried
_EDGE_MS = 32  # after which the checks do not know any more what is before

Rows = tuple[FloatArray, tuple[Move, ...], float]
"""Control points (n + 2,) of distances, with one more at either end, along moves that begin at that distance."""


class Chain:
    """Two smoothed paths one after the other as one, from the distance `from_m` along the first one on."""

    def __init__(self, first: SmoothPath, second: SmoothPath, from_m: float) -> None:
        self._first, self._second, self._joint_m = first, second, first.length_m
        later = first.grid_m[first.grid_m > from_m]
        self.grid_m = np.concatenate([[from_m], later, self._joint_m + second.grid_m[1:]])
        self.stops_m = np.array([from_m, self._joint_m + second.length_m])

    def derivative(self, s_m: FloatArray, order: int) -> FloatArray:
        """Derivative (n, 2) by the distance along the first path; order 0 is the point."""
        out = self._first.derivative(s_m, order)
        later = s_m >= self._joint_m
        out[later] = self._second.derivative(s_m[later] - self._joint_m, order)
        return out

    def point(self, s_m: FloatArray) -> FloatArray:
        return self.derivative(s_m, 0)


class Windows:
    """Takes the windows of a path in their order, and gives their motion as far as it is known. The end of a window is
    held back until the next one comes."""

    def __init__(self, limits: Limits, checked: Limits) -> None:
        self.limits, self._checked = limits, checked
        self._held: tuple[FloatArray, Smooth, Move, FloatArray, FloatArray, float] | None = None

    def add(
        self,
        part: Smooth,
        move: Move,
        feed_mps: FloatArray,
        ends_m: FloatArray,
        at_m: float,
        report: Callable[[float], None],
    ) -> Iterator[Rows]:
        """The motion up to some place in `part`, which is driven as `move`, and begins at the distance `at_m`. Feeds
        and their ends as in time_law.distances()."""
        assert isinstance(part.path, SmoothPath)
        moves: tuple[Move, ...] = (move,)
        start_m, control = at_m, None
        if part.continues and self._held is not None:
            control = self._continued(part, feed_mps, ends_m, report)
            if control is not None:
                moves, start_m = (self._held[2], move), self._held[5]
        if control is None:
            yield from self.rest()
            law = time_law.distances(part.path, part.dwell_s, feed_mps, ends_m, self.limits, self._checked, report)
            control = np.pad(law, 1, mode="edge")
        self._held = None
        joint_m = at_m - start_m
        count = len(control) - 2
        if part.goes_on:
            count = max(count - self._back_ms(feed_mps) - _EDGE_MS, int(np.searchsorted(control[1:-1], joint_m)))
            self._held = (control[count:] - joint_m, part, move, feed_mps, ends_m, at_m)
        if count:
            yield control[: count + 2], moves, start_m

    def rest(self) -> Iterator[Rows]:
        """What is held back: it ends with a stop."""
        yield from self.tail()
        self._held = None

    def tail(self) -> Iterator[Rows]:
        """What rest() would give; it stays held back."""
        if self._held is not None:
            control, _, move, _, _, at_m = self._held
            yield control, (move,), at_m

    def _back_ms(self, feed_mps: FloatArray) -> int:
        """How far back the next window is planned from."""
        limits = self.limits
        gain_s = max(
            min(float(np.max(feed_mps)), v) / a + a / j
            for v, a, j in zip(limits.velocity_mps, limits.acceleration_mps2, limits.jerk_mps3, strict=True)
        )
        return _MIXED_MS[0] + math.ceil((_SETTLED * gain_s + 2.0 * limits.average_s) / KNOT_S)

    def _continued(
        self, part: Smooth, feed_mps: FloatArray, ends_m: FloatArray, report: Callable[[float], None]
    ) -> FloatArray | None:
        """What is held back and the motion along `part` as one; None: they do not fit."""
        assert self._held is not None
        control, before, _, feed_before, ends_before, _ = self._held
        assert isinstance(before.path, SmoothPath)
        assert isinstance(part.path, SmoothPath)
        back = min(self._back_ms(feed_before), len(control) - 2 - _EDGE_MS)
        if back < _MIXED_MS[-1]:
            return None
        path = Chain(before.path, part.path, float(control[-1 - back]))
        feed = np.concatenate([feed_before, feed_mps])
        ends = np.concatenate([ends_before, before.path.length_m + ends_m])
        law = time_law.distances(path, part.dwell_s, feed, ends, self.limits, self._checked, report)
        law = np.pad(law, 1, mode="edge")
        for mixed in _MIXED_MS:
            joined = self._mixed(path, control, law, len(control) - 1 - back, mixed)
            if joined is not None:
                return joined
        return None

    def _mixed(self, path: Chain, one: FloatArray, other: FloatArray, first: int, mixed: int) -> FloatArray | None:
        """The motion `one`, which turns into `other` within so many ms, after its row `first` and before its end. Of
        the places that keep the limits it is that in which their speeds differ least. None: there is none."""
        half = mixed // 2
        middle = np.arange(first + half, len(one) - 1 - half, _STEP_MS)
        row = np.searchsorted(other, one[middle], side="right") - 1  # there it is not further
        inside = (row >= half) & (row < len(other) - 1 - half)
        middle, row = middle[inside], row[inside]
        gap = np.abs((one[middle + 1] - one[middle - 1]) - (other[row + 1] - other[row - 1]))
        for i in np.argsort(gap, kind="stable")[:5]:
            at, there = int(middle[i]), int(row[i])
            share = (np.arange(mixed + 1) / mixed)[: 2 * half + 1]
            share = share**4 * (35.0 - 84.0 * share + 70.0 * share**2 - 20.0 * share**3)
            mix = (1.0 - share) * one[at - half : at + half + 1] + share * other[there - half : there + half + 1]
            joined = np.concatenate([one[: at - half], mix, other[there + half + 1 :]])
            low, high = max(at - half - _EDGE_MS, 0), at + half + _EDGE_MS
            near = joined[low:high]
            if np.all(np.diff(near) >= 0.0) and time_law.excess(path, near, self._checked, _EDGE_MS // 2) <= 1.0:
                return joined
        return None
