# SPDX-License-Identifier: Apache-2.0
"""The machine that the drive simulates by itself against the simulator's, and what a file may ask of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from kontur import machine
from kontur.commissioning import first_moves
from kontur.commissioning.first_moves import Agreed, Diagnosis
from kontur.drive.target import Target, open_drive
from kontur.errors import MachineError
from kontur.experiments import on_chip
from kontur.machine import MACHINES, Machine
from kontur.path import shapes
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.runs.runner import run

FILE = MACHINES / "table1_on_chip.toml"
REAL = MACHINES / "ball_screw_on_chip.toml"


def circle(m: Machine, seed: int = 1) -> np.ndarray:
    """True positions (n, 2) in m of 20 mm/s around 4 mm."""
    truth = run(plan(shapes.circle(0.004, 0.02), limits(m)), "ccu", Target(m, seed=seed)).truth
    assert truth is not None
    return truth.pos_m


def test_positions_are_those_of_the_double_precision_plant_slow_and_fast() -> None:
    rows = on_chip.compare(machine.load(FILE))
    assert [(round(row["radius_mm"]), round(row["feed_mm_s"])) for row in rows] == [
        (4, 4),
        (4, 20),
        (4, 100),
        (20, 100),
    ]
    for row in rows:
        assert row["mean_nm"] < 6.0, row
        assert row["max_nm"] < 65.0, row
    assert rows[0]["max_nm"] > 1.0  # two models, not one twice


def test_a_seed_gives_the_same_run_again_and_another_one_another() -> None:
    chip = machine.load(FILE)
    first = circle(chip)
    np.testing.assert_array_equal(first, circle(chip))
    assert not np.array_equal(first, circle(chip, seed=2))


def test_axes_with_a_mode_go_as_those_of_the_double_precision_plant() -> None:
    """But for the number of slip elements, 8 for 10, whose difference the loop holds below some hundred nanometres."""
    row = on_chip.compare(machine.load(REAL), circles=[(0.004, 0.02)])[0]
    assert 5.0 < row["mean_nm"] < 60.0, row
    assert row["max_nm"] < 400.0, row


@pytest.mark.parametrize("num", ["f32", "fix"])
def test_drive_is_told_what_the_axes_of_its_own_machine_have(num: str) -> None:
    chip = machine.load(REAL)
    told = chip.parameters(told=machine.NOTHING)
    with open_drive(Target(chip, num=num, told=machine.NOTHING)) as device:
        for name, value in told.items():
            assert device.read(name) == pytest.approx(value, rel=1e-4), name
    assert told["onchip_axis_x.resonance"] == 90.0
    assert told["onchip_axis_y.presliding"] == pytest.approx(18.0)
    assert told["onchip_axis_x.encoder"] == pytest.approx(0.07629)
    assert "plant_x.encoder" not in told


def test_index_pulses_and_a_wrong_length_are_seen_on_the_machine_on_the_chip() -> None:
    """The drive counts in its own length, whatever the true one is."""
    chip = machine.load(REAL)
    with open_drive(Target(chip, told=machine.LENGTHS)) as device:
        device.parameters.set({"plant_x.encoder": 0.5 * chip.x.encoder_m * 1e6, "plant_x.mass": chip.x.mass_kg})
        device.select_controller("cascade")
        device.parameters.set(first_moves.FIRM | {"following_window_x": first_moves.MEASURE_NM})
        with pytest.raises(Diagnosis, match=r"wrong by a factor of 2\b.*plant_x.encoder=0.07628"):
            first_moves.length_factor(device, "x", Agreed(350.0, index_m=chip.x.index_m), lambda: False)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('model = "on_chip"', 'model = "chip"', "model: must be one of full, on_chip, is 'chip'"),
        ("start_m = 0.0", "scale_m = 1e-7", "x.scale_m: must be left out with model 'on_chip'"),
        ("start_m = 0.0", "backlash_m = 1e-5", "x.backlash_m: needs resonance_Hz with model 'on_chip'"),
        (
            "centripetal_step",
            "friction_schedule = {rows = [[1, 2]]}\ncentripetal_step",
            "friction_schedule: must be left out",
        ),
    ],
)
def test_what_the_drives_own_model_does_not_have_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = tmp_path / "machine.toml"
    file.write_text(FILE.read_text().replace(old, new))
    with pytest.raises(MachineError, match=message):
        machine.load(file)
