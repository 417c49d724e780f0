# SPDX-License-Identifier: Apache-2.0
"""Windows of a stretch without stops: the motion goes on where they meet, or stops where it cannot."""

import itertools

import numpy as np
import pytest
from cam_paths import TURN, letters
from knot_spline import assert_within

from kontur.experiments.bench_plan import of_curve, rosette_curve, spiral_lines
from kontur.path import gcode, smoothing
from kontur.path.geometry import Dwell, Program
from kontur.path.smoothing import TOLERANCE_M, Exact, Smooth, parts
from kontur.planning import joined
from kontur.planning.planner import Limits, Planning, plan

LIMITS = Limits()
UNEVEN = Limits((0.08, 0.2), (2.0, 8.0), (300.0, 60.0))
ROSETTE = of_curve(rosette_curve, 2.0 * TURN, 1000)  # 3.9 s


def planned(program, windows_s, monkeypatch, of=LIMITS):
    monkeypatch.setattr(smoothing, "_WINDOWS_S", windows_s)
    return plan(program, of, tolerance_m=TOLERANCE_M)


def rests(trajectory):
    """How often it stands still between its ends."""
    still = np.all(np.diff(trajectory.knots_nm, axis=0) == 0, axis=1)
    return int(np.sum(np.diff(still.astype(int)) == 1)) - 1


@pytest.mark.parametrize("of", [LIMITS, UNEVEN], ids=["even", "uneven"])
def test_the_motion_goes_on_where_windows_meet_and_takes_the_time_of_the_whole(of, monkeypatch):
    windows = planned(ROSETTE, (1.0,), monkeypatch, of)
    assert len(windows.driven) > 2
    whole = planned(ROSETTE, (1e9,), monkeypatch, of)
    assert len(whole.driven) == 1
    assert windows.duration_s == pytest.approx(whole.duration_s, rel=0.005)
    assert rests(windows) == rests(whole) == 0
    assert_within(windows, of)
    assert windows.deviation_m <= TOLERANCE_M
    assert windows.path_s_m[-1] == pytest.approx(ROSETTE.length_m, rel=1e-12)
    np.testing.assert_allclose(windows.position_m[-1], ROSETTE.moves[-1].segment.end_m, atol=1e-12)


def test_the_curves_of_windows_meet_with_four_derivatives(monkeypatch):
    curves = [move.segment for move in planned(ROSETTE, (1.0,), monkeypatch).driven]
    for one, other in itertools.pairwise(curves):
        for order in range(5):
            end, start = one.derivative(np.array([one.length_m]), order), other.derivative(np.zeros(1), order)
            np.testing.assert_allclose(end, start, rtol=1e-6, atol=1e-9 * 1e3**order)


def test_as_many_lines_are_smoothed_before_the_first_knots_of_one_stretch_whatever_its_length(monkeypatch):
    fitted, seen = smoothing.fitted, []
    monkeypatch.setattr(smoothing, "fitted", lambda *a: seen.append(a[2] - a[1][0]) or fitted(*a))
    first = []
    for count in (26_000, 40_000):
        seen.clear()
        work = Planning(gcode.parse(spiral_lines(count), "spiral"), LIMITS, tolerance_m=TOLERANCE_M)
        for _ in work.steps():
            if work.rows.count > 500:
                break
        first.append(tuple(seen))
    assert first[0] == first[1]
    assert sum(first[0]) < 6000


def test_where_nothing_fits_the_motion_stops_between_the_windows(monkeypatch):
    monkeypatch.setattr(joined.time_law, "excess", lambda *a: 2.0)
    trajectory = planned(ROSETTE, (1.0,), monkeypatch)
    assert rests(trajectory) == len(trajectory.driven) - 1 > 1
    assert_within(trajectory, LIMITS)


