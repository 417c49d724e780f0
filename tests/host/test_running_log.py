# SPDX-License-Identifier: Apache-2.0
"""A log while the run goes: whatever ends the program, what was received is in a file that `kontur log` reads."""

from __future__ import annotations

import resource
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from kontur import machine
from kontur.can.link import Link
from kontur.drive.device import Device
from kontur.drive.pdos import TELEMETRY
from kontur.drive.stream import Operator
from kontur.drive.target import Target, tell
from kontur.path import shapes
from kontur.planning.bounds import limits
from kontur.planning.planner import Trajectory, plan
from kontur.runs import log
from kontur.runs.runner import RunOptions, run
from kontur.sim.bus import KonturBus
from kontur.sim.process import SimProcess, start

KONTUR = [sys.executable, "-m", "kontur.cli"]
CIRCLE = ["run", "circle", "--radius", "10", "--feed", "10", "--approach"]
PATIENCE_S = 60.0  # on a loaded machine
SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.fixture
def drive() -> Iterator[SimProcess]:
    """A drive that stands at the start of CIRCLE, told all of its machine, by the wall clock."""
    there = machine.load().starting_at((0.01, 0.0))
    with start(slcan_tcp="0", machine=there) as process:
        tell(Target(there, process.options()))
        yield process


@pytest.fixture(scope="module")
def trajectory() -> Trajectory:
    return plan(shapes.circle(0.01, 0.05), limits(machine.load()))


def heed_signals() -> None:
    """Also where the tests run under nohup, or in the background of a script."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)


def started(drive: SimProcess, *options: str, file: Path, kontur: Sequence[str] = KONTUR) -> subprocess.Popen[str]:
    """The run of CIRCLE on `drive`, when the first rows of its log are on the disk."""
    process = subprocess.Popen(
        [*kontur, *CIRCLE, "-i", drive.interface, "-c", drive.channel, "--log", str(file), *options],
        preexec_fn=heed_signals,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    until(lambda: process.poll() is not None or rows_of(running(file)) > 300)
    assert process.poll() is None, process.communicate()
    return process


def running(file: Path) -> Path:
    return file.with_name(f"{file.stem}-running.csv")


def rows_of(file: Path) -> int:
    return sum(line[:1].isdigit() for line in file.read_text().splitlines()) if file.exists() else 0


def until(condition: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s, "waited too long"
        time.sleep(0.02)


def killed_drive(drive: SimProcess) -> None:
    """The end of a `with start()` complains of a process that was killed; here that is meant."""
    drive.process.kill()
    drive.process.wait()
    drive.end = lambda: None  # type: ignore[method-assign]


@pytest.mark.parametrize("suffix", [".csv", ".mf4"])
def test_log_of_a_run_that_is_killed_is_read_and_mended(drive: SimProcess, tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"a{suffix}"
    process = started(drive, file=file)
    rows = rows_of(running(file))
    process.kill()
    process.communicate()
    assert not file.exists()
    found = log.read(running(file))
    assert found.meta["status"] == "killed"
    assert found.meta["parameters"]["compensator.alpha"] == 60.0
    assert len(found) >= rows
    assert (np.diff(found.columns["tick"]) == 1).all()
    mended = subprocess.run([*KONTUR, "log", "convert", running(file), file], check=True)
    assert mended.returncode == 0
    assert log.read(file).meta == found.meta
    np.testing.assert_array_equal(log.read(file).columns["contour_error_um"], found.columns["contour_error_um"])


@pytest.mark.parametrize("number", SIGNALS)
def test_signal_stops_on_the_path_and_the_log_is_complete(
    drive: SimProcess, tmp_path: Path, number: signal.Signals
) -> None:
    file = tmp_path / "a.csv"
    process = started(drive, file=file)
    process.send_signal(number)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 128 + number
    assert "contour error" in out
    assert "stopped on the path" in err
    found = log.read(file)
    assert found.meta["status"] == "interrupted"
    last_mm = np.hypot(*(np.diff(found.columns[f"position_{axis}_mm"])[-1] for axis in "xy"))
    assert last_mm < 1e-3  # in a ms; 0.01 at speed
    assert not running(file).exists()


HEEDING = """
import signal, sys
from kontur.cli import main

set_handler = signal.signal

def tell(number, handler):
    before = set_handler(number, handler)
    if handler is signal.default_int_handler:
        print("the first one is heeded", file=sys.__stderr__, flush=True)
    return before

signal.signal = tell
main()
"""


def test_second_ctrl_c_ends_at_once_and_the_log_is_kept(drive: SimProcess, tmp_path: Path) -> None:
    """It comes when the first one is heeded, and before the drive can stop."""
    file = tmp_path / "a.csv"
    process = started(drive, file=file, kontur=[sys.executable, "-c", HEEDING])
    drive.process.send_signal(signal.SIGSTOP)
    process.send_signal(signal.SIGINT)
    assert process.stderr is not None
    while "heeded" not in process.stderr.readline():
        assert process.poll() is None
    process.send_signal(signal.SIGINT)
    drive.process.send_signal(signal.SIGCONT)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert err.endswith("Interrupted.\n")
    found = log.read(file)
    assert len(found) > 300
    assert found.meta["status"] == "interrupted"


TELLING = """
import sys
from kontur.cli import main

def tell(event, args):
    if event in ("import", "open") and str(args[0]).endswith(("matplotlib", "-running.csv")):
        print(str(args[0])[-12:], file=sys.__stderr__)

