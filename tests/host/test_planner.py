# SPDX-License-Identifier: Apache-2.0
"""Planned motion, measured on SciPy's spline of the knots as they go over the wire, against values worked out here."""

import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from knot_spline import spline
from scipy.signal import TransferFunction, lsim

from kontur.errors import PathError
from kontur.machine import MACHINES, load
from kontur.path import csv, gcode, shapes
from kontur.path.geometry import Arc, Dwell, Line, Move, Program
from kontur.planning import planner
from kontur.planning.bounds import limits
from kontur.planning.planner import Limits, PlannerError, plan

EXAMPLES = Path(__file__).parents[2] / "examples"
LIMITS = Limits()
V, A, J = 0.3, 5.0, 100.0  # of LIMITS, both axes
ROUNDING = np.array([0.5e-6, 2e-3, 4.0])  # what knots rounded to 1 nm can add: m/s, m/s2, m/s3


def line(length_m, feed_mps=0.1, angle_rad=0.0):
    end = (length_m * math.cos(angle_rad), length_m * math.sin(angle_rad))
    return Program("line", (Move(Line((0.0, 0.0), end), feed_mps),), (0.0, 0.0))


def ngc(text):
    return gcode.parse(text, "p.ngc")


def derivatives(trajectory, per_knot=4):
    """Speed, acceleration (n, 2) in SI units at knots and between, jerk in the middle of each interval."""
    curve = spline(trajectory.knots_nm * 1e-9)
    t = np.arange(0, (len(trajectory.knots_nm) - 1) * per_knot + 1) / per_knot
    middle = np.arange(len(trajectory.knots_nm) - 1) + 0.5
    return curve(t, 1) * 1e3, curve(t, 2) * 1e6, curve(middle, 3) * 1e9


def assert_within(trajectory, limits, jerk=True):
    for values, limit, slack in zip(
        derivatives(trajectory)[: 3 if jerk else 2],
        (limits.velocity_mps, limits.acceleration_mps2, limits.jerk_mps3),
        ROUNDING,
        strict=False,
    ):
        assert np.all(np.abs(values) <= np.array(limit) * (1.0 + 1e-6) + slack)


# --- simple moves -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("length", "feed", "optimum"),
    [
        (0.400, 0.3, 0.400 / V + V / A + A / J),  # all seven phases
        (0.020, 0.1, 0.020 / 0.1 + 2 * math.sqrt(0.1 / J)),  # the acceleration limit is not reached
        (0.001, 0.1, 4 * (0.001 / (2 * J)) ** (1 / 3)),  # nor the feed
    ],
)
def test_a_straight_move_takes_little_longer_than_the_fastest_s_curve(length, feed, optimum):
    assert optimum < plan(line(length, feed), LIMITS).duration_s < 1.03 * optimum + 0.005


def test_a_straight_move_uses_its_limits_and_keeps_them_after_rounding():
    speed, acceleration, jerk = derivatives(plan(line(0.4, math.inf), LIMITS))
    assert 0.995 * V < np.max(speed[:, 0]) < V
    assert 0.97 * A < np.max(np.abs(acceleration[:, 0])) < A
    assert 0.93 * J < np.max(np.abs(jerk[:, 0])) < J


def test_each_axis_has_limits_of_its_own_and_a_slanted_move_uses_both():
    limits = Limits((0.3, 0.1), (5.0, 2.0), (100.0, 50.0))
    trajectory = plan(line(0.4, math.inf, math.atan2(1, 3)), limits)  # x three times as fast as y
    speed, acceleration, _ = derivatives(trajectory)
    assert np.max(speed, axis=0) == pytest.approx([0.3, 0.1], rel=2e-3)
    assert np.max(acceleration, axis=0) == pytest.approx([4.9, 4.9 / 3], rel=2e-3)
    assert_within(trajectory, limits)


