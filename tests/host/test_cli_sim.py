# SPDX-License-Identifier: Apache-2.0
"""`kontur sim` as a user meets it: it tells what to type, ends when told to, and leaves nothing behind."""

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from click.testing import CliRunner

from kontur.cli import main
from kontur.machine import MACHINES
from kontur.sim import process as sim_process

TIMEOUT_S = 60.0


@contextmanager
def kontur_sim(*arguments: str) -> Iterator[tuple["subprocess.Popen[str]", list[str]]]:
    """The process and what it prints until it waits."""
    command = [sys.executable, "-m", "kontur.cli", "sim", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        lines: list[str] = []
        for line in process.stdout:
            lines.append(line.rstrip())
            if line.startswith("Ctrl-C"):
                break
        try:
            yield process, lines
        finally:
            process.kill()


def ended(channel: str) -> bool:
    """Whether nobody listens any more; waits for it."""
    host, _, port = channel.removeprefix("socket://").rpartition(":")
    end_s = time.monotonic() + TIMEOUT_S
    while time.monotonic() < end_s:
        try:
            socket.create_connection((host, int(port)), TIMEOUT_S).close()
        except ConnectionRefusedError:
            return True
        except ConnectionResetError:  # it ends just now
            pass
        time.sleep(0.01)
    return False


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_what_it_tells_to_type_works_until_it_is_ended(number: signal.Signals) -> None:
    with kontur_sim("--node", "3", "--seed", "7") as (process, lines):
        info = next(line.split() for line in lines if line.strip().startswith("kontur info"))
        result = CliRunner().invoke(main, info[1:])
        assert result.exit_code == 0, result.output
        assert "Kontur, node 3" in result.stdout
        process.send_signal(number)
        assert process.wait(TIMEOUT_S) == 0
        assert ended(info[info.index("-c") + 1])


def test_no_process_is_left_when_it_is_killed() -> None:
    with kontur_sim("--slcan-tcp", "127.0.0.1:0") as (process, lines):
        process.kill()
        assert ended(lines[1].split()[-1])


def test_truth_is_written_when_it_ends(tmp_path: Path) -> None:
    with kontur_sim("--slcan-pty", "--record", str(tmp_path / "truth")) as (process, _):
        process.send_signal(signal.SIGTERM)
        assert process.wait(TIMEOUT_S) == 0
    sim_process.read_record(tmp_path / "truth")


def test_what_the_process_has_to_say_is_passed_on() -> None:
    with kontur_sim("--pace", "sync") as (process, lines):
        channel = lines[1].split()[-1]
        taken = CliRunner().invoke(main, ["sim", "--slcan-tcp", channel.rpartition(":")[2]])
        assert taken.exit_code == 1
        assert "in use" in taken.stderr
        assert taken.stderr.startswith("Error: kontur-sim: ")
        process.send_signal(signal.SIGTERM)
        assert process.wait(TIMEOUT_S) == 0


@pytest.mark.parametrize("option", ["--store", "--record"])
def test_folder_that_is_not_there_is_reported_at_the_start(tmp_path: Path, option: str) -> None:
    file = tmp_path / "nowhere" / "file"
    result = CliRunner().invoke(main, ["sim", option, str(file)])
    assert result.exit_code == 1
    assert result.stderr == f"Error: {file}: the folder {file.parent} does not exist; make it, or name another one\n"
    assert result.stdout == ""


def test_one_bus_at_a_time() -> None:
    result = CliRunner().invoke(main, ["sim", "--can", "vcan0", "--slcan-pty"])
    assert result.exit_code == 2
    assert "one bus at a time" in result.stderr


@pytest.mark.parametrize(
    "option", [["--can", "vcan0"], ["--slcan-pty"], ["--node", "2"], ["--store", "flash"], ["--num", "fix"]]
)
def test_image_takes_no_option_that_it_would_not_obey(option: list[str]) -> None:
    result = CliRunner().invoke(main, ["sim", "--image", "kontur.elf", *option])
    assert result.exit_code == 2
    assert result.stderr.endswith(f"leave out {option[0]}\n")


def test_image_needs_a_machine_that_the_drive_simulates() -> None:
    result = CliRunner().invoke(main, ["sim", "--image", "kontur.elf"])
    assert result.exit_code == 1
    assert "is no machine that the drive simulates by itself" in result.stderr
    assert "ball_screw_on_chip.toml" in result.stderr


def test_image_that_is_not_there_is_named_with_what_makes_it() -> None:
    on_chip = str(MACHINES / "ball_screw_on_chip.toml")
    result = CliRunner().invoke(main, ["sim", "--image", "nowhere.elf", "--machine", on_chip])
    assert result.exit_code == 1
    assert result.stderr == "Error: nowhere.elf is not there; make it by `make firmware`\n"
