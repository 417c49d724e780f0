# SPDX-License-Identifier: Apache-2.0
"""`kontur check`: what it says of a file, and that nothing moves."""

import json
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from kontur.cli import main
from kontur.drive import target

ROOT = Path(__file__).parents[2]
PART = ROOT / "examples" / "part.ngc"


def kontur(*args: str | Path) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args])


def checked(folder: Path, text: str, *args: str) -> tuple[dict[str, object], int]:
    file = folder / "a.ngc"
    file.write_text(text)
    result = kontur("check", file, "--json", *args)
    return json.loads(result.stdout), result.exit_code


def test_refusals_come_at_once_with_count_and_first_line_and_an_exit_code(tmp_path: Path) -> None:
    text = "G21\nG41\nG1 X1 F100\nG41\nM98\nX1e2\n"
    found, code = checked(tmp_path, text)
    assert code == 1
    assert [(r["line"], r["word"], r["count"]) for r in found["refusals"]] == [  # type: ignore[attr-defined]
        (2, "G41", 2),
        (5, "M98", 1),
        (6, "X1e2", 1),
    ]
    assert "duration_s" not in found
    printed = kontur("check", tmp_path / "a.ngc")
    assert printed.exit_code == 1
    assert printed.stdout.splitlines()[0].startswith(
        "refused: G41 ×2, first in line 2: there is no cutter compensation"
    )
    assert printed.stdout.splitlines()[1].startswith("refused: M98 in line 5: subroutines are not understood")
    assert "kontur run` takes it" not in printed.stdout


def test_extent_length_time_and_feed_are_those_of_the_run(tmp_path: Path) -> None:
    found, code = checked(tmp_path, "G1 X30 F1200\nG3 X30 Y20 J10\nG1 X0\n")
    assert code == 0
    assert found["extent_mm"] == {"x": [0.0, 40.0], "y": [0.0, 20.0]}
    assert found["length_mm"] == pytest.approx(60.0 + 31.4159, abs=1e-3)
    ran = json.loads(kontur("run", tmp_path / "a.ngc", "--json").stdout)
    assert (found["duration_s"], found["feed"], found["notes"]) == (ran["duration_s"], ran["feed"], ran["notes"])


def test_slowest_places_are_those_that_lose_most_time_and_name_their_limit(tmp_path: Path) -> None:
    found, _ = checked(tmp_path, "G1 X30 F1200\nG2 X30 Y8 J4 F9000\nG1 X0 F18000\nX0.1\n")
    slowest = found["feed"]["slowest"]  # type: ignore[index]
    assert {slow["place"].rpartition(":")[2] for slow in slowest} == {"2", "3", "4"}
    assert [slow["lost_s"] for slow in slowest] == sorted((slow["lost_s"] for slow in slowest), reverse=True)
    feed = found["feed"]
    assert feed["by"] in [slow["by"] for slow in slowest if slow["place"] == feed["place"]]  # type: ignore[index]
    assert all(slow["lost_s"] > 0.0 and slow["reached_mps"] < slow["asked_mps"] for slow in slowest)
    printed = kontur("check", tmp_path / "a.ngc").stdout
    assert "feed 300 mm/s is not reached" in printed
    assert "lost s" in printed


def test_events_have_the_time_at_which_the_path_is_there(tmp_path: Path) -> None:
    text = "M3 S500\nG1 X10 F600\nG4 P1\nS600 M8\nG1 X20\nM5\n"
    found, _ = checked(tmp_path, text)
    events = {event["word"]: event for event in found["events"]}  # type: ignore[attr-defined]
    assert {word: (e["count"], e["line"]) for word, e in events.items()} == {
        "S": (2, 1),
        "M3": (1, 1),
        "M8": (1, 4),
        "M5": (1, 6),
    }
    assert events["M3"]["time_s"] == 0.0
    assert events["M8"]["time_s"] == pytest.approx(2.1, abs=0.15)  # after the dwell
    assert events["M5"]["time_s"] == pytest.approx(found["duration_s"], abs=0.01)


