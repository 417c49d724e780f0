# SPDX-License-Identifier: Apache-2.0
"""`kontur sweep`: what a file asks for, and that the table is the same however the runs are made."""

from __future__ import annotations

import csv
import os
import select
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from kontur import machine as machines
from kontur.cli import main
from kontur.drive.target import Target
from kontur.errors import FileError, InputError
from kontur.experiments import sweep
from kontur.path import shapes
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.runs.runner import RunOptions, run
from kontur.runs.summary import summary

SMALL = """
path = "circle"
radius = 1
feed = [20, 50]
controller = "cascade"
seed = { first = 1, count = 2 }
"""
DEADLINE_S = 120.0


def written(folder: Path, text: str) -> Path:
    file = folder / "sweep.toml"
    file.write_text(text)
    return file


# --- what a file asks for ---------------------------------------------------------------------------------------------
def test_grid_is_the_product_of_all_lists_and_a_draw_meets_each_point(tmp_path: Path) -> None:
    text = (
        SMALL + "draws = 3\nset.smc.lambda = { low = 50, high = 200, log = true }\nx.mass_kg = { low = 80, high = 90 }"
    )
    runs = sweep.load(written(tmp_path, text)).runs
    assert len(runs) == 3 * 2 * 2
    points = [(one["draw"], one["seed"], one["feed"]) for one in runs]
    assert points == [(draw, seed, feed) for draw in range(3) for seed in (1, 2) for feed in (20, 50)]
    for draw in range(3):
        assert len({(one["set.smc.lambda"], one["x.mass_kg"]) for one in runs if one["draw"] == draw}) == 1
    assert len({one["set.smc.lambda"] for one in runs}) == 3
    assert all(50 <= one["set.smc.lambda"] <= 200 and 80 <= one["x.mass_kg"] <= 90 for one in runs)


def test_draws_stay_where_there_are_more_of_them_and_change_with_their_seed(tmp_path: Path) -> None:
    text = "x.mass_kg = { low = 80, high = 90 }\n"
    few, many, other = (
        [one["x.mass_kg"] for one in sweep.load(written(tmp_path, text + more)).runs]
        for more in ("draws = 3", "draws = 30", "draws = 30\ndraw_seed = 2")
    )
    assert many[:3] == few
    assert other[:3] != few
    assert min(many) < 82
    assert max(many) > 88


def test_names_of_parameters_may_stand_in_quotes_or_not(tmp_path: Path) -> None:
    for text in ('[set]\n"smc.lambda" = [1, 2]', "[set]\nsmc.lambda = [1, 2]", "[set.smc]\nlambda = [1, 2]"):
        assert [one["set.smc.lambda"] for one in sweep.load(written(tmp_path, text)).runs] == [1, 2]


def test_files_are_found_beside_the_sweep_and_machines_by_their_names(tmp_path: Path) -> None:
    (tmp_path / "p.ngc").write_text("G1 X1 F600\n")
    [one] = sweep.load(written(tmp_path, 'path = "p.ngc"\nmachine = "ball_screw"\ncontroller = "contour-smc"')).runs
    assert one["path"] == str(tmp_path / "p.ngc")
    assert one["machine"] == "ball_screw"
    assert one["controller"] == "cc"


def test_names_of_files_are_absolute_so_that_a_worker_elsewhere_opens_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "p.ngc").write_text("G1 X1 F600\n")
    written(tmp_path, 'path = "p.ngc"')
    monkeypatch.chdir(tmp_path)
    asked = sweep.load(Path("sweep.toml"))
    assert asked.files == {str(tmp_path / "p.ngc")}
    assert asked.runs[0]["path"] == str(tmp_path / "p.ngc")


def test_files_that_cannot_be_read_are_refused_before_anything_runs(tmp_path: Path) -> None:
    (tmp_path / "p.ngc").write_text("G1 X1 F600\nhello\n")
    (tmp_path / "m.toml").write_text('name = "half"\n')
    (tmp_path / "p.csv").write_text("x,y\n0,0\n1,1\n")
    for text, message in (
        ('path = "p.ngc"', r"p\.ngc:2: hello"),
        ('machine = ["table1", "m.toml"]', r"m\.toml: .* is missing"),
        ('path = "p.csv"', r"p\.csv.*feed"),
    ):
        with pytest.raises(InputError, match=message):
            sweep.load(written(tmp_path, text))


