# SPDX-License-Identifier: Apache-2.0
"""A path begins where the axes are held, however stiff the loop is: within the window of its start they go there first.

A step of the reference by some µm saturates the force of stiff gains, and not all come to rest from there.
"""

from pathlib import Path

import numpy as np
import pytest

from kontur import machine
from kontur.drive.target import Target, tell
from kontur.path.geometry import Line, Move, Program
from kontur.planning.bounds import Limits, limits
from kontur.planning.planner import plan
from kontur.runs.runner import RunOptions, run
from kontur.sim import process

MACHINE = machine.load()
STIFF = {"cascade.position_gain": 300.0, "cascade.velocity_gain": 900.0, "cascade.integral_gain": 100.0}
OFF_M = 9.5e-6  # of limits.start_window, 10 µm
START_M = (0.01, 0.0)


@pytest.mark.parametrize("approach", [None, limits(MACHINE)])
def test_path_begins_without_a_step_of_the_force_where_the_axes_stand_in_its_start_window(
    approach: Limits | None, tmp_path: Path
) -> None:
    program = Program("line", (Move(Line(START_M, (0.0105, 0.0)), 0.002),), START_M)
    stands = MACHINE.starting_at((START_M[0] + OFF_M, START_M[1]))
    record = tmp_path / "truth"
    with process.start(slcan_tcp="0", pace="sync", machine=stands, record=record) as drive:
        target = Target(machine=MACHINE, bus=drive.options())
        tell(target)
        options = RunOptions(parameters=STIFF, approach=approach)
        assert run(plan(program, limits(MACHINE)), "cascade", target, options).completed
    greatest_N = np.abs(process.read_record(record).force_N).max(axis=0)
    assert OFF_M * MACHINE.x.mass_kg * 300.0 * 900.0 > 220.0  # what a step asks for
    assert greatest_N[0] < 120.0
