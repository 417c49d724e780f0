# SPDX-License-Identifier: Apache-2.0
"""The engine of sweeps and experiments: its file of rows, its errors, and the same rows whoever makes them."""

from __future__ import annotations

import csv
import gc
import json
import os
import pickle
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from click.testing import CliRunner

from kontur import errors
from kontur.cli import main
from kontur.errors import EmcyError, FileError, InputError, KonturError, SimulatorError
from kontur.experiments import engine, machines, sweep, table
from kontur.experiments.engine import Row, carry_out
from kontur.machine import Machine

JOBS = [(name, number) for name in "ab" for number in (1, 2)]


def made(job: tuple[str, int]) -> Row:
    """A row whose figures have all digits, and what JSON has no own kind for."""
    name, number = job
    return {"name": name, "third": number / 3.0, "nothing": None, "nan": float("nan"), "pair": (number, 0.1)}


ROWS = [json.loads(json.dumps(made(job))) for job in JOBS]


RUNS = [
    {"path": "circle", "radius": 1, "feed": 50, "controller": controller, "seed": seed}
    for controller in ("cascade", "ccu")
    for seed in (1, 2)
]


def same(rows: list[Row]) -> bool:
    return repr(rows) == repr(ROWS)


# --- the file of rows -------------------------------------------------------------------------------------------------
@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Jobs of this process, whose functions need not be imported anywhere."""
    monkeypatch.setattr(engine, "_by_processes", lambda function, jobs, *_: iter_of(function, jobs))


def iter_of(function: Callable[[Any], Any], jobs: list[tuple[int, Any]]) -> Iterator[tuple[int, Any]]:
    for number, job in reversed(jobs):
        yield number, function(job)


@pytest.mark.usefixtures("here")
def test_rows_are_the_same_with_a_file_without_one_and_where_they_were_there_before(tmp_path: Path) -> None:
    rows_file, shares = tmp_path / "a.rows", list[float]()
    assert same(carry_out(made, JOBS))
    assert same(carry_out(made, JOBS, rows_file=rows_file))
    lines = rows_file.read_bytes().splitlines(keepends=True)
    rows_file.write_bytes(b"".join(lines[:3]) + lines[3][:-5])
    assert same(carry_out(made, JOBS, rows_file=rows_file, progress=shares.append))
    assert shares == [0.5, 0.75, 1.0]  # what was finished is not made again
    assert same(carry_out(made, JOBS, rows_file=rows_file))


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"x,y\n1,2\n", "is of another sweep"),
        (b"not mine", "is no file of a sweep"),
        (b'{"kontur_sweep": 1, "digest": "0", "runs": 4}\n', "is of another sweep, or of other files or firmware"),
    ],
)
def test_rows_of_something_else_are_refused_and_stay(tmp_path: Path, content: bytes, message: str) -> None:
    rows_file = tmp_path / "a.rows"
    rows_file.write_bytes(content)
    with pytest.raises(FileError, match=message):
        carry_out(made, JOBS, rows_file=rows_file)
    assert rows_file.read_bytes() == content


@pytest.mark.usefixtures("here")
def test_rows_with_damage_are_one_message(tmp_path: Path) -> None:
    rows_file = tmp_path / "a.rows"
    carry_out(made, JOBS, rows_file=rows_file)
    head = rows_file.read_bytes().splitlines(keepends=True)[0]
    for damage in (b"{\n", b"[1]\n", b"{}\n", json.dumps({"mean_um": 1.0}).encode() + b"\n"):
        rows_file.write_bytes(head + damage)
        with pytest.raises(FileError, match="has a line that is no row of a sweep"):
            carry_out(made, JOBS, rows_file=rows_file)


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("what", ["jobs", "function", "file", "code"])
def test_rows_are_of_these_jobs_this_function_these_files_and_this_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    file, rows_file = tmp_path / "m.toml", tmp_path / "a.rows"
    file.write_text("a = 1\n")
    carry_out(made, JOBS, [str(file)], rows_file)
    jobs, function = JOBS, made
    if what == "jobs":
        jobs = [*JOBS[:-1], ("b", 3)]
    elif what == "function":
        function = lambda job: made(job)  # noqa: E731
    elif what == "file":
        file.write_text("a = 2\n")
    else:
        monkeypatch.setattr(engine, "_code", lambda: "another")
    with pytest.raises(FileError, match="is of another sweep, or of other files or firmware"):
        carry_out(function, jobs, [str(file)], rows_file)


def test_code_is_of_all_that_computes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lib").mkdir()
    (tmp_path / "a.py").write_text("1\n")
    (tmp_path / "lib" / "libkontur_f32.so").write_bytes(b"1")
    (tmp_path / "notes.txt").write_text("1\n")
    monkeypatch.setattr(engine, "_PACKAGE", tmp_path)
    found = [engine._code.__wrapped__()]
    for name in ("a.py", "lib/libkontur_f32.so", "notes.txt"):
        (tmp_path / name).write_text("2\n")
        found.append(engine._code.__wrapped__())
    assert found[0] != found[1] != found[2] == found[3]


@pytest.mark.usefixtures("here")
def test_a_file_that_takes_no_more_is_one_message_and_keeps_what_it_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows_file = tmp_path / "a.rows"

    def full(done: float) -> None:
        if done == 0.5:
            rows_file.rename(tmp_path / "b.rows")
            rows_file.mkdir()

    with pytest.raises(FileError, match=r"a\.rows: cannot be written \(Is a directory\); the same command goes on"):
        carry_out(made, JOBS, rows_file=rows_file, progress=full)
    assert len((tmp_path / "b.rows").read_bytes().splitlines()) == 3


# --- processes --------------------------------------------------------------------------------------------------------
def dies_or_raises(job: str) -> Row:
    if job == "dies":
        os.kill(os.getpid(), signal.SIGKILL)
    raise FileError("part.ngc", "is wrong", 3, "G1")


def test_errors_of_a_job_and_the_death_of_a_process_are_messages() -> None:
    with pytest.raises(FileError, match=r"^part\.ngc:3: G1: is wrong$") as error:
        carry_out(dies_or_raises, ["raises", "raises"], workers=1)
    assert (error.value.file, error.value.line) == ("part.ngc", 3)
    with pytest.raises(SimulatorError, match="was killed, perhaps for lack of memory; the same command goes on"):
        carry_out(dies_or_raises, ["dies", "dies"], workers=1)


def test_ctrl_c_waits_while_processes_are_started() -> None:
    reached, before = list[str](), signal.getsignal(signal.SIGINT)

    def start() -> None:
        with engine._without_ctrl_c():
            signal.raise_signal(signal.SIGINT)
            reached.append("end")

    with pytest.raises(KeyboardInterrupt):
        start()
    assert reached
    assert signal.getsignal(signal.SIGINT) is before


def test_errors_are_the_same_in_another_process() -> None:
    for error in (
        FileError("a.ngc", "is wrong", 3, "G1"),
        EmcyError(0x8611, 1, b"12345", "following error"),
        *(kind("what", "more") for kind in (KonturError, InputError, errors.StreamError)),
    ):
        again = pickle.loads(pickle.dumps(error))
        assert (type(again), again.args, vars(again), str(again)) == (
            type(error), error.args, vars(error), str(error),
        )  # fmt: skip


def test_one_process_reads_the_eds_once_for_all_its_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    first = sweep.one_run(RUNS[0])
    monkeypatch.setattr("canopen.objectdictionary.eds.import_eds", lambda *_: pytest.fail("the EDS is read again"))
    assert sweep.one_run(RUNS[0]) == first
    assert first["mean_um"] > 0.0


# --- a dask cluster ---------------------------------------------------------------------------------------------------
@contextmanager
def cluster(**how: Any) -> Iterator[Any]:
    distributed = pytest.importorskip("distributed", reason="no dask; get it by: pip install 'kontur[sweep]'")
    with distributed.LocalCluster(dashboard_address=None, threads_per_worker=1, memory_limit=None, **how) as made:
        yield made


def test_rows_of_a_dask_cluster_are_those_of_this_machine_though_one_of_its_workers_dies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, "_ON_CLUSTER", 2)  # the others follow
    rows_file, killed = tmp_path / "a.rows", list[int]()
    with cluster(n_workers=2) as workers:

        def kill_one(done: float) -> None:
            if done > 0.0 and not killed:
                killed.append(workers.workers[0].pid)
                os.kill(killed[0], signal.SIGKILL)

        rows = carry_out(sweep.one_run, RUNS, (), rows_file, workers.scheduler_address, kill_one)
    assert killed
    assert rows == [sweep.one_run(inputs) for inputs in RUNS]
    assert carry_out(sweep.one_run, RUNS, (), rows_file) == rows  # goes on from that file, where nothing is left to do
    assert len(rows_file.read_bytes().splitlines()) == 1 + len(RUNS)


def test_a_cluster_that_cannot_work_is_one_message(monkeypatch: pytest.MonkeyPatch) -> None:
    with cluster(n_workers=0) as workers, pytest.raises(SimulatorError, match="has no worker; start some: dask worker"):
        carry_out(sweep.one_run, RUNS, workers=workers.scheduler_address)
    monkeypatch.setattr(engine, "_CONNECT_S", 0.2)
    for address in (workers.scheduler_address, "tcp://", "carrier-pigeon://home"):
        # A client that failed is closed where it is collected. In the next one's loop that waits for a lock which the
        # start of that loop holds (distributed's LoopRunner, for 10 s): so it is collected here.
        gc.collect()
        with pytest.raises(SimulatorError, match=f"{address}: no dask scheduler answers"):
            carry_out(sweep.one_run, RUNS, workers=address)


def test_without_dask_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    result = CliRunner().invoke(main, ["experiment", "robust", "--seeds", "2", "--workers", "tcp://localhost:8786"])
    assert result.exit_code == 1
    assert "needs dask, which is not installed: pip install 'kontur[sweep]'" in result.output


def test_a_worker_that_would_make_other_rows_refuses(tmp_path: Path) -> None:
    file = tmp_path / "m.toml"
    file.write_text("a = 1\n")
    hashes = tuple(engine._hashes([str(file)]).items())
    assert engine._on_worker(made, JOBS[0], engine._code(), hashes)["name"] == "a"
    with pytest.raises(SimulatorError, match="has another Kontur, NumPy or SciPy; install the same there"):
        engine._on_worker(made, JOBS[0], "another", hashes)
    for change in (lambda: file.write_text("a = 2\n"), file.unlink):
        change()
        engine._check_worker.cache_clear()
        with pytest.raises(FileError, match=r"m\.toml: is not this file on the dask worker on .*; put it where all"):
            engine._on_worker(made, JOBS[0], engine._code(), hashes)


# --- the commands -----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("value", ["0", "-1", "many", "1025", "localhost:8786"])
def test_workers_are_a_number_or_an_address(value: str) -> None:
    result = CliRunner().invoke(main, ["experiment", "robust", "--workers", value])
    assert result.exit_code == 2
    assert f"{value!r} is neither a number of processes from 1 to 1024 nor an address such as tcp://" in result.output


@pytest.mark.usefixtures("here")
def test_an_experiment_keeps_its_runs_and_their_table(tmp_path: Path) -> None:
    command = ["experiment", "paper", "--case", "high-tight", "--controller", "track", "--controller", "cascade",
               "--json", "--out", str(tmp_path / "new" / "folder")]  # fmt: skip
    first = CliRunner().invoke(main, command)
    assert first.exit_code == 0, first.output
    folder = tmp_path / "new" / "folder"
    assert {"paper.rows", "paper.csv"} <= {file.name for file in folder.iterdir()}
    with (folder / "paper.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["controller"] for row in rows] == ["track", "cascade"]  # the second one was ready first
    assert [float(row["mean_um"]) for row in rows] == [row["mean_um"] for row in json.loads(first.stdout)["cases"]]
    lines = (folder / "paper.rows").read_bytes().splitlines(keepends=True)
    (folder / "paper.rows").write_bytes(b"".join(lines[:2]) + lines[2][:9])
    again = CliRunner().invoke(main, command)
    assert again.stdout == first.stdout
    assert len((folder / "paper.rows").read_bytes().splitlines()) == 3
    other = CliRunner().invoke(main, [*command, "--seed", "2"])
    assert other.exit_code == 1
    assert "paper.rows: is of another sweep" in other.output


@pytest.mark.usefixtures("here")
def test_machines_are_spread_by_design_and_gathered_by_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    margins = SimpleNamespace(axes=[SimpleNamespace(margins=SimpleNamespace(ms=1.5))])
    work, asked = [machines.draw(1), machines.draw(2)], list[tuple[str, str, str]]()

    def design(machine: Machine, controller: str, compensation: str) -> SimpleNamespace:
        asked.append((machine.name, controller, compensation))
        return SimpleNamespace(axes=margins.axes, gains={"smc.lambda": 20.0}, parameters={"what": compensation})

    monkeypatch.setattr(machines, "design", design)
    monkeypatch.setattr(machines, "cases", lambda: {"a": None, "b": None})
    monkeypatch.setattr(machines, "_drive", lambda machine, path, controller, values, num: {
        "ended": "", "why": f"{machine.name} {controller} {values['what']}"})  # fmt: skip
    rows = machines.compare(work, rows_file=tmp_path / "machines.rows")
    assert len(asked) == 6  # each design is a job of its own
    for row, machine in zip(rows, work, strict=True):
        assert list(row) == ["name", "x", "y", "designs", "runs"]
        assert list(row["designs"]) == ["ccu full", "cascade full", "cascade rigid"]
        assert all(one == {"ms": 1.5, "gains": {"smc.lambda": 20.0}} for one in row["designs"].values())
        assert list(row["runs"]) == ["a", "b"]
        assert {name: one["why"] for name, one in row["runs"]["b"].items()} == {
            f"{law} {what}": f"{machine.name} {law} {what}"
            for law, what in (("ccu", "full"), ("cascade", "full"), ("cascade", "rigid"))
        }


# --- the table --------------------------------------------------------------------------------------------------------
def test_table_has_a_column_for_each_value_within_a_value_and_one_kind_in_each(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="no pyarrow; get it by: pip install 'kontur[sweep]'")
    rows = [
        {"x": {"travel_m": [0, 0.5]}, "feed": 2**60 + 1, "problem": None, "mean_um": None},
        {"x": {"travel_m": [1, 1.5]}, "feed": 0.1, "problem": None, "mean_um": None, "gains": {"smc.k": 1 / 3}},
    ]
    names = table.write(rows, tmp_path / "a.csv")
    assert [name.name for name in names] == ["a.csv", "a.parquet"]
    assert names[0].read_text() == (
        "x.travel_m.0,x.travel_m.1,feed,problem,mean_um,gains.smc.k\n"
        "0,0.5,1152921504606846977,,,\n"
        "1,1.5,0.1,,,0.3333333333333333\n"
    )
    found = parquet.read_table(names[1])
    kinds = dict(zip(found.schema.names, map(str, found.schema.types), strict=True))
    assert kinds == {"x.travel_m.0": "int64", "x.travel_m.1": "double", "feed": "double", "problem": "string",
                     "mean_um": "double", "gains.smc.k": "double"}  # fmt: skip
    assert found.column("gains.smc.k").to_pylist() == [None, 1 / 3]
