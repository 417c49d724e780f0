# SPDX-License-Identifier: Apache-2.0
"""The command line as a user meets it: results where they belong, one message for a mistake, exit codes."""

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from kontur.cli import main
from kontur.drive.controllers import CONTROLLERS
from kontur.runs import log

CIRCLE = ("run", "circle", "--radius", "5", "--feed", "50")


def kontur(*args: str, **env: str) -> Result:
    return CliRunner().invoke(main, args, env=env)


def succeeds(*args: str, **env: str) -> str:
    result = kontur(*args, **env)
    assert result.exit_code == 0, result.output
    return result.stdout


def test_every_verb_has_help() -> None:
    text = succeeds("--help")
    for verb in ("run", "jog", "home", "sim", "experiment", "info", "param", "log", "report", "bench", "demo"):
        assert f"  {verb} " in text
        succeeds(verb, "--help")


def test_run_of_a_shape_prints_a_table() -> None:
    text = succeeds(*CIRCLE)
    assert "ccu" in text
    assert "mean µm" in text


def test_run_under_all_controllers_as_json() -> None:
    result = json.loads(succeeds(*CIRCLE, "--controller", "all", "--json"))
    assert [run["controller"] for run in result["runs"]] == list(CONTROLLERS)
    for run in result["runs"]:
        assert 0.0 < run["mean_um"] < run["max_um"] < 100.0
        assert run["path_percent"] == pytest.approx(100.0, abs=0.01)
        assert run["frames_lost"] == 0


def test_logs_of_several_controllers_go_to_files_of_their_own(tmp_path: Path) -> None:
    succeeds(*CIRCLE, "--controller", "ccu", "--controller", "track", "--log", str(tmp_path / "a.csv"))
    assert log.read(tmp_path / "a-ccu.csv").meta["controller"] == "ccu"
    assert log.read(tmp_path / "a-track.csv").meta["controller"] == "track"


@pytest.mark.parametrize("suffix", [".csv", ".mf4"])
def test_two_runs_give_equal_bytes_wherever_they_are_logged_to(tmp_path: Path, suffix: str) -> None:
    for name in ("a", "b"):
        succeeds(*CIRCLE, "--seed", "7", "--log", str(tmp_path / (name + suffix)))
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_log_tells_the_command_that_makes_it_again(tmp_path: Path) -> None:
    succeeds(*CIRCLE, "--set", "smc.lambda=150", "--log", str(tmp_path / "a.csv"), "--json")
    command = log.read(tmp_path / "a.csv").meta["command"]
    assert command == "kontur run circle --controller ccu --feed 50.0 --radius 5.0 --set smc.lambda=150"
    succeeds(*command.split()[1:], "--log", str(tmp_path / "b.csv"))
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_machine_of_the_user_is_simulated(tmp_path: Path) -> None:
    from kontur import machine

    mine = tmp_path / "mine.toml"
    mine.write_text(
        machine.DEFAULT.read_text().replace("coulomb_N = 45.5", "coulomb_N = 5.0").replace('"Table 1"', '"mine"')
    )
    file = tmp_path / "a.csv"
    succeeds(*CIRCLE, "--machine", str(mine), "--log", str(file))
    meta = log.read(file).meta
    assert meta["machine"] == "mine"
    assert meta["parameters"]["plant_x.coulomb"] == 5.0


def test_report_is_written(tmp_path: Path) -> None:
    succeeds(*CIRCLE, "--report", str(tmp_path / "r.html"))
    assert "<!doctype html>" in (tmp_path / "r.html").read_text()


def test_option_may_come_from_the_environment() -> None:
    result = json.loads(succeeds("run", "circle", "--feed", "50", "--json", KONTUR_RUN_CONTROLLER="track"))
    assert [run["controller"] for run in result["runs"]] == ["track"]


def test_experiment_prints_the_agreed_fields() -> None:
    text = succeeds(
        "experiment", "paper", "--case", "high-tight", "--controller", "ccu", "--seed", "3", "--seeds", "2", "--json"
    )
    rows = json.loads(text)["cases"]
    assert [(row["case"], row["controller"], row["seed"], row["num"]) for row in rows] == [
        ("high-tight", "ccu", 3, "f32"),
        ("high-tight", "ccu", 4, "f32"),
    ]
    assert set(rows[0]) == {
        *("case", "controller", "seed", "num", "path_percent", "mean_um", "rms_um", "max_um"),
        *("energy_J", "force_max_N", "force_step_N"),
    }
    assert rows[0]["mean_um"] != rows[1]["mean_um"]