def failing(monkeypatch, fails):
    """Let the fits whose numbers are in `fails` fail; returns what they were called with."""
    fitted, calls = smoothing.fitted, []

    def counted(*a):
        calls.append((a[1], a[5]))
        fit, good = fitted(*a)
        return fit, good & (len(calls) - 1 not in fails)

    monkeypatch.setattr(smoothing, "fitted", counted)
    monkeypatch.setattr(smoothing, "_WINDOWS_S", (1.0,))
    return calls


def test_a_window_that_is_not_within_the_tolerance_gets_a_closer_curve(monkeypatch):
    calls = failing(monkeypatch, {1})
    trajectory = plan(ROSETTE, LIMITS, tolerance_m=TOLERANCE_M)
    assert calls[1][0] == calls[2][0]
    assert [spacing for _, spacing in calls[:4]] == [1.0, 1.0, 0.5, 1.0]
    assert_within(trajectory, LIMITS)
    assert rests(trajectory) == 0


def test_a_first_window_without_a_curve_stays_exact(monkeypatch):
    failing(monkeypatch, {0, 1, 2, 3})
    found = list(parts(ROSETTE, TOLERANCE_M))
    assert [type(part) for part in found[:3]] == [Exact, Smooth, Smooth]
    assert [part.continues for part in found[1:3]] == [False, True]
    assert tuple(move for part in found for move in part.moves) == ROSETTE.moves
    trajectory = plan(ROSETTE, LIMITS, tolerance_m=TOLERANCE_M)
    assert_within(trajectory, LIMITS)


def test_a_later_window_without_a_curve_begins_where_the_one_before_was_fitted_to(monkeypatch):
    """It was refused, though each of its corners may be a stop: 5 of 1,100 random programs."""
    failing(monkeypatch, {1, 2, 3, 4})
    found = list(parts(ROSETTE, TOLERANCE_M))
    assert [type(part) for part in found[:3]] == [Smooth, Smooth, Smooth]
    assert [(part.continues, part.goes_on) for part in found[:2]] == [(False, True), (True, False)]
    assert not found[2].continues
    assert tuple(move for part in found for move in part.moves) == ROSETTE.moves
    one, other = (part.path for part in found[:2])
    for order in range(5):
        end, start = one.derivative(np.array([one.length_m]), order), other.derivative(np.zeros(1), order)
        np.testing.assert_allclose(end, start, rtol=1e-6, atol=1e-9 * 1e3**order)
    failing(monkeypatch, {1, 2, 3, 4})
    trajectory = plan(ROSETTE, LIMITS, tolerance_m=TOLERANCE_M)
    assert_within(trajectory, LIMITS)
    assert rests(trajectory) == 1
    assert trajectory.path_s_m[-1] == pytest.approx(ROSETTE.length_m, rel=1e-12)
    assert trajectory.deviation_m <= TOLERANCE_M


def test_dwells_around_a_long_stretch_and_stretches_beside_it_are_kept(monkeypatch):
    corner = letters(2).moves
    x, y = corner[-1].segment.end_m[0] - ROSETTE.start_m[0], corner[-1].segment.end_m[1] - ROSETTE.start_m[1]
    away = of_curve(lambda u, order: rosette_curve(u, order) + np.array([x, y]), 2.0 * TURN, 1000).moves
    gap = smoothing.replace(away[0], segment=type(away[0].segment)(corner[-1].segment.end_m, away[0].segment.end_m))
    items = (Dwell(0.1), *corner, Dwell(0.2), gap, *away[1:], Dwell(0.3))
    program = Program("p", items, corner[0].segment.start_m)
    monkeypatch.setattr(smoothing, "_WINDOWS_S", (1.0,))
    found = list(parts(program, TOLERANCE_M))
    assert sum(float(np.sum(part.dwell_s)) for part in found) == pytest.approx(0.6)
    trajectory = plan(program, LIMITS, tolerance_m=TOLERANCE_M)
    assert_within(trajectory, LIMITS)
    still = np.all(np.diff(trajectory.knots_nm, axis=0) == 0, axis=1)
    assert np.all(still[:100])
    assert np.all(still[-300:])
