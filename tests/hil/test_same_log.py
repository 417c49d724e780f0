# SPDX-License-Identifier: Apache-2.0
"""The paper's circles through the wire give, sample for sample, the logs of the drive in the host's process.

Both are paced by SYNC. In lockstep, the other pace of the drive in the process, SDO transfers take its time, so its
axes get power at another period, and the noise, the observer and the last nanometres are others.
"""

import dataclasses

import numpy as np
import pytest
from targets import Target

from kontur import machine
from kontur.can.bus import open_bus
from kontur.drive.device import connected
from kontur.drive.target import Target as RunTarget
from kontur.experiments.circles import CASES, Case
from kontur.machine import Machine
from kontur.path import shapes
from kontur.planning.bounds import limits
from kontur.planning.planner import Trajectory, plan
from kontur.runs.log import RunLog
from kontur.runs.runner import RunOptions, run

pytestmark = pytest.mark.motion

# What the drive simulates by itself, so that a chip can: not the simulator's double precision.
PLANT = machine.load(machine.MACHINES / "table1_on_chip.toml")
SEED = 7
SHORT_S = 0.3
ONE_STEP = {"smc.lambda": 200.001}  # from 200


def path(case: Case, seconds: float | None = None) -> tuple[Trajectory, Machine]:
    """A case of the paper, or the begin of it, and the plant that stands at its start."""
    program = case.program()
    if seconds is not None:
        program = shapes.circle(case.radius_m, case.feed_mps, duration_s=seconds)
    return plan(program, limits(PLANT)), PLANT.starting_at(program.start_m)


def log_of(target: Target, trajectory: Trajectory, plant: Machine) -> tuple[RunLog, int]:
    """The log of a run on `target`, and for how many ms its drive has been on before."""
    with target.power_on() as drive:
        with connected(open_bus(drive.bus_options), drive.node_id) as device:
            device.parameters.set({"onchip_plant.simulated": 0})
            device.link.wait(lambda: False, 0.01)  # so that it starts anew, where it is told to
            device.parameters.set(plant.parameters(SEED))
            on_for_ms = device.read("clock.tick")
        over_bus = RunTarget(plant, bus=drive.bus_options, node_id=drive.node_id, place_at_start=False)
        return run(trajectory, "ccu", over_bus).log, on_for_ms


def log_in_process(
    trajectory: Trajectory, plant: Machine, on_for_ms: int, parameters: dict[str, float] | None = None
) -> RunLog:
    """The same in this process, on a drive that has been on for as long."""
    options = {"interface": "kontur", "channel": "sim", "pace": "sync", "on_for_ms": on_for_ms}
    in_process = RunTarget(plant, bus=options, seed=SEED)
    return run(trajectory, "ccu", in_process, RunOptions(parameters=parameters or {})).log


def differing(log: RunLog, other: RunLog) -> list[str]:
    """Columns of `log` that are not, row for row and bit for bit, those of `other`, which knows the truth as well."""
    return [
        name for name, column in log.columns.items() if not np.array_equal(column, other.columns[name], equal_nan=True)
    ]


@pytest.fixture(autouse=True)
def wire(target: Target) -> None:
    if not target.simulated:
        pytest.skip("a real drive moves a real machine")
    if not target.outlives_host:
        pytest.skip("this is the drive to compare with")


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_circle_of_the_paper_is_that_in_the_process_sample_for_sample(target: Target, case: Case) -> None:
    trajectory, plant = path(case)
    log, on_for_ms = log_of(target, trajectory, plant)
    in_process = log_in_process(trajectory, plant, on_for_ms)
    assert log.meta["frames_lost"] == 0
    assert len(log.columns["tick"]) > 5000
    assert differing(log, in_process) == []
    apart = {
        name: value
        for name, value in log.meta["parameters"].items()
        if value != in_process.meta["parameters"][name] and name != "pace_select"
    }
    assert apart == {}


def test_another_gain_by_its_smallest_step_gives_another_log(target: Target) -> None:
    trajectory, plant = path(CASES["high-tight"], SHORT_S)
    log, on_for_ms = log_of(target, trajectory, plant)
    assert differing(log, log_in_process(trajectory, plant, on_for_ms)) == []
    assert {"force_x_N", "position_x_mm"} <= set(differing(log, log_in_process(trajectory, plant, on_for_ms, ONE_STEP)))
    other_seed = dataclasses.replace(plant, name="noise of another seed")
    options = {"interface": "kontur", "channel": "sim", "pace": "sync", "on_for_ms": on_for_ms}
    other = run(trajectory, "ccu", RunTarget(other_seed, bus=options, seed=SEED + 1)).log
    assert "position_x_mm" in differing(log, other)
