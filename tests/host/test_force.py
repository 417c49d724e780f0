# SPDX-License-Identifier: Apache-2.0
"""The motion keeps to the force that the axes of a machine have, by an independent check of the knots."""

import math
from dataclasses import replace

import numpy as np
import pytest
from cam_paths import letters, lines_and_arcs, rosette
from knot_spline import ROUNDING, assert_within, greatest_force_N

from kontur.errors import PathError
from kontur.machine import DEFAULT, MACHINES, load
from kontur.path import shapes
from kontur.path.smoothing import TOLERANCE_M
from kontur.planning import planner
from kontur.planning.bounds import Force, clipped, limits, planned
from kontur.planning.checks import PlannerError
from kontur.planning.planner import plan

TABLE1 = load(DEFAULT)
FAST = 0.3


def with_force(share):
    """Table 1 with this share of its force."""
    x, y = (replace(axis, force_limit_N=share * axis.force_limit_N) for axis in TABLE1.axes)
    return replace(TABLE1, x=x, y=y)


def assert_has_the_force(trajectory, machine):
    mass = np.array([axis.mass_kg for axis in machine.axes])
    limit = np.array([axis.force_limit_N for axis in machine.axes])
    assert np.all(greatest_force_N(trajectory, machine) <= 1.001 * limit + mass * ROUNDING[1])


@pytest.mark.parametrize("share", [1.0, 0.6])
@pytest.mark.parametrize("tolerance_m", [0.0, TOLERANCE_M])
@pytest.mark.parametrize(
    "program",
    [shapes.square(0.1, 0.0, FAST), shapes.circle(0.03, FAST), letters(6, feed_mps=FAST), lines_and_arcs(1)],
    ids=["square", "circle", "letters", "random"],
)
def test_no_knot_needs_more_force_than_the_axes_have(program, tolerance_m, share):
    machine = with_force(share)
    assert_has_the_force(plan(program, limits(machine), tolerance_m=tolerance_m), machine)


@pytest.mark.parametrize("name", ["ball_screw", "lead_screw", "long_axis", "stiff_scale"])
def test_nor_on_the_real_machines(name):
    machine = load(MACHINES / f"{name}.toml")
    assert_has_the_force(plan(lines_and_arcs(2), limits(machine), tolerance_m=TOLERANCE_M), machine)


def test_smoothed_paths_use_the_force_at_each_speed():
    machine = with_force(0.5)
    bounds = limits(machine)
    program = rosette(545, FAST)
    trajectory = plan(program, bounds, tolerance_m=TOLERANCE_M)
    assert_has_the_force(trajectory, machine)
    assert_within(trajectory, bounds)
    least = [float(force.gaining_mps2(np.array(FAST))) for force in bounds.force]
    careful = plan(program, replace(bounds, acceleration_mps2=(least[0], least[1])), tolerance_m=TOLERANCE_M)
    assert trajectory.duration_s < 0.9 * careful.duration_s
    assert trajectory.duration_s > plan(program, replace(bounds, force=None), tolerance_m=TOLERANCE_M).duration_s


def test_where_the_force_is_enough_the_knots_stay_what_they_are():
    bounds = limits(TABLE1)
    for program in (shapes.square(0.04, 0.0, 0.1), rosette(244), shapes.circle(0.02, 0.1)):
        for tolerance_m in (0.0, TOLERANCE_M):
            without = plan(program, replace(bounds, force=None), tolerance_m=tolerance_m)
            assert plan(program, bounds, tolerance_m=tolerance_m).digest == without.digest


def test_the_acceleration_of_a_line_is_what_the_force_leaves_at_each_speed():
    force, jerk, top, share = Force(300.0, 100.0, 500.0, 40.0), 80.0, 0.3, 0.8
    a = force.ramp_mps2(share, top, jerk)
    speed = np.linspace(0.0, top, 100_001)
    profile = np.minimum(a, np.sqrt(2.0 * jerk * (top - speed)))
    needed = share * (force.mass_kg * profile + force.viscous_Nspm * speed) + force.coulomb_N
    assert np.max(needed) == pytest.approx(force.limit_N, rel=1e-4)
    assert force.ramp_mps2(0.0, top, jerk) == math.inf
    assert replace(force, viscous_Nspm=0.0).ramp_mps2(1.0, top, jerk) == pytest.approx(2.6)
    assert replace(force, limit_N=3000.0).ramp_mps2(1.0, top, jerk) == math.inf


def test_an_axis_that_friction_holds_back_is_planned_slower_and_told():
    x = replace(TABLE1.x, viscous_Nspm=2400.0)
    machine = replace(TABLE1, x=x)
    bounds = limits(machine)
    assert planned(bounds).velocity_mps[0] == pytest.approx((0.88 * 600.0 - 45.5) / 2400.0)
    assert any("Axis x is planned with 201" in note and "force_limit_N" in note for note in clipped(bounds))
    assert not any("force" in note for note in clipped(limits(TABLE1)))
    assert_has_the_force(plan(shapes.square(0.1, 0.0, FAST), bounds), machine)


def test_an_axis_whose_friction_takes_its_force_is_refused():
    machine = replace(TABLE1, y=replace(TABLE1.y, force_limit_N=60.0))
    with pytest.raises(PathError, match=r"force of axis y: 60 N .* friction of 54.8 N leaves too little"):
        plan(shapes.square(0.01, 0.0, 0.1), limits(machine))


def test_the_planner_s_own_check_looks_at_the_force(monkeypatch):
    monkeypatch.setattr(planner, "planned", lambda bounds: replace(planned(bounds), force=None))
    with pytest.raises(PlannerError, match=r"force of axis y is 1\.0"):
        plan(shapes.square(0.1, 0.0, FAST), limits(TABLE1))
