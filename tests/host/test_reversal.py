# SPDX-License-Identifier: Apache-2.0
"""Presliding, backlash and the table's share of the friction, from slow reversals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kontur.commissioning import first_moves, reversal
from kontur.commissioning.fit import Dynamics, Friction, Value
from kontur.commissioning.identify import _reversals
from kontur.commissioning.recording import Scan
from kontur.commissioning.reversal import Presliding
from kontur.drive.target import Target, open_drive
from kontur.machine import LENGTHS, MACHINES, Axis, Machine, load


def known(axis: Axis, delay_periods: int) -> tuple[Dynamics, Friction]:
    """What was found before, for the most part: the Stribeck velocity is half more than the true one."""
    lag_s = axis.current_lag_s + 1e-4 * delay_periods
    figures = (axis.mass_kg, axis.resonance_Hz, axis.resonance_damping, axis.motor_share, lag_s)
    dynamics = Dynamics(*(Value(one, 0.0) for one in figures), lag_s, 0, axis.encoder_at, 1.0)
    friction = (axis.coulomb_N, axis.viscous_Nspm, axis.breakaway, 1.5 * axis.stribeck_mps)
    return dynamics, Friction(*(Value(one, 0.0) for one in friction))


def presliding_of(machine: str | Machine, **changed: float | str) -> tuple[Axis, Presliding | None]:
    """Of the simulated axis x, of which only this is measured. It has no cogging, which would be taken off before."""
    whole = machine if isinstance(machine, Machine) else load(MACHINES / f"{machine}.toml")
    axis = replace(whole.x, cogging_N=0.0, ripple=0.0, **changed)  # type: ignore[arg-type]
    with open_drive(Target(machine=replace(whole, x=axis), told=LENGTHS)) as device:
        device.select_controller("cascade")
        first_moves.prepare(device, "x")
        device.parameters.set(
            {"plant_x.mass": 1.1 * axis.mass_kg, "plant_x.coulomb": 0.8 * axis.coulomb_N}
            | {"plant_x.force_limit": axis.force_limit_N, "second_encoder_x.length": axis.scale_m * 1e6}
            | {"following_window_x": first_moves.MEASURE_NM}
            | first_moves.FIRM
        )
        with first_moves.moving(device, "x", lambda: False) as mover:
            scans = _reversals(mover)
    return axis, reversal.presliding(scans, *known(axis, whole.delay_periods))


@pytest.mark.parametrize("machine", ["ball_screw", "lead_screw"])
def test_reversals_show_presliding_backlash_and_share_without_a_scale(machine: str) -> None:
    axis, found = presliding_of(machine)
    assert found is not None
    assert found.distance_m.value == pytest.approx(axis.presliding_m, rel=0.05)
    assert abs(found.distance_m.value - axis.presliding_m) <= found.distance_m.uncertainty < 0.3 * axis.presliding_m
    assert found.rest_N.value == pytest.approx(axis.coulomb_N * axis.breakaway, rel=0.03)
    assert found.friction_share is not None
    assert found.friction_share.value == pytest.approx(axis.friction_share, abs=0.05)
    assert abs(found.friction_share.value - axis.friction_share) <= found.friction_share.uncertainty
    if axis.backlash_m == 0.0:
        assert found.backlash_m is None
    else:
        assert found.backlash_m is not None
        assert found.backlash_m.value == pytest.approx(axis.backlash_m, rel=0.1)


@pytest.mark.parametrize(
    "changed", [{"scale_m": 1e-8, "backlash_m": 1e-5}, {"encoder_at": "table", "motor_share": 0.4}]
)
def test_what_the_encoder_at_the_table_sees_is_used(changed: dict[str, float | str]) -> None:
    axis, found = presliding_of("ball_screw", **changed)
    assert found is not None
    assert abs(found.distance_m.value - axis.presliding_m) <= found.distance_m.uncertainty < 0.15 * axis.presliding_m
    assert found.backlash_m is None  # a scale shows it better, and an encoder at the table alone not at all


def test_rigid_axis_has_no_share_at_a_table() -> None:
    axis, found = presliding_of("ball_screw", resonance_Hz=0.0)
    assert found is not None
    assert found.distance_m.value == pytest.approx(axis.presliding_m, rel=0.05)
    assert found.friction_share is None
    assert found.backlash_m is None


def test_force_that_does_not_build_up_by_distance_is_refused() -> None:
    time_s = np.arange(3000) * 7e-4
    way_m = 1e-4 * np.abs(time_s - 0.1)
    scan = Scan(time_s, way_m, None, 50.0 * np.sin(5e5 * way_m))
    ball_screw = load(MACHINES / "ball_screw.toml")
    assert reversal.presliding([scan], *known(ball_screw.x, 1)) is None


def test_what_was_found_before_is_taken_back_first() -> None:
    left_over = {
        "friction_y.breakaway": 1.3, "screw_y.cogging_cos_1": 2.0, "screw_y.error_sin": 1.0,
        "transmission_y.backlash": 10.0, "plant_y.coulomb": 40.0,
    }  # fmt: skip
    with open_drive(Target(machine=load(MACHINES / "ball_screw.toml"), told=LENGTHS)) as device:
        device.parameters.set(left_over)
        first_moves.prepare(device, "y")
        found = {name: float(device.read(name)) for name in left_over}
    assert found == dict.fromkeys(left_over, 0.0) | {"friction_y.breakaway": 1.0}
