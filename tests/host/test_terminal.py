# SPDX-License-Identifier: Apache-2.0
"""What reaches the terminal: any text in any encoding, no escape sequences from outside, and outputs that fail."""

import json
import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from kontur.cli import main
from kontur.errors import visible
from kontur.runs import log

KONTUR = (sys.executable, "-m", "kontur.cli")
TIMEOUT_S = 120.0
HOSTILE = "\x1b]0;owned\x07\x1b[31m\x9b2J\x7f\u202e[bold]:smile:"
SHOWN = r"\x1b]0;owned\x07\x1b[31m\x9b2J\x7f\u202e[bold]:smile:"
RAW = re.compile(rb"[\x00-\x08\x0b-\x1f\x7f]|\xc2[\x80-\x9f]|\xe2\x80\xae")
ROWS = """tick,time_s,tangential_error_um,contour_error_um,reference_x_mm,reference_y_mm
1,0.001,1.0,1.0,1.0,1.0
2,0.002,1.0,1.5,1.1,1.0
"""


def kontur(*arguments: str | bytes, stdout: int = subprocess.PIPE, **env: str) -> "subprocess.CompletedProcess[bytes]":
    """The command as a process; its standard output and error."""
    return subprocess.run(
        [*KONTUR, *arguments],
        stdout=stdout,
        stderr=subprocess.PIPE,
        timeout=TIMEOUT_S,
        check=False,
        env=os.environ | env,
    )


def on_terminal(*arguments: str | bytes) -> bytes:
    """All that a terminal gets from the command."""
    leader, follower = pty.openpty()
    with subprocess.Popen([*KONTUR, *arguments], stdout=follower, stderr=follower, stdin=follower) as process:
        os.close(follower)
        got = b""
        while True:
            try:
                piece = os.read(leader, 1 << 16)
            except OSError:  # the command has ended
                break
            if not piece:
                break
            got += piece
        process.wait(TIMEOUT_S)
    os.close(leader)
    return got


def written(tmp_path: Path, name: str | bytes = "a.csv", **meta: object) -> str:
    """A log with these entries; its name."""
    head = {"program": "circle", "controller": "ccu", "status": "complete"} | meta
    file = os.path.join(os.fsencode(tmp_path), os.fsencode(name))
    with open(file, "w") as out:
        out.writelines(["# kontur log 1\n", *(f"# {key}: {json.dumps(value)}\n" for key, value in head.items()), ROWS])
    return os.fsdecode(file)


def test_text_is_shown_and_lines_stay_lines() -> None:
    assert visible("µm\tis fine\n") == "µm\tis fine\n"
    assert visible(HOSTILE) == SHOWN
    assert visible("\r\udcff\u2028") == r"\r\udcff\u2028"


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_tables_are_printed_in_any_encoding(tmp_path: Path, encoding: str) -> None:
    result = kontur("log", "show", written(tmp_path, program="Teil µ ± 漢"), PYTHONIOENCODING=encoding, LC_ALL="C")
    assert result.returncode == 0, result.stderr
    assert {"ascii": r"Teil \xb5 \xb1 \u6f22", "latin-1": r"Teil µ ± \u6f22"}.get(
        encoding, "Teil µ ± 漢"
    ) in result.stdout.decode(encoding)


def test_messages_and_help_are_printed_in_ascii() -> None:
    result = kontur("run", "µ.ngc", PYTHONIOENCODING="ascii")
    assert result.returncode == 1
    assert result.stderr.startswith(b"Error: \\xb5.ngc: no such file, and no shape either")
    assert kontur("run", "--help", PYTHONIOENCODING="ascii").returncode == 0


def test_file_name_that_is_not_utf_8_is_read_logged_reported_and_shown(tmp_path: Path) -> None:
    part = os.fsencode(tmp_path) + b"/part-\xff\x1b.ngc"
    page, record = os.fsencode(tmp_path) + b"/page-\xfe.html", os.fsencode(tmp_path) + b"/log-\xfe.csv"
    with open(part, "w") as file:
        file.write("G1 X1 F1000\n")
    result = kontur("run", part, "--log", record, "--report", page)
    assert (result.returncode, result.stderr) == (0, b"")
    assert rb"part-\udcff\x1b.ngc" in re.sub(rb"\s", b"", result.stdout)
    assert json.loads(kontur("run", part, "--json").stdout)["program"] == os.fsdecode(part)
    assert log.read(os.fsdecode(record)).meta["program"] == os.fsdecode(part)
    with open(page, "rb") as file:
        content = file.read()
    assert rb"part-\udcff\x1b.ngc" in content
    assert RAW.search(content) is None
    assert kontur("log", "show", record).returncode == 0
    assert kontur("log", "convert", record, str(tmp_path / "a.mf4")).returncode == 0
    assert kontur("report", record, "-o", page).returncode == 0
    missing = kontur("run", b"no-\xff.ngc")
    assert missing.stderr.startswith(rb"Error: no-\udcff.ngc: no such file")


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", HOSTILE),
        ("run", f"{HOSTILE}.ngc"),
        ("run", "circle", "--feed", HOSTILE),
        ("run", "circle", "--feed", "1", "--machine", HOSTILE),
        ("run", "circle", "--feed", "1", "--set", f"{HOSTILE}=1"),
        ("run", "circle", "--feed", "1", "--log", f"{HOSTILE}/a.csv"),
        ("param", "get", HOSTILE),
        ("param", "set", HOSTILE),
        ("info", "-i", HOSTILE),
        ("info", "-i", "slcan", "-c", HOSTILE),
        ("log", "show", f"{HOSTILE}.csv"),
        (HOSTILE,),
        (f"--{HOSTILE}",),
        ("run", f"--{HOSTILE}"),
    ],
)
def test_message_about_a_hostile_word_shows_its_control_characters(arguments: tuple[str, ...]) -> None:
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code in (1, 2)
    assert isinstance(result.exception, SystemExit)
    assert RAW.search(result.output_bytes) is None
    assert rb"\x1b[31m" in result.stderr_bytes