def test_a_path_starts_and_ends_at_rest_with_three_equal_knots():
    for program in (line(0.02), shapes.circle(0.004, 0.1), ngc((EXAMPLES / "part.ngc").read_text())):
        trajectory = plan(program, LIMITS)
        start = np.rint(np.array(program.start_m) * 1e9)
        assert np.all(trajectory.knots_nm[:3] == start)
        assert np.all(trajectory.knots_nm[-3:] == trajectory.knots_nm[-1])
        end = program.moves[-1].segment.point(np.array([program.moves[-1].segment.length_m]))[0]
        np.testing.assert_allclose(trajectory.knots_nm[-1] * 1e-9, end, atol=0.5e-9)


# --- circles ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("radius", "feed"), [(0.004, 0.004488), (0.020, 0.1), (0.004, 0.1), (0.004, 0.0862)])
def test_a_circle_reaches_its_feed_exactly_and_holds_it(radius, feed):
    trajectory = plan(shapes.circle(radius, feed, duration_s=2.0), LIMITS)
    speed = np.diff(trajectory.path_s_m) / 1e-3
    steady = speed[300:-300]
    assert np.max(np.abs(steady / feed - 1.0)) < 1e-6
    assert np.max(speed) < feed * (1.0 + 1e-9)
    assert_within(trajectory, LIMITS)


def test_the_paper_s_fast_tight_circle_is_up_to_speed_before_it_is_scored():
    trajectory = plan(shapes.circle(0.004, 0.1, duration_s=2.0), LIMITS)
    reached = np.argmax(np.diff(trajectory.path_s_m) > 0.1e-3 * (1.0 - 1e-9))
    assert reached < 250


def test_the_spline_stays_on_the_circle_between_its_samples_too():
    knots = plan(shapes.circle(0.004, 0.1, duration_s=1.0), LIMITS).knots_nm
    radius = np.hypot(*spline(knots)(np.linspace(0, len(knots) - 1, 20_000)).T)
    assert np.max(np.abs(radius - 4e6)) < 2.0  # nm


def test_the_spline_passes_its_samples_to_a_nanometre_and_they_are_on_the_path():
    trajectory = plan(shapes.ellipse(0.030, 0.010, 0.2), LIMITS)
    knots = trajectory.knots_nm
    off_nm = spline(knots)(np.arange(len(knots))) - trajectory.position_m * 1e9
    assert np.max(np.abs(off_nm)) <= 1.0
    x, y = trajectory.position_m.T
    assert np.max(np.abs(np.hypot(x / 0.030, y / 0.010) - 1.0)) < 1e-10
    (move,) = trajectory.program.moves
    np.testing.assert_allclose(move.segment.point(trajectory.path_s_m), trajectory.position_m, atol=1e-12)


# --- corners and jumps of curvature -----------------------------------------------------------------------------------


def test_the_motion_stops_exactly_at_corners():
    trajectory = plan(ngc("G1 X10 F3000\nY7\nG3 X3 Y14 R7\nG1 X0 Y0"), LIMITS)
    knots = trajectory.knots_nm
    speed, acceleration, _ = derivatives(trajectory, per_knot=1)
    for corner in ((10_000_000, 0), (3_000_000, 14_000_000)):
        there = np.flatnonzero(np.all(knots == corner, axis=1))
        assert len(there) >= 3
        assert np.all(np.diff(there) == 1)
        middle = there[1]
        assert np.all(speed[middle] == 0.0)
        assert np.max(np.abs(acceleration[middle])) < 1e-9
    tangent = np.argmin(np.hypot(*(knots - [10_000_000, 7_000_000]).T))
    assert np.hypot(*speed[tangent]) > 0.02


def test_a_change_of_direction_is_a_corner_from_two_milliradians_on():
    def slowest(turn):
        end = (0.02 + 0.02 * math.cos(turn), 0.02 * math.sin(turn))
        moves = (Move(Line((0.0, 0.0), (0.02, 0.0)), 0.05, line=1), Move(Line((0.02, 0.0), end), 0.05, line=2))
        speed = np.diff(plan(Program("bend", moves, (0.0, 0.0)), LIMITS).path_s_m) / 1e-3
        return np.min(speed[100:-100])

    assert slowest(0.0) == pytest.approx(0.05, rel=1e-9)
    assert slowest(1.9e-3) == pytest.approx(0.05, rel=1e-9)
    assert slowest(2.1e-3) < 0.001


