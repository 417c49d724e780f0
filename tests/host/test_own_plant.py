# SPDX-License-Identifier: Apache-2.0
"""Machines in Python: in lockstep with the firmware, the same each time, and their errors are told."""

from __future__ import annotations

import math
import runpy
from pathlib import Path

import numpy as np
import pytest

from kontur import machine as machines
from kontur.drive.target import Target
from kontur.errors import KonturError
from kontur.path import shapes
from kontur.planning.bounds import limits
from kontur.planning.planner import Trajectory, plan
from kontur.runs.runner import RunResult, run
from kontur.sim.bus import KonturBus

MACHINE = machines.load()
ROOT = Path(__file__).parents[2]


class Mass:
    """90 kg with viscous friction; it keeps what it is asked for."""

    def __init__(self, start_m: tuple[float, float], period_s: float) -> None:
        self.position_m, self.velocity_mps = np.array(start_m), np.zeros(2)
        self.period_s = period_s
        self.forces: list[tuple[float, float]] = []
        self.positions: list[np.ndarray] = []

    def step(self, force_N: tuple[float, float]) -> np.ndarray:
        self.velocity_mps = self.velocity_mps + (np.array(force_N) - 200.0 * self.velocity_mps) / 90.0 * self.period_s
        self.position_m = self.position_m + self.velocity_mps * self.period_s
        self.forces.append(force_N)
        self.positions.append(self.position_m)
        return self.position_m


@pytest.fixture(scope="module")
def trajectory() -> Trajectory:
    return plan(shapes.circle(0.0005, 0.05), limits(MACHINE))


def circle(trajectory: Trajectory, plant: object) -> RunResult:
    return run(trajectory, "ccu", Target(MACHINE, plant=plant))  # type: ignore[arg-type]


def test_firmware_moves_the_plant_period_by_period(trajectory: Trajectory) -> None:
    made: list[Mass] = []

    def make(start_m: tuple[float, float], period_s: float) -> Mass:
        made.append(Mass(start_m, period_s))
        return made[-1]

    result = circle(trajectory, make)
    assert result.completed
    assert result.truth is not None
    assert made[0].period_s == 1e-4
    positions, forces = np.array(made[0].positions), np.array(made[0].forces)
    count = len(result.truth.pos_m)
    first = next(i for i in range(len(positions) - count) if np.array_equal(positions[i], result.truth.pos_m[0]))
    np.testing.assert_array_equal(result.truth.pos_m, positions[first : first + count])
    np.testing.assert_array_equal(result.truth.force_N[:-1], forces[first + 1 : first + count])
    reference = np.hypot(result.log.columns["reference_x_mm"], result.log.columns["reference_y_mm"])
    assert np.ptp(result.log.columns["reference_x_mm"]) > 0.9
    assert reference.max() < 1.1
    assert np.abs(result.log.columns["true_contour_error_um"]).max() < 5.0


def test_equal_plants_give_equal_logs(trajectory: Trajectory) -> None:
    first, second = (circle(trajectory, Mass).log for _ in range(2))
    for name, values in first.columns.items():
        np.testing.assert_array_equal(values, second.columns[name], err_msg=name)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda force_N: 1 / 0, "the plant in Python failed: ZeroDivisionError: division by zero"),
        (lambda force_N: (math.nan, 0.0), "the position became nan, 0 m; it must be two finite numbers"),
        (lambda force_N: (1.0,), "not enough values to unpack"),
    ],
)
def test_error_of_the_plant_is_told(wrong: object, message: str) -> None:
    class Wrong:
        def __init__(self, start_m: tuple[float, float], period_s: float) -> None:
            self.step = wrong

    bus = KonturBus(plant=Wrong)  # type: ignore[arg-type]
    with pytest.raises(KonturError, match=message):
        bus.sim.run(10)


def test_example_with_python_control_runs(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("control", reason="no python-control; get it by: pip install control")
    runpy.run_path(str(ROOT / "examples/own_plant.py"), run_name="__main__")
    means = [float(line.split()[2]) for line in capsys.readouterr().out.splitlines()]
    assert len(means) == 2
    assert max(means) < 20.0


def test_example_of_a_law_in_python_runs(capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(ROOT / "examples/own_law.py"), run_name="__main__")
    words = capsys.readouterr().out.split()
    assert 1.0 < float(words[words.index("mean") + 1]) < 10.0  # a law that does nothing is 40 mm off
