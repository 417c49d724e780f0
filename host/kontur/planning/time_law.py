# SPDX-License-Identifier: Apache-2.0
"""Nearly the fastest motion along a smooth path within the limits of velocity, acceleration and jerk of each axis.

A motion s(t) that is not within the limits, or not fast, is given another time: t becomes a function of a new time, and
b(t) is the square of its rate. With the motion p(t) of an axis its velocity is then p' sqrt(b), its acceleration
p'' b + p' b' / 2, and its jerk sqrt(b) (p''' b + 3/2 p'' b' + 1/2 p' b''). The first two are linear bounds on b. The
third is |p''' b + 3/2 p'' b' + 1/2 p' b''| <= jerk / sqrt(b), whose right side is convex in b. The duration, the
integral of 1/sqrt(b), is minimised by Newton's method with a logarithmic barrier, from a b that is small enough to be
within all limits: each step stays within them. b(t) is sampled evenly in the time of the motion before, so that its
equations have five diagonals, and the cost is linear in the duration. At a stop p' and p'' vanish, and nothing else is
needed there: the first motion starts with a constant jerk.

The first motion keeps velocity, centripetal acceleration and a tangential acceleration, averaged over the time in which
the jerk builds it up. Each pass starts from the result of the one before, so that its samples become those of the
drive: one a millisecond. The last result is averaged over a few milliseconds, checked as the spline that the drive
follows, and slowed around where it exceeds a limit. Corners, which are passed in some milliseconds, need that pass
again.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.ndimage import maximum_filter1d

from kontur.path.geometry import KNOT_S, FloatArray
from kontur.planning import knots
from kontur.planning.barrier import Barrier
from kontur.planning.bounds import AXIS_SPEED, BEND_LIMITS, Limits, Piece, accelerations

_STEPS_S = (4.0 * KNOT_S, 2.0 * KNOT_S, KNOT_S)  # of the samples, in each pass
_AVERAGE_S = 2.0 * KNOT_S  # of the result
_TANGENTIAL_SHARE = 0.6  # of the acceleration, for the first motion
_GAP = 0.01  # share of the duration that the result may be above the least one
_LAST_GAP = 0.004  # of the last pass
_TURNS = 5  # of the last pass, at most
_WORTH = 0.995  # of its duration: if one does not make it shorter than that, no more follow
_MUCH_LOWER = 0.75  # share of a limit
_LOWEST = 1e-3  # share of a limit that is planned with; equations with less are not solvable in double precision
_REST = 3  # equal control points at a stop
_NEAR = 7  # ms around an excess in which a limit is lowered
_NEAR_CAP = 0.88
_SLOWING = 24  # rounds; two or three are usual
_AROUND = 24  # ms, in the first round; half as much more in each that follows
_PASSED_S, _OF_PERIOD = 6e-3, 0.4
_TINY = 1e-10  # m, nearer than this to a stop is at rest
_WINDOW = 4000  # samples that are solved for at once, up to the next stop

_Index = npt.NDArray[np.intp]


class DrivenPath(Protocol):
    """A path by the distance along the file's, which rests at `stops_m` (k + 1,). `grid_m` (n,): distances that are
    close together where it bends."""

    @property
    def stops_m(self) -> FloatArray: ...
    @property
    def grid_m(self) -> FloatArray: ...
    def point(self, s_m: FloatArray) -> FloatArray: ...
    def derivative(self, s_m: FloatArray, order: int) -> FloatArray: ...


def distances(
    path: DrivenPath,
    dwell_s: FloatArray,
    feed_mps: FloatArray,
    ends_m: FloatArray,
    limits: Limits,
    checked: Limits,
    report: Callable[[float], None] = lambda share: None,
) -> FloatArray:
    """Distances (n,) along the file's path at each millisecond: the control points of their cubic B-spline.

    The motion starts, ends and rests at `path.stops_m`, for `dwell_s` (k + 1,) at each. Up to `ends_m` (m,) the feed is
    `feed_mps` (m,). It is planned with `limits`, and keeps `checked`. `report` is called with the share done.
    """
    law = _Law(path, feed_mps, ends_m, limits, checked)
    s, rests = law.first()
    for done, (step, next_step) in enumerate(itertools.pairwise(_STEPS_S)):
        report(done / len(_STEPS_S))
        s, rests = law.faster(s, rests, step, next_step, np.ones((len(s), 2)))
    report((len(_STEPS_S) - 1) / len(_STEPS_S))
    out = law.within(s, rests)
    holds = np.ceil(dwell_s / KNOT_S - 1e-9).astype(int)
    rows = [np.full(_REST - 1 + holds[0], out[0][0])]
    for one, hold in zip(out, holds[1:], strict=True):
        rows += [one, np.full(hold, one[-1])]
    return np.concatenate([*rows, out[-1][-1:]])


@dataclass
class _Law:
    path: DrivenPath
    feed_mps: FloatArray
    ends_m: FloatArray
    limits: Limits
    checked: Limits

    def feed(self, s: FloatArray) -> FloatArray:
        """The feed (n,) at the distances `s` (n,)."""
        move = np.minimum(np.searchsorted(self.ends_m, s), len(self.ends_m) - 1)
        return np.asarray(self.feed_mps[move])

    def first(self) -> tuple[FloatArray, _Index]:
        """The first motion: distances (n,), and the rows (k + 1,) in the middle of each rest."""
        limits, step = self.limits, _STEPS_S[0]
        s = samples(self.path.grid_m)
        cap, _ = caps(self.path, self.feed(s), limits, s)
        square = cap**2
        stop = np.searchsorted(s, self.path.stops_m)
        square[stop] = 0.0
        gain = 2.0 * _TANGENTIAL_SHARE * min(limits.acceleration_mps2)
        square = np.minimum.accumulate(square - gain * s) + gain * s
        square = np.minimum.accumulate((square + gain * s)[::-1])[::-1] - gain * s
        speed = np.sqrt(np.maximum(square, 0.0))
        width = max(1, round(min(limits.acceleration_mps2) / min(limits.jerk_mps3) / step))
        hold = step * 2.0 * (width + 4)
        duration = 2.0 * np.diff(s) / (speed[1:] + speed[:-1])
        again = np.sort(np.append(np.arange(len(s)), stop))  # each stop begins and ends
        s, speed = s[again], speed[again]
        at = np.searchsorted(again, stop)
        duration = np.insert(duration, stop, hold)
        time = np.append(0.0, np.cumsum(duration))
        even = np.arange(0.0, time[-1], step)
        moved = np.asarray(CubicHermiteSpline(time, s, speed)(even))
        moved = _averaged(_averaged(np.maximum.accumulate(moved), width), 1)
        return moved, np.rint((time[at] + 0.5 * hold) / step).astype(np.intp)

    def faster(
        self, s: FloatArray, rests: _Index, step: float, next_step: float, shares: FloatArray
    ) -> tuple[FloatArray, _Index]:
        """The motion `s` (n,), sampled each `step`, as fast as it may be, sampled each `next_step`, and the rows of its
        rests. `shares` (n, 2) of the limits of acceleration and jerk are allowed.
        """
        position, feed = self.path.point(s), self.feed(s)
        gap = _LAST_GAP if step == _STEPS_S[-1] else _GAP
        b = np.empty(len(s))
        first = 0
        while first < len(s):
            later = rests[rests >= first + _WINDOW]
            last = int(later[0]) if later.size and later[0] < rests[-1] else len(s)
            rows = slice(first, last)
            b[rows] = Barrier(position[rows], step, feed[rows], self.limits, shares[rows]).solve(gap)
            first = last
        return _resampled(s, rests, b, step, next_step)

    def within(self, s: FloatArray, rests: _Index) -> list[FloatArray]:
        """The stretches of the fastest motion that keeps the limits as a spline, from the motion `s` (n,), sampled each
        millisecond.

        Where a spline exceeds limits, smaller ones are planned with. Where these are much smaller, as in a corner that
        the coarser samples could not show, it is planned again, and the fastest motion of all counts.
        """
        found: list[list[FloatArray]] = []
        shares = np.minimum(1.0, 1.0 / self.excess(s, rests))
        for turn in range(_TURNS):
            was = s
            s, rests = self.faster(s, rests, KNOT_S, KNOT_S, shares)
            found.append(self.slowed(self.stretches(s, rests)))
            rows = [sum(map(len, stretches)) for stretches in found[-2:]]
            if (turn == 0 and np.min(shares) >= _MUCH_LOWER) or (turn > 1 and rows[1] > _WORTH * rows[0]):
                break
            before = np.stack([np.interp(s, was, one) for one in shares.T], axis=1) if turn else 1.0
            shares = np.clip(before / self.excess(s, rests), _LOWEST, 1.0)
        return min(found, key=lambda stretches: sum(map(len, stretches)))

    def stretches(self, s: FloatArray, rests: _Index) -> list[FloatArray]:
        """Control points of the distances of each stretch, averaged, with its rest at both ends."""
        width = round(max(_AVERAGE_S, self.limits.average_s) / KNOT_S)
        out = []
        for begin, end, low, high in zip(
            rests[:-1], rests[1:], self.path.stops_m[:-1], self.path.stops_m[1:], strict=True
        ):
            part = np.maximum.accumulate(np.clip(s[begin : end + 1], low, high))
            moving = np.flatnonzero((part > low + _TINY) & (part < high - _TINY))
            part = part[max(moving[0] - 1, 0) : moving[-1] + 2] if moving.size else part[[0, -1]]
            part[[0, -1]] = low, high
            part = _averaged(np.pad(part, width // 2 + 1, mode="edge"), width)
            out.append(_between_rests(part, low, high))
        return out

    def _ratios(self, stretches: list[FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
        return _ratios(self.path, np.concatenate(stretches), self.checked)

    def excess(self, s: FloatArray, rests: _Index) -> FloatArray:
        """Acceleration and jerk (n, 2) over their limits, a little more, near the samples `s`, of their spline."""
        stretches = self.stretches(s, rests)
        at = np.searchsorted(np.concatenate(stretches), s)
        near = [maximum_filter1d(one, _NEAR) for one in self._ratios(stretches)[1:]]
        return np.stack([np.maximum(1.01 * one[np.minimum(at, len(one) - 1)], _TINY) for one in near], axis=1)

    def slowed(self, stretches: list[FloatArray]) -> list[FloatArray]:
        """The stretches, slowed around where they exceed the limits until they keep them."""
        for turn in range(_SLOWING):
            around = _AROUND * (2 + turn) // 2
            speed, acceleration, jerk = self._ratios(stretches)
            excess = np.maximum(np.maximum(speed, np.sqrt(acceleration)), np.cbrt(jerk))
            if np.max(excess) <= 1.0:
                break
            ends = np.cumsum([len(one) for one in stretches])[:-1]
            of_each = np.split(excess, ends)
            stretches = [
                _slower(one, e, around) if np.max(e) > 1.0 else one for one, e in zip(stretches, of_each, strict=True)
            ]
        return stretches


def _between_rests(part: FloatArray, low: float, high: float) -> FloatArray:
    """The motion `part`, with one row of rest at `low` before and those of a stop at `high` behind what moves."""
    moving = np.flatnonzero((part > low + _TINY) & (part < high - _TINY))
    return np.concatenate([[low], part[moving[0] : moving[-1] + 1], np.full(_REST - 1, high)])


def _ratios(path: DrivenPath, control_m: FloatArray, checked: Limits) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Speed, acceleration and jerk (n,) over their limits of the axis that comes nearest to them, for control points
    (n,) of the distance, with a rest at either end."""
    control = knots.control_points(path.point(_spline_values(np.pad(control_m, _REST, mode="edge"))))

    def ratio(values: FloatArray, limit: tuple[float, float]) -> FloatArray:
        return np.asarray(np.max(np.abs(values) / np.array(limit), axis=1))

    velocity, second = (control[2:] - control[:-2]) / (2.0 * KNOT_S), np.diff(control, 2, axis=0) / KNOT_S**2
    upper, lower = accelerations(velocity, checked)
    speed, acceleration = (
        ratio(velocity, checked.velocity_mps),
        np.max(np.maximum(second / upper, -second / lower), axis=1),
    )
    between = ratio(np.diff(control, 3, axis=0) / KNOT_S**3, checked.jerk_mps3)
    jerk = np.maximum(between[1:], between[:-1])
    inner = slice(_REST - 1, -(_REST - 1))
    return speed[inner], acceleration[inner], jerk[_REST - 2 : -(_REST - 2)]


