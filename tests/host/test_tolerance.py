# SPDX-License-Identifier: Apache-2.0
"""The tolerance of a path as a user meets it: `kontur check`, `kontur run`, log, report and `kontur bench plan`."""

import json

import pytest
from cam_paths import letters, rosette
from click.testing import CliRunner

from kontur.cli import main
from kontur.cli.bench import plan_command
from kontur.experiments import bench_plan
from kontur.path import gcode
from kontur.path.geometry import Arc
from kontur.runs.log import read


def ngc(program, feed_mps, first=""):
    x, y = program.start_m
    ends = [move.segment.end_m for move in program.moves]
    rows = [f"X{1e3 * a:.4f} Y{1e3 * b:.4f}" for a, b in ends]
    return "\n".join([f"G21 G90 {first}", f"G0 X{1e3 * x:.4f} Y{1e3 * y:.4f}", f"G1 F{6e4 * feed_mps:g}", *rows, "M2"])


def kontur(*arguments):
    result = CliRunner().invoke(main, [str(argument) for argument in arguments], catch_exceptions=False)
    return result


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "rosette.ngc"
    path.write_text(ngc(rosette(244), 0.1))
    return path


def checked(file, *more):
    return json.loads(kontur("check", file, "--json", *more).stdout)


def test_check_tells_the_time_and_how_far_the_path_is_from_the_file_s(file):
    smooth, exact, coarse = checked(file), checked(file, "--tolerance", 0), checked(file, "--tolerance", 0.05)
    assert smooth["duration_s"] < 0.25 * exact["duration_s"]
    assert 1.0 < smooth["path_deviation_um"] <= 10.0 < coarse["path_deviation_um"] <= 50.0
    assert exact["path_deviation_um"] == 0.0
    assert "smoothed within the tolerance: at most" in kontur("check", file).stdout
    assert "smoothed" not in kontur("check", file, "--tolerance", 0).stdout


def test_the_option_rules_over_what_the_file_says(tmp_path):
    file = tmp_path / "exact.ngc"
    file.write_text(ngc(rosette(244), 0.1, "G61"))
    assert checked(file)["path_deviation_um"] == 0.0
    assert checked(file, "--tolerance", 0.01)["path_deviation_um"] > 1.0
    file.write_text(ngc(rosette(244), 0.1, "G64 P0.003"))
    assert 0.5 < checked(file)["path_deviation_um"] <= 3.0


@pytest.mark.parametrize("value", ["-0.01", "2", "x"])
def test_a_tolerance_out_of_range_is_refused(file, value):
    result = kontur("check", file, "--tolerance", value)
    assert result.exit_code == 2
    assert "--tolerance" in result.stderr


def test_run_tells_tolerance_and_tracking_apart(tmp_path):
    file, log, report = tmp_path / "letters.ngc", tmp_path / "run.csv", tmp_path / "run.html"
    file.write_text(ngc(letters(3), 0.05))
    result = json.loads(kontur("run", file, "--json", "--log", log, "--report", report).stdout)
    (run,) = result["runs"]
    assert 1.0 < result["path_deviation_um"] <= 10.0
    assert 0.0 < run["tracking_mean_um"] < 0.5 * run["mean_um"]
    assert run["tracking_max_um"] < 10.0
    meta = read(log).meta
    assert meta["tracking_score"]["mean_um"] == pytest.approx(run["tracking_mean_um"])
    assert "at most" in meta["smoothing"]
    page = report.read_text()
    assert "off the smoothed path" in page
    assert "smoothed within the tolerance" in page


def test_bench_plan_prints_the_ratios_and_the_speed():
    result = json.loads(kontur("bench", "plan", "--lines", 1000, "--json").stdout)
    ratios = {path["path"]: path["ratio"] for path in result["paths"]}
    assert ratios["rosette, 545 lines"] < 1.05
    assert ratios["circle r 20, 360 lines"] < 1.05
    assert all(path["deviation_um"] <= result["tolerance_um"] for path in result["paths"])
    assert result["lines"] == 1000
    assert result["total_s"] == pytest.approx(result["read_s"] + result["plan_s"])
    assert "1000 lines (arcs): read in" in kontur("bench", "plan", "--lines", 1000, "--kind", "arcs").stdout


@pytest.mark.parametrize("kind", bench_plan.KINDS)
def test_long_file_of_the_bench_has_what_its_kind_says(kind):
    (option,) = (option for option in plan_command.params if option.name == "kind")
    assert set(option.type.choices) == set(bench_plan.KINDS)
    program = gcode.parse(bench_plan.KINDS[kind](3000), kind)
    arcs = sum(isinstance(move.segment, Arc) for move in program.moves)
    assert (arcs, len(program.events)) == {"arcs": (2000, 0), "raster": (0, 3000)}.get(kind, (0, 0))
    assert len(program.moves) == 3000 + (kind == "spiral")
