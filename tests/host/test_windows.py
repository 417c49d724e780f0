# SPDX-License-Identifier: Apache-2.0
"""Planning in windows: the first knots come early, and the whole is what it would be if it were planned at once."""

import math

import numpy as np
import pytest
from cam_paths import letters, rosette
from knot_spline import assert_within

from kontur.errors import PathError
from kontur.experiments.bench_plan import lines, waves
from kontur.path import gcode, smoothing
from kontur.path.geometry import Arc, Dwell, Move, Program
from kontur.path.smoothing import TOLERANCE_M, Exact, Smooth, parts
from kontur.planning import checks, knots
from kontur.planning.planner import Limits, Planning, plan

LIMITS = Limits()


def planning(program):
    return Planning(program, LIMITS, tolerance_m=TOLERANCE_M)


def corners(count):
    """Lines of 0.1 mm that turn to and fro by more than a corner."""
    number = np.arange(count + 1)
    return lines(1e-4 * np.stack([(number + 1) // 2, number // 2], axis=1))


def test_the_first_knots_come_after_a_part_of_the_planning_and_stay_what_they_are(monkeypatch):
    monkeypatch.setattr(knots, "ROWS", 700)
    work = planning(gcode.parse(waves(10_000), "waves"))
    steps = work.steps()
    next(steps)
    nm, position, s = (column.copy() for column in work.rows.planned())
    for _ in steps:
        pass
    trajectory = work.trajectory()
    assert 500 < len(nm) < 0.3 * len(trajectory.knots_nm)
    for early, column in zip((nm, position, s), (trajectory.knots_nm, trajectory.position_m, trajectory.path_s_m),
                             strict=True):  # fmt: skip
        np.testing.assert_array_equal(early, column[: len(early)])
    at_once = np.rint(knots.control_points(trajectory.position_m) * 1e9)
    np.testing.assert_array_equal(trajectory.knots_nm, at_once)


def test_as_many_lines_are_smoothed_before_the_first_knots_whatever_the_length(monkeypatch):
    fitted, seen = smoothing.fitted, []
    monkeypatch.setattr(smoothing, "fitted", lambda *a: seen.append(a[2] - a[1][0]) or fitted(*a))
    first = []
    for count in (5000, 15_000):
        seen.clear()
        next(planning(gcode.parse(waves(count), "waves")).steps())
        first.append(tuple(seen))
    assert first[0] == first[1]
    assert sum(first[0]) < 4000


@pytest.mark.parametrize("program", [letters(12), gcode.parse(waves(5000), "waves")], ids=["letters", "waves"])
def test_windows_take_the_time_of_the_whole_and_keep_the_limits(program, monkeypatch):
    in_windows = plan(program, LIMITS, tolerance_m=TOLERANCE_M)
    monkeypatch.setattr(smoothing, "_WINDOWS_S", (1.0,))
    in_small_windows = plan(program, LIMITS, tolerance_m=TOLERANCE_M)
    monkeypatch.setattr(smoothing, "_WINDOWS_S", (1e9,))
    whole = plan(program, LIMITS, tolerance_m=TOLERANCE_M)
    assert len(list(parts(program, TOLERANCE_M))) == 1
    for trajectory, window_s in ((in_windows, 2.0), (in_small_windows, 0.5)):
        stops = 1 + whole.duration_s / window_s  # no more than these, in corners
        assert abs(trajectory.duration_s - whole.duration_s) < 0.01 * whole.duration_s + 0.03 * stops
        assert_within(trajectory, LIMITS)
        assert trajectory.deviation_m <= TOLERANCE_M


def test_a_window_has_the_motion_that_its_moves_take(monkeypatch):
    monkeypatch.setattr(smoothing, "_WINDOWS_S", (1.0, 2.0))
    found = list(parts(gcode.parse(waves(8000), "waves"), TOLERANCE_M))
    assert len(found) > 3
    assert all(isinstance(part, Smooth) for part in found)
    assert sum(len(part.moves) for part in found) == 8000


def test_a_long_exact_program_is_cut_at_its_stops():
    program = corners(50_000)
    found = list(parts(program, 0.0))
    assert len(found) == 3
    assert all(isinstance(part, Exact) for part in found)
    assert tuple(move for part in found for move in part.moves) == program.moves


def tangent_arcs(count):
    """A row of arcs that go on from one another without a corner, left, right, right, left."""
    moves, x, y, heading, radius = [], 0.0, 0.0, 0.0, 2e-3
    for i in range(count):
        sweep = 0.05 * (1, -1, -1, 1)[i % 4]
        toward = math.copysign(radius, sweep) * np.array([-math.sin(heading), math.cos(heading)])
        arc = Arc((x + toward[0], y + toward[1]), radius, math.atan2(-toward[1], -toward[0]), sweep)
        moves.append(Move(arc, 0.1))
        (x, y), heading = arc.point(np.array([arc.length_m]))[0].tolist(), heading + sweep
    return Program("p", tuple(moves), (0.0, 0.0))


def test_tangent_arcs_are_exact_unless_they_are_too_many_to_be_planned_at_once(monkeypatch):
    program = tangent_arcs(6000)
    (whole,) = parts(program, TOLERANCE_M)
    assert isinstance(whole, Exact)
    monkeypatch.setattr("kontur.path.smoothing._MOVES", 100)
    planning = Planning(program, LIMITS, tolerance_m=TOLERANCE_M)
    steps = planning.steps()
    while not planning.rows.count:
        next(steps)
    assert planning.rows.planned()[2][-1] < 0.5 * planning.length_m
    for _ in steps:
        pass
    trajectory = planning.trajectory()
    assert 0.0 < trajectory.deviation_m <= TOLERANCE_M
    exact = plan(program, LIMITS)
    assert not exact.is_smoothed
    assert trajectory.duration_s < exact.duration_s


def test_arcs_between_corners_begin_with_a_short_window_in_a_long_program(monkeypatch):
    text = "F6000 G1\n" + "".join(f"G2 X{(i + 1) / 10} I0.05\n" for i in range(400))
    program = gcode.parse(text, "p.ngc")
    assert len(next(parts(program, TOLERANCE_M)).moves) > 200
    monkeypatch.setattr("kontur.path.smoothing._MOVES", 399)
    sizes = [len(part.moves) for part in parts(program, TOLERANCE_M)]
    assert sum(sizes) == 400
    assert sizes[0] < 0.6 * sizes[1] < sizes[1] < 0.6 * sizes[2]


def test_dwells_are_kept_where_windows_meet(monkeypatch):
    monkeypatch.setattr(smoothing, "_WINDOWS_S", (0.5,))
    moves = rosette(244).moves
    items = (Dwell(0.1), *moves[:100], Dwell(0.25), *moves[100:200], Dwell(0.3), *moves[200:], Dwell(0.4))
    found = list(parts(Program("p", items, moves[0].segment.start_m), TOLERANCE_M))
    assert len(found) > 1
    assert sum(float(np.sum(part.dwell_s)) for part in found) == pytest.approx(1.05)


def test_a_smoothed_program_that_takes_too_long_is_refused_at_its_last_part(monkeypatch):
    monkeypatch.setattr(checks, "DURATION_MAX_S", 1.9)  # less than what it takes, and more than at its feed
    with pytest.raises(PathError, match="it takes"):
        plan(rosette(244), LIMITS, tolerance_m=TOLERANCE_M)


def test_what_is_known_before_is_refused_before_the_first_step():
    program = gcode.parse(waves(2000), "waves")
    with pytest.raises(PathError, match="outside the travel"):
        Planning(program, LIMITS, None, ((-1e-3, 1e-3), (-1.0, 1.0)), TOLERANCE_M)
