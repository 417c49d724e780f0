# SPDX-License-Identifier: Apache-2.0
"""Paths of short lines, such as CAM programs make them, and the smooth curves that they stand for."""

import math
from functools import partial

import numpy as np

from kontur.experiments.bench_plan import (
    circle_curve,
    lines,
    of_curve,
    rosette_curve,
    spiral_curve,
    trochoid_curve,
)
from kontur.path import gcode

TURN = 2.0 * math.pi


def circle(count, radius_m=0.02, feed_mps=0.1):
    return lines(circle_curve(radius_m)(np.linspace(0.0, TURN, count + 1), 0), feed_mps)


rosette = partial(of_curve, rosette_curve, TURN)
spiral = partial(of_curve, spiral_curve, 3.0 * TURN)
trochoid = partial(of_curve, trochoid_curve, 10.0 * TURN)


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


def lines_and_arcs(seed):
    """Lines in all directions, each with half a circle behind it, at feeds of up to 300 mm/s, and corners."""
    random = np.random.default_rng(seed)
    rows = ["G21 G91 G0 X1 Y1", "G1 F18000"]
    for _ in range(12):
        angle, length = random.uniform(0.0, TURN), random.uniform(0.2, 60.0)
        x, y = length * math.cos(angle), length * math.sin(angle)
        rows.append(f"G1 X{x:.4f} Y{y:.4f} F{random.choice([2000, 6000, 18000])}")
        radius = random.uniform(0.5, 30.0)
        i, j = -radius * math.sin(angle), radius * math.cos(angle)
        rows.append(f"G3 X{2 * i:.4f} Y{2 * j:.4f} I{i:.4f} J{j:.4f}")
    return gcode.parse("\n".join(rows), "random.ngc")