@pytest.mark.parametrize(("radius_mm", "step"), [(2.0, 1.0), (10.0, 1.0), (10.0, 0.1)])
def test_speed_at_a_jump_of_curvature_is_limited_by_the_step_of_acceleration(radius_mm, step):
    limits = Limits(centripetal_step_mps2=step)
    program = ngc(f"G1 X40 F18000\nG3 Y{2 * radius_mm} J{radius_mm}\nG1 X0")
    trajectory = plan(program, limits)
    speed = np.gradient(trajectory.path_s_m, 1e-3)
    for jump in (0.040, 0.040 + math.pi * radius_mm * 1e-3):
        at_jump = speed[np.argmin(np.abs(trajectory.path_s_m - jump))]
        assert at_jump**2 / (radius_mm * 1e-3) == pytest.approx(step, rel=0.02)


def test_a_rounded_square_keeps_its_feed_where_the_limits_allow_it():
    speed = np.diff(plan(shapes.square(0.040, 0.005, 0.05), LIMITS).path_s_m) / 1e-3
    assert np.all(speed[100:-100] == pytest.approx(0.05, rel=1e-9))


def test_a_lower_feed_is_reached_where_its_move_begins():
    trajectory = plan(ngc("G1 X20 F6000\nX40 F1200\nX60 F6000"), LIMITS)
    speed = np.gradient(trajectory.path_s_m, 1e-3)
    slow = (trajectory.path_s_m > 0.02001) & (trajectory.path_s_m < 0.03999)
    assert np.max(speed[slow]) < 0.02 * (1 + 1e-3)
    assert np.max(speed) == pytest.approx(0.1, rel=1e-9)


# --- limits, whatever the path ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("feed", [0.05, 0.3])
@pytest.mark.parametrize("shape", ["ellipse", "flat ellipse", "eight", "spiral", "points"])
def test_curves_keep_all_limits(shape, feed):
    program = {
        "ellipse": lambda: shapes.ellipse(0.030, 0.010, feed),
        "flat ellipse": lambda: shapes.ellipse(0.050, 0.001, feed),
        "eight": lambda: shapes.eight(0.040, feed, laps=2),
        "spiral": lambda: shapes.spiral(0.0, 0.020, 0.005, feed),
        "points": lambda: csv.parse((EXAMPLES / "points.csv").read_text(), "points.csv", feed),
    }[shape]()
    trajectory = plan(program, LIMITS)
    assert_within(trajectory, LIMITS)
    if shape == "ellipse":  # slow enough in the flat parts for the tight ends, not all the way
        speed = np.diff(trajectory.path_s_m) / 1e-3
        assert np.max(speed) > min(feed * 0.999, 0.15)


def test_points_with_the_noise_of_measured_ones_keep_all_limits():
    u = np.linspace(0.0, 6.0, 343)
    points = 2.7 * np.stack([np.cos(u), np.sin(u)], axis=1) + np.random.default_rng(3).normal(0.0, 1e-4, (343, 2))  # mm
    text = "x,y\n" + "\n".join(f"{x:.6f},{y:.6f}" for x, y in points)
    trajectory = plan(csv.parse(text, "p.csv", 0.3), LIMITS)
    assert_within(trajectory, LIMITS)
    assert np.max(np.diff(trajectory.path_s_m)) > 0.01e-3


