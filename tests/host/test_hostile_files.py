# SPDX-License-Identifier: Apache-2.0
"""Every reader, given hostile bytes: it reads them, or raises one error that a user can read. Nothing else comes out.

The bytes are random ones, and files that are good but for a few random edits, which get further into a reader.
"""

import dataclasses
import json
import math
import os
import struct
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made_runs import made_run

from kontur import files, machine
from kontur.cli import main
from kontur.drive import parameter_file, scope
from kontur.errors import KonturError
from kontur.path import programs
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.report import capture_file, page
from kontur.runs import log
from kontur.runs.summary import summary

PART = Path(__file__).parents[2] / "examples" / "part.ngc"
GCODE = b"G21 G90\nG0 X1 Y1\nG1 X5 F600 (cut)\nG2 X10 Y6 I0 J5\nG3 X0 Y0 R-20.5\nG4 P0.1\nG91 G1 X1 ; end\nM30\n"
POINTS = b"x,y\n0,0\n1,0.5\n2,0\n3,-1 # last\n"
TIMED = b"t,x,y\n0,0,0\n0.5,1,0.5\n1.0,2,0\n"
PARAMETERS = b"# of a drive\nlonely = 1\n\n[smc]\nlambda = 200.0  # 1/s\nk = 1e-3\n[limits]\nx = 5\n"
PIECES = st.sampled_from(
    [b"nan", b"inf", b"-inf", b"1e308", b"-1e999", b"1e-320", b"9" * 20, b"9" * 400, b"9" * 5000, b"-", b"0", b",",
     b"\n", b"\r", b'"', b"#", b"[", b"]", b"{", b"}", b"[" * 5000, b'{"a":' * 500, b"(" * 500, b"%", b"\x00",
     b"\x1b[31m", b"\xff", b"\xc2\x9b", b"\xed\xa0\x80", b"=", b".", b"null", b"true", b"X", b"G2", b"R", b"I"]
)  # fmt: skip
EDIT = st.tuples(st.floats(0.0, 1.0), st.integers(0, 12), PIECES | st.binary(max_size=8))


def mutated(good: bytes) -> st.SearchStrategy[bytes]:
    """`good` after a few edits, each of which deletes some bytes somewhere and inserts others."""

    def edited(edits: list[tuple[float, int, bytes]]) -> bytes:
        content = good
        for place, deleted, inserted in edits:
            at = round(place * len(content))
            content = content[:at] + inserted + content[at + deleted :]
        return content

    return st.builds(edited, st.lists(EDIT, min_size=1, max_size=4))


def hostile(*good: bytes) -> st.SearchStrategy[bytes]:
    return st.one_of(st.binary(max_size=64), *(mutated(one) for one in good))


