# SPDX-License-Identifier: Apache-2.0
"""The rest of a trajectory: on the same path, from standstill at any millisecond, and found again by its length."""

from pathlib import Path

import numpy as np
import pytest

from kontur import machine
from kontur.path import programs, shapes
from kontur.path.geometry import Program
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.planning.rest import rest, rest_of_length, whole

EXAMPLES = Path(__file__).parents[2] / "examples"
BOUNDS = limits(machine.load())
PROGRAMS = {
    "circle": shapes.circle(0.02, 0.1),
    "part": programs.load(EXAMPLES / "part.ngc"),
    "timed": programs.load(EXAMPLES / "timed.csv"),
}


@pytest.mark.parametrize("program", PROGRAMS.values(), ids=PROGRAMS.keys())
@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.9, 0.999])
def test_rest_begins_and_ends_at_rest_and_goes_over_the_same_way(program: Program, share: float) -> None:
    trajectory = plan(program, BOUNDS)
    from_ms = int(share * (len(trajectory.knots_nm) - 2))
    left = rest(trajectory, from_ms, 100.0)
    position_m = left.trajectory.position_m
    np.testing.assert_allclose(position_m[0], trajectory.position_m[from_ms], atol=1e-12)
    np.testing.assert_allclose(position_m[-1], trajectory.position_m[-1], atol=1e-12)
    steps_nm = np.diff(left.trajectory.knots_nm.astype(np.int64), axis=0)
    assert np.abs(steps_nm[:2]).max() <= 3
    assert np.abs(steps_nm[-1:]).max() <= 3
    s_m = left.trajectory.path_s_m
    assert (np.diff(s_m) >= 0.0).all()
    np.testing.assert_allclose(np.interp(left.path_ms, whole(trajectory).path_ms, trajectory.path_s_m), s_m, atol=2e-6)


def test_rest_gains_speed_no_faster_than_a_drive_that_goes_on_after_a_stop() -> None:
    trajectory = plan(PROGRAMS["circle"], BOUNDS)
    left = rest(trajectory, 600, 100.0)
    acceleration_mps2 = np.diff(left.trajectory.knots_nm.astype(np.float64), 2, axis=0) * 1e-3
    centripetal = 0.1**2 / 0.02
    along = 4.0 / 3.0 * 0.1 / 0.1  # of 100 mm/s in 100 ms
    assert np.hypot(*acceleration_mps2[: 2 * 100].T).max() < np.hypot(centripetal, along)


@pytest.mark.parametrize("stop_ms", [1, 100, 250])
def test_rest_is_found_again_by_its_number_of_knots(stop_ms: int) -> None:
    trajectory = plan(PROGRAMS["circle"], BOUNDS)
    total = len(trajectory.knots_nm)
    lengths = set()
    for from_ms in (0, 1, 2, 333, total - 60, total - 3, total - 2):
        left = rest(trajectory, from_ms, stop_ms)
        found = rest_of_length(trajectory, len(left.trajectory.knots_nm), stop_ms)
        assert found is not None
        assert found.trajectory.digest == left.trajectory.digest
        np.testing.assert_array_equal(found.path_ms, left.path_ms)
        lengths.add(len(left.path_ms))
    assert len(lengths) == 7
    assert rest_of_length(trajectory, 3, stop_ms) is None
    assert rest_of_length(trajectory, 10 * total, stop_ms) is None
