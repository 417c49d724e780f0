# SPDX-License-Identifier: Apache-2.0
"""What a machine is and what its drive is told of it: options, parameters of the drive, logs and headings."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner
from test_cli_sim import TIMEOUT_S, kontur_sim

from kontur import machine as machines
from kontur.cli import main
from kontur.drive.target import Target, open_drive
from kontur.errors import ParameterError
from kontur.runs import log

TABLE1 = machines.load()
LEAD_SCREW = machines.MACHINES / "lead_screw.toml"


def invoke(*arguments: str) -> str:
    result = CliRunner().invoke(main, list(arguments))
    assert result.exit_code == 0, result.output
    return result.stdout


def value(name: str, *options: str) -> float:
    """A parameter of a drive."""
    return float(json.loads(invoke("param", "get", name, "--json", *options))[0]["value"])


@pytest.mark.parametrize(
    ("options", "mass", "count", "limit"),
    [
        ((), "told", "told", "told"),
        (("--told",), "told", "told", "told"),
        (("--compensation", "rigid"), "told", "told", "told"),
        (("--untold",), "factory", "told", "told"),
        (("--untold", "all"), "factory", "factory", "factory"),
    ],
)
def test_drive_is_told_what_the_options_say(options: tuple[str, ...], mass: str, count: str, limit: str) -> None:
    told = machines.load(LEAD_SCREW).parameters()
    with open_drive(Target(told=machines.NOTHING)) as device:
        factory = {name: device.parameters[name].default for name in told}
    for name, expected in (("plant_x.mass", mass), ("plant_x.encoder", count), ("position_limit_y.max", limit)):
        assert told[name] != factory[name]
        assert value(name, "--machine", str(LEAD_SCREW), *options) == pytest.approx(
            {"told": told, "factory": factory}[expected][name], rel=1e-6
        )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--untold", "some"), "'some' is not 'all'"),
        (("--untold", "--told"), "--told and --untold: which one?"),
        (("--untold", "--compensation", "rigid"), "--compensation says what --told sets"),
        (("--compensation", "half"), "'half' is not one of 'full', 'rigid'"),
        (("--untold", "-i", "virtual", "-c", "a"), "a drive on a bus has its own parameters"),
        (("--told", "-i", "virtual", "-c", "a"), "a drive on a bus has its own parameters"),
    ],
)
def test_nonsense_is_refused_with_one_message(options: tuple[str, ...], message: str) -> None:
    result = CliRunner().invoke(main, ["run", "circle", *options])
    assert result.exit_code == 2
    assert message in result.stderr
    assert result.stderr.count("Error") == 1
    assert result.stdout == ""


def test_a_file_behind_untold_is_refused_with_what_to_write() -> None:
    result = CliRunner().invoke(main, ["run", "--untold", "circle"])
    assert result.exit_code == 2
    assert "'circle' is not 'all'; write --untold behind" in result.stderr


def test_another_word_is_refused_in_python() -> None:
    with pytest.raises(ParameterError, match="told: must be one of all, lengths and limits, nothing, is 'much'"):
        TABLE1.parameters(told="much")
    with pytest.raises(ParameterError, match="compensation: must be one of full, rigid, is 'half'"):
        TABLE1.parameters(compensation="half")


@pytest.mark.parametrize(
    ("options", "told", "compensation", "words"),
    [
        ((), "all", "full", "the drive was told all of its machine"),
        (("--compensation", "rigid"), "all", "rigid", "told of its machine what a rigid axis has"),
        (("--untold",), "lengths and limits", None, "told only encoder lengths and soft limits"),
        (("--untold", "all"), "nothing", None, "told nothing of its machine"),
    ],
)
def test_run_says_what_was_told_in_heading_log_report_and_command(
    tmp_path: Path, options: tuple[str, ...], told: str, compensation: str | None, words: str
) -> None:
    out = invoke("run", "circle", "--radius", "1", "--log", str(tmp_path / "a.csv"), *options,
                 "--report", str(tmp_path / "a.html"))  # fmt: skip
    title = " ".join(out.split("┏")[0].split())
    assert "true contour error of the tool" in title
    assert words in title
    found = log.read(tmp_path / "a.csv").meta
    assert (found["told"], found.get("compensation")) == (told, compensation)
    assert str(found["command"]).endswith(" ".join(("--radius 1.0", *options)))
    assert f"<dt>the drive was told</dt><dd>{told}" in (tmp_path / "a.html").read_text()


def test_json_says_what_was_told_and_that_the_error_is_the_true_one() -> None:
    found = json.loads(invoke("run", "circle", "--radius", "1", "--untold", "--json"))
    assert (found["contour_error"], found["told"], found["compensation"]) == ("true", "lengths and limits", None)


def test_over_a_bus_the_error_is_called_the_drives_own_estimate_and_the_drive_is_told_what_sim_says() -> None:
    with kontur_sim("--pace", "sync", "--told", "--machine", str(LEAD_SCREW)) as (process, lines):
        assert any("is told all of its machine" in line for line in lines)
        bus = ("-i", "slcan", "-c", lines[1].split()[-1])
        assert value("plant_x.mass", *bus) == machines.load(LEAD_SCREW).x.mass_kg
        run = ("run", "circle", "--radius", "1", "--approach", "--controller", "cascade", *bus)
        text = " ".join(invoke(*run).split("┏")[0].split())
        assert "contour error by the drive's own estimate" in text
        assert "true" not in text
        found = json.loads(invoke(*run, "--json"))
        assert (found["contour_error"], found["told"]) == ("estimated", None)
        process.terminate()
        assert process.wait(TIMEOUT_S) == 0


def test_sim_is_told_nothing_unless_it_is_asked() -> None:
    with kontur_sim("--machine", str(LEAD_SCREW)) as (_, lines):
        assert any("is told nothing of its machine" in line for line in lines)
        assert value("plant_x.mass", "-i", "slcan", "-c", lines[1].split()[-1]) == TABLE1.x.mass_kg


def test_what_is_simulated_on_the_chip_is_simulated_whatever_the_drive_is_told() -> None:
    on_chip = machines.load(machines.MACHINES / "table1_on_chip.toml")
    for told in machines.TOLD:
        assert on_chip.parameters(told=told)["onchip_plant.simulated"] == 1


def test_a_drive_that_does_not_know_its_mass_says_so_where_the_axis_lags() -> None:
    command = ("run", "circle", "--radius", "4", "--feed", "100", "--controller", "track", "--untold")
    result = CliRunner().invoke(main, [*command, "--machine", str(machines.MACHINES / "long_axis.toml")])
    assert result.exit_code == 1
    assert "8611h" in result.stderr
    assert "mass or friction are not those of the axis" in result.stderr
    assert "set plant_x and plant_y as the machine is" in result.stderr


def test_a_drive_with_other_lengths_of_a_count_moves_nothing_and_says_why() -> None:
    """It takes a count of 200 nm for one of 76.29 nm."""
    command = ["run", "circle", "--radius", "4", "--machine", str(LEAD_SCREW), "--untold", "all"]
    ran = CliRunner().invoke(main, command)
    assert ran.exit_code != 0
    assert "the axes stand at the start, (4.000, 0.000) mm, and the drive takes it for (1.526, 0.000) mm" in ran.output
    assert "--set plant_x.encoder" in ran.output
    assert "jog there" not in ran.output