def check(suffix: str, content: bytes, read: Callable[[Path], Any], use: Callable[[Any], Any] = lambda _: None) -> None:
    """Read the file, and use what was read; an error of Kontur has to be readable in one line."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")  # a user must not see one
        file = Path(folder, f"hostile{suffix}")
        file.write_bytes(content)
        try:
            use(read(file))
        except KonturError as error:
            message = str(error)
            assert len(message) < 4000, message[:200]


def refusal(suffix: str, content: bytes, read: Callable[[Path], Any]) -> str:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, f"hostile{suffix}")
        file.write_bytes(content)
        with pytest.raises(KonturError) as error:
            read(file)
    return str(error.value)


def planned(program: Any) -> None:
    """Only for short ones, since the time it takes depends on the length."""
    table = machine.load()
    if sum(move.segment.length_m for move in program.moves) < 0.05:
        plan(program, limits(table), travel_m=table.soft_limits_m)


@given(hostile(GCODE, PART.read_bytes()[:600]))
@settings(max_examples=200)
def test_gcode(content: bytes) -> None:
    check(".ngc", content, programs.load, planned)


@given(hostile(POINTS), st.sampled_from([0.01, None]))
def test_points(content: bytes, feed_mps: float | None) -> None:
    check(".csv", content, lambda file: programs.load(file, feed_mps), planned)


@given(hostile(TIMED))
def test_timed_points(content: bytes) -> None:
    check(".csv", content, programs.load, planned)


@given(hostile(machine.DEFAULT.read_bytes(), (machine.MACHINES / "table1_on_chip.toml").read_bytes()))
@settings(max_examples=200)
def test_machine(content: bytes) -> None:
    check(".toml", content, machine.load, lambda table: limits(table))


@given(hostile(PARAMETERS))
def test_parameters(content: bytes) -> None:
    def all_numbers(values: dict[str, float]) -> None:
        assert all(math.isfinite(value) for value in values.values())

    check(".toml", content, parameter_file.read, all_numbers)


def short_run() -> log.RunLog:
    run = made_run(trajectory="0" * 64, frames_lost=0, seed=1, command="kontur run circle")
    return log.RunLog(run.meta, {name: values[:30] for name, values in run.columns.items()})


RUN_CSV = log.csv_text(short_run()).encode()


def used(run: log.RunLog) -> None:
    summary(run)
    log.csv_text(run)


@given(hostile(RUN_CSV[:1500], RUN_CSV))
@settings(max_examples=200)
def test_log(content: bytes) -> None:
    check(".csv", content, log.read, used)


def run_mf4() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        log.write(short_run(), Path(folder, "a.mf4"))
        return Path(folder, "a.mf4").read_bytes()


@given(hostile(run_mf4()))
@settings(max_examples=25, suppress_health_check=[HealthCheck.too_slow])
def test_mf4_log(content: bytes) -> None:
    check(".mf4", content, log.read, used)


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=6) | st.sampled_from([10**400, "$x^{"]),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=4), inner, max_size=2),
    max_leaves=4,
)  # fmt: skip
CELL = st.sampled_from([0.0, 1.0, -1.0, np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-320])


@given(
    st.dictionaries(st.sampled_from([*log.META, "other"]), VALUES, max_size=3),
    st.lists(st.tuples(st.integers(0, 100), st.integers(0, 29), CELL), max_size=4),
    st.sets(st.integers(0, 100), max_size=5),
    st.integers(1, 30),
)
@settings(max_examples=40, suppress_health_check=[HealthCheck.too_slow])
def test_report_of_a_log(
    meta: dict[str, Any], cells: list[tuple[int, int, float]], left_out: set[int], rows: int
) -> None:
    """What a log may hold, as far as its reader accepts it, can also be summarised and drawn."""
    good = short_run()
    names = list(good.columns)
    left = {names[i % len(names)] for i in left_out}
    columns = {name: values[:rows].copy() for name, values in good.columns.items() if name not in left}
    for column, row, value in cells:
        name = names[column % len(names)]
        if name in columns:
            columns[name][row % rows] = value
    fake = dataclasses.replace(good)
    object.__setattr__(fake, "meta", {**good.meta, **meta})
    object.__setattr__(fake, "columns", columns)
    content = log.csv_text(fake).encode(errors="surrogatepass")

    def reported(run: log.RunLog) -> None:
        used(run)
        with tempfile.TemporaryDirectory() as folder:
            page.write_report(Path(folder, "a.html"), [run])
            page.picture(Path(folder, "a.png"), [run])

    check(".csv", content, log.read, reported)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("score", {"mean_um": "1.0"}, "score is no table of numbers"),
        ("score", [1.0], "score is no table"),
        ("score", {"mean_um": float("nan")}, "score is no table of numbers"),
        ("path", {"from_mm": 0.0}, "path is no table with from_mm, known_mm, length_mm, to_mm"),
        (
            "path",
            {"from_mm": 0, "known_mm": 0, "length_mm": 0, "to_mm": 0},
            "table with from_mm, known_mm, length_mm, to_mm",
        ),
        ("score", {"mean_um": None}, "score is no table of numbers"),
        ("force_max_N", "600", "force_max_N is no number"),
        ("frames_lost", True, "frames_lost is no number"),
        ("seed", 10**400, "seed is no number"),
        ("controller", ["ccu"], "controller is no text"),
        ("parameters", "none", "parameters is no table"),
        ("other", [[[[[[[[[[]]]]]]]]]], "other is nested more than 8 levels deep"),
    ],
)
def test_head_of_a_log_with_another_kind_of_entry_is_one_message(key: str, value: Any, message: str) -> None:
    lines = RUN_CSV.decode().splitlines(keepends=True)
    lines = [line for line in lines if not line.startswith(f"# {key}:")]
    content = "".join([lines[0], f"# {key}: {json.dumps(value)}\n", *lines[1:]])
    assert refusal(".csv", content.encode(), log.read).endswith(message)


@pytest.mark.parametrize(
    ("suffix", "content", "read"),
    [
        (".csv", RUN_CSV.replace(b'"ccu"', b"[" * 100_000), log.read),
        (".csv", RUN_CSV.replace(b'"ccu"', b"9" * 5000), log.read),
        (".toml", b"x = " + b"[" * 100_000, machine.load),
        (".toml", b"x = " + b"[" * 100_000, parameter_file.read),
        (".toml", b"[smc]\nlambda = " + b"9" * 400, parameter_file.read),
        (".toml", machine.DEFAULT.read_bytes().replace(b"88.08", b"9" * 400), machine.load),
        (".csv", RUN_CSV.replace(b"\n700,", b"\n7e999,"), log.read),
    ],
)
def test_nesting_and_numbers_without_end_are_one_message(
    suffix: str, content: bytes, read: Callable[[Path], Any]
) -> None:
    assert len(refusal(suffix, content, read)) < 4000


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "pipe.ngc"),
        ("run", "pipe.csv"),
        ("run", "circle", "--feed", "1", "--machine", "pipe.ngc"),
        ("log", "show", "pipe.csv"),
        ("log", "show", "pipe.mf4"),
        ("log", "convert", "pipe.csv", "a.mf4"),
        ("report", "pipe.csv", "-o", "a.html"),
        ("param", "load", "pipe.ngc"),
    ],
)
def test_pipe_that_brings_nothing_does_not_hang_a_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]
) -> None:
    monkeypatch.setattr(files, "_PIPE_S", 0.01)
    monkeypatch.chdir(tmp_path)
    for suffix in ("ngc", "csv", "mf4"):
        os.mkfifo(f"pipe.{suffix}")
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 1
    assert "is a pipe that brought nothing" in result.stderr


class HostileDrive:
    """Answers with any bytes where a capture is read. No real drive does, so this is none."""

    def __init__(self, data: bytes) -> None:
        self.data = data

    def read_domain(self, name: str, progress: Any) -> bytes:
        return self.data

    def read(self, name: str) -> int:
        return {"clock.control_hz": 10_000}.get(name, 0)


CAPTURE = struct.pack("<BBHIIIII8s6i", 1, 2, 1, 3, 1, 100, 101, 0, bytes([1, 2, 0, 0, 0, 0, 0, 0]), *range(6))


def saved(capture: scope.Capture) -> None:
    from kontur.cli.scope import show

    capture_file.csv_text(capture)
    show(capture, True)


@given(hostile(CAPTURE))
def test_capture_of_the_scope(content: bytes) -> None:
    check(".bin", content, lambda file: scope.read(HostileDrive(file.read_bytes())), saved)  # type: ignore[arg-type]
