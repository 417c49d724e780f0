# SPDX-License-Identifier: Apache-2.0
"""`tools/linear_bound.py`: its least errors are those of closed forms, and its measures are those of kontur.design."""

from __future__ import annotations

import json
from pathlib import Path

import linear_bound
import numpy as np
import pytest
from linear_bound import Affine, Controllers, least, norm

from kontur.design import loop
from kontur.design.search import Problem
from kontur.experiments import machines
from kontur.machine import FULL, Axis

HZ = 10_000
ORDERS = (20, 20)
COUNTS_M = (1e-9, 0.0)
RIGID = Axis(
    mass_kg=10.0, viscous_Nspm=50.0, coulomb_N=1.0, force_limit_N=100.0, encoder_m=1e-9, travel_m=(-0.1, 0.1),
    soft_limit_m=(-0.09, 0.09), velocity_mps=0.1, acceleration_mps2=1.0, jerk_mps3=10.0,
)  # fmt: skip
CAREFUL = {"cascade.position_gain": 40.0, "cascade.velocity_gain": 80.0, "cascade.integral_gain": 30.0,
           "observer.bandwidth": 2000.0}  # fmt: skip


def grid() -> loop.Grid:
    return loop.Grid.at(np.unique(np.concatenate([np.geomspace(1.0, 5000.0, 150), np.linspace(50.0, 5000.0, 150)])), HZ)


def test_the_least_distance_to_a_disc_is_along_its_normal() -> None:
    """|x - 3|, |x| <= 2: 1 at x = 2."""
    none = Affine(np.zeros((1, 1)), np.array([0.0]))
    error = Affine(np.array([[1.0 + 0j]]), np.array([-3.0 + 0j]))
    size = Affine(np.array([[1.0 + 0j]]), np.array([0j]))
    x = least(error, none, 1.0, size, Affine(none.a, np.array([2.0])), np.array([0.1]))
    assert x[0] == pytest.approx(2.0, rel=2e-2)
    assert x[0] < 2.0


def test_the_effort_is_kept() -> None:
    """(x - 3)^2 + (y - 4)^2, |(x, y)| <= 1: at (0.6, 0.8)."""
    one = np.eye(2, dtype=complex)
    free = Affine(np.zeros((1, 2)), np.array([1e6]))
    size = Affine(np.zeros((1, 2), dtype=complex), np.array([0j]))
    x = least(Affine(one, np.array([-3.0 + 0j, -4.0])), Affine(one, np.zeros(2)), 1.0, size, free, np.array([0.0, 0.1]))
    assert x == pytest.approx([0.6, 0.8], rel=1e-2)


def test_a_half_plane_is_kept() -> None:
    """|x - 3| with |1| <= 5 - 2 x: x <= 2."""
    none = Affine(np.zeros((1, 1)), np.array([0.0]))
    size = Affine(np.zeros((1, 1), dtype=complex), np.array([1.0 + 0j]))
    error = Affine(np.array([[1.0 + 0j]]), np.array([-3.0 + 0j]))
    x = least(error, none, 1.0, size, Affine(np.array([[-2.0]]), np.array([5.0])), np.array([0.0]))
    assert x[0] == pytest.approx(2.0, rel=1e-2)


def test_a_first_x_outside_the_limits_is_refused() -> None:
    none = Affine(np.zeros((1, 1)), np.array([0.0]))
    size = Affine(np.array([[1.0 + 0j]]), np.array([0j]))
    with pytest.raises(ValueError, match="keep the limits"):
        least(size, none, 1.0, size, Affine(none.a, np.array([2.0])), np.array([2.1]))


@pytest.mark.parametrize("delay", [1, 2])
def test_the_least_variance_is_that_of_what_comes_before_any_answer(delay: int) -> None:
    """Minimum variance: K. J. Astrom, Introduction to Stochastic Control Theory (1970), chapter 6.

    A disturbance of the position, the sum of white noise of variance 1, leaves a variance of one for each period until
    the force acts: the delay, and one more. The zero of the plant near -1 makes the way to it slow.
    """
    of = grid()
    controllers = Controllers(of, RIGID, delay, COUNTS_M, 0, ORDERS)
    error = controllers.s.times(np.sqrt(2.0 / HZ * linear_bound.weights(of.hz)) / (1.0 - of.z_inverse))
    far = Affine(np.zeros_like(controllers.s.a), np.full(len(of.hz), 100.0))
    x = least(error, controllers.change, 1e6, controllers.s, far, np.zeros(controllers.s.a.shape[1]))
    variance = norm(error, x) ** 2
    assert 0.995 * (delay + 1) <= variance <= 1.1 * (delay + 1)


@pytest.fixture(scope="module")
def ball_screw() -> tuple[Problem, loop.Grid, Axis, loop.Law]:
    machine = {one.name: one for one in machines.packaged()}["Ball screw, motor encoders"]
    problem = Problem(machine, "cascade", FULL, 2.0, 2.0)
    of = loop.Grid.around(machine.axes, problem.control_hz)
    return problem, of, machine.x, problem.loops(of, CAREFUL)[0]


def test_its_measures_are_those_of_the_design(ball_screw: tuple[Problem, loop.Grid, Axis, loop.Law]) -> None:
    problem, of, axis, law = ball_screw
    controllers = Controllers(of, axis, 1, problem.counts_m[0], 0, ORDERS)
    error_m, x = controllers.design(law)
    plant = loop.plant(of, axis, 1)
    loops = loop.transfer(law, plant)
    s = 1.0 / (1.0 + loops[0])
    assert error_m == pytest.approx(loop.reversal_error(of, axis, 0, law, plant, s), rel=1e-9)
    assert norm(controllers.error, x) == pytest.approx(error_m, rel=0.02)
    change_N = loop.force_change(of, problem.counts_m[0], law, s)
    assert norm(controllers.change, x) == pytest.approx(change_N, rel=0.02)
    assert controllers.ms(x) == pytest.approx(loop.margins(of, loops).ms, rel=0.02)


def test_what_is_reached_keeps_all_limits_and_lies_between_the_bound_and_the_design(
    ball_screw: tuple[Problem, loop.Grid, Axis, loop.Law],
) -> None:
    """And the area under log |S| is not negative, which is Bode's integral for loops with a delay (C. Mohtadi, Proc.
    IEE D 137 (1990) 57): zero where the controller is stable by itself."""
    problem, of, axis, law = ball_screw
    controllers = Controllers(of, axis, 1, problem.counts_m[0], 0, (12, 10))
    error_m, x = controllers.design(law)
    reached = controllers.reach(x, 1.0)
    assert controllers.ms(reached) <= 2.0
    assert norm(controllers.change, reached) <= 1.0
    bound = controllers.bound(reached)
    assert np.max(np.abs(controllers.s(bound))) <= 2.0
    assert norm(controllers.error, bound) < norm(controllers.error, reached) < error_m
    log_s = np.log(np.abs(controllers.s(bound)))
    below, above = (float(np.trapezoid(part, of.hz)) for part in (np.minimum(log_s, 0.0), np.maximum(log_s, 0.0)))
    assert above > -0.98 * below


def test_a_file_that_is_no_result_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "wrong.json"
    file.write_text(json.dumps({"machines": [{"name": "none"}]}))
    assert linear_bound.main([str(file)]) == 2
    assert "kontur experiment machines --json" in capsys.readouterr().err
