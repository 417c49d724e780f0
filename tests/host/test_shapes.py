# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from scipy.special import ellipe

from kontur.errors import PathError
from kontur.path import shapes
from kontur.path.geometry import Arc, Line

ALL = {
    "circle": shapes.circle(0.020, 0.05),
    "ellipse": shapes.ellipse(0.030, 0.010, 0.05),
    "eight": shapes.eight(0.040, 0.05),
    "square": shapes.square(0.040, 0.005, 0.05),
    "sharp square": shapes.square(0.040, 0.0, 0.05),
    "round square": shapes.square(0.040, 0.020, 0.05),
    "spiral": shapes.spiral(0.005, 0.020, 0.004, 0.05),
}


def dense(program):
    return np.concatenate([m.segment.point(np.linspace(0.0, m.segment.length_m, 400)) for m in program.moves])


@pytest.mark.parametrize("program", ALL.values(), ids=ALL)
def test_a_shape_is_connected_starts_on_the_positive_x_axis_and_sets_out_upwards(program):
    here = np.array(program.start_m)
    assert here[0] > 0.0
    assert here[1] == 0.0
    for move in program.moves:
        np.testing.assert_allclose(move.segment.point(np.zeros(1))[0], here, atol=1e-16)
        here = move.segment.point(np.array([move.segment.length_m]))[0]
        assert move.feed_mps == 0.05
    assert program.moves[0].segment.tangent(np.zeros(1))[0, 1] > 0.5


@pytest.mark.parametrize("program", ALL.values(), ids=ALL)
def test_tangent_and_curvature_of_a_shape_are_those_of_its_points(program):
    h = 1e-6
    for move in program.moves:
        segment = move.segment
        s = np.linspace(0.0, segment.length_m, 50)[1:-1]
        before, here, after = (segment.point(s + step) for step in (-h, 0.0, h))
        tangent, bend = (after - before) / (2 * h), (after - 2 * here + before) / h**2
        np.testing.assert_allclose(segment.tangent(s), tangent, atol=1e-6)
        curvature = tangent[:, 0] * bend[:, 1] - tangent[:, 1] * bend[:, 0]
        np.testing.assert_allclose(segment.curvature(s), curvature, atol=0.02)


@pytest.mark.parametrize("name", [name for name in ALL if name != "spiral"])
def test_a_closed_shape_ends_where_it_starts(name):
    np.testing.assert_allclose(dense(ALL[name])[-1], ALL[name].start_m, atol=1e-15)


def test_a_circle_of_a_given_duration_is_as_long_as_the_feed_makes_it():
    (move,) = shapes.circle(0.004, 0.004488, duration_s=5.6).moves
    assert move.segment.length_m == pytest.approx(5.6 * 0.004488, abs=1e-15)
    (move,) = shapes.circle(0.004, 0.004488, laps=2.5).moves
    assert move.segment.length_m == pytest.approx(2.5 * 2.0 * math.pi * 0.004, abs=1e-15)


def test_an_ellipse_has_its_half_axes():
    x, y = dense(ALL["ellipse"]).T
    np.testing.assert_allclose((x / 0.030) ** 2 + (y / 0.010) ** 2, 1.0, atol=1e-10)
    assert ALL["ellipse"].length_m == pytest.approx(4 * 0.030 * ellipe(1 - (10 / 30) ** 2), abs=1e-14)


def test_an_eight_is_the_lemniscate_of_gerono():
    x, y = dense(ALL["eight"]).T
    np.testing.assert_allclose(x**4, 0.020**2 * (x**2 - y**2), atol=1e-18)
    assert (np.max(x), np.max(y)) == pytest.approx((0.020, 0.010), abs=1e-6)


def test_a_square_is_lines_and_quarter_arcs_with_its_side_and_corner_radius():
    segments = [move.segment for move in ALL["square"].moves]
    assert [type(s) for s in segments] == [Line, Arc, Line, Arc, Line, Arc, Line, Arc, Line]
    assert np.ptp(dense(ALL["square"]), axis=0) == pytest.approx([0.040, 0.040], abs=1e-15)
    assert ALL["square"].length_m == pytest.approx(4 * 0.030 + 2 * math.pi * 0.005, abs=1e-15)
    assert [type(m.segment) for m in ALL["sharp square"].moves] == [Line] * 5
    assert [type(m.segment) for m in ALL["round square"].moves] == [Arc] * 4


def test_a_spiral_grows_by_its_pitch_each_turn():
    points = dense(ALL["spiral"])
    radius = np.hypot(*points.T)
    turns = np.unwrap(np.arctan2(points[:, 1], points[:, 0])) / (2 * math.pi)
    np.testing.assert_allclose(radius, 0.005 + 0.004 * turns, atol=1e-14)
    assert radius[-1] == pytest.approx(0.020, abs=1e-14)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: shapes.circle(-0.001, 0.1), "circle: radius is -0.001 m; it must be 1e-09..1e+06 m"),
        (lambda: shapes.circle(0.001, 1e305), "circle: feed is 1e+305 m/s; it must be 1e-09..1e+06 m/s"),
        (lambda: shapes.circle(0.001, 0.1, 1e9), "circle: laps is 1e+09; it must be 1e-09..1e+06"),
        (lambda: shapes.circle(0.001, 0.0), "circle: feed is 0"),
        (lambda: shapes.circle(0.001, 0.1, duration_s=math.nan), "circle: duration is nan"),
        (lambda: shapes.ellipse(0.01, math.inf, 0.1), "ellipse: half height is inf"),
        (lambda: shapes.eight(0.0, 0.1), "eight: size is 0"),
        (lambda: shapes.square(0.01, 0.006, 0.1), "square: the corner radius is 6 mm; it must be 0 .. 5 mm"),
        (lambda: shapes.spiral(0.01, 0.005, 0.001, 0.1), "spiral: the inner radius is 10 mm"),
        (lambda: shapes.spiral(0.0, 0.1, 1e-9, 0.1), "turns are too many"),
    ],
)
def test_a_size_that_makes_no_shape_is_refused_by_name(make, message):
    with pytest.raises(PathError) as caught:
        make()
    assert message in str(caught.value)
