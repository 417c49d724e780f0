# SPDX-License-Identifier: Apache-2.0
"""Truth scoring against distances known by construction and against dense or general-purpose searches of the path."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from kontur.errors import PathError
from kontur.path.geometry import Arc, Curve, Dwell, Line, Move, Program
from kontur.runs.scoring import Rapids, Scorer, contour_error

Array = NDArray[np.float64]
UM = 1e-6
MM = 1e-3


def program(*segments: Line | Arc | Curve) -> Program:
    start = segments[0].point(np.zeros(1))[0]
    return Program("test", tuple(Move(segment, 0.1) for segment in segments), (float(start[0]), float(start[1])))


def polyline(*points_mm: tuple[float, float]) -> Program:
    points = [(x * MM, y * MM) for x, y in points_mm]
    return program(*(Line(a, b) for a, b in pairwise(points)))


def error_at(path: Program, x_mm: float, y_mm: float, path_s_mm: float) -> tuple[float, float, float]:
    """Normal, tangential in um and foot position in mm of one point."""
    error = contour_error(path, np.array([[x_mm, y_mm]]) * MM, np.array([path_s_mm]) * MM)
    return error.normal_m[0] / UM, error.tangential_m[0] / UM, error.foot_s_m[0] / MM


def ellipse(a_m: float, b_m: float, first_u: float = 0.0) -> Curve:
    def formula(u: Array, order: int) -> Array:
        phase = np.asarray(u) + 0.5 * math.pi * order  # each derivative turns the phase by a quarter
        return np.stack([a_m * np.cos(phase), b_m * np.sin(phase)], axis=1)

    return Curve(formula, first_u + np.array([0.0, 2.0 * math.pi]))


def test_error_beside_a_line_is_positive_on_the_left_and_lag_is_negative() -> None:
    path = polyline((0, 0), (30, 40))
    left = (-0.8, 0.6)
    assert error_at(path, 3 + 0.005 * left[0], 4 + 0.005 * left[1], 5.002) == pytest.approx((5.0, -2.0, 5.0), abs=1e-8)
    assert error_at(path, 3 - 0.005 * left[0], 4 - 0.005 * left[1], 4.999) == pytest.approx((-5.0, 1.0, 5.0), abs=1e-8)


@pytest.mark.parametrize(("sweep", "left_is"), [(2 * math.pi, "inside"), (-2 * math.pi, "outside")])
def test_error_beside_an_arc_is_the_difference_of_radii(sweep: float, left_is: str) -> None:
    angle = np.linspace(0.0, 2 * math.pi, 37)[1:-1]
    radius = 4.003 * MM if left_is == "outside" else 3.997 * MM
    q = radius * np.stack([np.cos(angle), math.copysign(1.0, sweep) * np.sin(angle)], axis=1)
    error = contour_error(program(Arc((0.0, 0.0), 4 * MM, 0.0, sweep)), q, 4 * MM * angle + 7 * UM)
    np.testing.assert_allclose(error.normal_m, 3 * UM, rtol=0, atol=1e-16)
    np.testing.assert_allclose(error.tangential_m, -7 * UM, rtol=0, atol=1e-15)


@pytest.mark.parametrize("laps_in_one_piece", [True, False])
def test_each_of_many_laps_is_scored_in_its_own_lap(laps_in_one_piece: bool) -> None:
    laps = 12
    sweeps = [2 * math.pi * laps] if laps_in_one_piece else [2 * math.pi] * laps
    path = program(*(Arc((0.0, 0.0), 4 * MM, 0.0, sweep) for sweep in sweeps))
    angle = np.linspace(0.01, 2 * math.pi * laps - 0.01, 5001)
    error_m = 2 * UM * np.sin(0.37 * angle)
    q = (4 * MM - error_m)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    error = contour_error(path, q, 4 * MM * angle + 30 * UM)
    np.testing.assert_allclose(error.normal_m, error_m, rtol=0, atol=1e-15)
    np.testing.assert_allclose(error.foot_s_m, 4 * MM * angle, rtol=0, atol=1e-14)


def test_overshoot_of_a_sharp_corner_is_the_distance_to_the_corner_or_the_next_leg() -> None:
    path = polyline((0, 0), (10, 0), (10, 10))
    assert error_at(path, 10.003, -0.004, 10.0)[0] == pytest.approx(-5.0, abs=1e-8)  # nearest is the corner point
    assert error_at(path, 10.005, 0.0, 9.999)[0] == pytest.approx(-5.0, abs=1e-8)
    assert error_at(path, 10.005, 0.002, 10.0) == pytest.approx((-5.0, 2.0, 10.002), abs=1e-8)
    assert error_at(path, 9.990, 0.003, 10.01) == pytest.approx((3.0, -20.0, 9.990), abs=1e-8)  # cut inside: first leg
    assert error_at(path, 9.997, 0.010, 9.98) == pytest.approx((3.0, 30.0, 10.010), abs=1e-8)  # ahead on the second


def test_the_corner_point_has_its_outside_on_the_right_side() -> None:
    right_turn = polyline((0, 0), (10, 0), (10, -10))
    assert error_at(right_turn, 10.003, 0.004, 10.0)[0] == pytest.approx(5.0, abs=1e-8)
    spike = polyline((0, 0), (10, 0), (0, 1))
    assert error_at(spike, 10.005, 0.0, 10.0)[0] == pytest.approx(-5.0, abs=1e-8)


def test_points_before_the_start_and_past_the_end_are_measured_to_these_points() -> None:
    path = polyline((0, 0), (10, 0))
    assert error_at(path, -0.003, 0.004, 0.0) == pytest.approx((5.0, 0.0, 0.0), abs=1e-8)
    assert error_at(path, 10.003, -0.004, 99.0) == pytest.approx((-5.0, 0.0, 10.0), abs=1e-8)


def test_the_other_branch_of_a_crossing_is_not_taken_for_the_present_one() -> None:
    path = polyline((-5, -5), (5, 5), (5, -5), (-5, 5))
    first_leg = 10 * math.sqrt(2)
    at_crossing = first_leg + 10 + 5 * math.sqrt(2)
    away = 0.02 / math.sqrt(2)  # 20 um from the present leg, and right on the first one
    assert error_at(path, away, away, at_crossing)[0] == pytest.approx(-20.0, abs=1e-8)
    assert error_at(path, away, away, first_leg / 2)[0] == pytest.approx(0.0, abs=1e-8)


def test_the_neighbouring_pass_of_a_zigzag_is_not_taken_for_the_present_one() -> None:
    path = polyline((0, 0), (10, 0), (10, 0.02), (0, 0.02))
    assert error_at(path, 5.0, 0.015, 5.0)[0] == pytest.approx(15.0, abs=1e-8)
    assert error_at(path, 5.0, 0.015, 15.02)[0] == pytest.approx(5.0, abs=1e-8)  # left of the way back is below it


def test_a_dwell_is_scored_where_the_path_rests() -> None:
    lines = polyline((0, 0), (10, 0), (10, 10))
    path = Program("dwell", (lines.items[0], Dwell(1.0), lines.items[1]), (0.0, 0.0))
    q = np.array([[10.0, 0.0], [10.001, 0.0], [9.999, 0.0005]]) * MM
    error = contour_error(path, q, np.full(3, 10 * MM))
    np.testing.assert_allclose(error.normal_m, [0.0, -1 * UM, 0.5 * UM], rtol=0, atol=1e-14)


def test_lines_shorter_than_the_error_are_searched_far_enough() -> None:
    radius = 20 * MM
    angle = np.linspace(0.0, 2 * math.pi, 20001)  # chords of 6 um, 0.25 nm off the circle
    corners = [(radius * math.cos(a), radius * math.sin(a)) for a in angle.tolist()]
    path = program(*(Line(a, b) for a, b in pairwise(corners)))
    at = np.linspace(0.1, 6.0, 100)
    q = (radius - 50 * UM) * np.stack([np.cos(at), np.sin(at)], axis=1)
    error = contour_error(path, q, radius * at + 200 * UM)
    np.testing.assert_allclose(error.normal_m, 50 * UM, rtol=0, atol=0.3e-9)
    np.testing.assert_allclose(error.tangential_m, -200 * UM, rtol=0, atol=20e-9)


def test_error_to_an_ellipse_agrees_with_a_general_minimiser() -> None:
    a, b = 20 * MM, 5 * MM
    curve = ellipse(a, b)
    rng = np.random.default_rng(5)
    u = rng.uniform(0.2, 6.0, 60)
    outward = np.stack([b * np.cos(u), a * np.sin(u)], axis=1)
    outward /= np.hypot(outward[:, 0], outward[:, 1])[:, None]
    off = rng.normal(0.0, 100 * UM, u.size)
    foot = np.stack([a * np.cos(u), b * np.sin(u)], axis=1)
    q = foot + off[:, None] * outward
    expected_s = curve.arc_length(u) + rng.normal(0.0, 200 * UM, u.size)
    error = contour_error(program(curve), q, expected_s)
    np.testing.assert_allclose(error.normal_m, -off, rtol=0, atol=1e-15)  # counter-clockwise: left is inside
    np.testing.assert_allclose(error.foot_s_m, curve.arc_length(u), rtol=0, atol=1e-12)
    for point, start, normal in zip(q, u, error.normal_m, strict=True):
        found = minimize_scalar(
            lambda v, p=point: math.hypot(a * math.cos(v) - p[0], b * math.sin(v) - p[1]),
            bounds=(start - 0.3, start + 0.3),
            method="bounded",
            options={"xatol": 1e-10},
        )
        assert abs(normal) == pytest.approx(found.fun, abs=1e-12)


@pytest.mark.filterwarnings("error")
def test_error_at_rest_has_the_direction_in_which_the_curve_begins() -> None:
    def formula(u: Array, order: int) -> Array:  # along x, from rest and to rest
        values = (
            u**3 * (10.0 - 15.0 * u + 6.0 * u**2),
            30.0 * u**2 * (1.0 - u) ** 2,
            60.0 * u * (1.0 - u) * (1.0 - 2.0 * u),
        )
        return np.stack([10.0 * MM * values[order], 0.0 * u], axis=1)

    path = program(Curve(formula, np.array([0.0, 1.0])))
    for x_mm, s_mm in ((0.002, 0.0), (9.998, 10.0)):
        assert error_at(path, x_mm, 0.001, s_mm) == pytest.approx((1.0, 1e3 * (x_mm - s_mm), x_mm), abs=1e-6)
        assert error_at(path, x_mm, -0.001, s_mm) == pytest.approx((-1.0, 1e3 * (x_mm - s_mm), x_mm), abs=1e-6)


@pytest.mark.parametrize("y_mm", [0.01, 0.0])
def test_error_inside_the_tip_of_a_narrow_ellipse_finds_the_nearer_of_both_sides(y_mm: float) -> None:
    a, b = 20 * MM, 2 * MM  # radius at the tip is b^2 / a = 0.2 mm
    curve = ellipse(a, b, first_u=-math.pi)
    q = np.array([[a - 0.5 * MM, y_mm * MM]])  # beyond the centre of curvature: the tip is the farthest point near it
    error = contour_error(program(curve), q, curve.arc_length(np.zeros(1)))
    u = np.linspace(-0.5, 0.5, 2_000_001)
    dense = np.min(np.hypot(a * np.cos(u) - q[0, 0], b * np.sin(u) - q[0, 1]))
    assert dense < 0.46 * MM
    assert error.normal_m[0] == pytest.approx(dense, abs=1e-11)


def test_error_to_lines_arcs_and_corners_agrees_with_a_dense_search() -> None:
    lines = [Line((0.0, 0.0), (10 * MM, 0.0)), Arc((10 * MM, 3 * MM), 3 * MM, -math.pi / 2, math.pi)]
    lines += [Line((10 * MM, 6 * MM), (4 * MM, 6 * MM)), Line((4 * MM, 6 * MM), (4 * MM, 1 * MM))]
    lines += [Arc((4 * MM, 0.5 * MM), 0.5 * MM, math.pi / 2, -math.pi)]
    path = program(*lines)
    ends = np.cumsum([0.0, *(segment.length_m for segment in lines)])
    rng = np.random.default_rng(7)
    joints = rng.choice(ends, 60) + rng.normal(0.0, 30 * UM, 60)
    s = np.clip(np.concatenate([rng.uniform(0.0, ends[-1], 20), joints]), 0.0, ends[-1])
    for expected_s in s:
        step = 10e-9
        near = np.arange(max(0.0, expected_s - 0.5 * MM), min(ends[-1], expected_s + 0.5 * MM), step)
        near = np.sort(np.concatenate([near, ends[np.abs(ends - expected_s) < 0.5 * MM]]))
        piece = np.clip(np.searchsorted(ends, near, side="right") - 1, 0, len(lines) - 1)
        dense = np.concatenate([lines[i].point(near[piece == i] - ends[i]) for i in np.unique(piece)])
        centre = dense[np.argmin(np.abs(near - expected_s))]
        q = centre + rng.normal(0.0, 20 * UM, 2)
        distance = np.min(np.hypot(*(dense - q).T))
        error = contour_error(path, q[None], np.array([expected_s]))
        assert abs(error.normal_m[0]) == pytest.approx(distance, abs=(step / 2) ** 2 / distance + 1e-12)


SCORED_MM = np.array([[0.0, 9e-3], [1.0, 1e-3], [2.0, -4e-3], [3.0, 1e-3]])  # beside a line along x
EXPECTED_MM = np.array([0.0, 1.003, 1.999, 2.998])
SCORED_S = np.array([0.0, 0.1, 0.2, 0.3])
FORCE_N = np.array([[90.0, 0.0], [0.0, 0.0], [3.0, 4.0], [3.0, -5.0]])


@pytest.mark.parametrize("pieces", [1, 2, 4])
def test_score_is_the_size_of_the_error_and_says_where_the_greatest_was(pieces: int) -> None:
    scorer = Scorer(polyline((0, 0), (10, 0)), from_s=0.1)
    for rows in np.array_split(np.arange(4), pieces):
        scorer.add(SCORED_S[rows], SCORED_MM[rows] * MM, EXPECTED_MM[rows] * MM, FORCE_N[rows])
    result = scorer.score()
    assert result is not None
    assert result.mean_um == pytest.approx(2.0)
    assert result.rms_um == pytest.approx(math.sqrt(6.0))
    assert result.max_um == pytest.approx(4.0)
    assert result.tangential_mean_um == pytest.approx(2.0)
    assert (result.max_time_s, result.max_x_mm, result.max_y_mm) == pytest.approx((0.2, 2.0, -4e-3))
    assert result.from_s == 0.1
    assert scorer.effort() == pytest.approx((5.0, (5.0 + 9.0) / 2))


def test_a_run_that_ends_before_scoring_begins_is_scored_from_its_start() -> None:
    scorer = Scorer(polyline((0, 0), (10, 0)), from_s=0.4)
    assert scorer.score() is None
    scorer.add(SCORED_S, SCORED_MM * MM, EXPECTED_MM * MM, FORCE_N)
    result = scorer.score()
    assert result is not None
    assert (result.max_um, result.from_s) == pytest.approx((9.0, 0.0))
    assert scorer.effort()[0] == 90.0


def test_rapid_moves_are_distinguished_from_feed_moves_by_the_path_position() -> None:
    lines = polyline((0, 0), (10, 0), (10, 10)).moves
    path = Program("rapid first", (Move(lines[0].segment, math.inf, rapid=True), Dwell(1.0), lines[1]), (0.0, 0.0))
    at = Rapids(path).at(np.array([0.0, 9.9, 10.0, 10.1, 20.0, 20.1]) * MM)
    assert at.tolist() == [True] * 3 + [False] * 3


def test_a_program_without_motion_cannot_be_scored() -> None:
    with pytest.raises(PathError, match="no motion"):
        contour_error(Program("still", (Dwell(1.0),), (0.0, 0.0)), np.zeros((1, 2)), np.zeros(1))


def test_rows_of_different_number_are_refused() -> None:
    with pytest.raises(ValueError, match="do not fit"):
        contour_error(polyline((0, 0), (1, 0)), np.zeros((3, 2)), np.zeros(2))
