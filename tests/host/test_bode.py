# SPDX-License-Identifier: Apache-2.0
"""The measured frequency response of a simulated axis is the one that the machine's equations give."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from kontur.cli import main
from kontur.commissioning import response
from kontur.commissioning.response import Response, Setup
from kontur.design import loop
from kontur.design.search import Problem
from kontur.drive import parameter_file
from kontur.drive.target import Target, open_drive
from kontur.errors import DeviceError, KonturError, ParameterError
from kontur.machine import MACHINES, load

DESIGN = MACHINES / "designs" / "ball_screw-cascade.toml"


def measured(machine: str, setup: Setup, params: Path = DESIGN, axis: str = "x", num: str = "f32") -> Response:
    with open_drive(Target(machine=load(MACHINES / f"{machine}.toml"), num=num)) as device:
        device.parameters.set(parameter_file.read(params))
        device.select_controller("cascade")
        with device.axes.enabled():
            return response.measure(device, axis, setup)


@pytest.mark.parametrize(("axis", "num"), [("x", "f32"), ("y", "fix")])
def test_measured_machine_loop_and_sensitivity_are_those_of_the_equations(axis: str, num: str) -> None:
    machine = load(MACHINES / "ball_screw.toml")
    hz = response.lines(20.0, 500.0, 24, 0.5)
    found = measured("ball_screw", Setup(hz, 100.0, window_s=0.5), axis=axis, num=num)
    problem = Problem(machine, "cascade", "full", 2.0, 2.0)
    grid = loop.Grid.at(found.hz, problem.control_hz)
    i = "xy".index(axis)
    law = problem.loops(grid, parameter_file.read(DESIGN))[i]
    plant = loop.plant(grid, machine.axes[i], machine.delay_periods, ((1.0, 1.0),))
    expected = plant.force[0, 0]
    assert np.max(np.abs(found.plant[0] / expected - 1.0)) < 0.08  # the worst is near the zero of the mode
    assert np.median(np.abs(found.plant[0] / expected - 1.0)) < 0.01
    s = 1.0 / (1.0 + loop.transfer(law, plant)[0])
    assert np.max(np.abs(found.sensitivity - s)) < 0.05
    assert not np.any(found.plant[1])
    assert np.all(found.coherence > 0.99)


def test_stated_deviation_is_that_of_the_error() -> None:
    machine = load(MACHINES / "ball_screw.toml")
    found = measured("ball_screw", Setup(response.lines(200.0, 1000.0, 16, 0.5), 60.0, window_s=0.5, windows=3))
    grid = loop.Grid.at(found.hz, 10_000)
    expected = loop.plant(grid, machine.x, machine.delay_periods, ((1.0, 1.0),)).force[0, 0]
    off = np.abs(found.plant[0] - expected) / found.plant_sigma[0]
    assert 0.2 < np.median(off) < 3.0


def test_scale_at_the_table_is_measured_besides() -> None:
    machine = load(MACHINES / "stiff_scale.toml")
    setup = Setup(response.lines(40.0, 300.0, 8, 0.5), 100.0, window_s=0.5)
    with open_drive(Target(machine=machine)) as device:
        device.parameters.set(
            {"cascade.position_gain": 28.0, "cascade.velocity_gain": 52.0, "cascade.integral_gain": 12.0}
        )
        device.select_controller("cascade")
        with device.axes.enabled():
            found = response.measure(device, "x", setup)
    grid = loop.Grid.at(found.hz, 10_000)
    expected = loop.plant(grid, machine.x, machine.delay_periods, ((1.0, 1.0),)).force[0]
    assert np.median(np.abs(found.plant / expected - 1.0), axis=1) == pytest.approx([0.0, 0.0], abs=0.02)


def test_lines_have_whole_periods_in_a_window_and_differ() -> None:
    hz = response.lines(5.0, 500.0, 40, 0.5)
    assert hz[0] == 6.0 or hz[0] == 4.0
    assert hz[-1] == 500.0
    assert all((f * 0.5).is_integer() for f in hz)
    assert sorted(set(hz)) == list(hz)


@pytest.mark.parametrize(
    ("setup", "words"),
    [
        (Setup((5000.0,), 10.0), "half the control rate"),
        (Setup((), 10.0), "widen the band"),
        (Setup((50.0,), 10.0, window_s=6.0), "5 s at most"),
        (Setup((50.0,), 10.0, speed_mps=0.4, window_s=5.0), "to move, too little"),
        (Setup((50.0,), 800.0), "half of the force limit"),
    ],
)
def test_what_cannot_be_measured_is_refused_in_words(setup: Setup, words: str) -> None:
    with pytest.raises(KonturError, match=words) as caught:
        measured("ball_screw", setup)
    assert isinstance(caught.value, (ParameterError, DeviceError))


def bode(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["bode", *arguments])


def test_command_shows_saves_and_prints_json(tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("b.svg", "b.csv")]
    common = ("x", "--machine", str(MACHINES / "ball_screw.toml"), "--params", str(DESIGN), "--controller", "cascade")
    band = ("--from", "20", "--to", "200", "--points", "8", "--window", "0.2")
    result = bode(*common, *band, *(word for file in files for word in ("-o", str(file))))
    assert result.exit_code == 0, result.output
    assert "Ms" in result.output
    assert files[0].read_text().startswith("<?xml")
    assert "math" not in files[0].read_text()  # the decades are numbers
    with files[1].open() as file:
        table = list(csv.DictReader(file))
    found = json.loads(bode(*common, *band, "--json").stdout)
    assert found["axis"] == "x"
    assert found["controller"] == "cascade"
    assert 1.0 < found["margins"]["ms"] < 3.0
    assert len(found["points"]) == len(table)
    for point, row in zip(found["points"], table, strict=True):
        assert point["plant_m_per_N"][1] == pytest.approx(float(row["plant_m_per_N_im"]), rel=1e-6)
        assert set(point) >= {"hz", "sensitivity", "sensitivity_sigma", "loop", "coherence"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("x", "--from", "50", "--to", "20"), "must be below"),
        (("x", "--controller", "all"), "of one controller"),
        (("z",), "is not one of"),
        (("x", "-o", "b.xls"), "must end in"),
    ],
)
def test_command_refuses_in_words(arguments: tuple[str, ...], words: str) -> None:
    result = bode(*arguments)
    assert result.exit_code != 0
    assert words in result.output
