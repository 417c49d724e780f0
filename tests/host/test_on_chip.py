# SPDX-License-Identifier: Apache-2.0
"""The machine that the drive simulates by itself against the simulator's, and what a file may ask of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from kontur import machine
from kontur.drive.target import Target
from kontur.errors import MachineError
from kontur.experiments import on_chip
from kontur.machine import MACHINES, Machine
from kontur.path import shapes
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.runs.runner import run

FILE = MACHINES / "table1_on_chip.toml"


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


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('model = "on_chip"', 'model = "chip"', "model: must be one of full, on_chip, is 'chip'"),
        ("breakaway = 1.0", "breakaway = 1.5", "x.breakaway: must be 1 with model 'on_chip'"),
        ("current_lag_s = 0.0", "current_lag_s = 0.001", "x.current_lag_s: must be 0 with model 'on_chip'"),
        ("delay_periods = 1", "delay_periods = 2", "delay_periods: must be 1 with model 'on_chip'"),
    ],
)
def test_what_the_drives_own_model_does_not_have_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = tmp_path / "machine.toml"
    file.write_text(FILE.read_text().replace(old, new))
    with pytest.raises(MachineError, match=message):
        machine.load(file)
