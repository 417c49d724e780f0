# SPDX-License-Identifier: Apache-2.0
"""What goes by the angle of the screw, and what a scale shows: the fits against equations that made the scans."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kontur.commissioning import fit, screw
from kontur.commissioning.fit import Dynamics, Value
from kontur.commissioning.recording import Scan
from kontur.design import loop
from kontur.machine import MACHINES, Axis, load

BALL_SCREW = load(MACHINES / "ball_screw.toml")
LEADS_M = (0.004, 0.005, 0.01, 0.016)
RIGID = Dynamics(*(Value(value, 0.0) for value in (80.0, 0.0, 0.0, 0.5, 4e-4)), 3e-4, 1, "motor", 1.0)
ELASTIC = Dynamics(*(Value(value, 0.0) for value in (80.0, 100.0, 0.02, 0.5, 4e-4)), 3e-4, 1, "motor", 1.0)
STIFFNESS_NPM = 20.0 * (2.0 * np.pi * 100.0) ** 2


def friction_N(speed_mps: float) -> float:
    return 30.0 + 400.0 * speed_mps


def scan_of(
    velocity_mps: float,
    cogging_N: float = 3.0,
    ripple: float = 0.02,
    gap_m: float = 8e-6,
    share: float = 0.6,
    seed: int = 1,
    origin_m: float = 0.0,
) -> Scan:
    """An axis of 80 kg with a lead of 10 mm that cogging shakes; behind its spring of STIFFNESS_NPM is a scale, and the
    screw is too long by 100 um/m and wrong by 5 um once a turn."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, 0.08 / abs(velocity_mps), 0.00267)
    omega = 2.0 * np.pi * velocity_mps / 0.01
    swing_m = 40e-6 * np.cos(omega * time_s + 0.3)
    swing_mps = -40e-6 * omega * np.sin(omega * time_s + 0.3)
    first_m = velocity_mps * time_s + swing_m + (0.08 if velocity_mps < 0.0 else 0.0)
    angle = 2.0 * np.pi * first_m / 0.01
    needed_N = 80.0 * -(omega**2) * swing_m + 400.0 * swing_mps + np.sign(velocity_mps) * friction_N(abs(velocity_mps))
    force_N = (needed_N - cogging_N * np.sin(angle + 0.5)) / (1.0 + ripple * np.cos(2.0 * angle))
    user_m = first_m + origin_m
    behind_m = 0.5 * gap_m + share * friction_N(abs(velocity_mps)) / STIFFNESS_NPM
    screw_m = 1e-4 * user_m + 5e-6 * np.sin(2.0 * np.pi * user_m / 0.01)
    second_m = first_m + screw_m - np.sign(velocity_mps) * behind_m + 2e-8 * rng.standard_normal(len(time_s))
    return Scan(time_s, first_m, second_m, force_N + 0.3 * rng.standard_normal(len(time_s)), origin_m)


def both(speed_mps: float, **what: float) -> tuple[Scan, Scan]:
    return scan_of(speed_mps, **what), scan_of(-speed_mps, **what)  # type: ignore[arg-type]


def kg(mass_kg: float, damping_Nspm: float = 400.0, delay_s: float = 0.0) -> screw.Load:
    """A rigid axis."""
    return screw.Load(lambda hz: np.full_like(hz, mass_kg), damping_Nspm, delay_s)


def inside(value: Value, true: float) -> bool:
    return abs(value.value - true) <= value.uncertainty


@pytest.mark.parametrize("encoder_at", ["motor", "table"])
def test_mass_that_a_force_moves_is_that_of_the_two_masses_on_their_spring(encoder_at: str) -> None:
    axis = replace(
        BALL_SCREW.x, encoder_at=encoder_at, resonance_damping=0.0, current_lag_s=0.0, viscous_Nspm=0.0, coulomb_N=0.0
    )
    hz = np.array([4.0, 12.0, 24.0, 48.0, 80.0])
    plant = loop.plant(loop.Grid.at(hz, 1_000_000), axis, 0, ((1.0, 1.0),)).force[0][0]
    found = screw.mass_at(dynamics(axis))(hz)
    assert found == pytest.approx((-1.0 / (plant * (2.0 * np.pi * hz) ** 2)).real, rel=0.02)
    rigid = screw.mass_at(replace(dynamics(axis), resonance_Hz=Value(0.0, 0.0)))(hz)
    assert rigid == pytest.approx(100.0)


def dynamics(axis: Axis) -> Dynamics:
    """The axis as if it had been found."""
    values = (axis.mass_kg, axis.resonance_Hz, axis.resonance_damping, axis.motor_share, axis.current_lag_s)
    mass, resonance, damping, share, lag = (Value(value, 0.0) for value in values)
    return Dynamics(mass, resonance, damping, share, lag, axis.current_lag_s, 0, axis.encoder_at, 1.0)


# --- forces by angle --------------------------------------------------------------------------------------------------
def test_cogging_and_ripple_are_told_apart_at_the_lead_that_they_have() -> None:
    found = screw.screw(both(0.02), kg(80.0), LEADS_M)
    assert found is not None
    assert found.lead_m == 0.01
    assert found.cogging is not None
    assert complex(found.cogging.sin[0], found.cogging.cos[0]) == pytest.approx(3.0 * np.exp(0.5j), abs=0.1)
    assert inside(found.cogging.peak, 3.0)
    assert found.ripple is not None
    assert found.ripple.cos[1] == pytest.approx(0.02, abs=0.002)
    assert inside(found.ripple.peak, 0.02)
    assert found.ripple.uncertainty < 0.01


