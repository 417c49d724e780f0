# SPDX-License-Identifier: Apache-2.0
"""The gains of a machine file: the drive gets them with all else that it is told of the machine."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from kontur import machine as machines
from kontur.cli import main
from kontur.drive.target import Target, open_drive
from kontur.errors import MachineError, ParameterError

LEAD_SCREW = (machines.MACHINES / "lead_screw.toml").read_text()
SLOW = "\n[gains.smc]\nlambda = 50.0\nk_max = 30.0\nk_0 = 20\n[gains.observer]\nbandwidth = 700.0\n"
GAINS = {"smc.lambda": 50.0, "smc.k_max": 30.0, "smc.k_0": 20.0, "observer.bandwidth": 700.0}


@pytest.fixture
def slow(tmp_path: Path) -> machines.Machine:
    return machines.load(written(tmp_path, SLOW))


def written(folder: Path, gains: str) -> Path:
    file = folder / "mine.toml"
    file.write_text(LEAD_SCREW + gains)
    return file


def read(target: Target) -> dict[str, float]:
    """The parameters GAINS of a drive."""
    with open_drive(target) as device:
        return {name: device.read(name) for name in GAINS}


@pytest.mark.parametrize("compensation", machines.COMPENSATIONS)
def test_a_drive_that_is_told_all_has_the_gains(slow: machines.Machine, compensation: str) -> None:
    """Also k_max, which is below the k_0 that the drive has before."""
    assert read(Target(slow, compensation=compensation)) == pytest.approx(GAINS)


@pytest.mark.parametrize("told", [machines.LENGTHS, machines.NOTHING])
def test_a_drive_that_is_untold_has_those_from_the_factory(slow: machines.Machine, told: str) -> None:
    with open_drive(Target(slow, told=told)) as device:
        assert {name: device.read(name) for name in GAINS} == {
            name: device.parameters[name].default for name in GAINS
        }  # fmt: skip
    assert read(Target(slow, told=told)) != pytest.approx(GAINS)


def test_params_and_set_go_before_the_gains_and_the_log_has_both(tmp_path: Path) -> None:
    file, params, log = written(tmp_path, SLOW), tmp_path / "params.toml", tmp_path / "a.csv"
    params.write_text("[smc]\nlambda = 60.0\nk_0 = 21.0\n")
    arguments = ["run", "circle", "--radius", "1", "--feed", "20", "--controller", "cc", "--machine", str(file)]
    done = CliRunner().invoke(
        main, [*arguments, "--params", str(params), "--set", "smc.k_0=22", "--log", str(log)], catch_exceptions=False
    )
    assert done.exit_code == 0, done.output
    head = dict(
        line[2:].split(": ", 1) for line in log.read_text().splitlines() if line.startswith("# ") and ": " in line
    )
    assert json.loads(head["plant"])["gains"] == GAINS
    used = json.loads(head["parameters"])
    assert {name: used[name] for name in GAINS} == pytest.approx(GAINS | {"smc.lambda": 60.0, "smc.k_0": 22.0})


def test_a_machine_without_gains_says_nothing_of_them() -> None:
    plain = machines.load(machines.MACHINES / "lead_screw.toml")
    assert plain.gains == {}
    assert not [name for name in plain.parameters() if name.startswith(machines.GAINS)]


@pytest.mark.parametrize("name", ["table1", "table1_on_chip"])
def test_the_machine_of_the_paper_has_gains_that_the_drive_takes(name: str) -> None:
    machine = machines.load(machines.MACHINES / f"{name}.toml")
    assert machine.gains == machines.load().gains
    assert machine.gains["smc.lambda"] == 200.0  # of Table 1
    assert machine.gains["compensator.alpha"] == 60.0
    with open_drive(Target(machine)) as device:
        for parameter, value in machine.gains.items():
            assert device.read(parameter) == pytest.approx(value), parameter


def test_the_c_tests_have_the_gains_of_the_paper_too() -> None:
    text = (Path(__file__).parents[1] / "unit/table1.h").read_text()
    counts = {f"{record}.{name}": int(value) for record, name, value in re.findall(r"od->(\w+)\.(\w+) = (\d+);", text)}
    table1 = machines.load()
    with open_drive(Target(table1)) as device:
        assert counts == {name: device.on_wire(name, value)[2] for name, value in table1.gains.items()}


@pytest.mark.parametrize(
    ("gains", "message"),
    [
        ("[gains.plant_x]\nmass = 1.0\n", r"gains\.plant_x: unknown key; known are .*smc"),
        ("[gains.smc]\nlambda = true\n", r"gains\.smc\.lambda: must be a number"),
        ("[gains.smc]\nlambda = nan\n", r"gains\.smc\.lambda: must be a number"),
        ("[gains.smc]\nlambda = '50'\n", r"gains\.smc\.lambda: must be a number"),
        ("[gains]\nsmc = 50.0\n", r"gains\.smc: must be a table \[gains\.smc\]"),
    ],
)
def test_a_mistake_is_named_with_file_and_key(tmp_path: Path, gains: str, message: str) -> None:
    with pytest.raises(MachineError, match=rf"mine\.toml: {message}"):
        machines.load(written(tmp_path, "\n" + gains))


@pytest.mark.parametrize(
    ("gains", "message"),
    [
        ("[gains.smc]\nlamda = 50.0\n", r"smc\.lamda: .*smc\.lambda"),
        ("[gains.smc]\nlambda = 1e9\n", r"smc\.lambda: .*2000"),
        ("[gains.smc]\nk_0 = 50.0\nk_max = 40.0\n", r"smc\.k_"),
    ],
)
def test_what_the_drive_refuses_is_named(tmp_path: Path, gains: str, message: str) -> None:
    with (
        pytest.raises(ParameterError, match=message),
        open_drive(Target(machines.load(written(tmp_path, "\n" + gains)))),
    ):
        pass