sys.addaudithook(tell)
main()
"""


def test_what_draws_the_report_is_loaded_before_motion_where_a_second_ctrl_c_cannot_break_it_off(
    tmp_path: Path,
) -> None:
    output = ["--log", str(tmp_path / "a.csv"), "--report", str(tmp_path / "a.html")]
    ended = subprocess.run(
        [sys.executable, "-c", TELLING, "run", "circle", "--radius", "2", *output],
        capture_output=True,
        text=True,
        check=True,
    )
    assert ended.stderr.split()[:2] == ["matplotlib", "-running.csv"]


def test_bus_that_is_lost_leaves_log_table_and_report_and_one_message_names_the_files(
    drive: SimProcess, tmp_path: Path
) -> None:
    file, report = tmp_path / "a.csv", tmp_path / "a.html"
    process = started(drive, "--report", str(report), file=file)
    killed_drive(drive)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert "contour error" in out
    assert f"The report up to then is in {report}." in err
    assert report.exists()
    assert err.count("Error: ") == 1
    assert f"The log up to then is in {file}." in err
    found = log.read(file)
    assert found.meta["status"] == "error"
    assert found.meta["fault"] in err
    assert len(found) > 300


def small_files() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))


@pytest.mark.parametrize("suffix", [".csv", ".mf4"])
def test_full_disk_stops_the_run_on_the_path_and_what_was_logged_stays(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"a{suffix}"
    ended = subprocess.run(
        [*KONTUR, *CIRCLE, "--log", str(file)], preexec_fn=small_files, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 1
    assert "contour error" in ended.stdout
    assert "File too large" in ended.stderr
    left = file if file.exists() else running(file)
    assert f"The log up to then is in {left}." in ended.stderr
    found = log.read(left)
    assert found.meta["status"] == "interrupted"
    assert 0.3 < found.columns["time_s"][-1] < 3.0  # of 6.3


def test_result_is_printed_before_a_report_that_cannot_be_written(tmp_path: Path) -> None:
    file = tmp_path / "a.html"
    ended = subprocess.run(
        [*KONTUR, "run", "circle", "--radius", "2", "--feed", "20", "--report", str(file)],
        preexec_fn=small_files,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 1
    assert "contour error" in ended.stdout
    assert f"{file}: cannot be written" in ended.stderr
    assert list(tmp_path.iterdir()) == []


def ignore_hangup() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)


def test_run_under_nohup_goes_on_when_the_terminal_is_closed(drive: SimProcess, tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    process = subprocess.Popen(
        [*KONTUR, *CIRCLE, "-i", drive.interface, "-c", drive.channel, "--log", str(file)],
        preexec_fn=ignore_hangup,
        stdout=subprocess.DEVNULL,
    )
    until(lambda: rows_of(running(file)) > 300)
    process.send_signal(signal.SIGHUP)
    assert process.wait(PATIENCE_S) == 0
    assert log.read(file).meta["status"] == "complete"


@pytest.mark.parametrize("suffix", [".csv", ".mf4"])
def test_log_that_takes_the_place_of_a_private_one_is_never_open_to_others(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    path.touch(mode=0o600)
    growing = log.Growing(path, {"program": "circle", "controller": "ccu"}, [c.name for c in log.COLUMNS if c.required])
    assert stat.S_IMODE(growing.file.stat().st_mode) == 0o600
    growing.append(np.array([[1.0, 0.0, 0.0, 0.0]]))
    growing.finish({"status": "complete"})
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_what_a_killed_run_left_is_not_overwritten(trajectory: Trajectory, tmp_path: Path) -> None:
    left = running(tmp_path / "a.csv")
    left.write_text("what was recorded")
    result = run(trajectory, "ccu", Target(machine=machine.load()), RunOptions(log=tmp_path / "a.csv"))
    assert left.read_text() == "what was recorded"
    assert log.read(tmp_path / "a.csv").meta["score"] == result.log.meta["score"]
    assert len(list(tmp_path.iterdir())) == 2


def test_log_that_grew_is_the_log_of_the_result_and_equal_runs_give_equal_bytes(
    trajectory: Trajectory, tmp_path: Path
) -> None:
    for name in ("a.csv", "b.csv", "c.mf4", "d.mf4"):
        result = run(trajectory, "ccu", Target(machine=machine.load()), RunOptions(log=tmp_path / name))
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    assert (tmp_path / "c.mf4").read_bytes() == (tmp_path / "d.mf4").read_bytes()
    assert (tmp_path / "a.csv").read_text() == log.csv_text(result.log)
    log.convert(tmp_path / "c.mf4", tmp_path / "e.csv")
    assert (tmp_path / "e.csv").read_bytes() == (tmp_path / "a.csv").read_bytes()


def test_log_that_cannot_be_begun_is_refused_before_the_drive_moves(trajectory: Trajectory, tmp_path: Path) -> None:
    moved: list[float] = []
    with pytest.raises(log.FileError, match="cannot be written"):
        run(
            trajectory,
            "ccu",
            Target(machine=machine.load()),
            RunOptions(log=tmp_path / "none" / "a.csv"),
            Operator(progress=moved.append),
        )
    assert moved == []


def test_telemetry_is_handed_over_twice_a_second_of_the_drive() -> None:
    with KonturBus() as bus:
        link = Link(bus, 1)
        Device(link).pdos.require(*TELEMETRY)
        link.node.nmt.state = "OPERATIONAL"
        at_s: list[float] = []
        link.record_telemetry(lambda function, payload: at_s.append(link.time_s))
        link.wait(lambda: False, 3.0)
    assert np.max(np.diff([0.0, *at_s, 3.0])) <= 0.5
