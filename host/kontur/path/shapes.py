# SPDX-License-Identifier: Apache-2.0
"""Built-in paths: one call gives a program of one shape around the origin that starts on the positive x axis.

All turn counter-clockwise first. Lengths in m, feed in m/s. Every function raises PathError for a size or feed that is
not a positive number or does not fit the shape.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from kontur.errors import PathError
from kontur.path.geometry import Arc, Curve, FloatArray, Line, Move, Program, Segment

_TURN = 2.0 * math.pi
_LEAST, _GREATEST = 1e-9, 1e6  # of sizes, speed (SI) and laps
_TURNS_MAX = 10_000


def circle(radius_m: float, feed_mps: float, laps: float = 1.0, duration_s: float | None = None) -> Program:
    """Circle from (radius, 0) on: `laps` of it, or as many as take `duration_s` at the feed.

    To speed up and to slow down takes a little longer.
    """
    _check("circle", radius=radius_m, feed=feed_mps, laps=laps)
    sweep = _TURN * laps
    if duration_s is not None:
        _check("circle", duration=duration_s)
        sweep = feed_mps * duration_s / radius_m
    return _program("circle", [Arc((0.0, 0.0), radius_m, 0.0, sweep)], feed_mps)


def ellipse(half_width_m: float, half_height_m: float, feed_mps: float, laps: float = 1.0) -> Program:
    """Ellipse with the given half axes along x and y."""
    _check("ellipse", half_width=half_width_m, half_height=half_height_m, feed=feed_mps, laps=laps)
    return _program("ellipse", [_curve(partial(_ellipse, half_width_m, half_height_m), laps)], feed_mps)


def eight(size_m: float, feed_mps: float, laps: float = 1.0) -> Program:
    """Lying figure eight, `size_m` wide and half as high: the lemniscate of Gerono, x = a cos u, y = a sin u cos u."""
    _check("eight", size=size_m, feed=feed_mps, laps=laps)
    return _program("eight", [_curve(partial(_eight, 0.5 * size_m), laps)], feed_mps)


def square(side_m: float, corner_radius_m: float, feed_mps: float) -> Program:
    """Square of lines and quarter circles, once around from the middle of its right side. Radius 0: sharp corners."""
    _check("square", side=side_m, feed=feed_mps)
    half, r = 0.5 * side_m, corner_radius_m
    if not 0.0 <= r <= half:
        raise PathError(
            f"square: the corner radius is {r * 1e3:g} mm; it must be 0 .. {half * 1e3:g} mm (half the side)"
        )
    segments: list[Segment] = []
    here = (half, 0.0)
    for quarter in range(5):
        x, y = (1, 0, -1, 0)[quarter % 4], (0, 1, 0, -1)[quarter % 4]  # outwards from the side; (-y, x) is along it
        end = half - r if quarter < 4 else 0.0
        corner = (half * x - end * y, half * y + end * x)
        if math.dist(here, corner) > 0.0:
            segments.append(Line(here, corner))
        here = corner
        if r > 0.0 and quarter < 4:
            center = ((half - r) * (x - y), (half - r) * (y + x))
            segments.append(Arc(center, r, 0.25 * _TURN * quarter, 0.25 * _TURN))
            here = (center[0] - r * y, center[1] + r * x)
    return _program("square", segments, feed_mps)


def spiral(inner_m: float, outer_m: float, pitch_m: float, feed_mps: float) -> Program:
    """Archimedean spiral from radius `inner_m` (0 is allowed) out to `outer_m`, `pitch_m` from turn to turn."""
    _check("spiral", outer=outer_m, pitch=pitch_m, feed=feed_mps)
    if not 0.0 <= inner_m < outer_m:
        raise PathError(f"spiral: the inner radius is {inner_m * 1e3:g} mm; it must be 0 .. below the outer radius")
    turns = (outer_m - inner_m) / pitch_m
    formula = partial(spiral_formula, 0j, inner_m, pitch_m / _TURN, 1.0 + 0j, 1.0)
    return _program("spiral", [_curve(formula, turns)], feed_mps)


def spiral_formula(
    center: complex, radius: float, rise: float, towards: complex, sense: float, u: FloatArray, order: int
) -> FloatArray:
    """Spiral about `center` with radius `radius + rise u` after turning by u (n,) from the direction `towards`, to the
    left (`sense` 1) or right (-1): its derivative `order` (0..2) by u, (n, 2).
    """
    here = radius + rise * u
    factor = (here, rise + 1j * sense * here, 2j * sense * rise - here)[order]
    z = factor * np.exp(1j * sense * u) * (towards / abs(towards)) + (center if order == 0 else 0.0)
    return np.stack([z.real, z.imag], axis=1)


def _ellipse(a: float, b: float, u: FloatArray, order: int) -> FloatArray:
    phase = u + 0.25 * _TURN * order
    return np.stack([a * np.cos(phase), b * np.sin(phase)], axis=1)


def _eight(a: float, u: FloatArray, order: int) -> FloatArray:
    phase = 0.25 * _TURN * order
    return np.stack([a * np.cos(u + phase), 0.5 * a * 2**order * np.sin(2.0 * u + phase)], axis=1)


def _curve(formula: partial[FloatArray], turns: float) -> Curve:
    if turns > _TURNS_MAX:
        raise PathError(f"{turns:g} turns are too many; at most {_TURNS_MAX} can be planned")
    return Curve(formula, np.linspace(0.0, _TURN * turns, math.ceil(64 * turns) + 1))


def _program(name: str, segments: list[Segment], feed_mps: float) -> Program:
    x, y = segments[0].point(np.zeros(1))[0]
    return Program(name, tuple(Move(segment, feed_mps) for segment in segments), (float(x), float(y)))


def _check(shape: str, **values: float) -> None:
    for name, value in values.items():
        if not _LEAST <= value <= _GREATEST:
            unit = {"feed": " m/s", "laps": "", "duration": " s"}.get(name, " m")
            what = f"{shape}: {name.replace('_', ' ')} is {value:g}{unit}"
            raise PathError(f"{what}; it must be {_LEAST:g}..{_GREATEST:g}{unit}")
