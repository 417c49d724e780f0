# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from scipy.special import ellipe

from kontur.path.geometry import Arc, Curve, Line

A, B = 0.030, 0.010


def ellipse(u, order):
    phase = u + order * np.pi / 2
    return np.stack([A * np.cos(phase), B * np.sin(phase)], axis=1)


@pytest.fixture(scope="module")
def curve():
    return Curve(ellipse, np.linspace(0.0, 2.0 * np.pi, 9))


def test_a_line_is_followed_at_unit_speed_from_its_start_to_its_end():
    line = Line((0.001, 0.002), (0.004, 0.006))
    assert line.length_m == pytest.approx(0.005, abs=1e-18)
    np.testing.assert_allclose(
        line.point(np.array([0.0, 0.0025, 0.005])), [[0.001, 0.002], [0.0025, 0.004], [0.004, 0.006]]
    )
    np.testing.assert_allclose(line.tangent(np.zeros(1)), [[0.6, 0.8]])


@pytest.mark.parametrize(("sweep", "end", "tangent"), [(np.pi / 2, (1, 2), (-1, 0)), (-np.pi / 2, (1, 0), (-1, 0))])
def test_an_arc_turns_left_for_a_positive_sweep_and_right_for_a_negative_one(sweep, end, tangent):
    arc = Arc((1.0, 1.0), 1.0, 0.0, sweep)
    assert arc.length_m == pytest.approx(np.pi / 2)
    np.testing.assert_allclose(arc.point(np.array([arc.length_m])), [end], atol=1e-15)
    np.testing.assert_allclose(arc.tangent(np.array([arc.length_m])), [tangent], atol=1e-15)
    assert arc.curvature(np.zeros(1))[0] == math.copysign(1.0, sweep)


def test_the_length_of_an_ellipse_agrees_with_the_elliptic_integral(curve):
    assert curve.length_m == pytest.approx(4.0 * A * ellipe(1.0 - (B / A) ** 2), abs=1e-15)


def test_arc_length_is_inverted_to_a_picometre(curve):
    s = np.linspace(0.0, curve.length_m, 37)
    for wanted, u in zip(s, curve.parameter(s), strict=True):
        length, _ = quad(lambda t: math.hypot(A * math.sin(t), B * math.cos(t)), 0.0, u, epsabs=1e-15, limit=200)
        assert abs(length - wanted) < 1e-12


def test_curvature_of_an_ellipse_is_that_of_the_textbook_and_signed(curve):
    u = np.linspace(0.1, 6.0, 50)
    expected = A * B / (A**2 * np.sin(u) ** 2 + B**2 * np.cos(u) ** 2) ** 1.5
    np.testing.assert_allclose(curve.curvature(curve.arc_length(u)), expected, rtol=1e-9)
    mirrored = Curve(lambda u, order: ellipse(u, order) * [1.0, -1.0], np.linspace(0.0, 2.0 * np.pi, 9))
    assert np.all(mirrored.curvature(np.array([0.0, 0.01])) < 0.0)


def test_a_curve_stays_on_its_formula_and_its_tangent_is_the_difference_quotient(curve):
    s, h = np.linspace(0.001, 0.1, 40), 1e-7
    x, y = curve.point(s).T
    np.testing.assert_allclose((x / A) ** 2 + (y / B) ** 2, 1.0, atol=1e-12)
    np.testing.assert_allclose(curve.tangent(s), (curve.point(s + h) - curve.point(s - h)) / (2 * h), atol=1e-6)


def test_a_curve_that_starts_and_ends_at_rest_has_a_tangent_there():
    t = np.linspace(0.0, 1.0, 11)
    line = np.stack([3.0 * t**2 * (3.0 - 2.0 * t), 4.0 * t**2 * (3.0 - 2.0 * t)], axis=1)
    curve = Curve(CubicSpline(t, line, bc_type="clamped"), t)
    assert curve.length_m == pytest.approx(5.0, abs=1e-12)
    np.testing.assert_allclose(curve.tangent(np.array([0.0, 2.5, 5.0])), np.tile([0.6, 0.8], (3, 1)), atol=1e-9)
    np.testing.assert_allclose(curve.point(np.array([0.0, 2.5, 5.0])), [[0, 0], [1.5, 2], [3, 4]], atol=1e-12)


def test_a_curve_that_reverses_has_a_tangent_where_it_turns():
    u = np.linspace(-1.0, 1.0, 5)
    curve = Curve(CubicSpline(u, np.stack([1.0 - u**2, 0.0 * u], axis=1)), u)
    tangent = curve.tangent(np.array([0.5, 1.0, 1.5]))
    np.testing.assert_allclose(np.abs(tangent), [[1, 0], [1, 0], [1, 0]], atol=1e-12)
    np.testing.assert_allclose(tangent[[0, 2], 0], [1, -1])


def test_a_distance_beyond_the_ends_of_a_curve_gives_its_ends(curve):
    np.testing.assert_allclose(curve.point(np.array([-1.0, 1.0])), [[A, 0.0], [A, 0.0]], atol=1e-15)