def excess(path: DrivenPath, control_m: FloatArray, checked: Limits, edge: int) -> float:
    """The greatest of the speed, acceleration and jerk over their limits, but in so many rows at either end."""
    return max(float(np.max(one[edge:-edge])) for one in _ratios(path, control_m, checked))


def samples(grid_m: FloatArray) -> FloatArray:
    """Distances (n,) close enough to bound the speed between them: four in each span of the grid."""
    parts = np.arange(4) / 4.0
    return np.append((grid_m[:-1, None] + np.diff(grid_m)[:, None] * parts).ravel(), grid_m[-1])


def caps(path: DrivenPath, feed_mps: FloatArray, limits: Limits, s: FloatArray) -> tuple[FloatArray, _Index]:
    """Greatest constant rate (n,) of the distance at `s` (n,), and what it is by: 0 the feed, 1 the speed of an axis, 2
    the acceleration, 3 the jerk."""
    first, second, third = (np.abs(path.derivative(s, order)) for order in (1, 2, 3))
    with np.errstate(divide="ignore"):
        choices = np.stack(
            [
                feed_mps / np.hypot(first[:, 0], first[:, 1]),
                np.min(np.array(limits.velocity_mps) / first, axis=1),
                np.sqrt(np.min(np.array(limits.acceleration_mps2) / second, axis=1)),
                np.cbrt(np.min(np.array(limits.jerk_mps3) / third, axis=1)),
            ]
        )
    return np.min(choices, axis=0), np.argmin(choices, axis=0)