@st.composite
def programs(draw):
    """Lines, arcs, small kinks, sharp corners and dwells, connected."""
    here, heading, items = (0.0, 0.0), 0.0, []
    for number in range(draw(st.integers(1, 8))):
        heading += draw(st.sampled_from([0.0, 0.0, 1e-4, -1.5e-3, 0.3, -2.0]))
        feed = draw(st.sampled_from([0.002, 0.02, 0.1, math.inf]))
        size = 10 ** draw(st.floats(-5.0, -1.2))
        if draw(st.booleans()):
            end = (here[0] + size * math.cos(heading), here[1] + size * math.sin(heading))
            segment = Line(here, end)
        else:
            sweep = draw(st.sampled_from([-4.0, -1.0, -0.05, 0.05, 1.0, 4.0]))
            radius, side = max(size, 1e-4), math.copysign(1.0, sweep)
            center = (here[0] - side * radius * math.sin(heading), here[1] + side * radius * math.cos(heading))
            segment = Arc(center, radius, heading - side * math.pi / 2, sweep)
            end = tuple(segment.point(np.array([segment.length_m]))[0])
            heading += sweep
        items.append(Move(segment, feed, math.isinf(feed), number))
        here = end
        if draw(st.integers(0, 9)) == 0:
            items.append(Dwell(0.0123, number))
    return Program("random", tuple(items), (0.0, 0.0))


@settings(max_examples=60)
@given(programs(), st.sampled_from([LIMITS, Limits((0.05, 0.2), (2.0, 8.0), (300.0, 60.0), 0.3)]))
def test_random_programs_keep_velocity_and_acceleration_at_every_knot_and_end_where_they_should(program, limits):
    trajectory = plan(program, limits)
    speed, acceleration, _ = derivatives(trajectory, per_knot=1)
    assert np.all(np.abs(speed) <= np.array(limits.velocity_mps) + ROUNDING[0])
    assert np.all(np.abs(acceleration) <= np.array(limits.acceleration_mps2) + ROUNDING[1])
    assert np.all(np.diff(trajectory.path_s_m) >= 0.0)
    assert trajectory.path_s_m[-1] == pytest.approx(program.length_m, rel=1e-12)
    last = program.moves[-1].segment
    np.testing.assert_allclose(trajectory.position_m[-1], last.point(np.array([last.length_m]))[0], atol=1e-11)


def test_a_motion_out_of_limits_is_a_defect_that_is_caught_before_anything_is_sent(monkeypatch):
    monkeypatch.setattr(planner, "planned", lambda limits: Limits((0.4, 0.4), (9.0, 9.0), (100.0, 100.0)))
    with pytest.raises(PlannerError, match=r"velocity of axis x is 1\.33.* of its limit"):
        plan(line(0.5, math.inf), LIMITS)


# --- dwells, files with a time law ------------------------------------------------------------------------------------


def test_a_dwell_stands_still_for_its_time_wherever_it_is():
    plain = plan(ngc("G1 X10 F3000\nX20"), LIMITS).duration_s
    for text in ("G4 P0.25\nG1 X10 F3000\nX20", "G1 X10 F3000\nX20\nG4 P0.25"):
        assert plan(ngc(text), LIMITS).duration_s == pytest.approx(plain + 0.25, abs=1e-9)
    trajectory = plan(ngc("G1 X10 F3000\nG4 P0.25\nX20"), LIMITS)
    assert np.sum(trajectory.knots_nm[:, 0] == 10_000_000) == pytest.approx(253, abs=1)


def test_a_timed_table_is_followed_at_its_times():
    trajectory = plan(csv.parse((EXAMPLES / "timed.csv").read_text(), "timed.csv"), LIMITS)
    tau = np.linspace(0.0, 1.0, 2001)
    angle = 2 * np.pi * (10 * tau**3 - 15 * tau**4 + 6 * tau**5)
    expected = 1e-3 * np.stack([20 * np.cos(angle), 12 * np.sin(angle)], axis=1)
    np.testing.assert_allclose(trajectory.position_m[16:-16], expected, atol=1e-7)
    assert np.all(trajectory.knots_nm[:3] == [20_000_000, 0])
    np.testing.assert_allclose(
        np.cumsum(np.hypot(*np.diff(trajectory.position_m, axis=0).T)), trajectory.path_s_m[1:], atol=1e-6
    )


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("0,0,0\n1,1,0\n1.02,11,0\n2.02,12,0", "t.csv:3: 1.010 s after its start the velocity in x is 0.50"),
        ("0,0,0\n0.01,1,2\n0.02,2,4\n0.03,3,6", "t.csv:2: 0.001 s after its start the acceleration in y is 7"),
    ],
)
def test_a_timed_table_beyond_the_limits_is_refused_by_its_line(rows, message):
    with pytest.raises(PathError) as caught:
        plan(csv.parse("t,x,y\n" + rows, "t.csv"), LIMITS)
    assert message in str(caught.value)