def test_parameters_that_no_drive_has_are_refused_before_anything_runs(tmp_path: Path) -> None:
    (tmp_path / "p.toml").write_text("[smc]\nlamda = 3\n")
    for text, name in (("set.smc.lamda = [3, 4]", "sweep.toml"), ('params = "p.toml"', "p.toml")):
        with pytest.raises(FileError, match=rf"{name}: smc\.lamda: no such parameter; did you mean smc\.lambda"):
            sweep.load(written(tmp_path, text))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("speed = 3", "speed: is no input of a run; inputs are"),
        ("x.colour = 3", "x.colour: is no input of a run"),
        ("x.encoder_at = 3", "x.encoder_at: is no input of a run"),
        ("feed = []", "feed: has no value"),
        ("feed = true", "feed: must be a number, not True"),
        ("feed = nan", "feed: must be a number, not nan"),
        (f"feed = {10**400}", "feed: must be a number"),
        ("draws = 0", "draws: must be an integer from 1 on"),
        ("seed = -1", "seed: must be an integer from 0 on"),
        ("seed = { first = 1 }", "seed: must have low and high, or first and count"),
        ("seed = { first = 1, count = 1.5 }", "seed.count: must be an integer"),
        ("feed = { low = 3, high = 2 }", "feed: low must be below high"),
        ("feed = { low = 0, high = 2, log = true }", "above 0 on a logarithmic scale"),
        ('feed = { low = 1, high = "x" }', "feed: must be { low = NUMBER"),
        ("feed = { low = 1 }", "feed: must be { low = NUMBER"),
        ('controller = "pid"', "controller: must be one of track, cc, ccu"),
        ('num = "f16"', "num: must be one of f32, fix"),
        ("path = 3", "path: must be a text"),
        ('path = "nowhere.ngc"', "nowhere.ngc: there is no path of this name"),
        ('machine = "tank"', "tank: there is no machine of this name"),
        ("side = 3", "side: does not belong to the path circle"),
        ("seed = { first = 0, count = 900000000 }", "asks for"),
        ("[a", "is not a TOML file"),
    ],
)
def test_a_file_that_asks_for_what_cannot_be_is_one_message(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileError) as error:
        sweep.load(written(tmp_path, text))
    assert message in str(error.value)


# --- a run ------------------------------------------------------------------------------------------------------------
def test_a_row_has_the_figures_of_that_run(tmp_path: Path) -> None:
    text = "radius = 1\nfeed = 50\nseed = 7\nx.mass_kg = 80\nset.smc.lambda = 120\njerk = 50\nscore_from = 0.1"
    [inputs] = sweep.load(written(tmp_path, text)).runs
    table = machines.load()
    machine = replace(table, x=replace(table.x, mass_kg=80.0))
    trajectory = plan(shapes.circle(0.001, 0.05), limits(machine, None, 50.0))
    options = RunOptions({"smc.lambda": 120.0}, score_from_s=0.1)
    expected = summary(run(trajectory, "ccu", Target(machine=machine, seed=7), options).log)
    assert sweep.one_run(inputs) == expected | {"problem": None}


def test_a_run_that_is_not_possible_is_a_row_with_its_problem() -> None:
    inputs = {"path": "circle", "controller": "ccu", "seed": 1, "radius": 1, "feed": 50}
    for more, problem in (
        ({"set.smc.lambda": 1e9}, "out of range"),
        ({"set.smc.lamda": 1.0}, "smc.lamda"),
        ({"x.mass_kg": -1.0}, "table1.toml: x.mass_kg: must be at least"),
        ({"x.resonance_Hz": 90.0, "x.motor_share": 0.0}, "table1.toml: x.motor_share: must be at least"),
        ({"radius": 500}, "500"),
    ):
        row = sweep.one_run(inputs | more)
        assert problem in str(row["problem"])
        assert row["mean_um"] is None


def test_figures_of_a_run_that_ends_before_score_from_are_said_to_be_of_all_of_it() -> None:
    inputs = {"path": "circle", "controller": "ccu", "seed": 1, "radius": 1, "feed": 50}
    row = sweep.one_run(inputs | {"score_from": 1e9})
    assert row["problem"] == "score_from is after the end of the run; its figures are those of all of it"
    assert row["mean_um"] == sweep.one_run(inputs)["mean_um"]


