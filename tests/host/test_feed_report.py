# SPDX-License-Identifier: Apache-2.0
"""What a plan says of its feed: how much of it is reached, and which limit is in the way."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from kontur import machine
from kontur.cli import main
from kontur.errors import PathError
from kontur.path import programs, shapes
from kontur.path.geometry import Program
from kontur.planning.bounds import Limits, clipped, limits
from kontur.planning.feed import Feed
from kontur.planning.planner import plan
from kontur.runs import log

MACHINE = machine.load()
FAST = {"acceleration_mps2": 100.0, "jerk_mps3": 1e5}


def kontur(*args: str) -> Result:
    return CliRunner().invoke(main, args)


def feed_of(program: Program, **other: float) -> Feed:
    feed = plan(program, limits(MACHINE, **other)).feed
    assert feed is not None
    return feed


def gcode(folder: Path, text: str) -> Program:
    file = folder / "a.ngc"
    file.write_text("G21 G90\n" + text)
    return programs.load(file)


@pytest.mark.parametrize(
    ("program", "other", "reached_mmps", "by"),
    [
        (shapes.circle(0.004, 1.0), {}, 102.1, "the jerk in the bend"),
        (shapes.circle(0.02, 10.0), {}, 280.0, "the centripetal acceleration in the bend"),
        (shapes.circle(0.02, 10.0), FAST, 299.7, "the speed of an axis"),
        (shapes.circle(1e-6, 0.1), FAST, 0.2, "the distance of the knots in the bend"),
        (shapes.square(0.002, 0.0, 0.2), {}, 28.7, "the acceleration and the jerk along the path, which is too short"),
        (shapes.square(0.04, 0.005, 0.2), {}, 80.3, "the step of acceleration where the curvature jumps"),
    ],
)
def test_feed_that_is_not_reached_names_the_limit(
    program: Program, other: dict[str, float], reached_mmps: float, by: str
) -> None:
    feed = feed_of(program, **other)
    assert feed.limited > 0
    assert feed.reached_mps * 1e3 == pytest.approx(reached_mmps, rel=0.01)
    assert feed.by.startswith(by)
    assert "is not reached" in str(feed)
    assert f"limited by {by}" in str(feed)


def test_feed_that_is_reached_is_said_alone() -> None:
    assert str(feed_of(shapes.circle(0.02, 0.1))) == "feed 100 mm/s"


def test_moves_that_do_not_reach_their_f_are_counted_and_the_least_is_named(tmp_path: Path) -> None:
    feed = feed_of(gcode(tmp_path, "G0 X-50\nG1 X0 F1200\nG1 X0.1 F6000\nG1 Y50 F60000\n"))
    assert (feed.moves, feed.limited) == (3, 2)
    assert feed.place.endswith("a.ngc:4")
    assert "in 2 of 3 moves; the least in " in str(feed)


def test_program_with_a_time_law_of_its_own_has_no_feed() -> None:
    assert plan(programs.load(Path(__file__).parents[2] / "examples/timed.csv"), limits(MACHINE)).feed is None


def test_limits_that_others_do_not_let_be_are_named() -> None:
    assert clipped(limits(MACHINE)) == []
    (jerk,) = clipped(limits(MACHINE, jerk_mps3=1e6))
    assert jerk.startswith("A jerk of 1225 m/s³ is planned instead of 1e+06")
    (step,) = clipped(limits(MACHINE, acceleration_mps2=1.0))
    assert "a step of acceleration of 0.343 m/s² is planned instead of 1" in step


def test_run_without_a_feed_takes_one_and_says_which() -> None:
    result = kontur("run", "circle", "--radius", "5")
    assert result.exit_code == 0, result.output
    assert "Feed 20 mm/s." in result.stdout
    assert "No --feed was given, so it is 20 mm/s." in result.stdout


def test_run_without_a_feed_still_reports_what_is_wrong() -> None:
    result = kontur("run", "circle", "--set", "nonsense=1")
    assert result.exit_code == 1
    assert result.stderr == "Error: nonsense: no such parameter; see `kontur param list`\n"


def test_run_tells_of_a_clipped_feed_in_table_json_log_and_report(tmp_path: Path) -> None:
    command = ("run", "circle", "--radius", "4", "--feed", "1000")
    said = "feed 1000 mm/s is not reached: 117.8 mm/s, limited by the jerk in the bend (jerk_mps3, --jerk)"
    files = ("--log", str(tmp_path / "a.csv"), "--report", str(tmp_path / "a.html"))
    table = kontur(*command, "--override", "50", *files)
    assert f"The {said}; 50 % of that by --override." in table.stdout
    assert log.read(tmp_path / "a.csv").meta["feed"] == said
    assert said in (tmp_path / "a.html").read_text()
    found = json.loads(kontur(*command, "--jerk", "1e6", "--json").stdout)
    assert found["feed"]["asked_mps"] == 1.0
    assert found["feed"]["reached_mps"] == pytest.approx(0.1505, abs=1e-3)
    assert found["feed"]["by"].startswith("the centripetal acceleration")
    assert found["notes"][0].startswith("A jerk of 1225 m/s³ is planned instead of 1e+06")


@pytest.mark.parametrize(
    "args",
    [
        *(("run", "circle", name, "1e308") for name in ("--radius", "--laps", "--accel", "--jerk")),
        *(("run", "circle", name, "1e-300") for name in ("--radius", "--laps", "--accel", "--jerk", "--feed")),
        ("run", "circle", "--radius", "1e7"),
        ("run", "circle", "--feed", "1e-6"),
        ("run", "ellipse", "--half-width", "1e308"),
        ("run", "spiral", "--pitch", "1e-300"),
        ("run", "circle", "--set", "smc.lambda=1e308"),
        ("run", "circle", "--machine", "huge.toml"),
        ("run", "circle", "--machine", "tiny.toml"),
        ("run", "points.csv"),
        ("param", "load", "huge_parameters.toml"),
    ],
)
def test_number_of_any_size_is_one_short_message(
    args: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    table1 = machine.DEFAULT.read_text()
    Path("huge.toml").write_text(table1.replace("mass_kg = 88.08", f"mass_kg = {'9' * 400}", 1))
    Path("tiny.toml").write_text(table1.replace("jerk_mps3 = 100.0", "jerk_mps3 = 1e-300", 1))
    Path("huge_parameters.toml").write_text(f"[smc]\nlambda = {'9' * 400}\n")
    Path("points.csv").write_text("x,y\n0,0\n1,0\n2,1\n")
    result = kontur(*args)
    assert result.exit_code == 1, result.output
    assert result.stderr.startswith("Error: ")
    assert result.stderr.count("\n") == 1
    assert len(result.stderr) < 240
    assert "0" * 20 not in result.stderr


def test_limits_beyond_their_range_are_refused() -> None:
    with pytest.raises(PathError, match=r"limit jerk_mps3 is 1e\+308; it must be 1e-06\.\.1e\+09"):
        Limits(jerk_mps3=(1e308, 1.0))


def test_machine_file_and_parameter_file_that_are_mixed_up_are_told_apart(tmp_path: Path) -> None:
    result = kontur("param", "load", str(machine.DEFAULT))
    assert result.exit_code == 1
    assert "is the file of a machine, not of parameters. A simulation takes it as --machine FILE" in result.stderr
    file = tmp_path / "p.toml"
    assert kontur("param", "dump", str(file)).exit_code == 0
    result = kontur("run", "circle", "--machine", str(file))
    assert result.exit_code == 1
    assert f"is a file of parameters, not of a machine. `kontur param load {file}` gives them" in result.stderr
