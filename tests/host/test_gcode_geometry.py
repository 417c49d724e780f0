# SPDX-License-Identifier: Apache-2.0
"""What a G-code line means, to the last digit: full circles, arcs whose end is rounded, lines, numbers, long dwells."""

import math

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from kontur.cli import main
from kontur.errors import FileError
from kontur.path import csv, gcode
from kontur.path.geometry import Curve, Program
from kontur.planning.planner import Limits, plan


def parse(text: str) -> Program:
    return gcode.parse(text, "p.ngc")


def points(program: Program, count: int = 2001) -> tuple[np.ndarray, np.ndarray]:
    """Radii and angles (unwrapped) of the last move's points about (5, 0) mm."""
    segment = program.moves[-1].segment
    x, y = segment.point(np.linspace(0.0, segment.length_m, count)).T
    return np.hypot(x - 0.005, y), np.unwrap(np.arctan2(y, x - 0.005))


# --- full circles -----------------------------------------------------------------------------------------------------
MISSES = [(dx, dy) for dx in (-0.001, -0.0001, 0.0, 0.0001, 0.001) for dy in (-4e-6, -1e-7, 0.0, 1e-7, 4e-6)]


@pytest.mark.parametrize("code", ["G2", "G3"])
@pytest.mark.parametrize("miss", MISSES)
def test_circle_whose_end_misses_its_start_by_the_last_digit_in_any_direction_is_a_full_one(
    code: str, miss: tuple[float, float]
) -> None:
    program = parse(f"{code} X{miss[0]:.9f} Y{miss[1]:.9f} I5 F100")
    radius, angle = points(program)
    assert angle[-1] - angle[0] == pytest.approx((1 if code == "G3" else -1) * 2.0 * math.pi, abs=1e-6)
    assert np.all(np.abs(radius - 0.005) <= math.hypot(*miss) * 1e-3 + 1e-12)
    end = program.moves[-1].segment.point(np.array([program.moves[-1].segment.length_m]))[0]
    np.testing.assert_allclose(end, np.array(miss) * 1e-3, atol=1.1e-9)


@pytest.mark.parametrize(("code", "y", "turn"), [("G2", 0.001, 2e-4), ("G3", -0.001, 2e-4)])
def test_arc_that_turns_by_more_than_a_millionth_is_as_short_as_it_says(code: str, y: float, turn: float) -> None:
    assert parse(f"{code} X0 Y{y} I5 F100").moves[0].segment.length_m == pytest.approx(turn * 0.005, rel=1e-3)


def test_circle_in_inches_or_by_relative_steps_is_full_although_its_end_is_rounded() -> None:
    text = "G20\nG91\n" + "G1 X0.1 Y0.3 F10\n" * 3 + "G90\nG2 X0.3 Y0.9 I0.1 J0.2"
    assert parse(text).moves[-1].segment.length_m == pytest.approx(2.0 * math.pi * math.hypot(0.1, 0.2) * 25.4e-3)


# --- ends that are not on the arc -------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("text", "accepted"),
    [
        ("G3 X0.028 I5", True),
        ("G3 X0.029 I5", False),
        ("G20\nG3 X0.0028 I0.5", True),
        ("G20\nG3 X0.0029 I0.5", False),
        ("G3 X0.099 I100", True),
        ("G3 X0.101 I100", False),
        ("G3 X2.8 I2900", True),
        ("G3 X2.9 I2900", False),
    ],
)
def test_radii_of_an_arc_may_differ_as_much_as_for_linuxcnc(text: str, accepted: bool) -> None:
    program = text.replace("G3", "F100\nG3")
    if accepted:
        assert parse(program).moves
        return
    with pytest.raises(FileError, match="the end is not on the arc: the radius is"):
        parse(program)


@given(st.floats(0.5, 50.0), st.floats(1e-4, 2.0 * math.pi), st.floats(-0.028, 0.028), st.sampled_from([2, 3]))
def test_arc_with_a_rounded_end_goes_evenly_from_one_radius_to_the_other(
    radius: float, sweep: float, differ: float, code: int
) -> None:
    sense = 1.0 if code == 3 else -1.0
    end = radius - (radius + differ) * np.exp(1j * sense * sweep)
    segment = parse(f"G{code} X{end.real:.12f} Y{end.imag:.12f} I{radius:.12f} F100").moves[0].segment
    x, y = 1e3 * segment.point(np.linspace(0.0, segment.length_m, 401)).T
    angle = np.unwrap(np.arctan2(y, x - radius))
    turned = sense * (angle - angle[0])
    even = radius + differ * turned / sweep
    assert np.max(np.abs(np.hypot(x - radius, y) - even)) < 0.25e-3


