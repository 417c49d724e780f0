# SPDX-License-Identifier: Apache-2.0
"""The figures of a circular test: circles with known errors against closed forms and an independent fit."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from kontur.errors import LogError
from kontur.runs.circularity import PROFILE, Circularity, Spike, circularity, fitted, lap, profiles

Floats = NDArray[np.float64]
R = 20.0  # mm
N = 7200


def angles(sense: float, points: int = N) -> Floats:
    """Even angles that begin at 45 degrees and meet no reversal exactly from either side."""
    return np.asarray(0.25 * np.pi + sense * 2.0 * np.pi * (np.arange(points) + 0.5) / points)


def round_with(radius: Callable[[Floats, float], Floats]) -> tuple[Floats, Floats]:
    """Laps in both senses whose radius is `radius` of angle and sense."""
    laps = []
    for sense in (1.0, -1.0):
        t = angles(sense)
        laps.append(radius(t, sense)[:, None] * np.column_stack([np.cos(t), np.sin(t)]))
    return laps[0], laps[1]


def moved_by(error_mm: Callable[[Floats, float], tuple[Floats, Floats]]) -> tuple[Floats, Floats]:
    """Laps in both senses, each axis off by `error_mm` of angle and sense."""
    laps = []
    for sense in (1.0, -1.0):
        t = angles(sense)
        dx, dy = error_mm(t, sense)
        laps.append(np.column_stack([R * np.cos(t) + dx, R * np.sin(t) + dy]))
    return laps[0], laps[1]


def independent(points: Floats) -> tuple[Floats, float]:
    """Centre and radial range by scipy."""
    found = least_squares(
        lambda p: np.hypot(*(points - p[:2]).T) - p[2], [0.0, 0.0, R], xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    distance = np.hypot(*(points - found.x[:2]).T)
    return found.x, float(np.ptp(distance)) * 1e3


def spike(found: Circularity, place: str, sense: str) -> Spike:
    return next(one for one in found.spikes if (one.place, one.sense) == (place, sense))


def test_a_perfect_circle_has_no_deviation() -> None:
    found = circularity(*round_with(lambda t, _: np.full_like(t, R)), R)
    values = [value for value in vars(found).values() if isinstance(value, float)]
    assert np.max(np.abs(values)) < 1e-8
    assert all(abs(one.height_um) < 1e-8 for one in found.spikes)
    assert len(found.spikes) == 8


def test_ellipse_is_a_scale_mismatch_of_the_difference_of_its_half_axes() -> None:
    found = circularity(*moved_by(lambda t, _: (0.003 * np.cos(t), -0.001 * np.sin(t))), R)
    assert found.g_ccw_um == pytest.approx(4.0, abs=1e-4)
    assert found.g_both_um == pytest.approx(4.0, abs=1e-4)
    assert (found.f_max_ccw_um, found.f_min_cw_um) == (pytest.approx(3.0, abs=1e-4), pytest.approx(-1.0, abs=1e-4))
    assert found.d_um == pytest.approx(1.0, abs=1e-3)
    assert found.scale_um_per_m == pytest.approx(200.0, abs=0.05)  # 4 um on 20 mm
    assert abs(found.squareness_um_per_m) < 1e-3


def test_squareness_is_the_shear_and_g_the_difference_of_its_singular_values() -> None:
    found = circularity(*moved_by(lambda t, _: (np.zeros_like(t), 100e-6 * R * np.cos(t))), R)
    assert found.g_both_um == pytest.approx(2.0, abs=1e-5)  # a shear by g: s1 - s2 = g exactly
    assert found.squareness_um_per_m == pytest.approx(100.0, abs=0.02)
    other = circularity(*moved_by(lambda t, _: (-100e-6 * R * np.sin(t), np.zeros_like(t))), R)
    assert other.squareness_um_per_m == pytest.approx(-100.0, abs=0.02)


def test_an_offset_of_the_centre_is_f_and_no_g() -> None:
    found = circularity(*moved_by(lambda t, _: (np.full_like(t, 0.03), np.full_like(t, -0.04))), R)
    assert (found.centre_x_um, found.centre_y_um) == (pytest.approx(30.0), pytest.approx(-40.0))
    assert found.g_both_um < 1e-8
    assert (found.f_max_ccw_um, found.f_min_ccw_um) == (pytest.approx(50.0, abs=1e-4), pytest.approx(-50.0, abs=1e-4))
    assert abs(found.d_um) < 1e-8


def test_backlash_is_the_step_at_the_reversal_and_g_of_both_senses() -> None:
    """The table stays behind by half of the gap: dx = -b/2 sgn(vx), with vx = -s sin t."""
    found = circularity(*moved_by(lambda t, s: (0.0025 * s * np.sign(np.sin(t)), np.zeros_like(t))), R)
    assert found.backlash_x_um == pytest.approx(5.0, abs=2e-3)
    assert abs(found.backlash_y_um) < 2e-3
    assert found.g_both_um == pytest.approx(5.0, abs=1e-3)
    assert max(abs(one.height_um) for one in found.spikes) < 0.01
    found = circularity(*moved_by(lambda t, s: (np.zeros_like(t), -0.001 * s * np.sign(np.cos(t)))), R)
    assert (found.backlash_x_um, found.backlash_y_um) == (pytest.approx(0.0, abs=1e-3), pytest.approx(2.0, abs=1e-3))


def test_lag_of_one_axis_changes_its_sign_with_the_sense_and_is_no_squareness() -> None:
    """x lags by 4 um at the feed: dx = -4 um vx/v = s 4 um sin t."""
    found = circularity(*moved_by(lambda t, s: (0.004 * s * np.sin(t), np.zeros_like(t))), R)
    assert found.lag_um == pytest.approx(4.0, abs=1e-3)
    assert abs(found.squareness_um_per_m) < 0.05
    assert found.g_ccw_um == pytest.approx(4.0, abs=1e-4)


def test_mean_of_both_senses_is_the_mean_of_their_radii() -> None:
    found = circularity(*round_with(lambda t, s: np.full_like(t, R + (0.004 if s > 0.0 else -0.001))), R)
    assert found.d_um == pytest.approx(1.5)
    assert (found.g_ccw_um, found.g_cw_um) == (pytest.approx(0.0, abs=1e-8), pytest.approx(0.0, abs=1e-8))
    assert found.g_both_um == pytest.approx(5.0)


@pytest.mark.parametrize(("number", "place"), [(0, "x+"), (1, "y+"), (2, "x-"), (3, "y-")])
def test_a_spike_has_its_place_sense_height_and_width(number: int, place: str) -> None:
    """A triangle 4 um high at the middle, 3 degrees after the reversal, 2 degrees wide at half of it."""

    def radius(t: Floats, sense: float) -> Floats:
        after = (sense * (t - 0.5 * np.pi * number) + np.pi) % (2.0 * np.pi) - np.pi
        high = 0.004 * np.maximum(1.0 - np.abs(np.rad2deg(after) - 3.0) / 2.0, 0.0)
        return R + (high if sense < 0.0 else -0.25 * high)

    found = circularity(*round_with(radius), R)
    assert spike(found, place, "cw").height_um == pytest.approx(4.0, abs=0.06)
    assert spike(found, place, "cw").width_deg == pytest.approx(2.0, abs=0.05)
    assert spike(found, place, "ccw").height_um == pytest.approx(-1.0, abs=0.06)
    others = [one for one in found.spikes if one.place != place]
    assert max(abs(one.height_um) for one in others) < 0.06
    assert found.f_max_cw_um == pytest.approx(4.0, abs=0.06)


def test_a_spike_of_two_points_at_each_angle_is_as_wide_as_its_outer_ones() -> None:
    """As the drive reports it: the least and the greatest deviation."""

    def outer(t: Floats, _: float) -> Floats:
        return R + 0.004 * np.maximum(1.0 - np.abs(np.rad2deg((t + np.pi) % (2.0 * np.pi) - np.pi)) / 2.0, 0.0)

    ends = (round_with(outer), round_with(lambda t, sense: 0.5 * (R + outer(t, sense))))
    ccw, cw = (np.concatenate(pair) for pair in zip(*ends, strict=True))
    found = spike(circularity(ccw, cw, R), "x+", "ccw")
    assert found.height_um == pytest.approx(4.0, abs=0.06)
    assert found.width_deg == pytest.approx(2.0, abs=0.05)


def test_a_spike_is_what_goes_beyond_the_levels_before_and_after_the_step_of_backlash() -> None:
    """The gap of 5 um is crossed within 2 degrees after the reversal, with a spike of 3 um at its end."""

    def error(t: Floats, s: float) -> tuple[Floats, Floats]:
        after = (s * t + 0.5 * np.pi) % np.pi - 0.5 * np.pi  # from the reversals of x, in the direction of the motion
        crossed = np.sign(np.sin(t)) * s * np.clip(np.abs(np.rad2deg(after)) * np.sign(after) - 1.0, -1.0, 1.0)
        outside = np.sign(np.cos(t)) * 0.003 * np.maximum(1.0 - np.abs(np.rad2deg(after) - 2.0), 0.0)
        late = np.where(after > 0.0, crossed, s * np.sign(np.sin(t)))
        return 0.0025 * late + outside, np.zeros_like(t)

    found = circularity(*moved_by(error), R)
    assert found.backlash_x_um == pytest.approx(5.0, abs=0.05)
    assert spike(found, "x+", "ccw").height_um == pytest.approx(3.0, abs=0.1)
    assert abs(spike(found, "y+", "ccw").height_um) < 0.1


def test_all_causes_together_are_told_apart() -> None:
    def error(t: Floats, s: float) -> tuple[Floats, Floats]:
        dx = 0.03 + 0.002 * np.cos(t) + 0.0015 * s * np.sign(np.sin(t)) + 0.003 * s * np.sin(t)
        dy = -0.01 + 60e-6 * R * np.cos(t) - 0.0005 * s * np.sign(np.cos(t))
        return dx, dy

    found = circularity(*moved_by(error), R)
    assert found.scale_um_per_m == pytest.approx(100.0, abs=0.5)
    assert found.squareness_um_per_m == pytest.approx(60.0, abs=0.5)
    assert (found.backlash_x_um, found.backlash_y_um) == (pytest.approx(3.0, abs=0.02), pytest.approx(1.0, abs=0.02))
    assert found.lag_um == pytest.approx(3.0, abs=0.02)
    assert (found.centre_x_um, found.centre_y_um) == (pytest.approx(30.0, abs=0.1), pytest.approx(-10.0, abs=0.1))


def test_circle_and_g_are_those_of_an_independent_fit() -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        t = np.sort(rng.uniform(0.0, 2.0 * np.pi, 2000)) + 0.3 * np.sin(np.linspace(0.0, 3.0, 2000))  # not even
        noise = rng.normal(0.0, 0.003, (len(t), 2))
        points = R * np.column_stack([np.cos(t), np.sin(t)]) + rng.normal(0.0, 0.5, 2) + noise
        for some in (points, points[:800]):  # of a part of a circle, too
            expected, _ = independent(some)
            centre, radius = fitted(some)
            assert np.max(np.abs(np.array([*centre, radius]) - expected)) < 1e-6
        ccw, cw = points[: len(t) // 2 * 2 : 2], points[1::2][::-1]
        found = circularity(ccw, cw, R)
        for value, what in ((found.g_ccw_um, ccw), (found.g_cw_um, cw), (found.g_both_um, points)):
            assert value == pytest.approx(independent(what)[1], abs=1e-3)


def test_lap_leaves_out_what_is_before_and_after_one_turn() -> None:
    t = 0.25 * np.pi - np.linspace(0.0, 4.0 * np.pi, 4001)
    points = np.column_stack([3.0 + R * np.cos(t), R * np.sin(t) - 1.0])
    points[:900] += 1.0  # the start-up
    found = lap(points, (3.0, -1.0), 0.5)
    assert len(found) == pytest.approx(2000, abs=60)
    assert np.max(np.abs(np.hypot(*found.T) - R)) < 1e-12


def test_lap_that_is_not_whole_or_has_gaps_is_refused() -> None:
    t = np.linspace(0.0, 2.8 * np.pi, 3000)
    points = R * np.column_stack([np.cos(t), np.sin(t)])
    with pytest.raises(LogError, match=r"ends after 1\.4 turns; 1\.5 are needed"):
        lap(points, (0.0, 0.0), 0.5)
    whole = lap(points, (0.0, 0.0), 0.2)
    assert len(whole) > 2000
    with pytest.raises(LogError, match="degrees apart"):
        lap(np.delete(points, np.s_[1000:1030], axis=0), (0.0, 0.0), 0.2)


def test_profile_is_the_deviation_about_the_common_centre_by_angle() -> None:
    laps = moved_by(lambda t, s: (0.05 + 0.002 * np.cos(t) * (s > 0.0), np.zeros_like(t)))
    ccw, cw = profiles(*laps, R)
    assert len(ccw) == len(cw) == PROFILE
    assert (ccw[0], ccw[PROFILE // 2]) == (pytest.approx(2.0, abs=1e-3), pytest.approx(2.0, abs=1e-3))
    assert abs(ccw[PROFILE // 4]) < 1e-3
    assert np.max(np.abs(cw)) < 1e-3
