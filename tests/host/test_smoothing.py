# SPDX-License-Identifier: Apache-2.0
"""The smooth curve within a tolerance: how far it is from the file's path, how smooth, and what stays exact."""

from dataclasses import replace

import numpy as np
import pytest
from cam_paths import circle, letters, rosette, staircase, trochoid
from scipy.spatial import cKDTree

from kontur.errors import FileError, PathError
from kontur.path import gcode, shapes, spline_fit
from kontur.path.geometry import Dwell, Program
from kontur.path.smoothing import TOLERANCE_M, Exact, Smooth, parts, toleranced
from kontur.planning.planner import Limits, plan
from kontur.planning.rest import rest

LIMITS = Limits()
MIXED = "G1 F3000 X10\nX10.5 Y0.1\nX11 Y0.3\nG3 X12 Y1.3 R1\nG1 X12.05 Y2\nX12.2 Y3\nG2 X13 Y3.8 I0.8 J0\nG1 X20"


def mixed():
    return gcode.parse(MIXED, "mixed.ngc")


def points_of(segment, spacing_m):
    return segment.point(np.linspace(0.0, segment.length_m, int(segment.length_m / spacing_m) + 2))


def distances(program, found, spacing_m=2e-6):
    """How far the driven path is from the file's at most, and the file's from the driven one."""
    driven = [
        p for part in found for p in ([m.segment for m in part.moves] if isinstance(part, Exact) else [part.path])
    ]
    a = np.concatenate([points_of(move.segment, spacing_m) for move in program.moves])
    b = np.concatenate([points_of(segment, spacing_m) for segment in driven])
    return float(np.max(cKDTree(a).query(b)[0])), float(np.max(cKDTree(b).query(a)[0]))


@pytest.mark.parametrize("tolerance_m", [2e-6, 10e-6, 50e-6])
@pytest.mark.parametrize(
    "program", [circle(90), circle(4000), rosette(244), trochoid(400), staircase(400, 4e-6), letters(12), mixed()],
    ids=["circle 90", "circle 4000", "rosette", "trochoid", "staircase", "letters", "mixed"],
)  # fmt: skip
def test_neither_path_is_further_from_the_other_than_the_tolerance(program, tolerance_m):
    found = list(parts(program, tolerance_m))
    told = max(part.path.deviation_m for part in found if isinstance(part, Smooth))
    there, back = distances(program, found)
    assert max(there, back) <= np.hypot(told, 1.05e-6)  # the points are 2 um apart
    assert told <= tolerance_m


def test_the_curve_has_three_continuous_derivatives():
    (part,) = parts(rosette(244), TOLERANCE_M)
    edge = part.path.grid_m[5:-5]
    for order in (0, 1, 2, 3):
        before, after = (part.path.derivative(edge + shift, order) for shift in (-1e-10, 1e-10))
        size = np.max(np.abs(before))
        assert np.max(np.abs(after - before)) < 1e-4 * size


def test_the_curve_of_a_circle_in_lines_is_a_circle():
    (part,) = parts(circle(360), TOLERANCE_M)
    bend = part.path.curvature(np.linspace(0.003, part.path.length_m - 0.003, 1000))
    assert np.max(np.abs(bend * 0.02 - 1.0)) < 0.01


def test_parts_are_connected_and_hold_all_moves_and_dwells():
    program = letters(10)
    items = (*program.items[:20], Dwell(0.1), *program.items[20:], Dwell(0.2))
    found = list(parts(replace(program, items=items), TOLERANCE_M))
    assert sum(len(part.moves) for part in found) == len(program.moves)
    waits = sum(
        float(np.sum(part.dwell_s)) if isinstance(part, Smooth) else
        sum(item.duration_s for item in part.items if isinstance(item, Dwell)) for part in found
    )  # fmt: skip
    assert waits == pytest.approx(0.3)


def test_steps_smaller_than_the_tolerance_are_no_corners():
    (part,) = parts(staircase(400), 20e-6, corner_m=1.0)
    assert isinstance(part, Smooth)
    assert len(part.path.stops_m) <= 4  # the first and the last step are corners: there is no path beyond them