# --- lines, numbers, units --------------------------------------------------------------------------------------------
SEPARATORS = ["\v", "\f", "\x1c", "\x1d", "\x1e", "\x85", "\u2028", "\u2029"]


@pytest.mark.parametrize("end_mm", [0.0195, 0.02, 0.021, 0.022])
@pytest.mark.parametrize("tolerance_m", [0.0, 1e-5])
def test_short_arc_that_changes_its_radius_is_planned(end_mm: float, tolerance_m: float) -> None:
    program = gcode.parse(f"F600\nG1 X-1\nX0\nG3 X{end_mm} I0.003 J0.05\nG1 X1 Y1", "p.ngc")
    assert isinstance(program.moves[2].segment, Curve)
    assert program.moves[2].segment.length_m < 26e-6
    trajectory = plan(program, Limits(), tolerance_m=tolerance_m)
    assert np.max(np.abs(np.diff(trajectory.position_m, axis=0))) < 2e-5
    assert trajectory.position_m[-1] == pytest.approx([1e-3, 1e-3])


@pytest.mark.parametrize("separator", SEPARATORS)
@pytest.mark.parametrize("comment", ["; pass 1{}G1 X99", "(pass 1{}G1 X99)"])
def test_only_cr_and_lf_end_a_line_also_in_a_comment(separator: str, comment: str) -> None:
    (move,) = parse(f"G1 X1 F100 {comment.format(separator)}\n").moves
    assert (move.segment.length_m, move.line) == (pytest.approx(1e-3), 1)
    with pytest.raises(FileError, match=r"^p\.ngc:1: "):
        parse(f"G1 X1 F100{separator}G1 X99")


@pytest.mark.parametrize("end", ["\n", "\r", "\r\n"])
def test_cr_lf_and_both_end_a_line(end: str) -> None:
    moves = parse(end.join(["G1 X1 F100 ; a", "", "X2 (b)", "X3"])).moves
    assert [move.line for move in moves] == [1, 3, 4]
    table = csv.parse(end.join(["x,y", "0,0 # a", "1,1", ""]), "p.csv", 0.01)
    assert table.moves[0].segment.length_m == pytest.approx(math.sqrt(2) * 1e-3)


@pytest.mark.parametrize("separator", SEPARATORS)
def test_comment_of_a_table_goes_to_the_end_of_its_line(separator: str) -> None:
    table = csv.parse(f"x,y\n0,0 # a{separator}5,5\n1,0\n", "p.csv", 0.01)
    assert table.moves[0].segment.length_m == pytest.approx(1e-3)


@pytest.mark.parametrize(("word", "shown"), [("X1e2", "X1e2"), ("X1.5E-3", "X1.5E-3"), ("y-2e+1", "y-2e+1")])
def test_exponent_is_named_with_its_whole_word(word: str, shown: str) -> None:
    with pytest.raises(FileError) as caught:
        parse(f"G1 F100 {word}")
    assert str(caught.value).startswith(f"p.ngc:1: {shown}: a number with an exponent; write it out")


@pytest.mark.parametrize("text", ["G20 F6\nG1 X1", "G20 G1 X1 F6", "G20\nG1 X1 F6\nG21 F100", "F6 G20"])
def test_feed_on_the_line_that_changes_its_unit_is_refused_since_controls_differ(text: str) -> None:
    with pytest.raises(FileError, match=r"a feed on the line that changes the unit; .* put it on the next line"):
        parse(text + "\nG1 X2")


def test_feed_beside_the_unit_that_holds_already_is_taken() -> None:
    assert parse("G21 F600\nG1 X1").moves[0].feed_mps == pytest.approx(0.01)
    assert parse("G20\nG20 F60\nG1 X1").moves[0].feed_mps == pytest.approx(25.4e-3)


# --- dwells -----------------------------------------------------------------------------------------------------------
def test_long_dwells_are_told_once_with_the_first_and_the_longest() -> None:
    program = parse("G1 X1 F100\nG4 P10\nG4 P11\nG4 P160\nX2")
    assert program.notes == (
        "2 dwells wait for more than 10 s, the first in line 3 and the longest for 160 s: P is in seconds. "
        "Some programs mean milliseconds.",
    )
    assert parse("G4 P10\nG1 X1 F100").notes == ()


def test_run_tells_of_a_long_dwell(tmp_path) -> None:  # type: ignore[no-untyped-def]
    file = tmp_path / "a.ngc"
    file.write_text("G1 X1 F1000\nG4 P10.5\nX2\n")
    result = CliRunner().invoke(main, ["run", str(file)])
    assert result.exit_code == 0, result.output
    assert "1 dwell waits for more than 10 s, in line 2 for 10.5 s: P is in seconds." in result.stdout
