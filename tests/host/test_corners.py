# SPDX-License-Identifier: Apache-2.0
"""Times of paths with true corners: against exact stops, and against any motion within the tolerance."""

import numpy as np
import pytest
from tube_optimum import duration_s, of_program, with_stops_s

from kontur.experiments.bench_plan import (
    FEED_MPS,
    LEAST_WITHIN_S,
    LIMITS,
    TEXT_STOPS_S,
    WITHIN,
    lines,
    stopping,
    stops_s,
)
from kontur.path.smoothing import TOLERANCE_M
from kontur.planning.planner import plan

EXACT = [name for name in WITHIN if name != "text"]


def test_the_reference_knows_the_least_time_of_a_line():
    line = lines(np.array([[0.0, 0.0], [0.01, 0.0]]))
    points_m = np.array([[0.0, 0.0], [0.01, 0.0]])
    found = duration_s(points_m, np.zeros((100, 2)), np.zeros(100, dtype=int), FEED_MPS, LIMITS, 1e-7, 2e-3)
    assert found == pytest.approx(stops_s(line), rel=0.01)


def test_the_least_times_are_those_of_the_reference():
    raster = of_program(WITHIN["raster of 5 rows"], LIMITS, TOLERANCE_M, 4e-3)
    assert raster == pytest.approx(LEAST_WITHIN_S["raster of 5 rows"], rel=0.02)
    assert with_stops_s(WITHIN["text"], LIMITS, TOLERANCE_M, 2e-3) == pytest.approx(TEXT_STOPS_S, rel=0.005)


@pytest.mark.parametrize("name", WITHIN)
def test_paths_with_corners_take_little_longer_than_any_motion_within_the_tolerance(name):
    trajectory = plan(WITHIN[name], LIMITS, tolerance_m=TOLERANCE_M)
    assert LEAST_WITHIN_S[name] < trajectory.duration_s < 1.10 * LEAST_WITHIN_S[name]
    assert trajectory.deviation_m <= TOLERANCE_M


def test_a_text_takes_little_longer_than_the_least_time_with_stops_at_its_corners():
    trajectory = plan(stopping(WITHIN["text"]), LIMITS, tolerance_m=TOLERANCE_M)
    assert LEAST_WITHIN_S["text"] < TEXT_STOPS_S < trajectory.duration_s < 1.10 * TEXT_STOPS_S
    assert trajectory.deviation_m <= TOLERANCE_M


@pytest.mark.parametrize("name", EXACT)
def test_exact_stops_take_little_longer_than_the_least_time_with_stops(name):
    program = WITHIN[name]
    exact = plan(program, LIMITS)
    assert stops_s(program) < exact.duration_s < 1.05 * stops_s(program)
    assert exact.digest == plan(stopping(program), LIMITS, tolerance_m=TOLERANCE_M).digest
