# SPDX-License-Identifier: Apache-2.0
"""The motion along pieces with constant bounds: S-curves between speeds that follow from looking ahead and back.

Within a piece the jerk goes up, holds, goes down, the motion cruises, and the same to the end speed; its tangential
acceleration is zero at both ends.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from kontur.path.geometry import KNOT_S, FloatArray
from kontur.planning import knots
from kontur.planning.bounds import Piece

_STOP_S = 2.0 * KNOT_S  # a stop: three equal control points in a row, so that the spline is at rest there


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


def distance(
    pieces: list[Piece], average_s: float, check_duration: Callable[[float], None], report: Callable[[float], None]
) -> FloatArray:
    """Control points (n,) of the distance travelled, with the first and the last once more. `check_duration` gets what
    it takes, before anything of that length is made."""
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
    check_duration(float(np.sum(duration)))

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


def spline_values(control: FloatArray) -> FloatArray:
    """Values (n,) of the cubic spline of `control` (n + 2,)."""
    return np.asarray((control[:-2] + 4.0 * control[1:-1] + control[2:]) / 6.0)


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