@pytest.mark.parametrize(
    "program",
    [
        shapes.square(0.04, 0.005, 0.05),
        shapes.eight(0.04, 0.05),
        gcode.parse("G1 X10 F3000\nG3 X20 Y10 R10\nG1 Y20\nX0", "p.ngc"),
    ],
)
def test_without_joints_of_short_lines_the_motion_is_the_exact_one_bit_for_bit(program):
    assert plan(program, LIMITS, tolerance_m=TOLERANCE_M).digest == plan(program, LIMITS).digest


def test_without_a_tolerance_all_is_exact():
    program = rosette(244)
    assert list(parts(program, 0.0)) == [Exact(program.items)]
    trajectory = plan(program, LIMITS)
    assert trajectory.deviation_m == 0.0
    assert trajectory.smoothed == ""
    assert trajectory.driven == program.moves


def test_g61_and_g64_say_what_the_tolerance_is():
    text = "G1 X1 F1000\nG64 P0.02 Q0.01\nX2\nG64\nX3\nG61\nX4\nG20 G64 P0.001\nX5"
    found = [move.tolerance_m for move in gcode.parse(text, "p.ngc").moves]
    assert found == [None, pytest.approx(20e-6), None, 0.0, pytest.approx(25.4e-6)]
    with pytest.raises(FileError, match=r"Q-0\.01: the tolerance of G64 must not be negative"):
        gcode.parse("G64 P0.01 Q-0.01\nG1 F100 X1", "p.ngc")
    with pytest.raises(FileError, match="the tolerance of G64 must not be negative"):
        gcode.parse("G64 P-1\nG1 X1 F1000", "p.ngc")


def test_a_tolerance_from_outside_is_that_of_all_moves():
    program = gcode.parse("G61\nG1 X1 F1000\nG64 P0.02\nX2", "p.ngc")
    assert [move.tolerance_m for move in toleranced(program, 5e-6).moves] == [5e-6, 5e-6]
    assert toleranced(program, None) is program


def test_moves_of_exact_path_control_stop_at_each_corner():
    bends = [f"X{1 + i} Y{0.02 * i * i:.3f}" for i in range(8)]
    text = "\n".join(["G61", "G1 F3000 X1 Y0", *bends[1:4], "G64 P0.01", *bends[4:]])
    found = list(parts(gcode.parse(text, "p.ngc"), TOLERANCE_M))
    assert [type(part) for part in found] == [Exact, Smooth]
    assert [len(part.moves) for part in found] == [4, 4]


def test_a_curve_that_leaves_the_travel_is_refused_with_a_remedy():
    program = circle(90)  # its highest line lies 12 um below the circle
    driven = plan(program, LIMITS, tolerance_m=TOLERANCE_M).position_m
    top = max(move.segment.end_m[1] for move in program.moves)
    assert np.max(driven[:, 1]) > top + 1e-6
    with pytest.raises(PathError, match=r"within its tolerance the path leaves the travel in y by .* µm; .* 0"):
        plan(program, LIMITS, travel_m=((-0.1, 0.1), (-0.1, top)), tolerance_m=TOLERANCE_M)


def test_a_stretch_that_cannot_be_fitted_stays_exact(monkeypatch):
    monkeypatch.setattr(spline_fit.Fit, "tighten", lambda self: None)
    monkeypatch.setattr(spline_fit.Fit, "late", lambda self: np.ones(len(self._knots), dtype=bool))
    program = rosette(244)
    assert list(parts(program, TOLERANCE_M)) == [Exact(program.items)]


def test_the_rest_of_a_smoothed_path_is_on_it():
    trajectory = plan(rosette(244), LIMITS, tolerance_m=TOLERANCE_M)
    left = rest(trajectory, 700, 100.0).trajectory
    whole = trajectory.driven[0].segment
    assert np.max(np.abs(whole.point(left.path_s_m) - left.position_m)) < 1e-12
    np.testing.assert_allclose(left.position_m[0], trajectory.position_m[700], atol=1e-9)
    np.testing.assert_allclose(left.knots_nm[-1], trajectory.knots_nm[-1], atol=1)


def test_an_empty_program_is_refused_with_a_tolerance_too():
    with pytest.raises(PathError, match="there is no motion in it"):
        plan(Program("empty", (), (0.0, 0.0)), LIMITS, tolerance_m=TOLERANCE_M)
