# SPDX-License-Identifier: Apache-2.0
"""The arcs of G-code, which ends and centres that were rounded do not quite fit.

An arc starts and ends exactly where it is programmed. The radii at its ends may differ as much as for LinuxCNC 2.9
(interp_arc.cc, arc_data_ijk). The radius then goes from one to the other, nearly evenly with the angle.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import numpy.typing as npt

from kontur.path.geometry import Arc, Curve, FloatArray, Segment
from kontur.path.shapes import spiral_formula

INCH_M = 25.4e-3
SAME = 1e-9
"""m or degrees: positions nearer than this are one."""
FULL_RAD = 1e-6
"""An arc about a given centre that turns by less than this, either way, is a full circle."""
_TURN = 2.0 * math.pi
_UNEVEN_MAX_M = 0.2e-6  # how far a circular arc may be from the even change of the radius
_SHIFT_SHARE_MAX = 0.1  # of the radius: a centre may be shifted by as much


def problem(here: complex, to: complex, center: complex, unit_m: float) -> str | None:
    """Why there is no arc from `here` to `to` about `center`, in a program whose unit is `unit_m`; None: there is."""
    start_r, end_r = abs(here - center), abs(to - center)
    if start_r < SAME or end_r < SAME:
        return "the centre of the arc is one of its ends; correct I and J"
    if not on_arc(start_r, end_r, unit_m == INCH_M):
        return (
            f"the end is not on the arc: the radius is {start_r / unit_m:.4f} at its start and {end_r / unit_m:.4f} at "
            "its end; correct X, Y, I or J, or give more digits"
        )
    return None


def on_arc(start_r: float, end_r: float, inch: bool) -> bool:
    """Whether the end of an arc counts as on it, by the radii in m about its centre: 0.028 mm or, in a program in
    inches, 0.0028 inch, or 0.1 % of the radius, but never more than 100 times those lengths."""
    tolerance = _tolerance(inch)
    differ = abs(start_r - end_r)
    return differ <= tolerance or differ <= min(1e-3 * max(start_r, end_r), 100.0 * tolerance)


def _tolerance(inch: bool) -> float:
    return 2.0 * math.sqrt(2.0) * (25.4e-6 if inch else 10e-6)


def center_from_radius(here: complex, to: complex, radius: float, left: bool) -> complex | None:
    """Centre of the arc with `radius` (negative: the longer way around); None if the radius cannot span the chord."""
    half = (to - here) / 2.0
    height_squared = radius**2 - abs(half) ** 2
    if abs(half) - abs(radius) > max(5e-6, 1e-3 * abs(radius)) or radius == 0.0:
        return None
    side = 1.0 if left == (radius > 0.0) else -1.0
    return here + half + side * 1j * half / abs(half) * math.sqrt(max(height_squared, 0.0))


def segment(here: complex, to: complex, center: complex, left: bool, turns: int = 1) -> Segment:
    """The arc from `here` about `center` to `to`, to the left or right; a full turn where it would turn by nothing.
    `turns`: the number of turns that it begins."""
    sense = 1.0 if left else -1.0
    more = (turns - 1) * _TURN
    if to == here:
        return _arc(here, center, sense * (_TURN + more))
    sweep = _sweep(here - center, to - center, sense) + more
    chord = (to - here) / abs(to - here)
    shift = ((center - (here + to) / 2.0) * chord.conjugate()).real
    # A circle about a centre shifted along the chord, so that both ends lie on it, leaves the even change by this:
    uneven = 0.21 * abs(shift) * (sweep / math.pi) ** 3
    if uneven > _UNEVEN_MAX_M or abs(shift) > _SHIFT_SHARE_MAX * abs(here - center):
        start, rise = abs(here - center), (abs(to - center) - abs(here - center)) / sweep
        return Curve(
            partial(spiral_formula, center, start, rise, here - center, sense), np.linspace(0.0, sweep, 64 * turns + 1)
        )
    center -= shift * chord
    return _arc(here, center, sense * (_sweep(here - center, to - center, sense) + more))


def columns(
    here: FloatArray, to: FloatArray, center: FloatArray, left: npt.NDArray[np.bool_], unit_m: float
) -> tuple[FloatArray, dict[int, Segment]]:
    """What problem() and segment() say of arcs from `here` (2, n) about `center` to `to`, up to the first one that has
    a problem: the arcs (5, k) as ArcColumns has them, and those that are no arcs but curves, by their number.

    It is the same bit for bit: absolute values and angles are those of the C library, which NumPy's own are not on
    every processor.
    """
    start_r, end_r = np.hypot(*(here - center)), np.hypot(*(to - center))
    tolerance, differ = _tolerance(unit_m == INCH_M), np.abs(start_r - end_r)
    on = (differ <= tolerance) | (differ <= np.minimum(1e-3 * np.maximum(start_r, end_r), 100.0 * tolerance))
    good = (start_r >= SAME) & (end_r >= SAME) & on
    k = len(good) if np.all(good) else int(np.argmin(good))
    here, to, center, start_r = here[:, :k], to[:, :k], center[:, :k], start_r[:k]
    sense = np.where(left[:k], 1.0, -1.0)
    full = np.all(to == here, axis=0)
    chord = to - here
    chord /= np.where(full, 1.0, np.hypot(*chord))
    (x, y), (chord_x, chord_y) = center - (here + to) / 2.0, chord
    shift = np.where(full, 0.0, x * chord_x + y * chord_y)
    uneven = 0.21 * np.abs(shift) * (_sweeps(here - center, to - center, sense) / math.pi) ** 3
    curved = ~full & ((uneven > _UNEVEN_MAX_M) | (np.abs(shift) > _SHIFT_SHARE_MAX * start_r))
    others = {
        i: segment(complex(*here[:, i]), complex(*to[:, i]), complex(*center[:, i]), bool(left[i]))
        for i in np.flatnonzero(curved).tolist()
    }
    center = center - shift * chord
    sweep = sense * np.where(full, _TURN, _sweeps(here - center, to - center, sense))
    x, y = here - center
    return np.stack([*center, np.hypot(x, y), _angles(y, x), sweep]), others


def _sweeps(start: FloatArray, end: FloatArray, sense: FloatArray) -> FloatArray:
    """_sweep() of directions (2, n)."""
    angle = sense * _angles(end[1] * start[0] - end[0] * start[1], end[0] * start[0] + end[1] * start[1])
    return np.where(angle > FULL_RAD, angle, angle + _TURN)


def _angles(y: FloatArray, x: FloatArray) -> FloatArray:
    return np.fromiter(map(math.atan2, y.tolist(), x.tolist()), float, len(x))


def _arc(here: complex, center: complex, sweep: float) -> Arc:
    offset = here - center
    return Arc((center.real, center.imag), abs(offset), math.atan2(offset.imag, offset.real), sweep)


def _sweep(start: complex, end: complex, sense: float) -> float:
    """Angle from one direction to the other, turning by `sense`: above FULL_RAD, and a full turn more where less."""
    turn = end * start.conjugate()
    angle = sense * math.atan2(turn.imag, turn.real)
    return angle if angle > FULL_RAD else angle + _TURN
