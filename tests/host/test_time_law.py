# SPDX-License-Identifier: Apache-2.0
"""The motion along smoothed paths: its limits by an independent check of the knots, its time against an optimum."""

import math
import time

import numpy as np
import pytest
from cam_paths import TURN, circle, letters, lines_and_arcs, rosette, spiral, trochoid
from knot_spline import assert_within
from time_optimum import duration_s

from kontur.experiments.bench_plan import LEAST_S, circle_curve, lines, rosette_curve, spiral_curve, trochoid_curve
from kontur.machine import MACHINES, load
from kontur.path import gcode, shapes
from kontur.path.geometry import Dwell, Program
from kontur.path.line_arc import LineArcPath
from kontur.path.smoothing import TOLERANCE_M
from kontur.planning.bounds import limits
from kontur.planning.planner import Limits, plan, positions

LIMITS = Limits()
UNEVEN = Limits((0.08, 0.2), (2.0, 8.0), (300.0, 60.0))


def smooth(program, of=LIMITS):
    return plan(program, of, tolerance_m=TOLERANCE_M)


@pytest.mark.parametrize("of", [LIMITS, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize(
    "program",
    [circle(90), circle(4000), circle(60, 0.002), rosette(244), rosette(2433), trochoid(2000), letters(30)],
    ids=["circle 90", "circle 4000", "small circle", "rosette", "rosette 2433", "trochoid", "letters"],
)
def test_all_limits_hold_for_the_spline_of_the_knots(program, of):
    assert_within(smooth(program, of), of)


@pytest.mark.parametrize(
    ("program", "name", "most"),
    [
        (circle(360), "circle r 20", 1.05),
        (circle(360, 0.004), "circle r 4", 1.05),
        (rosette(244), "rosette", 1.05),
        (rosette(545), "rosette", 1.05),
        (rosette(2433), "rosette", 1.05),
        (spiral(800), "spiral", 1.05),
        (trochoid(2000), "trochoid", 1.15),
    ],
    ids=["circle r 20", "circle r 4", "rosette 244", "rosette 545", "rosette 2433", "spiral", "trochoid"],
)
def test_a_path_of_lines_takes_little_longer_than_the_fastest_motion_along_its_curve(program, name, most):
    assert 0.99 * LEAST_S[name] < smooth(program).duration_s < most * LEAST_S[name]


@pytest.mark.parametrize(
    ("name", "curve", "turns", "cells"),
    [
        ("circle r 20", circle_curve(0.02), 1, 300),
        ("circle r 4", circle_curve(0.004), 1, 300),
        ("rosette", rosette_curve, 1, 300),
        ("spiral", spiral_curve, 3, 300),
        ("trochoid", trochoid_curve, 10, 600),
    ],
)
def test_the_least_times_of_the_bench_are_those_of_the_reference(name, curve, turns, cells):
    assert duration_s(curve, turns * TURN, 0.1, LIMITS, cells) == pytest.approx(LEAST_S[name], rel=0.004)


@pytest.mark.parametrize(("radius_m", "name"), [(0.02, "circle r 20"), (0.004, "circle r 4")])
def test_a_true_circle_stays_exact_and_takes_little_longer_than_the_fastest_motion(radius_m, name):
    trajectory = smooth(shapes.circle(radius_m, 0.1))
    assert LEAST_S[name] < trajectory.duration_s < 1.05 * LEAST_S[name]
    assert trajectory.deviation_m == 0.0
    assert np.max(np.abs(np.hypot(*trajectory.position_m.T) - radius_m)) < 1e-12
    assert_within(trajectory, LIMITS)


def test_a_circle_that_takes_long_is_planned_at_once_as_ever():
    program = shapes.circle(0.02, 0.01, laps=100)
    started = time.process_time()
    assert smooth(program).digest == plan(program, LIMITS).digest
    assert time.process_time() - started < 10.0


def test_arcs_and_lines_between_corners_keep_their_limits_and_stop_there():
    program = gcode.parse("G1 F6000 X10\nG2 X14 Y4 I0 J4\nG1 X10\nG3 X10 Y4 I-3 J0\nG4 P0.05\nG1 Y0\nX0", "p.ngc")
    trajectory = smooth(program)
    assert_within(trajectory, LIMITS)
    for corner in ((14_000_000, 4_000_000), (10_000_000, 4_000_000), (10_000_000, 0)):
        assert np.sum(np.all(trajectory.knots_nm == corner, axis=1)) >= 3
    line_arc = LineArcPath(program.moves)
    s = np.linspace(0.0, line_arc.length_m, 500)
    np.testing.assert_allclose(line_arc.point(s), positions(program.moves, s), atol=1e-12)
    for order in (1, 2, 3):
        slope = (line_arc.derivative(s + 1e-7, order - 1) - line_arc.derivative(s - 1e-7, order - 1)) / 2e-7
        away = np.min(np.abs(s[:, None] - line_arc.stops_m), axis=1) > 1e-6
        np.testing.assert_allclose(line_arc.derivative(s, order)[away], slope[away], rtol=1e-4, atol=1e-2)


def test_the_reference_knows_the_least_time_of_a_straight_line():
    def line(u, order):
        return np.stack([(u, np.ones_like(u), 0.0 * u, 0.0 * u)[order], 0.0 * u], axis=1)

    exact = 0.04 / 0.1 + 2.0 * math.sqrt(0.1 / 100.0)
    assert duration_s(line, 0.04, 0.1, LIMITS, cells=300) == pytest.approx(exact, rel=0.005)


def test_the_number_of_lines_of_a_circle_does_not_change_its_time():
    times = [smooth(circle(count)).duration_s for count in (90, 180, 360, 1000, 4000, 20_000)]
    assert max(times) < 1.03 * min(times)


def test_a_smoothed_path_starts_and_ends_at_rest_with_three_equal_knots():
    program = rosette(244)
    knots = smooth(program).knots_nm
    assert np.all(knots[:3] == np.rint(np.array(program.start_m) * 1e9))
    assert np.all(knots[-3:] == knots[-1])
    np.testing.assert_allclose(knots[-1] * 1e-9, program.moves[-1].segment.end_m, atol=0.6e-9)


def test_distance_never_falls_and_is_that_along_the_file_s_path():
    program = letters(20)
    trajectory = smooth(program)
    assert np.all(np.diff(trajectory.path_s_m) >= 0.0)
    assert trajectory.path_s_m[-1] == pytest.approx(program.length_m, rel=1e-12)


def test_a_dwell_on_a_smoothed_path_stands_still_for_its_time():
    program = rosette(244)
    half = len(program.items) // 2
    stops = Program("p", (*program.items[:half], Dwell(0.25), *program.items[half:], Dwell(0.1)), program.start_m)
    knots = smooth(stops).knots_nm
    point = np.rint(np.array(program.items[half].segment.start_m) * 1e9)
    assert 250 <= np.sum(np.all(np.abs(knots - point) <= 1, axis=1)) < 275
    assert np.sum(np.all(knots == knots[-1], axis=1)) >= 100
    assert_within(smooth(stops), LIMITS)


def test_each_move_keeps_its_feed():
    fast, slow = circle(360).moves, circle(360, feed_mps=0.03).moves
    moves = tuple(slow[i] if 120 <= i < 240 else fast[i] for i in range(360))
    trajectory = smooth(Program("p", moves, (0.02, 0.0)))
    speed = np.hypot(*np.diff(trajectory.position_m, axis=0).T) / 1e-3
    share = trajectory.path_s_m[1:] / trajectory.path_s_m[-1]
    assert np.max(speed[(share > 0.334) & (share < 0.666)]) < 0.03 * 1.002
    assert np.max(speed[(share < 0.3) | (share > 0.7)]) == pytest.approx(0.1, rel=5e-3)


def test_feeds_that_are_not_reached_are_told_with_their_limit():
    feed = smooth(rosette(244, feed_mps=0.25)).feed
    assert feed.limited > 100
    assert feed.asked_mps == 0.25
    assert smooth(circle(360, feed_mps=0.02)).feed.limited < 10


@pytest.mark.parametrize("name", ["ball_screw", "long_axis"])
def test_machines_with_a_mode_have_it_averaged_out_within_their_limits(name):
    of = limits(load(MACHINES / f"{name}.toml"))
    assert of.average_s > 0.0
    trajectory = smooth(rosette(244), of)
    assert_within(trajectory, of)
    assert trajectory.duration_s < 1.5 * smooth(rosette(244), Limits(of.velocity_mps, of.acceleration_mps2,
                                                                     of.jerk_mps3)).duration_s  # fmt: skip


def test_a_long_file_of_short_lines_is_planned_in_seconds():
    x = np.arange(20_000) * 1e-4
    row = 2 * np.floor(x / 0.16) + (x % 0.16 > 0.08)
    along = np.abs((x + 0.08) % 0.16 - 0.08)
    program = lines(np.stack([along, 5e-4 * row + 1e-3 * np.sin(300.0 * along)], axis=1), digits=6)
    started = time.process_time()
    trajectory = smooth(program)
    assert time.process_time() - started < 12.0
    assert trajectory.duration_s < 1.3 * program.length_m / 0.1


@pytest.mark.parametrize("seed", [1, 2])
def test_what_exceeds_a_limit_is_slowed_until_it_keeps_it_on_a_machine_with_a_slow_mode(seed):
    of, program = limits(load(MACHINES / "long_axis.toml")), lines_and_arcs(seed)
    assert smooth(program, of).duration_s < plan(program, of).duration_s
