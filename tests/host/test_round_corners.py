# SPDX-License-Identifier: Apache-2.0
"""True corners that the motion goes round within the tolerance, and those at which it stops."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.signal import lfilter

from kontur.cli import main
from kontur.experiments.bench_plan import lines, stops_s
from kontur.machine import MACHINES, load
from kontur.path import gcode, shapes, smoothing, spline_fit
from kontur.path.geometry import KNOT_S, Dwell
from kontur.path.smoothing import TOLERANCE_M, Exact, Smooth, parts
from kontur.planning.bounds import limits
from kontur.planning.planner import Limits, plan
from kontur.planning.rest import rest
from kontur.planning.time_law import corner_m

LIMITS = Limits()


def zigzag(degrees, count=6, length_m=3e-3):
    """Lines that turn by so many degrees to and fro."""
    half = 0.5 * math.radians(degrees)
    step = length_m * np.array([[math.cos(half), (-1) ** i * math.sin(half)] for i in range(count)])
    return lines(np.concatenate([[[0.0, 0.0]], np.cumsum(step, axis=0)]))


def slowest_mps(trajectory, corner):
    """The least speed near a corner of the program."""
    off = np.hypot(*(trajectory.position_m - corner).T)
    speed = np.hypot(*np.diff(trajectory.position_m, axis=0).T) / KNOT_S
    return float(np.min(speed[off[:-1] < 2e-4]))


def corners(program):
    return np.array([move.segment.end_m for move in program.moves[:-1]])


@pytest.mark.parametrize("degrees", [40, 90, 150])
@pytest.mark.parametrize("tolerance_m", [7e-6, 10e-6, 50e-6])
def test_corners_are_passed_within_the_tolerance_and_faster_than_by_stops(degrees, tolerance_m):
    program = zigzag(degrees)
    trajectory = plan(program, LIMITS, tolerance_m=tolerance_m)
    assert trajectory.duration_s < 0.99 * plan(program, LIMITS).duration_s
    (path,) = (move.segment for move in trajectory.driven)
    s = np.linspace(0.0, path.length_m, 40_001)
    away = np.hypot(*(path.point(s) - of_distance(program, s)).T)
    assert 0.7 * tolerance_m < np.max(away) <= tolerance_m
    assert trajectory.deviation_m == pytest.approx(np.max(away), rel=0.02)
    for corner in corners(program):
        assert slowest_mps(trajectory, corner) > 1e-3


def of_distance(program, s):
    """Points (n, 2) of the program at distances from its start."""
    ends = np.concatenate([[program.start_m], [move.segment.end_m for move in program.moves]])
    edge = np.append(0.0, np.cumsum([move.segment.length_m for move in program.moves]))
    return np.stack([np.interp(s, edge, ends[:, axis]) for axis in (0, 1)], axis=1)


def test_a_path_that_goes_back_over_itself_is_within_the_tolerance():
    program = lines(np.array([[0.0, 0.0], [5e-3, 0.0], [1e-3, 0.0], [4e-3, 3e-3]]))
    trajectory = plan(program, LIMITS, tolerance_m=TOLERANCE_M)
    assert 0.0 < trajectory.deviation_m <= TOLERANCE_M
    assert np.max(trajectory.position_m[:, 0]) == pytest.approx(5e-3, abs=TOLERANCE_M)
    assert trajectory.duration_s < plan(program, LIMITS).duration_s


SQUARE = "G1 F6000 X5\nY5\nX0\nY0"


@pytest.mark.parametrize(
    "text",
    [
        "G61\n" + SQUARE,
        "G61.1\n" + SQUARE,
        "G64 P0\n" + SQUARE,
        "G1 F6000 X5\nG4 P0.01\nY5\nG4 P0.01\nX0\nG4 P0.01\nY0",
        "G1 F6000 X5\nM0\nY5\nM1\nX0\nM0\nY0",
        "G64 P0.01 G1 F6000 X5\nG61 Y5\nG64 P0.01 X0\nG61 Y0",
    ],
)
def test_where_a_program_says_stop_it_stops_in_the_corner(text):
    trajectory = plan(gcode.parse(text, "p.ngc"), LIMITS, tolerance_m=TOLERANCE_M)
    for corner in ([5_000_000, 0], [5_000_000, 5_000_000], [0, 5_000_000]):
        assert np.sum(np.all(trajectory.knots_nm == corner, axis=1)) >= 3


def stops_in_its_corner(program, of, tolerance_m=TOLERANCE_M):
    corner = np.rint(1e9 * corners(program)[0]).astype(int)
    return np.sum(np.all(plan(program, of, tolerance_m=tolerance_m).knots_nm == corner, axis=1)) >= 3


def test_the_tolerance_may_change_on_the_way_without_a_stop():
    text = "G64 P0.01 G1 F6000 X5\nG64 P0.05 Y5\nX0\nG64 P0.01 Y0"
    program = gcode.parse(text, "p.ngc")
    trajectory = plan(program, LIMITS)
    (path,) = (move.segment for move in trajectory.driven)
    s = np.linspace(0.0, path.length_m, 40_001)
    away = np.hypot(*(path.point(s) - of_distance(program, s)).T)
    within = np.where((s > 5e-3) & (s < 15e-3), 50e-6, 10e-6)
    assert np.all(away <= within)
    assert np.max(away[within > 10e-6]) > 25e-6
    assert np.max(away[within < 50e-6]) > 7e-6


def test_where_going_round_is_slower_or_lets_an_axis_ring_the_motion_stops():
    program = zigzag(90, 2)
    quick = replace(LIMITS, jerk_mps3=(1000.0, 1000.0))
    assert 4e-6 < corner_m(LIMITS) < TOLERANCE_M < corner_m(quick) < 60e-6
    assert not stops_in_its_corner(program, LIMITS)
    assert stops_in_its_corner(program, LIMITS, 4e-6)
    assert stops_in_its_corner(program, quick)
    assert not stops_in_its_corner(program, quick, 60e-6)
    assert not stops_in_its_corner(program, limits(load(MACHINES / "ball_screw.toml")))
    slow = limits(load(MACHINES / "long_axis.toml"))  # its mode takes 30 ms
    assert stops_in_its_corner(program, slow)
    assert not stops_in_its_corner(program, slow, 30e-6)


def test_an_axis_with_a_first_mode_rings_no_more_by_corners_than_by_arcs():
    of = limits(load(MACHINES / "ball_screw.toml"))
    square, arcs = shapes.square(0.02, 0.0, 0.1), shapes.square(0.02, 5e-3, 0.1)
    round_ = plan(square, of, tolerance_m=TOLERANCE_M)
    assert round_.duration_s < 0.93 * plan(square, of).duration_s
    ringing = ringing_m(round_, 1.0 / of.average_s)
    assert ringing < 0.8 * ringing_m(plan(arcs, of), 1.0 / of.average_s)
    unaware = plan(square, replace(of, average_s=0.0), tolerance_m=TOLERANCE_M)
    assert ringing < 0.5 * ringing_m(unaware, 1.0 / of.average_s)


def ringing_m(trajectory, mode_Hz):
    """How far a mode without damping swings about where the acceleration would hold it, at most."""
    knots = 1e-9 * np.pad(trajectory.knots_nm.astype(float), ((200, 200), (0, 0)), mode="edge")
    acceleration = np.diff(knots, 2, axis=0) / KNOT_S**2
    steps = np.arange(8)[:, None, None] / 8.0
    a = (acceleration[:-1] + steps * np.diff(acceleration, axis=0)).transpose(1, 0, 2).reshape(-1, 2)
    w, step_s = 2.0 * math.pi * mode_Hz, KNOT_S / 8.0
    swing = lfilter([0.0, -(step_s**2)], [1.0, (w * step_s) ** 2 - 2.0, 1.0], a, axis=0)
    return float(np.max(np.abs(swing + a / w**2)))


def test_a_corner_beside_an_exact_arc_is_a_stop():
    text = "G1 F6000 X5\nX10 Y5\nX15 Y0\nG3 X20 Y5 R5\nG1 X25 Y0\nX30 Y5"
    found = list(parts(gcode.parse(text, "p.ngc"), TOLERANCE_M))
    assert [len(part.moves) for part in found] == [3, 1, 2]
    assert [len(part.path.stops_m) for part in found] == [2, 2, 2]


def test_a_stretch_whose_corners_cannot_be_fitted_stops_there(monkeypatch):
    late = spline_fit.Fit.late
    monkeypatch.setattr(spline_fit.Fit, "late", lambda fit: late(fit) | (np.diff([*fit._span]) > 100))
    program = zigzag(90)
    items = (Dwell(0.1), *program.items, Dwell(0.2))
    (part,) = parts(replace(program, items=items), TOLERANCE_M)
    assert len(part.path.stops_m) == 7
    assert part.path.deviation_m < 1e-9
    assert part.dwell_s.tolist() == [0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.2]


def test_a_long_program_stops_in_a_corner_from_window_to_window():
    program = zigzag(90, 2000)
    found = list(parts(program, TOLERANCE_M))
    assert all(isinstance(part, Smooth) for part in found)
    assert sum(len(part.moves) for part in found) == 2000
    length_m = program.moves[0].segment.length_m
    between = np.rint(np.concatenate([np.diff(part.path.stops_m) for part in found]) / length_m)
    move_s = length_m / program.moves[0].feed_mps + smoothing._STOP_S
    for moves, window_s in zip(between[:-1], (2.0, 4.0, 8.0, *[16.0] * 20), strict=False):
        assert window_s - move_s < moves * move_s <= window_s


def test_lines_that_take_long_are_not_joined():
    program = lines(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.999, 1.0], [0.999, 0.999]]), feed_mps=0.01)
    found = list(parts(program, TOLERANCE_M))
    assert [len(part.moves) for part in found] == [1, 1, 2]


def test_a_single_line_stays_what_it_is():
    program = lines(np.array([[0.0, 0.0], [0.01, 0.0]]))
    assert list(parts(program, TOLERANCE_M)) == [Exact(program.items)]


def test_the_rest_of_a_path_with_corners_is_on_it():
    trajectory = plan(shapes.square(0.01, 0.0, 0.1), LIMITS, tolerance_m=TOLERANCE_M)
    (path,) = (move.segment for move in trajectory.driven)
    for from_ms in range(40, 600, 70):
        left = rest(trajectory, from_ms, 100.0).trajectory
        assert np.max(np.abs(path.point(left.path_s_m) - left.position_m)) < 1e-12
        np.testing.assert_allclose(left.knots_nm[-1], trajectory.knots_nm[-1], atol=1)


def test_a_program_of_corners_tells_its_deviation_and_is_exact_with_tolerance_0(tmp_path):
    file = tmp_path / "square.ngc"
    file.write_text(SQUARE)

    def checked(*more):
        result = CliRunner().invoke(main, ["check", str(file), "--json", *more], catch_exceptions=False)
        return json.loads(result.stdout)

    round_, exact = checked(), checked("--tolerance", "0")
    assert 1.0 < round_["path_deviation_um"] <= 10.0
    assert exact["path_deviation_um"] == 0.0
    least_s = stops_s(gcode.parse(SQUARE, "square.ngc"))
    assert round_["duration_s"] < least_s < exact["duration_s"]