# --- what is refused --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("G1 X10 F1000\nY61", "p.ngc:2: the path reaches y = 61.000 mm, outside the travel of -60.000 .. 60.000 mm"),
        ("G1 X-55 F1000\nG2 Y20 R10", "p.ngc:2: the path reaches x = -65.000 mm"),
        ("G1 X55 F1000\nG2 Y20 R10", None),
        ("G1 Y55 F1000\nG3 X-20 R10", "p.ngc:2: the path reaches y = 65.000 mm"),
        ("G0 X60 Y-60", None),
    ],
)
def test_a_path_outside_the_travel_is_refused_with_line_and_coordinate(text, message):
    travel = ((-0.06, 0.06), (-0.06, 0.06))
    if message is None:
        plan(ngc(text), LIMITS, travel_m=travel)
        return
    with pytest.raises(PathError) as caught:
        plan(ngc(text), LIMITS, travel_m=travel)
    assert message in str(caught.value)


def test_a_timed_table_outside_the_travel_is_refused_with_its_line():
    rows = "t,x,y\n0,0,0\n1,20,0\n2,40,0\n3,0,0"
    with pytest.raises(PathError, match=r"t\.csv:[34]: the path reaches x = 4\d\."):
        plan(csv.parse(rows, "t.csv"), LIMITS, travel_m=((-0.03, 0.03), (-0.03, 0.03)))


def test_a_curve_outside_the_travel_is_refused():
    with pytest.raises(PathError, match=r"ellipse: the path reaches y = 10\.000 mm"):
        plan(shapes.ellipse(0.03, 0.01, 0.05), LIMITS, travel_m=((-0.06, 0.06), (-0.06, 0.0099)))


@pytest.mark.parametrize(
    ("program", "message"),
    [
        (lambda: Program("empty", (), (0.0, 0.0)), "empty: there is no motion in it"),
        (lambda: Program("p", (Dwell(1.0),), (0.0, 0.0)), "p: there is no motion in it"),
        (lambda: line(0.01, 1e-7), "line: it takes 27.8 h; at most 1 h can be planned"),
        (lambda: ngc("G1 X1 F100\nG4 P99999"), "p.ngc: it takes 27.8 h"),
        (lambda: line(0.01, 0.0), "line: a move needs a length and a feed above zero"),
        (lambda: line(2.5), "line: the path reaches x = 2500.000 mm"),
        (lambda: Program("p", line(0.01).items, (0.001, 0.0)), "p: the move starts 1.000000 mm from where"),
        (
            lambda: csv.parse("x,y\n0,0\n10,0\n0,0", "c.csv", 0.05),
            "c.csv: the curve bends with less than",
        ),
    ],
)
def test_a_program_that_cannot_be_planned_is_refused(program, message):
    with pytest.raises(PathError) as caught:
        plan(program(), LIMITS)
    assert message in str(caught.value)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_limits_must_be_positive_numbers(value):
    with pytest.raises(PathError, match="limit acceleration_mps2 is"):
        Limits(acceleration_mps2=(5.0, value))


# --- the whole --------------------------------------------------------------------------------------------------------


def test_the_example_part_takes_between_twelve_and_twenty_seconds():
    trajectory = plan(gcode.parse((EXAMPLES / "part.ngc").read_text(), "part.ngc"), LIMITS)
    assert 12.0 < trajectory.duration_s < 20.0
    assert_within(trajectory, LIMITS, jerk=False)


def test_planning_twice_gives_the_same_knots_and_another_feed_gives_others():
    first, again, other = (plan(shapes.circle(0.01, feed), LIMITS) for feed in (0.05, 0.05, 0.051))
    assert first.digest == again.digest != other.digest


