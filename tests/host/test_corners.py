# SPDX-License-Identifier: Apache-2.0
"""Times of paths with true corners: against exact stops, and against any motion within the tolerance."""

import numpy as np
import pytest
from tube_optimum import duration_s, of_program

from kontur.experiments.bench_plan import FEED_MPS, LEAST_WITHIN_S, LIMITS, lines, raster, stops_s
from kontur.path import shapes
from kontur.path.smoothing import TOLERANCE_M
from kontur.planning.planner import plan

SQUARE = shapes.square(0.04, 0.0, FEED_MPS)
RASTER = raster(5)


def test_the_reference_knows_the_least_time_of_a_line():
    line = lines(np.array([[0.0, 0.0], [0.01, 0.0]]))
    points_m = np.array([[0.0, 0.0], [0.01, 0.0]])
    found = duration_s(points_m, np.zeros(100, dtype=int), FEED_MPS, LIMITS, 1e-7, 2e-3)
    assert found == pytest.approx(stops_s(line), rel=0.01)


def test_the_least_time_of_a_raster_is_that_of_the_reference():
    assert of_program(RASTER, LIMITS, TOLERANCE_M, 4e-3) == pytest.approx(LEAST_WITHIN_S["raster"], rel=0.02)


@pytest.mark.parametrize(("program", "name"), [(SQUARE, "square"), (RASTER, "raster")], ids=["square", "raster"])
def test_paths_with_corners_take_little_longer_than_any_motion_within_the_tolerance(program, name):
    trajectory = plan(program, LIMITS, tolerance_m=TOLERANCE_M)
    assert LEAST_WITHIN_S[name] < trajectory.duration_s < 1.10 * LEAST_WITHIN_S[name]


@pytest.mark.parametrize("program", [SQUARE, RASTER], ids=["square", "raster"])
def test_exact_stops_take_little_longer_than_the_least_time_with_stops(program):
    assert stops_s(program) < plan(program, LIMITS).duration_s < 1.05 * stops_s(program)