def test_hostile_texts_of_files_are_shown_on_a_terminal(tmp_path: Path) -> None:
    """rich's own sequences are the only ones that reach it."""
    (tmp_path / "a.ngc").write_text(f"G1 X1 F1000 ({HOSTILE}\n")
    assert rb"\x1b]0;owned\x07" in on_terminal("run", str(tmp_path / "a.ngc"))
    got = on_terminal(
        "log",
        "show",
        written(tmp_path, program=HOSTILE, machine="[bold]:smile:", **{HOSTILE.replace(":", ""): HOSTILE}),
    )
    assert got.count(rb"\x1b]0;owned\x07\x1b[31m") >= 2
    assert b"[bold]:smile:" in got
    assert b"\x1b]0;" not in got
    assert b"\x07" not in got


def test_table_of_a_run_shows_the_name_of_its_file(tmp_path: Path) -> None:
    name = f"{tmp_path}/[bold]\x1b]0;a\x07.ngc"
    Path(name).write_text("G1 X1 F1000\n")
    got = on_terminal("run", name)
    assert b"\x1b]0;" not in got
    assert b"[bold]" in got.replace(b"\r\n", b"")
    assert b"\x1b[1m" in got  # of the title, by rich


def test_report_of_hostile_texts_has_none_of_their_characters(tmp_path: Path) -> None:
    hostile = HOSTILE + "<script>$\\frac{"
    one = written(tmp_path, controller=hostile, program=hostile, machine=hostile, firmware=hostile, command=hostile)
    for output in ("a.html", "a.png"):
        result = kontur("report", one, "-o", str(tmp_path / output))
        assert result.returncode == 0, result.stderr
    page = (tmp_path / "a.html").read_bytes()
    assert RAW.search(page) is None
    assert b"<script>" not in page


def test_json_is_json_and_has_no_control_characters(tmp_path: Path) -> None:
    result = kontur("log", "show", "--json", written(tmp_path, program=HOSTILE))
    assert json.loads(result.stdout)["meta"]["program"] == HOSTILE
    assert RAW.search(result.stdout) is None


@pytest.mark.parametrize("arguments", [("--help",), ("scope", "--list"), ("param", "dump")])
def test_full_device_as_output_is_one_message(arguments: tuple[str, ...]) -> None:
    full = os.open("/dev/full", os.O_WRONLY)
    result = kontur(*arguments, stdout=full)
    os.close(full)
    assert result.stderr == b"Error: the output cannot be written (No space left on device); send it elsewhere\n"
    assert result.returncode == 1


@pytest.mark.parametrize(
    "arguments", [("--help",), ("scope", "--list"), ("param", "dump"), ("param", "get", "limits.x")]
)
def test_closed_pipe_ends_as_other_programs_end_there(arguments: tuple[str, ...]) -> None:
    """141 is what a shell gets from a program that SIGPIPE has ended; an error of the command itself comes first."""
    reader, writer = os.pipe()
    os.close(reader)
    result = kontur(*arguments, stdout=writer)
    os.close(writer)
    if "limits.x" in arguments:
        assert result.returncode == 1
        assert result.stderr.startswith(b"Error: limits.x")
    else:
        assert (result.returncode, result.stderr) == (141, b"")


@pytest.mark.parametrize("full", [False, True])
def test_run_whose_output_fails_still_writes_log_and_report(tmp_path: Path, full: bool) -> None:
    if full:
        writer = os.open("/dev/full", os.O_WRONLY)
    else:
        reader, writer = os.pipe()
        os.close(reader)
    files = ("--log", str(tmp_path / "a.csv"), "--report", str(tmp_path / "a.html"))
    result = kontur("run", "circle", "--radius", "1", "--feed", "50", *files, stdout=writer)
    os.close(writer)
    assert result.returncode == (1 if full else 141)
    assert log.read(tmp_path / "a.csv").meta["status"] == "complete"
    assert (tmp_path / "a.html").exists()


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_closed_descriptors_are_survived(tmp_path: Path, closed: str) -> None:
    """The files are whole: none of them got the number of a standard stream."""
    command = f'exec {sys.executable} -m kontur.cli param dump "$0" {closed}'
    assert subprocess.run(["sh", "-c", command, tmp_path / "a.toml"], timeout=TIMEOUT_S, check=False).returncode == 0
    assert (tmp_path / "a.toml").read_text().startswith("# Parameters of a Kontur drive")


@pytest.mark.parametrize("name", ["x" * 300, "x" * 300 + ".ngc", "a/" * 3000 + ".csv"])
def test_name_that_is_too_long_is_one_message(name: str) -> None:
    for arguments in (("run", name), ("log", "show", name), ("run", "circle", "--feed", "1", "--log", f"{name}.csv")):
        result = CliRunner().invoke(main, arguments)
        assert result.exit_code == 1
        assert isinstance(result.exception, SystemExit)
        assert result.stderr.startswith("Error: ")


def test_value_without_equals_sign_says_what_to_write() -> None:
    assert "write smc.lambda=VALUE" in CliRunner().invoke(main, ["param", "set", "smc.lambda", "150"]).stderr