def test_info_names_the_simulated_drive() -> None:
    text = succeeds("info")
    assert "machine 'Table 1'" in text
    assert "switch on disabled" in text


def test_bus_may_be_named_in_the_environment_of_python_can() -> None:
    text = succeeds("info", "--seed", "5", "--node", "4", CAN_INTERFACE="kontur", CAN_CHANNEL="sim")
    assert "seed 5, node 4" in text
    result = kontur("info", CAN_INTERFACE="virtual", CAN_CHANNEL="nobody")
    assert result.exit_code == 1
    assert "does not answer" in result.stderr


def test_parameters_go_to_a_file_and_back(tmp_path: Path) -> None:
    file = tmp_path / "p.toml"
    succeeds("param", "dump", str(file))
    succeeds("param", "load", str(file))
    file.write_text(file.read_text().replace("[smc]\n", "[smc]\nlambdo = 3.0\n"))
    for words in (("param", "load"), ("run", "circle", "--params")):
        result = kontur(*words, str(file))
        assert result.exit_code == 1
        assert f"{file}: smc.lambdo: no such parameter; did you mean smc.lambda" in result.stderr


def test_parameter_is_reported_with_its_unit() -> None:
    assert succeeds("param", "get", "plant_x.mass") == "plant_x.mass = 88.08 kg\n"
    assert json.loads(succeeds("param", "get", "plant_x.mass", "smc.gamma", "--json")) == [
        {"name": "plant_x.mass", "value": 88.08, "unit": "kg"},
        {"name": "smc.gamma", "value": 1.2, "unit": "1/s"},
    ]


PART = "G21 G90 G1 X10 F600\nG1 Y10\n"


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("run", "nowhere.ngc"), "nowhere.ngc: no such file, and no shape either"),
        (("run", "circle", "--feed", "50", "--radius", "200"), "200"),
        (("run", "circle", "--feed", "50", "--set", "smc.lambda=x"), "smc.lambda: 'x' is not a number"),
        (("run", "circle", "--feed", "50", "--set", "smc.lambda=1e9"), "out of range; it must be 1..2000 1/s"),
        (("run", "circle", "--feed", "50", "--machine", "nowhere.toml"), "nowhere.toml: cannot be read"),
        (("run", "circle", "--feed", "50", "--log", "a.txt"), "a.txt: must end in .csv or .mf4"),
        (
            ("run", "circle", "--feed", "50", "--log", "nowhere/a.csv"),
            "nowhere/a.csv: the folder nowhere does not exist",
        ),
        (("run", "circle", "--feed", "50", "--report", "a.pdf"), "a.pdf: must end in .html"),
        (("scope", "--trigger", "contour_error>nan"), "trigger 'contour_error>nan': the level is out of range"),
        (("scope", "--trigger", "contour_error>1e30"), "trigger 'contour_error>1e30': the level is out of range"),
        (("scope", "--trigger", "contour_error<-inf"), "trigger 'contour_error<-inf': the level is out of range"),
        (("run", "part.ngc", "--feed", "50"), "part.ngc: the feed of G-code stands in the file"),
        (("run", "bad.ngc"), "bad.ngc:2: G5"),
        (("run", "empty.ngc"), "empty.ngc"),
        (("run", "notes.txt"), "notes.txt: neither G-code"),
        (("info", "-i", "socketcan", "-c", "nocan0"), "bus socketcan nocan0 cannot be opened"),
        (("info", "-i", "nobus", "-c", "0"), "bus nobus 0 cannot be opened"),
        (("info", "-i", "slcan"), "bus slcan (no channel) cannot be opened: it needs a channel. Check -i, -c"),
        (("info", "-i", "slcan", "-c", "nowhere"), "bus slcan nowhere cannot be opened"),
        (("info", "-i", "slcan", "-c", "nowhere", "--bus-faults", "drop=0"), "bus slcan nowhere cannot be opened"),
        (("info", "-i", "virtual", "-c", "nobody"), "does not answer"),
        (("run", "circle", "--feed", "50", "-i", "virtual", "-c", "nobody"), "does not answer"),
        (("param", "set", "smc.lambda=0"), "smc.lambda: 0 1/s is out of range"),
        (("param", "load", "nowhere.toml"), "nowhere.toml: cannot be read"),
    ],
)
def test_mistake_is_one_message_and_exit_code_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, args: tuple[str, ...], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("part.ngc").write_text(PART)
    Path("bad.ngc").write_text("G21\nG5 X1\n")
    Path("empty.ngc").write_text("")
    Path("notes.txt").write_text("hello\n")
    result = kontur(*args)
    assert result.exit_code == 1, result.output
    assert message in result.stderr
    assert result.stderr.startswith("Error: ")
    assert result.stderr.count("\n") == 1
    assert result.stdout == ""


