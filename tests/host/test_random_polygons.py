# SPDX-License-Identifier: Apache-2.0
"""Random polygons with random limits, which the planner once refused by its own check: they are planned now."""

import numpy as np
import pytest

from kontur.experiments.bench_plan import lines
from kontur.planning import time_law
from kontur.planning.planner import Limits, plan


def polygon(seed):
    """Lines of random lengths and directions, limits, and a tolerance in m."""
    random = np.random.default_rng(seed)
    scale = 10 ** random.uniform(-4.3, -1.7)
    count = int(random.integers(3, 40))
    step = random.normal(0.0, scale, (count, 2)) * 10 ** random.uniform(-1.0, 0.5, (count, 1))
    if random.random() < 0.3:
        step[np.arange(count), random.integers(0, 2, count)] = 0.0
    feed = 10 ** random.uniform(-2.3, -0.5)
    jerk = tuple(10 ** random.uniform(1.2, 3.0, 2)) if random.random() < 0.6 else (100.0, 100.0)
    acceleration = tuple(10 ** random.uniform(-0.3, 1.3, 2)) if random.random() < 0.6 else (5.0, 5.0)
    random.random()
    points = np.concatenate([[[0.0, 0.0]], np.cumsum(step, axis=0)])
    limits = Limits(acceleration_mps2=acceleration, jerk_mps3=jerk)
    return lines(points, feed), limits, 10 ** random.uniform(-5.3, -4.0)


@pytest.mark.parametrize("seed", [303, 364, 464])
def test_a_polygon_whose_first_millisecond_was_beyond_its_jerk_is_planned(seed):
    program, limits, tolerance_m = polygon(seed)
    assert plan(program, limits, tolerance_m=tolerance_m).deviation_m <= tolerance_m


@pytest.mark.parametrize(
    "seed",
    [
        pytest.param(19, id="short between its stops"),
        pytest.param(342, id="16 and 18 m/s2 and 100 m/s3"),
        pytest.param(319, id="equations without a solution"),
    ],
)
def test_a_polygon_with_stops_in_its_corners_is_planned(seed, monkeypatch):
    monkeypatch.setattr(time_law, "corner_m", lambda limits: 1.0)
    program, limits, tolerance_m = polygon(seed)
    assert plan(program, limits, tolerance_m=tolerance_m).deviation_m <= tolerance_m