def test_friction_that_rises_with_speed_is_not_taken_for_ripple() -> None:
    for damping_Nspm, seen in ((0.0, True), (400.0, False)):
        made = screw.screw(both(0.02, ripple=0.0), kg(80.0, damping_Nspm), (0.01,))
        assert made is not None
        assert (made.ripple is not None) == seen
    found = fit.Friction(Value(50.0, 0.0), Value(400.0, 0.0), Value(1.5, 0.0), Value(0.01, 0.0))
    force_N = [50.0 * (1.0 + 0.5 * np.exp(-v / 0.01)) + 400.0 * v for v in (0.0199, 0.0201)]
    assert fit.slope_Nspm(found, 0.02) == pytest.approx((force_N[1] - force_N[0]) / 0.0002, rel=1e-3)


def test_delay_of_the_force_is_not_taken_for_ripple() -> None:
    """Strong cogging, and little friction."""
    late_s = 0.004
    scans = [replace(one, time_s=one.time_s - late_s) for one in both(0.02, cogging_N=9.0, ripple=0.01)]
    scans = [replace(one, force_N=np.interp(one.time_s + late_s, one.time_s, one.force_N)) for one in scans]
    found = screw.screw(scans, kg(80.0, delay_s=late_s), (0.01,))
    assert found is not None
    assert found.cogging is not None
    assert inside(found.cogging.peak, 9.0)
    assert found.ripple is None or inside(found.ripple.peak, 0.01)


@pytest.mark.parametrize(("cogging_N", "ripple"), [(3.0, 0.0), (0.0, 0.03)])
def test_what_is_not_there_is_not_seen(cogging_N: float, ripple: float) -> None:
    found = screw.screw(both(0.02, cogging_N=cogging_N, ripple=ripple), kg(80.0), LEADS_M)
    assert found is not None
    assert found.lead_m == 0.01
    assert (found.cogging is not None) == (cogging_N > 0.0)
    assert (found.ripple is not None) == (ripple > 0.0)


def test_force_without_cogging_and_ripple_has_none() -> None:
    assert screw.screw(both(0.02, cogging_N=0.0, ripple=0.0), kg(80.0), LEADS_M) is None


# --- what a scale shows -----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("gap_m", [0.0, 8e-6])
def test_gap_is_told_from_the_stretch_of_the_spring(gap_m: float) -> None:
    pairs = [both(0.02, gap_m=gap_m), both(0.2, gap_m=gap_m)]
    found = screw.transmission(pairs, ELASTIC, 0.01)
    assert found is not None
    assert found.backlash_m.value == pytest.approx(gap_m, abs=2e-7)
    assert inside(found.backlash_m, gap_m)
    assert found.backlash_m.uncertainty < 1e-6
    assert found.friction_share is not None
    assert found.friction_share.value == pytest.approx(0.6, abs=0.05)
    assert inside(found.friction_share, 0.6)


def test_one_speed_alone_leaves_the_gap_as_uncertain_as_the_stretch() -> None:
    found = screw.transmission([both(0.02)], ELASTIC, 0.01)
    assert found is not None
    assert inside(found.backlash_m, 8e-6)
    assert found.backlash_m.uncertainty > 1e-6


def test_gap_of_a_rigid_axis_has_no_share_of_the_friction() -> None:
    found = screw.transmission([both(0.02, share=0.0), both(0.2, share=0.0)], RIGID, None)
    assert found is not None
    assert found.backlash_m.value == pytest.approx(8e-6, abs=1e-6)
    assert found.friction_share is None
    assert found.lead_once is None


@pytest.mark.parametrize("origin_m", [0.0, 0.0025])
def test_errors_of_the_screw_go_by_the_users_position(origin_m: float) -> None:
    found = screw.transmission([both(0.02, origin_m=origin_m), both(0.2, origin_m=origin_m)], ELASTIC, 0.01)
    assert found is not None
    assert found.lead_error.value == pytest.approx(1e-4, abs=2e-6)
    assert found.lead_once is not None
    assert found.lead_once.sin[0] == pytest.approx(5e-6, abs=1e-7)
    assert inside(found.lead_once.peak, 5e-6)
    position_m, error_m = np.transpose(found.lead_map)
    assert len(position_m) == 64
    assert np.polyfit(position_m, error_m, 1)[0] == pytest.approx(1e-4, abs=2e-6)


def test_without_a_scale_nothing_is_said_of_the_transmission() -> None:
    one = replace(scan_of(0.02), second_m=None)
    assert screw.transmission([(one, one)], ELASTIC, 0.01) is None
    assert screw.transmission([both(0.02)], replace(ELASTIC, encoder_at="table"), 0.01) is None


# --- at rest ----------------------------------------------------------------------------------------------------------
def test_noise_of_an_encoder_is_its_scatter_and_below_a_count_it_is_not_sure() -> None:
    rng = np.random.default_rng(1)
    noisy = np.round(rng.normal(0.0, 3.0, 1500)) * 1e-8
    found = fit.noise(noisy, 1e-8)
    assert inside(found, 3e-8)
    assert found.uncertainty < 5e-9
    still = fit.noise(np.zeros(1500), 1e-8)
    assert still.value == 0.0
    assert still.uncertainty == pytest.approx(1e-8 / np.sqrt(12.0))
