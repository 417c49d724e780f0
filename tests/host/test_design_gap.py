# SPDX-License-Identifier: Apache-2.0
"""`kontur design` keeps a loop quiet that is in the gap of its machine, where only the motor's mass is left."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from kontur.design import loop, search
from kontur.design.search import Problem, predicted
from kontur.drive.target import Target
from kontur.errors import EmcyError
from kontur.experiments import machines
from kontur.machine import FULL, NOTHING, Axis, Machine
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.runs.runner import RunOptions, run

MACHINE = dataclasses.replace(machines.draw(2005), name="gap")
# What a search found that looked at closed gaps only: sum and product of the poles, alpha, mu/phi, observer, a filter.
GAINS = np.log([1508.14, 0.24596, 1387.7, 6.0 / 0.004558, 132.85, 0.80381, 0.14749, 1.3288, 0.61181])


def without_gap(machine: Machine) -> Machine:
    def axis(one: Axis) -> Axis:
        return dataclasses.replace(one, backlash_m=0.0)

    return dataclasses.replace(machine, x=axis(machine.x), y=axis(machine.y))


def problem(machine: Machine) -> Problem:
    return Problem(machine, "ccu", FULL, 2.0, 2.0)


def test_a_gap_oscillates_where_the_spring_of_its_describing_function_says() -> None:
    found = problem(MACHINE)
    gains = found.gains(GAINS)
    grid, plants = found.plants(900, 101)
    open_loop = loop.transfer(found.loops(grid, gains)[1], plants[1])
    size = 1.0 / np.abs(1.0 + open_loop)
    at_hz = grid.hz[np.argmax(size, axis=1)][np.max(size, axis=1) > loop.GAP_MS * found.ms]
    case = machines.cases()["part"]
    options = RunOptions(parameters={**found.told, **gains}, score_from_s=case.score_from_s)
    with pytest.raises(EmcyError, match=r"FF1Fh.* y at \d+ Hz") as ended:
        run(plan(case.program, limits(MACHINE)), "ccu", Target(machine=MACHINE, seed=1, told=NOTHING), options)
    seen_hz = float(str(ended.value).rpartition(" y at ")[2].split()[0])
    assert 90.0 < min(at_hz) < seen_hz < max(at_hz) < 135.0  # it depends on how far it swings


def test_a_search_counts_the_loop_in_the_gap_against_its_limit() -> None:
    axes = predicted(problem(MACHINE), problem(MACHINE).gains(GAINS))
    assert axes[1].margins.ms < 2.0 < 4.0 < axes[1].largest
    assert len(axes[1].loops) == len(loop.VARIANTS)
    with_gap, closed = (search._Search(problem(one), 2.0)(GAINS) for one in (MACHINE, without_gap(MACHINE)))
    assert with_gap - closed > search._EXCESS * math.log(1.5)


def test_what_limits_a_design_is_its_gap() -> None:
    found = problem(MACHINE)
    axes = predicted(found, found.gains(GAINS))
    assert search._limit(found, axes, 1.0).startswith("The gap of 12.3 µm of y limits it")


def test_a_spring_that_is_all_but_gone_counts_only_where_no_sensor_is_at_the_table() -> None:
    motor = MACHINE.x
    softest = min(resonance for resonance, _ in loop.variants_of(motor))
    assert softest == 0.2
    for table in (dataclasses.replace(motor, scale_m=1e-8), dataclasses.replace(motor, encoder_at="table")):
        assert min(resonance for resonance, _ in loop.variants_of(table)) == 0.5
        rigid = dataclasses.replace(table, backlash_m=0.0)
        assert loop.variants_of(rigid) == loop.VARIANTS
