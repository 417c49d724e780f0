# SPDX-License-Identifier: Apache-2.0
"""Paths of short lines, such as CAM programs make them, and the smooth curves that they stand for."""

import itertools
import math

import numpy as np

from kontur.path.geometry import Line, Move, Program


def lines(points_m, feed_mps=0.1, digits=9):
    """A program of lines through points (n, 2), rounded to so many digits of a metre."""
    points = [tuple(point) for point in np.round(np.asarray(points_m, dtype=float), digits).tolist()]
    pairs = [(a, b) for a, b in itertools.pairwise(points) if a != b]
    moves = tuple(Move(Line(a, b), feed_mps, line=i + 1) for i, (a, b) in enumerate(pairs))
    return Program("lines", moves, points[0])


def circle(count, radius_m=0.02, feed_mps=0.1):
    angle = np.linspace(0.0, 2.0 * np.pi, count + 1)
    return lines(circle_curve(radius_m)(angle, 0), feed_mps)


def circle_curve(radius_m):
    """The circle by its angle, or its derivative of some order."""
    return lambda u, order: radius_m * np.stack([np.cos(u + order * np.pi / 2), np.sin(u + order * np.pi / 2)], axis=1)


def rosette(count, feed_mps=0.1):
    return lines(rosette_curve(np.linspace(0.0, 2.0 * np.pi, count + 1), 0), feed_mps, digits=7)


def rosette_curve(u, order):
    """Radius 20 mm (1 + 0.3 cos 5u)."""
    parts = ((0.02, 1j), (0.003, 6j), (0.003, -4j))
    z = sum(size * turns**order * np.exp(turns * u) for size, turns in parts)
    return np.stack([z.real, z.imag], axis=1)


def spiral(count, feed_mps=0.1):
    return lines(spiral_curve(np.linspace(0.0, 6.0 * np.pi, count + 1), 0), feed_mps, digits=7)


def spiral_curve(u, order):
    """From a radius of 5 mm, by 5 mm a turn."""
    growth = 0.005 / (2.0 * np.pi)
    z = 1j**order * np.exp(1j * u) * (0.005 + growth * u) + order * growth * 1j ** max(order - 1, 0) * np.exp(1j * u)
    return np.stack([z.real, z.imag], axis=1)


def trochoid(count, feed_mps=0.1):
    return lines(trochoid_curve(np.linspace(0.0, 20.0 * np.pi, count + 1), 0), feed_mps, digits=7)


def trochoid_curve(u, order):
    """Radius 1 mm, by 0.3 mm a turn."""
    z = 1e-3 * 1j**order * np.exp(1j * u)
    z = z + ((3e-4 / (2.0 * np.pi)) * (u if order == 0 else 1.0) if order < 2 else 0.0)
    return np.stack([z.real, z.imag], axis=1)


def staircase(count, step_m=16e-6):
    """A slanted line in steps along the axes."""
    number = np.arange(count + 1)
    return lines(step_m * np.stack([(number + 1) // 2, number // 2], axis=1))


def letters(count, seed=1, feed_mps=0.05):
    """Outlines with corners, round parts of 8 to 40 lines, and rapid moves between them as feed moves."""
    random = np.random.default_rng(seed)
    points, x = [(0.0, 0.0)], 0.0
    for _ in range(count):
        if random.integers(4) == 0:
            points += [(x + 1e-3 * i, 4e-3 * (i % 2)) for i in range(5)]
        else:
            radius = random.uniform(0.5e-3, 2e-3)
            angle = np.linspace(0.0, 1.8 * math.pi, int(random.integers(8, 40)))
            points += list(zip(x + radius * np.sin(angle), radius * np.cos(angle), strict=True))
        x += 3e-3
    return lines(points, feed_mps, digits=6)
