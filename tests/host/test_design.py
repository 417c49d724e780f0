# SPDX-License-Identifier: Apache-2.0
"""`kontur design`: the loop that it computes with is the firmware's and the machine's, and its margins hold."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from kontur.cli import main
from kontur.design import loop, search
from kontur.design.search import Problem, predicted
from kontur.drive import parameter_file
from kontur.drive.controllers import CONTROLLERS
from kontur.drive.target import Target
from kontur.experiments import demo, machines
from kontur.machine import FULL, MACHINES, Axis, Machine, load
from kontur.path import shapes
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.runs.log import read
from kontur.runs.runner import RunOptions, run
from kontur.runs.summary import summarise
from kontur.sim import library

CONTROL_HZ = 10_000
# Modulus margins of the default gains on Table 1, computed by hand before there was this command.
MODULUS = {
    ("ccu", 0.0): 0.57,
    ("ccu", 5e-4): 0.30,
    ("ccu", 1e-3): 0.11,
    ("cascade", 0.0): 0.74,
    ("cascade", 1e-3): 0.52,
}


def only(machine: Machine, **values: float) -> Machine:
    """The machine with these values of both axes."""
    return dataclasses.replace(
        machine, x=dataclasses.replace(machine.x, **values), y=dataclasses.replace(machine.y, **values)
    )


def loop_of(axis: Axis, law: loop.Law, grid: loop.Grid) -> loop.Complex:
    return loop.transfer(law, loop.plant(grid, axis, 1, [(1.0, 1.0)]))


@pytest.mark.parametrize(("controller", "lag_s"), MODULUS)
def test_margins_of_default_gains_are_those_known(controller: str, lag_s: float) -> None:
    machine = only(load(), current_lag_s=lag_s)
    problem = Problem(machine, controller, "full", 2.0, 2.0)
    grid = loop.Grid.around(machine.axes, CONTROL_HZ, points=600)
    law = problem.loops(grid, {})[0]
    open_loop = loop_of(machine.x, law, grid)
    assert loop.stable(grid, machine.x, law, open_loop)
    assert 1.0 / loop.margins(grid, open_loop, [(1.0, 1.0)]).ms == pytest.approx(MODULUS[controller, lag_s], abs=0.005)


def test_the_law_of_a_cascade_is_its_closed_form_whatever_the_screw() -> None:
    """M K_v (s + K_p) (1 + K_i / s). What cancels ripple would look like a spring of 195 N/mm beside 256."""
    machine = machines.draw(518)
    gains = {"cascade.position_gain": 28.0, "cascade.velocity_gain": 52.0, "cascade.integral_gain": 12.0}
    k_p, k_v, k_i = gains.values()
    grid = loop.Grid.at(np.geomspace(1.0, 15.0, 12), CONTROL_HZ)
    s = 2j * np.pi * grid.hz
    for axis, law in zip(machine.axes, Problem(machine, "cascade", FULL, 2.0, 2.0).loops(grid, gains), strict=True):
        expected = -axis.mass_kg * k_v * (s + k_p) * (1.0 + k_i / s)
        assert law.force[0] == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("stiffness", [0.0, 8000.0])
def test_the_law_of_ccu_leaves_a_rigid_mass_with_these_four_poles(stiffness: float) -> None:
    """1 + L = ((s + A) (s + k) + B) (s + alpha) (s + mu/phi) / s^4 with A = lambda + beta gamma but for the observer.

    Without B, the stiffness, all are real. With it two may be complex, as those of a cascade are (docs/adr/0084).
    """
    machine = only(load(MACHINES / "ball_screw.toml"), viscous_Nspm=0.0, encoder_m=1e-8)
    problem, (a, k, alpha, ratio) = Problem(machine, "ccu", FULL, 2.0, 2.0), (100.0, 120.0, 90.0, 110.0)
    grid = loop.Grid.at(np.geomspace(2.0, 20.0, 12), CONTROL_HZ)
    gains = {"smc.lambda": a, "smc.k_0": k, "smc.k_max": k, "smc.zeta": k, "smc.beta": 0.0, "smc.stiffness": stiffness}
    gains |= {"compensator.alpha": alpha, "compensator.mu_0": 6.0, "compensator.mu_max": 6.0}
    gains |= {"compensator.phi": 6.0 / ratio, "observer.bandwidth": 5000.0}
    s = 2j * np.pi * grid.hz
    one_plus_l = ((s + a) * (s + k) + stiffness) * (s + alpha) * (s + ratio) / s**4
    for axis, law in zip(machine.axes, problem.loops(grid, gains), strict=True):
        assert law.force[0] == pytest.approx(-axis.mass_kg * s**2 * (one_plus_l - 1.0), rel=0.05)


def test_a_loop_with_more_lag_than_its_delay_margin_is_unstable() -> None:
    machine = only(load(), current_lag_s=0.003)
    grid = loop.Grid.around(machine.axes, CONTROL_HZ)
    law = Problem(machine, "ccu", "full", 2.0, 2.0).loops(grid, {})[0]
    assert not loop.stable(grid, machine.x, law, loop_of(machine.x, law, grid))


def test_the_response_of_the_law_is_linear_and_ends_as_extrapolated(monkeypatch: pytest.MonkeyPatch) -> None:
    objects = [(0x2110, 10, 0), (0x2111, 4, 0)]  # no adaptation
    small, large = (library.response(objects, 2, counts, 1024) / counts for counts in (3, 13))
    assert small == pytest.approx(large, abs=1e-4 * float(np.max(np.abs(large))))
    machine = load()
    grid = loop.Grid.around(machine.axes, CONTROL_HZ)
    encoder_m = [axis.encoder_m for axis in machine.axes]
    short = loop.laws(grid, objects, 2, encoder_m)[0]
    monkeypatch.setattr(loop, "_PERIODS", 8192)
    long = loop.laws(loop.Grid.around(machine.axes, CONTROL_HZ), objects, 2, encoder_m)[0]
    assert np.max(np.abs(short.force[0] / long.force[0] - 1.0)[grid.hz > 5.0]) < 0.005


def test_the_transform_of_a_response_is_the_sum_over_its_periods() -> None:
    grid = loop.Grid.around([], CONTROL_HZ, points=300)
    response = np.random.default_rng(1).normal(size=1024)
    expected = np.exp(-2j * np.pi * np.outer(grid.hz, np.arange(1024)) / CONTROL_HZ) @ response
    assert np.max(np.abs(loop._sum(grid, response) - expected)) < 1e-9 * np.max(np.abs(expected))


def test_an_object_that_the_firmware_does_not_have_or_accept_is_refused() -> None:
    for objects in (
        [(0x2110, 99, 1)],
        [(0x3000, 0, 1)],
        [(0x2110, 1, -1)],
        [(0x2110, 7, 500_000), (0x2110, 8, 400_000)],
    ):
        with pytest.raises(ValueError, match="out of range, or"):
            library.response(objects, 2, 1, 4)
    with pytest.raises(ValueError, match="out of range, or"):
        library.response([], 99, 1, 4)


@pytest.mark.parametrize("at", ["motor", "table"])
def test_the_plant_is_the_closed_form_of_two_masses_with_hold_lag_and_delay(at: str) -> None:
    hz, lag_s = 62.5, 4e-4
    axis = dataclasses.replace(
        load(MACHINES / "ball_screw.toml").x, viscous_Nspm=0.0, encoder_at=at, current_lag_s=lag_s, friction_share=1.0
    )
    grid = loop.Grid.at(np.array([hz]), CONTROL_HZ)
    plant = loop.plant(grid, axis, 2, [(1.0, 1.0)])
    s, motor_kg, table_kg = 2j * np.pi * hz, 50.0, 50.0
    omega = 2.0 * np.pi * axis.resonance_Hz
    spring = 25.0 * (omega**2 + 2.0 * axis.resonance_damping * omega * s)
    both = s**2 * (motor_kg * table_kg * s**2 + axis.mass_kg * spring)
    of_motor = (table_kg * s**2 + spring if at == "motor" else spring) / both
    of_table = (spring if at == "motor" else motor_kg * s**2 + spring) / both
    hold = np.exp(-1j * np.pi * hz / CONTROL_HZ) * np.sinc(hz / CONTROL_HZ)
    assert plant.force[0, 0, 0] == pytest.approx(of_motor * hold * grid.z_inverse[0] ** 2 / (1.0 + lag_s * s), rel=2e-3)
    assert plant.friction[0, 0, 0] == pytest.approx(of_table * hold, rel=2e-3)


def test_the_resonance_of_the_plant_is_where_the_machine_says() -> None:
    axis = load(MACHINES / "ball_screw.toml").x
    grid = loop.Grid.around([axis], CONTROL_HZ, near=201)
    near = (grid.hz > 60.0) & (grid.hz < 130.0)
    size = np.abs(loop.plant(grid, axis, 1, [(1.0, 1.0)]).force[0, 0][near])
    assert grid.hz[near][int(np.argmax(size))] == pytest.approx(axis.resonance_Hz, rel=0.01)


def test_a_design_keeps_its_limits_and_runs_quietly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "_GENERATIONS", 12)
    monkeypatch.setattr(search, "_DAMPED", ())
    file, machine = tmp_path / "params.toml", MACHINES / "ball_screw.toml"
    done = CliRunner().invoke(
        main, ["design", str(machine), "--controller", "cascade", "-o", str(file), "--json"], catch_exceptions=False
    )
    assert done.exit_code == 0, done.output
    found = json.loads(done.output)["designs"][0]
    assert all(axis["ms"] <= 2.005 for axis in found["axes"].values())
    assert found["force_step_N"] <= 2.005
    assert "resonance" in found["limit"]
    assert file.with_suffix(".svg").read_text().startswith("<?xml")
    assert "math" not in file.with_suffix(".svg").read_text()  # the decades are numbers
    values = parameter_file.read(file)
    plain = load(machine)
    again = predicted(Problem(plain, "cascade", "full", 2.0, 2.0), values)
    assert again[0].margins.ms == pytest.approx(found["axes"]["x"]["ms"])
    circle = plan(shapes.circle(0.004, 0.1, duration_s=0.6), limits(plain))
    log = run(circle, "cascade", Target(machine=plain), RunOptions(parameters=values, score_from_s=0.3)).log
    assert log.meta["force_step_N"] < 1.6 * found["force_step_N"]  # force noise and ripple besides the counts
    assert log.meta["force_max_N"] < 450.0


def test_limits_that_no_gains_keep_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "_GENERATIONS", 2)
    monkeypatch.setattr(search, "_DAMPED", ())
    file = tmp_path / "params.toml"
    done = CliRunner().invoke(
        main,
        ["design", str(MACHINES / "lead_screw.toml"), "--controller", "track", "--force-step", "1e-9", "-o", str(file)],
    )
    assert done.exit_code == 1
    assert "no gains of track keep" in done.output
    assert "--force-step" in done.output
    assert not file.exists()


def test_two_encoders_share_the_loop_by_their_crossover() -> None:
    machine = load(MACHINES / "stiff_scale.toml")
    grid = loop.Grid.around(machine.axes, CONTROL_HZ)
    values = load().gains | {"second_encoder_x.crossover": 25.0}
    dual = Problem(machine, "cascade", "full", 2.0, 2.0).loops(grid, values)[0].force
    alone = Problem(machine, "cascade", "rigid", 2.0, 2.0).loops(grid, values)[0].force
    assert not np.any(alone[1])
    assert np.max(np.abs(np.sum(dual, axis=0) / alone[0] - 1.0)[grid.hz > 5.0]) < 0.02
    share = np.abs(dual[1] / np.sum(dual, axis=0))
    assert share == pytest.approx(1.0 / np.hypot(1.0, grid.hz / 25.0), abs=0.02)


def test_each_axis_has_its_turn_along_the_normal() -> None:
    """Under ccc the loop along the normal has more gain: x and y swapped give the same loops, swapped."""
    values = {"cascade.coupling_gain": 2.0, "force_filter_x.pole_1": 300.0, "force_filter_x.zero_1": 200.0}
    machine = load(MACHINES / "ball_screw.toml")
    problem = Problem(machine, "ccc", "full", 2.0, 2.0)
    grid = loop.Grid.around(machine.axes, CONTROL_HZ, points=20, near=1)
    along_x, normal_y, normal_x, along_y = [law.force[0] for law in problem.loops(grid, values)]
    assert [(place.number, place.axis is machine.x) for place in problem.places] == [
        (0, True), (1, False), (1, True), (0, False)
    ]  # fmt: skip
    high = grid.hz > 300.0
    assert np.all(np.abs(normal_x[high]) > 1.5 * np.abs(along_x[high]))
    assert np.all(np.abs(normal_y[high]) > 1.5 * np.abs(along_y[high]))
    plain = Problem(machine, "ccc", "full", 2.0, 2.0).loops(grid, {"cascade.coupling_gain": 2.0})
    assert np.max(np.abs(plain[2].force[0] / normal_x - 1.0)) > 0.1  # the filter of x goes with x
    assert np.max(np.abs(plain[3].force[0] / along_y - 1.0)) < 1e-3


def test_run_uses_a_file_of_parameters_and_set_goes_before_it(tmp_path: Path) -> None:
    file, log = tmp_path / "params.toml", tmp_path / "log.csv"
    file.write_text("[smc]\nlambda = 150.0\nk_0 = 90.0\n[observer]\nbandwidth = 900.0\n")
    done = CliRunner().invoke(
        main,
        [
            "run",
            "circle",
            "--radius",
            "1",
            "--feed",
            "20",
            "--params",
            str(file),
            "--set",
            "smc.k_0=80",
            "--log",
            str(log),
        ],
        catch_exceptions=False,
    )
    assert done.exit_code == 0, done.output
    used = read(log).meta["parameters"]
    assert (used["smc.lambda"], used["smc.k_0"], used["observer.bandwidth"]) == (150.0, 80.0, 900.0)
    file.write_text("[smc]\nlambda = 1e9\n")
    done = CliRunner().invoke(main, ["run", "circle", "--radius", "1", "--feed", "20", "--params", str(file)])
    assert done.exit_code == 1
    assert "smc.lambda" in done.output


def test_the_second_encoder_corrects_the_screw_up_to_the_crossover() -> None:
    """Once a turn of 10 mm at 100 mm/s is 10 Hz."""
    machine = load(MACHINES / "stiff_scale.toml")
    grid = loop.Grid.around(machine.axes, CONTROL_HZ)
    plant = loop.plant(grid, machine.x, 1, [(1.0, 1.0)])
    left = []
    for crossover in (2.0, 25.0):
        values = load().gains | {"second_encoder_x.crossover": crossover}
        law = Problem(machine, "cascade", "full", 2.0, 2.0).loops(grid, values)[0]
        s = 1.0 / (1.0 + loop.transfer(law, plant)[0])
        left.append(loop.screw_error(grid, machine.x, law, plant, s) / machine.x.lead_once_m)
    assert left[1] < 0.6 * left[0] < 0.6
    assert loop.screw_error(grid, dataclasses.replace(machine.x, lead_once_m=0.0), law, plant, s) == 0.0


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_the_designs_of_the_demo_keep_their_margins(controller: str) -> None:
    """They are committed, and firmware and machine go on: small changes of these move the margins a little."""
    machine = load(demo.REAL)
    values = parameter_file.read(demo.designed(controller))
    told = machine.parameters()
    assert {name: values[name] for name in told} == pytest.approx(told, rel=1e-3, abs=1e-3), "design it anew"
    axes = predicted(Problem(machine, controller, FULL, 2.0, 2.0), values)
    assert max(axis.margins.ms for axis in axes) < 2.05, "design it anew"  # made for 2.0
    assert max(axis.force_change_N for axis in axes) < 2.05, "design it anew"


def test_a_design_learns_more_slowly_than_its_loop() -> None:
    """At the factory's rates the feedforward of ccu follows what a slow machine's compensator does at a reversal."""
    machine = load(demo.REAL)
    slow = plan(shapes.circle(0.004, 0.0045, duration_s=1.6), limits(machine))
    designed = parameter_file.read(demo.designed("ccu"))
    error_um = []
    for values in (designed, {**designed, "feedforward.friction_rate": 40.0, "feedforward.mass_rate": 20.0}):
        log = run(slow, "ccu", Target(machine=machine), RunOptions(parameters=values, score_from_s=0.3)).log
        mean_um = summarise(log).mean_um
        assert mean_um is not None
        error_um.append(mean_um)
    assert error_um[0] < 0.93 * error_um[1]