@pytest.mark.parametrize(
    "args",
    [
        ("run",),
        ("run", "circle", "--feed", "fast"),
        ("run", "circle", "--feed", "50", "--side", "3"),
        ("run", "circle", "--feed", "50", "--controller", "pid"),
        ("run", "circle", "--feed", "50", "-c", "can0"),
        ("jog", "--x", "nan"),
        ("jog", "--y", "inf"),
        ("jog", "--x", "1e12"),
        ("jog", "--x", "1", "--duration", "nan"),
        ("home", "x", "--offset", "nan"),
        ("home", "x", "--offset", "-1e12"),
        ("param", "set", "smc.lambda"),
        ("drive",),
    ],
)
def test_wrong_usage_is_exit_code_2(args: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CAN_INTERFACE", raising=False)
    result = kontur(*args)
    assert result.exit_code == 2
    assert "Error: " in result.stderr


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--feed", "0", "0.0 is not in the range x>0"),
        ("--feed", "-3", "-3.0 is not in the range x>0"),
        ("--feed", "nan", "'nan' is not a number"),
        ("--feed", "inf", "'inf' is not a number"),
        ("--radius", "0", "0.0 is not in the range x>0"),
        ("--accel", "0", "0.0 is not in the range x>0"),
        ("--jerk", "-1", "-1.0 is not in the range x>0"),
        ("--num", "q7", "'q7' is not one of 'f32', 'fix', 'chk'"),
    ],
)
def test_wrong_value_is_reported_as_it_was_typed(option: str, value: str, message: str) -> None:
    result = kontur("run", "circle", "--feed", "50", option, value)
    assert result.exit_code == 2
    assert f"Error: Invalid value for '{option}': {message}" in result.stderr


def test_ctrl_c_stops_on_the_path_and_the_log_is_complete_up_to_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def press_ctrl_c_at_two_thirds(*_: object) -> Iterator[tuple[Callable[[float], None], None]]:
        pressed = False

        def progress(share: float) -> None:
            nonlocal pressed
            if share > 0.66 and not pressed:
                pressed = True
                signal.raise_signal(signal.SIGINT)

        yield progress, None

    monkeypatch.setattr("kontur.cli.run.run_progress", press_ctrl_c_at_two_thirds)
    before = signal.getsignal(signal.SIGINT)
    file = tmp_path / "a.csv"
    result = kontur("run", "circle", "--feed", "50", "--controller", "all", "--log", str(file), "--json")
    assert result.exit_code == 130
    assert "the drive stopped on the path" in result.stderr
    assert signal.getsignal(signal.SIGINT) is before
    assert len(json.loads(result.stdout)["runs"]) == 1
    assert f"Not run after that: {', '.join(CONTROLLERS[1:])}." in result.stderr
    run = log.read(tmp_path / "a-track.csv")
    assert run.meta["status"] == "interrupted"
    assert (run.columns["tick"][1:] - run.columns["tick"][:-1] == 1).all()
    assert run.columns["time_s"][-1] > 0.5


def test_ctrl_c_in_a_process_of_its_own_is_exit_code_130() -> None:
    """From the shell: Python's own handling of the signal must not get in between."""
    command = [sys.executable, "-m", "kontur.cli", "run", "circle", "--feed", "5", "--laps", "5"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        while "libkontur" not in Path(f"/proc/{process.pid}/maps").read_text():
            assert process.poll() is None
        process.send_signal(signal.SIGINT)
        _, stderr = process.communicate(timeout=60.0)
    assert process.returncode == 130
    assert b"Traceback" not in stderr
    assert stderr.count(b"\n") == 1