def test_ten_thousand_lines_are_planned_in_seconds_with_progress():
    random = np.random.default_rng(1)
    points = np.cumsum(random.uniform(-1.0, 1.0, (10_000, 2)), axis=0) * 0.2
    text = "G21 G90 F3000\n" + "\n".join(f"G1 X{x:.3f} Y{y:.3f}" for x, y in points)
    shares = []
    started = time.process_time()
    trajectory = plan(ngc(text), LIMITS, shares.append)
    assert time.process_time() - started < 15.0
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert len(shares) > 20
    np.testing.assert_allclose(trajectory.knots_nm[-1], np.rint(points[-1] * 1e3) * 1e3, atol=1)


# --- averaged over the period of a mode -------------------------------------------------------------------------------

MODE_HZ = 50.0
AVERAGED = Limits(average_s=1.0 / MODE_HZ)
CORNER = "G21 G90 G0 X0 Y0\nF6000\nG1 X20\nG1 Y20\nG2 X30 Y30 I10 J0\nM2\n"


def ringing_m(trajectory):
    """Largest deflection of an undamped mode of MODE_HZ behind x, after the motion has ended."""
    omega = 2.0 * math.pi * MODE_HZ
    at_rest = np.pad(trajectory.knots_nm[:, 0] * 1e-9, (0, 200), mode="edge")
    acceleration = np.diff(at_rest, 2) / 1e-6
    t = np.arange(len(acceleration)) * 1e-3
    _, deflection, _ = lsim(TransferFunction([-1.0], [1.0, 0.0, omega**2]), acceleration, t, interp=True)
    return float(np.max(np.abs(deflection[-150:])))


@pytest.mark.parametrize(("length", "feed"), [(0.002, 0.1), (0.02, 0.07), (0.2, 0.09)])
def test_an_average_over_its_period_leaves_a_mode_at_rest(length, feed):
    plain, averaged = plan(line(length, feed), LIMITS), plan(line(length, feed), AVERAGED)
    assert ringing_m(plain) > 1e-6
    assert ringing_m(averaged) < 3e-9  # knots are rounded to 1 nm


def test_an_averaged_path_is_the_same_path_and_keeps_the_limits():
    program = shapes.circle(0.004, 0.1, laps=3)
    averaged = plan(program, AVERAGED)
    radius = np.linalg.norm(averaged.position_m, axis=1)
    assert np.max(np.abs(radius - 0.004)) < 1e-12
    assert averaged.path_s_m[-1] == pytest.approx(3 * 2.0 * math.pi * 0.004, rel=1e-12)
    assert_within(averaged, AVERAGED)


def test_an_averaged_motion_still_stops_at_corners():
    averaged = plan(ngc(CORNER), AVERAGED)
    curve = spline(averaged.knots_nm * 1e-9)
    t = np.arange(len(averaged.knots_nm))
    at_corner = np.linalg.norm(curve(t) - np.array([0.02, 0.0]), axis=1) < 2e-9
    assert np.any(at_corner & (np.linalg.norm(curve(t, 1), axis=1) < 2e-9))  # m/ms: rounding
    assert np.all(np.diff(averaged.path_s_m) >= 0.0)


def test_the_average_is_one_period_of_the_table_behind_a_motor_that_is_held():
    machine = load(MACHINES / "long_axis.toml")
    swing_Hz = {}
    for name, axis in (("x", machine.x), ("y", machine.y)):
        motor, table = axis.mass_kg * axis.motor_share, axis.mass_kg * (1.0 - axis.motor_share)
        stiffness = (2.0 * math.pi * axis.resonance_Hz) ** 2 * motor * table / (motor + table)
        swing_Hz[name] = math.sqrt(stiffness / table) / (2.0 * math.pi)
    assert limits(machine).average_s == math.ceil(1e3 / min(swing_Hz.values())) * 1e-3
    at_table = replace(machine, x=replace(machine.x, encoder_at="table"), y=replace(machine.y, encoder_at="table"))
    assert limits(at_table).average_s == math.ceil(1e3 / min(a.resonance_Hz for a in machine.axes)) * 1e-3
    assert limits(load()).average_s == 0.0


def test_a_negative_average_is_refused():
    with pytest.raises(PathError, match="average_s is -1"):
        Limits(average_s=-1.0)
