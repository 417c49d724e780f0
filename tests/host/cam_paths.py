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