def corner_m(limits: Limits) -> float:
    """The least tolerance with which the motion goes round true corners.

    An axis that comes to rest with a constant jerk, within the acceleration, is this far from the corner some time
    before. Where the other axis sets off at that time, both are so far from it together, and the corner is passed in
    twice the time. Were that less than twice _PASSED_S, milliseconds could not resolve it, and a stop would be faster.
    Nor may it be much less than the period of a mode, which it would excite.
    """
    jerk, acceleration = max(limits.jerk_mps3), max(limits.acceleration_mps2)
    passed_s = max(_PASSED_S, _OF_PERIOD * limits.average_s)
    return math.sqrt(2.0) * min(jerk * passed_s**3 / 6.0, acceleration * passed_s**2 / 2.0)


def pieces(path: DrivenPath, feed_mps: FloatArray, ends_m: FloatArray, limits: Limits) -> list[Piece]:
    """What bounds the speed along the path: a piece for each span of its grid.

    Where the path bends the speed swings about what a constant one could be; _NEAR_CAP of that counts as bounded by it.
    """
    middle = 0.5 * (path.grid_m[1:] + path.grid_m[:-1])
    feed = feed_mps[np.minimum(np.searchsorted(ends_m, middle), len(ends_m) - 1)]
    cap, by = caps(path, feed, limits, middle)
    names = ("", AXIS_SPEED, BEND_LIMITS[0], BEND_LIMITS[1])
    return [
        Piece(length, v * (_NEAR_CAP if i > 1 else 1.0), 1.0, 1.0, names[i])
        for length, v, i in zip(np.diff(path.grid_m).tolist(), cap.tolist(), by.tolist(), strict=True)
    ]


