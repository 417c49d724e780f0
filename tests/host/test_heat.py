# SPDX-License-Identifier: Apache-2.0
"""Programs that heat motors and amplifiers: the planner keeps their heat below what the drive bears."""

import json
import re

import numpy as np
import pytest
from click.testing import CliRunner

from kontur.cli import main
from kontur.errors import PathError
from kontur.experiments.bench_plan import of_curve, spiral_curve
from kontur.machine import MACHINES, load
from kontur.path import gcode, smoothing
from kontur.path.geometry import KNOT_S
from kontur.planning.bounds import limits
from kontur.planning.heat import HEAT
from kontur.planning.planner import plan

WARNS = 0.9  # the drive does, at this heat
TO_AND_FRO = "G1 F18000\n" + 8 * "X30 Y5\nX0 Y0\n" + "M2\n"


def machine_file(folder, continuous_N, thermal_s, axes=2):
    """Table 1's machine, with a continuous force of its first `axes`."""
    more = rf"\1continuous_force_N = {continuous_N}\nthermal_s = {thermal_s}\n"
    path = folder / "hot.toml"
    path.write_text(re.sub(r"(force_limit_N = .*\n)", more, (MACHINES / "table1.toml").read_text(), count=axes))
    return path


def heat(trajectory, machine):
    """The heat (n, 2) from the knots, by the equation of firmware/core/force_limit.h."""
    knots = np.concatenate([trajectory.knots_nm[:1], trajectory.knots_nm, trajectory.knots_nm[-1:]]) * 1e-9
    speed, acceleration = (knots[2:] - knots[:-2]) / (2 * KNOT_S), np.diff(knots, 2, axis=0) / KNOT_S**2
    out = np.zeros((len(speed) + 1, 2))
    for i, axis in enumerate(machine.axes):
        v = np.where(np.abs(speed[:, i]) > 1e-5, speed[:, i], 0.0)
        force = axis.mass_kg * acceleration[:, i] + axis.viscous_Nspm * v + axis.coulomb_N * np.sign(v)
        for k, square in enumerate((force / axis.continuous_force_N) ** 2):
            out[k + 1, i] = out[k, i] + (square - out[k, i]) * KNOT_S / axis.thermal_s
    return out


def windows_of_a_second(monkeypatch):
    monkeypatch.setattr(smoothing, "_WINDOWS_S", (0.5, 1.0))


@pytest.mark.parametrize(
    ("path", "continuous_N", "thermal_s"), [("corners", 200.0, 1.0), ("spiral", 120.0, 2.0), ("stops", 100.0, 0.1)]
)
def test_no_axis_becomes_hotter_than_the_drive_bears(path, continuous_N, thermal_s, tmp_path, monkeypatch):
    windows_of_a_second(monkeypatch)
    machine = load(machine_file(tmp_path, continuous_N, thermal_s))
    program = of_curve(spiral_curve, 20.0, 1000, 0.3) if path == "spiral" else gcode.parse(TO_AND_FRO, "p.ngc")
    trajectory = plan(program, limits(machine), tolerance_m=0.0 if path == "stops" else 10e-6)
    hottest = float(np.max(heat(trajectory, machine)))
    assert hottest < WARNS - 0.03
    assert hottest > 0.6  # it is not slower than it has to be


def test_a_program_that_stays_cold_is_planned_as_ever(tmp_path):
    machine = load(machine_file(tmp_path, 300.0, 60.0))
    program = gcode.parse(TO_AND_FRO, "p.ngc")
    assert plan(program, limits(machine)).digest == plan(program, limits(load(MACHINES / "table1.toml"))).digest


def test_a_program_that_came_to_the_continuous_force_and_stopped_runs_whole(tmp_path):
    machine = machine_file(tmp_path, 200.0, 0.5)
    file = tmp_path / "p.ngc"
    file.write_text(TO_AND_FRO)
    result = CliRunner().invoke(main, ["run", str(file), "--machine", str(machine), "--json"])
    assert result.exit_code == 0, result.output
    assert "2351h" not in result.stderr


def test_check_says_that_it_is_the_heat(tmp_path):
    file = tmp_path / "p.ngc"
    file.write_text(TO_AND_FRO)
    machine = machine_file(tmp_path, 200.0, 0.5)
    result = CliRunner().invoke(main, ["check", str(file), "--machine", str(machine), "--json"])
    feed = json.loads(result.stdout)["feed"]
    assert feed["by"] == HEAT
    assert feed["slowest"][0]["by"] == HEAT


def test_friction_above_the_continuous_force_is_told(tmp_path):
    machine = load(machine_file(tmp_path, 40.0, 0.2))
    with pytest.raises(PathError, match=r"even slowly the force of an axis stays above its continuous one.*coulomb_N"):
        plan(gcode.parse("G1 F600 X40\nX0", "p.ngc"), limits(machine))
