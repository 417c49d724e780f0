# SPDX-License-Identifier: Apache-2.0
"""The force that was agreed is the most that the first moves and the identification take, whatever the axis is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kontur.can.simulated import simulated
from kontur.commissioning import first_moves
from kontur.commissioning.first_moves import Agreed, Diagnosis
from kontur.commissioning.identify import _expected_N, identify
from kontur.commissioning.session import identify_axes
from kontur.drive.target import Target, open_drive
from kontur.machine import LENGTHS, MACHINES, Machine, load

LONG_AXIS, BALL_SCREW = (load(MACHINES / f"{name}.toml") for name in ("long_axis", "ball_screw"))


def loose(machine: Machine) -> Machine:
    """Its encoder is at the table of x, behind a gap of a millimetre."""
    return replace(machine, x=replace(machine.x, backlash_m=1e-3, encoder_at="table"))


def test_axis_behind_a_gap_gets_no_more_force_than_was_agreed() -> None:
    with open_drive(Target(machine=loose(LONG_AXIS), told=LENGTHS)) as device:
        sim = simulated(device.link.bus)
        assert sim is not None
        device.parameters.set({"plant_x.force_limit": 1600.0})
        sim.start_recording()
        with pytest.raises(Diagnosis, match="loose"):
            identify(device, "x", Agreed(800.0))
        truth = sim.take_truth()
    assert np.max(np.abs(truth.force_N)) <= 800.0
    assert np.ptp(truth.pos_m[:, 0]) < 0.005


def test_limit_of_the_drive_is_the_agreed_force_and_comes_back() -> None:
    said: list[str] = []
    seen: list[tuple[float, float]] = []
    names = ("plant_x.force_limit", "profile_acceleration_x")
    with open_drive(Target(machine=BALL_SCREW, told=LENGTHS)) as device:
        device.parameters.set({"plant_x.force_limit": 600.0})
        before = [device.read(name) for name in names]

        def say(text: str) -> None:
            said.append(text)
            seen.append((device.read(names[0]), device.read(names[1])))

        with pytest.raises(KeyboardInterrupt):
            identify_axes(device, {"x": Agreed(150.0)}, {}, say, lambda: "lost motion" in said[-1])
        assert seen[-1][0] == 150.0
        assert seen[-1][1] * 1e-6 * BALL_SCREW.x.mass_kg < 0.5 * (150.0 - BALL_SCREW.x.coulomb_N)
        assert [device.read(name) for name in names] == before


def test_force_that_is_hardly_enough_to_move_is_told() -> None:
    with open_drive(Target(machine=BALL_SCREW, told=LENGTHS)) as device:
        with pytest.raises(Diagnosis, match=r"breaks away at \d+ N, and 85 N are allowed.*--force") as caught:
            identify(device, "x", Agreed(85.0))
        assert device.read("plant_x.force_limit") == 600.0
    assert caught.value.kind == "force"


def test_speeds_end_where_their_friction_would_take_too_much_of_the_force() -> None:
    assert _expected_N([], 0.2) == _expected_N([(0.1, 90.0, 1.0)], 0.2) == 0.0
    assert _expected_N([(0.05, 60.0, 1.0), (0.1, 90.0, 1.0)], 0.2) == pytest.approx(150.0)
    assert _expected_N([(0.001, 60.0, 1.0), (0.002, 50.0, 1.0)], 0.2) == 50.0  # it falls with the speed at first


def test_force_is_bound_also_where_the_drive_allows_less() -> None:
    with open_drive(Target(machine=BALL_SCREW, told=LENGTHS)) as device:
        device.parameters.set({"plant_x.force_limit": 120.0})
        first_moves.bind(device, "x", Agreed(300.0), 100.0, 60.0)
        assert device.read("plant_x.force_limit") == 120.0
