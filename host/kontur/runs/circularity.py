# SPDX-License-Identifier: Apache-2.0
"""What a circle in both senses says of two axes, after ISO 230-4 (Test code for machine tools, circular tests).

Pure functions on positions (n, 2) in mm. A lap is one whole turn; what is before and after it, in which the axes speed
up and slow down, is cut off by lap(). Radial deviations are positive outwards. All circles are least-squares ones.

Differences from ISO 230-4: G is the radial range about the least-squares centre, which the standard allows, and not
that of the minimum zone. Causes and spikes are no part of the standard. The causes are a fit, by least squares, of

    dr = mean + scale/2 R cos 2t + squareness/2 R sin 2t + s lag/2 sin 2t
         + s backlash_x/2 cos t sgn(sin t) - s backlash_y/2 sin t sgn(cos t)

to both senses together, with s = 1 counter-clockwise and -1 clockwise, t the angle, R the radius. It leaves out what is
near a reversal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kontur.errors import LogError

Floats = NDArray[np.float64]

SENSES = ("ccw", "cw")
PLACES = ("x+", "y+", "x-", "y-")
"""Where an axis reverses: at 0, 90, 180 and 270 degrees."""
PROFILE = 1440  # angles of a profile, from 0 degrees on
_NEAR_DEG = 15.0  # of a reversal: a spike is looked for there, and the causes are not fitted there
_GAP_DEG = 5.0  # widest from point to point
_SAME_DIGITS = 6  # of an angle in rad: points with the same ones are at one place, of which the outer one counts
_TURNS_MAX = 50  # of the fit of a circle, which converges within a few
_FITTED_MM = 1e-12


@dataclass(frozen=True)
class Spike:
    """The greatest deviation near the reversal at `place`, in `sense`: `height_um`, positive outwards, beyond the
    levels before and after the reversal; `width_deg` at half of the height, 0 where there is no spike."""

    place: str
    sense: str
    height_um: float
    width_deg: float


@dataclass(frozen=True)
class Circularity:
    """The figures of a circle in both senses.

    `g_*_um`: circular deviation G of each sense about its own centre, and G(b) of both about their common one.
    `f_*_um`: least and greatest radial deviation F from the programmed circle. `d_um`: mean bi-directional radial
    deviation D, the mean of both radii less the programmed one. `centre_*_um`: the common centre, from the programmed
    one.

    Causes: `scale_um_per_m`: x is so much longer than y. `squareness_um_per_m`: how much the angle between the positive
    axes is below 90 degrees, in microradians. `backlash_*_um`: whole gap, positive where an axis is left behind after
    its reversal. `lag_um`: at the feed, x lags so much more than y.
    """

    g_ccw_um: float
    g_cw_um: float
    g_both_um: float
    f_min_ccw_um: float
    f_max_ccw_um: float
    f_min_cw_um: float
    f_max_cw_um: float
    d_um: float
    centre_x_um: float
    centre_y_um: float
    scale_um_per_m: float
    squareness_um_per_m: float
    backlash_x_um: float
    backlash_y_um: float
    lag_um: float
    spikes: tuple[Spike, ...]


def lap(position_mm: Floats, centre_mm: tuple[float, float], before: float) -> Floats:
    """The points (m, 2) of one turn about `centre_mm`, from it, which begins `before` turns after the first point.

    Raises LogError: there is no whole turn, or points are missing in it.
    """
    points = position_mm - np.array(centre_mm)
    angle = np.unwrap(np.arctan2(points[:, 1], points[:, 0]))
    turns = np.abs(angle - angle[0]) / (2.0 * np.pi)
    inside = (turns >= before) & (turns < before + 1.0)
    if turns[-1] < before + 1.0 or not np.any(inside):
        raise LogError(f"the circle ends after {turns[-1]:.3g} turns; {before + 1.0:g} are needed to measure one")
    gap_deg = float(np.max(np.abs(np.diff(angle[inside])), initial=0.0)) * 180.0 / np.pi
    if gap_deg > _GAP_DEG:
        raise LogError(
            f"the positions of the circle are up to {gap_deg:.3g} degrees apart; {_GAP_DEG:g} are allowed. Use a lower "
            "feed or a greater radius; on a bus see that no telemetry is lost"
        )
    return np.asarray(points[inside])


def fitted(points_mm: Floats) -> tuple[Floats, float]:
    """Centre (2,) and radius of the circle with the least sum of squared radial distances (Gauss-Newton)."""
    centre = np.mean(points_mm, axis=0)
    radius = 0.0
    for _ in range(_TURNS_MAX):
        away = points_mm - centre
        distance = np.hypot(away[:, 0], away[:, 1])
        jacobian = np.column_stack([away / distance[:, None], np.ones(len(away))])
        step = np.linalg.lstsq(jacobian, distance - radius, rcond=None)[0]
        centre, radius = centre + step[:2], radius + float(step[2])
        if np.max(np.abs(step)) < _FITTED_MM:
            break
    return centre, radius


def circularity(ccw_mm: Floats, cw_mm: Floats, radius_mm: float) -> Circularity:
    """The figures of two laps, points from the programmed centre; `radius_mm` is the programmed radius."""
    both = np.concatenate([ccw_mm, cw_mm])
    centre, _ = fitted(both)
    (centre_ccw, radius_ccw), (centre_cw, radius_cw) = fitted(ccw_mm), fitted(cw_mm)
    off_ccw, off_cw = _distance(ccw_mm) - radius_mm, _distance(cw_mm) - radius_mm

    angle, deviation, sense = _about((ccw_mm, cw_mm), centre, radius_mm)
    far = np.abs(_from_reversal(angle)) > np.deg2rad(_NEAR_DEG)
    size = np.linalg.lstsq(_causes(angle, sense)[far], deviation[far], rcond=None)[0]
    scale, skew, lag, gap_x, gap_y = (2e3 * float(value) for value in size[3:])
    return Circularity(
        g_ccw_um=_range_um(ccw_mm, centre_ccw),
        g_cw_um=_range_um(cw_mm, centre_cw),
        g_both_um=_range_um(both, centre),
        f_min_ccw_um=1e3 * float(np.min(off_ccw)),
        f_max_ccw_um=1e3 * float(np.max(off_ccw)),
        f_min_cw_um=1e3 * float(np.min(off_cw)),
        f_max_cw_um=1e3 * float(np.max(off_cw)),
        d_um=1e3 * (0.5 * (radius_ccw + radius_cw) - radius_mm),
        centre_x_um=1e3 * float(centre[0]),
        centre_y_um=1e3 * float(centre[1]),
        scale_um_per_m=1e3 * scale / radius_mm,
        squareness_um_per_m=1e3 * skew / radius_mm,
        backlash_x_um=gap_x,
        backlash_y_um=gap_y,
        lag_um=lag,
        spikes=tuple(
            _spike(place, name, angle[one], deviation[one], sense[one], size)
            for name, one in zip(SENSES, (sense > 0.0, sense < 0.0), strict=True)
            for place in range(len(PLACES))
        ),
    )


def profiles(ccw_mm: Floats, cw_mm: Floats, radius_mm: float) -> tuple[Floats, Floats]:
    """Radius about the common centre less the programmed one, in um, of each sense at PROFILE angles from 0 on.

    Of the points around an angle it is the one furthest from the programmed circle, so that no peak is lost.
    """
    centre, _ = fitted(np.concatenate([ccw_mm, cw_mm]))
    ccw, cw = (_profile(*_about((one,), centre, radius_mm)[:2]) for one in (ccw_mm, cw_mm))
    return ccw, cw


def _profile(angle: Floats, deviation: Floats) -> Floats:
    """The greatest of the deviations, in mm, around each of PROFILE angles, in um."""
    at = np.rint(angle * (PROFILE / (2.0 * np.pi))).astype(int) % PROFILE
    order = np.argsort(np.abs(deviation))
    found = np.full(PROFILE, np.nan)
    found[at[order]] = deviation[order]  # the last one that is written to an angle is the greatest
    known = np.flatnonzero(np.isfinite(found))
    return np.asarray(1e3 * np.interp(np.arange(PROFILE), known, found[known], period=PROFILE))


def _distance(points_mm: Floats) -> Floats:
    return np.asarray(np.hypot(points_mm[:, 0], points_mm[:, 1]))


def _range_um(points_mm: Floats, centre_mm: Floats) -> float:
    return 1e3 * float(np.ptp(_distance(points_mm - centre_mm)))


def _about(laps: tuple[Floats, ...], centre: Floats, radius_mm: float) -> tuple[Floats, Floats, Floats]:
    """Angle, radial deviation in mm and sense of the points of `laps`, about `centre`."""
    points = np.concatenate(laps) - centre
    angle = np.arctan2(points[:, 1], points[:, 0])
    sense = np.repeat((1.0, -1.0)[: len(laps)], [len(one) for one in laps])
    return np.asarray(angle), _distance(points) - radius_mm, sense


def _from_reversal(angle: Floats) -> Floats:
    """Angle from the nearest reversal, in rad."""
    return np.asarray((angle + 0.25 * np.pi) % (0.5 * np.pi) - 0.25 * np.pi)


def _causes(angle: Floats, sense: Floats) -> Floats:
    """What each cause does to the radius (n, 8): centre, mean, scale, squareness, lag, backlash in x and y."""
    cos, sin = np.cos(angle), np.sin(angle)
    skew = np.sin(2.0 * angle)
    columns = [cos, sin, np.ones_like(angle), np.cos(2.0 * angle), skew, sense * skew,
               sense * cos * np.sign(sin), -sense * sin * np.sign(cos)]  # fmt: skip
    return np.column_stack(columns)


def _spike(place: int, name: str, angle: Floats, deviation: Floats, sense: Floats, size: Floats) -> Spike:
    """The spike of one sense at the reversal number `place`."""
    away = (angle - 0.5 * np.pi * place + np.pi) % (2.0 * np.pi) - np.pi
    near = np.flatnonzero(np.abs(away) <= np.deg2rad(_NEAR_DEG))
    causes = _causes(angle[near], sense[near])
    gap = 6 + place % 2
    step = np.abs(causes[:, gap] * size[gap])  # half of the step that backlash makes here
    size = np.where(np.arange(len(size)) == gap, 0.0, size)
    rest = deviation[near] - causes @ size
    beyond = np.sign(rest) * np.maximum(np.abs(rest) - step, 0.0)
    height = float(beyond[np.argmax(np.abs(beyond))])
    if height == 0.0:
        return Spike(PLACES[place], name, 0.0, 0.0)
    place_rad, at = np.unique(np.round(away[near], _SAME_DIGITS), return_inverse=True)
    share = np.full(len(place_rad), -np.inf)
    np.maximum.at(share, at, beyond / height - 0.5)
    top = int(np.argmax(share))
    edges = [_edge(share[side], place_rad[side]) for side in (slice(top, None), slice(top, None, -1))]
    return Spike(PLACES[place], name, 1e3 * height, float(np.rad2deg(edges[0] - edges[1])))


def _edge(share: Floats, away: Floats) -> float:
    """Where `share` first falls below 0; the last angle where it does not."""
    below = np.flatnonzero(share < 0.0)
    if not below.size:
        return float(away[-1])
    i = int(below[0])
    return float(away[i - 1] + (away[i] - away[i - 1]) * share[i - 1] / (share[i - 1] - share[i]))