def test_an_error_of_ours_is_the_problem_of_its_run_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("float division by zero")

    monkeypatch.setattr(sweep, "run", broken)
    row = sweep.one_run({"path": "circle", "controller": "ccu", "seed": 1, "radius": 1, "feed": 50})
    assert row["problem"] == (
        "error in Kontur itself, which should be reported: ZeroDivisionError: float division by zero"
    )


# --- the table --------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A sweep by two workers: its file and its table."""
    folder = tmp_path_factory.mktemp("sweep")
    file, out = written(folder, SMALL), folder / "a.csv"
    result = CliRunner().invoke(main, ["sweep", str(file), "-o", str(out), "--workers", "2"])
    assert result.exit_code == 0, result.output
    assert "4 runs are in" in result.stdout
    return file, out


def test_table_has_every_input_and_figure_of_every_run(table: tuple[Path, Path]) -> None:
    with table[1].open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["seed"], row["feed"]) for row in rows] == [("1", "20"), ("1", "50"), ("2", "20"), ("2", "50")]
    assert {row["controller"] for row in rows} == {"cascade"}
    assert len({row["mean_um"] for row in rows}) == 4
    assert all(float(row["max_um"]) > 0.0 and row["problem"] == "" for row in rows)


def test_table_is_the_same_bit_for_bit_by_one_worker_that_goes_on_after_a_crash(
    table: tuple[Path, Path], tmp_path: Path
) -> None:
    file, first = table
    lines = first.with_suffix(".rows").read_bytes().splitlines(keepends=True)
    out, rows = tmp_path / "b.csv", tmp_path / "b.rows"
    rows.write_bytes(lines[0] + lines[4] + lines[2][:-9])  # in another order, and cut off in the middle of a line
    result = CliRunner().invoke(main, ["sweep", str(file), "-o", str(out), "--workers", "1"])
    assert result.exit_code == 0, result.output
    assert out.read_bytes() == first.read_bytes()
    assert rows.read_bytes().startswith(lines[0] + lines[4])  # what was finished has not been run again
    assert len(rows.read_bytes().splitlines()) == 5


def test_a_sweep_whose_program_is_killed_leaves_no_process_and_goes_on(
    table: tuple[Path, Path], tmp_path: Path
) -> None:
    file, first = table
    out = tmp_path / "c.csv"
    command = [sys.executable, "-m", "kontur.cli", "sweep", str(file), "-o", str(out), "--workers", "1"]
    with subprocess.Popen(command, start_new_session=True) as process:
        handles = [os.pidfd_open(worker) for worker in _workers(process, out.with_suffix(".rows"))]
        process.kill()
    assert handles
    try:
        for handle in handles:
            assert select.select([handle], [], [], DEADLINE_S)[0], "a worker outlives its parent"
    finally:
        for handle in handles:
            os.close(handle)
    assert not out.exists()
    done = len(out.with_suffix(".rows").read_bytes().splitlines()) - 1
    assert 1 <= done < 4
    subprocess.run(command, check=True, capture_output=True)
    assert out.read_bytes() == first.read_bytes()


def _workers(process: subprocess.Popen[bytes], rows: Path) -> list[int]:
    """The children of `process` once its first row is there."""
    while not (rows.exists() and rows.read_bytes().count(b"\n") >= 2):
        with pytest.raises(subprocess.TimeoutExpired):  # it has not ended by itself
            process.wait(0.05)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text()
    return [int(child) for child in children.split()]


def test_ctrl_c_keeps_what_is_done(table: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "d.csv"
    command = [sys.executable, "-m", "kontur.cli", "sweep", str(table[0]), "-o", str(out), "--workers", "1"]
    with subprocess.Popen(command, start_new_session=True, stderr=subprocess.PIPE) as process:
        _workers(process, out.with_suffix(".rows"))
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, errors.decode().strip()) == (130, "Interrupted.")
    assert out.with_suffix(".rows").read_bytes().endswith(b"}\n")


def test_parquet_has_the_table_too(table: tuple[Path, Path]) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="no pyarrow; get it by: pip install 'kontur[sweep]'")
    found = parquet.read_table(table[1].with_suffix(".parquet")).to_pylist()
    with table[1].open() as file:
        rows = list(csv.DictReader(file))
    assert [str(row["mean_um"]) for row in found] == [row["mean_um"] for row in rows]
    assert list(found[0]) == list(rows[0])
