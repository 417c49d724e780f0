# SPDX-License-Identifier: Apache-2.0
"""Distances to a smoothed path in its corners, where there is more than one foot point, against a dense search."""

import math

import numpy as np
import pytest

from kontur.experiments.bench_plan import lines
from kontur.path.geometry import Move, Program
from kontur.path.smoothing import TOLERANCE_M, parts
from kontur.runs.scoring import contour_error


@pytest.mark.parametrize("degrees", [90, 150, 170, 178])
def test_the_distance_to_a_corner_is_that_to_its_nearest_point(degrees):
    angle = math.radians(degrees)
    corner = np.array([5e-3, 0.0])
    program = lines(np.array([[0.0, 0.0], corner, corner + 4e-3 * np.array([math.cos(angle), math.sin(angle)])]))
    (part,) = parts(program, TOLERANCE_M)
    path = part.path
    random = np.random.default_rng(degrees)
    at = corner[0] + random.uniform(-60e-6, 60e-6, 1000)
    off = random.normal(0.0, 4e-6, (1000, 2))
    position = path.point(at) + off
    error = contour_error(Program("smooth", (Move(path, 0.1),), program.start_m), position, at)
    reach = 4.0 * np.hypot(off[:, 0], off[:, 1])
    point = path.point((at + reach * np.linspace(-1.0, 1.0, 801)[:, None]).ravel()).reshape(801, 1000, 2)
    chord, gap = np.diff(point, axis=0), position - point[:-1]
    share = np.clip(np.sum(gap * chord, axis=2) / np.maximum(np.sum(chord**2, axis=2), 1e-300), 0.0, 1.0)
    gap -= share[..., None] * chord
    nearest = np.min(np.hypot(gap[..., 0], gap[..., 1]), axis=0)
    np.testing.assert_allclose(np.abs(error.normal_m), nearest, rtol=0.0, atol=1e-8)