def _averaged(values: FloatArray, width: int) -> FloatArray:
    """Moving averages (n,) over `width` intervals around each value, by the trapezoidal rule."""
    weight = np.full(width + 1, 1.0 / width)
    weight[[0, -1]] *= 0.5
    return np.convolve(np.pad(values, (width // 2, width - width // 2), mode="edge"), weight, mode="valid")


def _spline_values(control: FloatArray) -> FloatArray:
    padded = np.pad(control, 1, mode="edge")
    return np.asarray((padded[:-2] + 4.0 * padded[1:-1] + padded[2:]) / 6.0)


def _slower(control: FloatArray, excess: FloatArray, around: int) -> FloatArray:
    """The same motion, slowed smoothly for so many ms `around` the rows where `excess` (n,) is above 1."""
    needed = np.where(excess > 1.0, 1.002 * excess, 1.0)
    factor = _averaged(_averaged(maximum_filter1d(needed, 2 * around + 1), around), around)
    control, factor = np.pad(control, _REST, mode="edge"), np.pad(factor, _REST, mode="edge")
    time = np.append(0.0, np.cumsum(0.5 * (factor[1:] + factor[:-1])))
    rows = np.arange(len(control), dtype=np.float64)
    at = np.minimum(CubicSpline(time, rows)(np.minimum(np.arange(math.ceil(time[-1]) + 1), time[-1])), rows[-1])
    slow = np.maximum.accumulate(np.clip(CubicSpline(rows, control, bc_type="clamped")(at), control[0], control[-1]))
    return _between_rests(slow, control[0], control[-1])


def _resampled(s: FloatArray, rests: _Index, b: FloatArray, step: float, new_step: float) -> tuple[FloatArray, _Index]:
    """The motion `s` with the square `b` of its rate, sampled evenly each `new_step`, and the rows of its rests."""
    rate = np.sqrt(b)
    old = np.arange(len(s)) * step
    time = np.append(0.0, np.cumsum(2.0 * step / (rate[1:] + rate[:-1])))
    even = np.arange(0.0, time[-1], new_step)
    was = CubicSpline(time, old, bc_type=((1, rate[0]), (1, rate[-1])))(even)
    rows = np.minimum(np.rint(time[rests] / new_step).astype(np.intp), len(even) - 1)
    return np.asarray(CubicSpline(old, s, bc_type="clamped")(was)), rows