def test_path_beyond_the_travel_of_the_machine_is_a_refusal_with_its_extent(tmp_path: Path) -> None:
    found, code = checked(tmp_path, "G1 X200 F6000\n")
    assert code == 1
    assert found["extent_mm"]["x"] == [0.0, 200.0]  # type: ignore[index]
    assert "outside the travel" in found["refusals"][0]["problem"]  # type: ignore[index]


def test_table_of_points_and_other_axes_are_checked_too(tmp_path: Path) -> None:
    assert kontur("check", ROOT / "examples" / "timed.csv").exit_code == 0
    assert kontur("check", ROOT / "examples" / "points.csv").exit_code == 1
    assert kontur("check", ROOT / "examples" / "points.csv", "--feed", "20").exit_code == 0
    for z, code in (("pen", 1), ("ignore", 0), ("refuse", 1)):
        found, got = checked(tmp_path, "G1 X10 Z-1 F600\n", "--z", z)
        assert got == code, found


def test_file_that_is_not_there_is_one_message() -> None:
    result = kontur("check", "nothing.ngc")
    assert result.exit_code == 1
    assert result.stdout == (
        "refused: no such file, and no shape either; shapes are circle, ellipse, eight, square, spiral\n"
    )


def test_nothing_is_opened_that_could_move(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*args: object, **kwargs: object) -> None:
        raise AssertionError("a drive was opened")

    monkeypatch.setattr(target, "open_drive", refuse)
    result = kontur("check", PART)
    assert result.exit_code == 0, result.output
    assert "takes 12.7" in result.stdout


def test_run_tells_in_one_line_what_it_does_not_execute(tmp_path: Path) -> None:
    file = tmp_path / "a.ngc"
    file.write_text("T2\nM3 S500 T3\nG0 Z5\nG1 X1 F600\nM5\n")
    result = kontur("run", file)
    assert result.exit_code == 0, result.output
    assert "Not executed, since the machine has no such thing: T ×2; first in line 1.\n" in result.stdout
    assert kontur("run", file, "--z", "refuse").exit_code == 1


OF_A_DRIVE = {
    *("--controller", "--set", "--params", "--override", "--approach", "--resume", "--yes"),
    *("--log", "--report", "--live", "--scope", "--scope-trigger", "--scope-pre", "--scope-divider", "--scope-out"),
    *("--seed", "--num", "--told", "--untold", "--compensation"),
    *("-i", "--interface", "-c", "--channel", "-b", "--bitrate", "--bus", "--bus-faults", "--node", "--set-pdos"),
}
"""What check has no use for: it changes neither the path nor what the program switches."""


def test_check_takes_every_option_of_run_that_changes_the_path_or_what_it_switches() -> None:
    def options(verb: str) -> set[str]:
        command = main.get_command(click.Context(main), verb)
        assert command is not None
        return {option for parameter in command.params for option in parameter.opts}

    assert options("run") - options("check") == OF_A_DRIVE


def test_check_takes_shapes_with_their_sizes() -> None:
    result = kontur("check", "circle", "--radius", "4", "--feed", "50", "--json")
    found = json.loads(result.stdout)
    assert result.exit_code == 0
    assert found["extent_mm"]["x"] == pytest.approx([-4.0, 4.0])
    ran = json.loads(kontur("run", "circle", "--radius", "4", "--feed", "50", "--json").stdout)
    assert (found["duration_s"], found["feed"]) == (ran["duration_s"], ran["feed"])


def test_laser_has_no_power_in_rapid_moves_so_its_outputs_change_more_often(tmp_path: Path) -> None:
    text = "M3 S500\nG1 X5 F1200\nG0 X10\nG1 X15\nM5\nX16\n"
    spindle, _ = checked(tmp_path, text)
    laser, _ = checked(tmp_path, text, "--laser", "--full-s", "500")
    assert spindle["output_changes"] == 2
    assert laser["output_changes"] == 5  # on at rest, power, none in G0, power, off
    assert "outputs change 5 times" in kontur("check", tmp_path / "a.ngc", "--laser").stdout
