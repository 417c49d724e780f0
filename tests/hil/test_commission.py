# SPDX-License-Identifier: Apache-2.0
"""Steps of a commissioning on every simulated drive: a machine with a mode, of which the drive knows only lengths.

The whole takes too long for this suite (docs/commissioning.md has its figures); these are steps of each of its kinds.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from rig import Rig
from targets import Target

from kontur import machine
from kontur.commissioning import first_moves, response

ON_CHIP = machine.load(machine.MACHINES / "ball_screw_on_chip.toml")
FULL = dataclasses.replace(ON_CHIP, model="full")  # a target that simulates the machine on the drive says so itself
FORCE_N = 200.0

pytestmark = pytest.mark.motion


def test_mass_and_first_mode_are_measured_by_the_drive(target: Target) -> None:
    with target.power_on(plant=FULL) as drive, Rig(drive) as rig:
        device = rig.device
        device.select_controller("cascade")
        first_moves.prepare(device, "x")
        mass_kg, coulomb_N = first_moves.rough(device, "x", FORCE_N, lambda: False)
        assert mass_kg == pytest.approx(FULL.x.mass_kg, rel=0.1)
        assert coulomb_N == pytest.approx(FULL.x.coulomb_N, rel=0.3)
        device.parameters.set(first_moves.FIRM | {"plant_x.mass": mass_kg, "plant_x.coulomb": 0.8 * coulomb_N})
        setup = response.Setup((30.0, FULL.x.resonance_Hz), 16.0, 0.03, 0.4, 2, 0.2)
        with first_moves.moving(device, "x", lambda: False) as mover:
            found = response.measure(device, "x", setup, stop_requested=mover.stop_requested)
        masses_kg = 1.0 / np.abs(found.plant[0]) / (2.0 * np.pi * found.hz) ** 2
        assert masses_kg[0] > 0.7 * FULL.x.mass_kg
        assert masses_kg[1] < 0.3 * FULL.x.mass_kg, "the motor swings against the table"
