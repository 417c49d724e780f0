# SPDX-License-Identifier: Apache-2.0
"""Words of G-code that a large collection of programs asked for (tools/collection.py): turned coordinate systems, exact
stops, arcs of several turns; and one refusal for one mistake."""

import math
import os
import shutil

import numpy as np
import pytest

from kontur.errors import FileError
from kontur.path import gcode, interpreter
from kontur.path.geometry import Arc, Dwell, Program

needs_rs274 = pytest.mark.skipif(
    shutil.which("rs274") is None and "CI" not in os.environ,
    reason="rs274 is not installed: apt-get install linuxcnc-uspace (80 MB)",
)
HALF = math.sqrt(0.5)


def ends_mm(program: Program) -> list[tuple[float, float]]:
    ends = [1e3 * m.segment.point(np.array([m.segment.length_m]))[0] for m in program.moves]
    return [(float(x), float(y)) for x, y in ends]


def problems(text: str) -> list[tuple[int | None, str]]:
    _, refusals = gcode.read(text, "p.ngc")
    return [(error.line, error.problem) for error, _ in refusals]


TURNED = {
    "both": ("G10 L2 P1 X10 Y5 R90\nG0 X2 Y1", [(9, 7)]),
    "one axis": ("G10 L2 P1 R45\nG0 X2 Y0\nX4\nY2", [(2 * HALF, 2 * HALF), (4 * HALF, 4 * HALF), (2 * HALF, 6 * HALF)]),
    "relative": ("G10 L2 P1 X1 R90\nG91\nG0 X2\nX2 Y1", [(0, 2), (-1, 4)]),
    "another system": ("G10 L2 P2 R90\nG0 X2\nG55\nX3\nG54\nX1", [(2, 0), (2, 3), (1, 3)]),
    "machine": ("G10 L2 P1 R90\nG53 G0 X2 Y1\nX5", [(2, 1), (2, 5)]),
    "G92": ("G10 L2 P1 R90\nG0 X4 Y0\nG92 X1 Y0\nG0 X2 Y1\nG92.1\nG0 X1 Y0", [(0, 4), (-1, 5), (0, 1)]),
    "L20": ("G10 L2 P1 R90\nG0 X4 Y0\nG10 L20 P1 X1\nG0 X2 Y0", [(0, 4), (0, 5)]),
    "arc": ("G10 L2 P1 X1 R90\nG0 X0 Y0\nG2 X2 Y0 I1", [(1, 0), (1, 2)]),
    "arc, absolute centre": ("G90.1 G10 L2 P1 X1 R90\nG0 X0 Y0\nG2 X2 Y0 I1 J0", [(1, 0), (1, 2)]),
    "turned back": ("G10 L2 P1 R90\nG10 L2 P1 R0\nG0 X2 Y1", [(2, 1)]),
}


@pytest.mark.parametrize("name", TURNED)
def test_coordinate_system_is_turned(name: str) -> None:
    text, ends = TURNED[name]
    program = gcode.parse("F600\n" + text, "p.ngc")
    np.testing.assert_allclose(ends_mm(program), ends, atol=1e-9)


def test_arc_in_a_turned_system_lies_about_the_turned_centre() -> None:
    (_, arc) = gcode.parse("F600\n" + TURNED["arc"][0], "p.ngc").moves
    np.testing.assert_allclose(1e3 * arc.segment.point(np.array([0.5 * arc.segment.length_m]))[0], (0, 1), atol=1e-9)


def test_l20_does_not_turn() -> None:
    assert problems("G10 L20 P1 X0 R5\nG0 X1") == [(1, "G10 L20 turns no coordinate system; use L2")]


@needs_rs274
@pytest.mark.parametrize("name", TURNED)
def test_rs274_turns_it_as_well(name: str) -> None:
    text = "F600\n" + TURNED[name][0] + "\nM2\n"
    own, other = gcode.parse(text, "p.ngc"), gcode.parse(text, "p.ngc", source=interpreter.blocks)
    np.testing.assert_allclose(ends_mm(own), ends_mm(other), atol=1e-4)
    thirds = [[m.segment.point(np.array([m.segment.length_m / 3]))[0] for m in p.moves] for p in (own, other)]
    np.testing.assert_allclose(thirds[0], thirds[1], atol=1e-6)


@needs_rs274
def test_rs274_turns_any_angle() -> None:
    text = (
        "F600\nG10 L2 P1 X3 Y-2 R-33.5\nG10 L2 P2 R12\nG0 X5 Y7\nG1 Y9\nG92 X1\nG3 X4 Y10 R5\nG55 G1 X-3 Y1\nX0\nM2\n"
    )
    own, other = gcode.parse(text, "p.ngc"), gcode.parse(text, "p.ngc", source=interpreter.blocks)
    np.testing.assert_allclose(ends_mm(own), ends_mm(other), atol=1.5e-4)


def test_exact_stop_mode_rests_after_each_move_until_it_ends() -> None:
    program = gcode.parse("F600\nG61.1\nG1 X1\nX2\nG61\nX3\nX4", "p.ngc")
    assert ["rest" if isinstance(item, Dwell) else "move" for item in program.items] == [
        *("move", "rest", "move", "rest", "move", "move"),
    ]
    assert [move.tolerance_m for move in program.moves] == [0.0] * 4


@pytest.mark.parametrize(("words", "turns"), [("X0 Y0 I5 P1", 1.0), ("X0 Y0 I5 P3", 3.0), ("X10 Y0 I5 P2", 1.5)])
def test_arc_begins_as_many_turns_as_p_says(words: str, turns: float) -> None:
    (move,) = gcode.parse(f"F600\nG2 {words}", "p.ngc").moves
    assert isinstance(move.segment, Arc)
    assert move.segment.sweep_rad == pytest.approx(-turns * 2.0 * math.pi)


@needs_rs274
def test_rs274_begins_as_many_turns() -> None:
    text = "F600\nG2 X10 Y0 I5 P2\nG3 X10 Y0 I5 P3\nM2\n"
    own, other = (gcode.parse(text, "p.ngc", source=s) for s in (gcode.gcode_words.blocks, interpreter.blocks))
    assert [m.segment.length_m for m in own.moves] == pytest.approx([m.segment.length_m for m in other.moves])


@pytest.mark.parametrize("p", ["0", "1.5", "-1", "100000"])
def test_turns_of_an_arc_are_a_whole_number(p: str) -> None:
    with pytest.raises(FileError, match=rf"p\.ngc:2: P{p}: P of an arc is the number of its turns, 1 to 1000"):
        gcode.parse(f"F600\nG2 X1 Y0 I5 P{p}", "p.ngc")


def test_spiral_of_several_turns_ends_where_it_is_programmed() -> None:
    (move,) = gcode.parse("F600\nG3 X0.02 Y0 I5 P4", "p.ngc").moves
    assert ends_mm(gcode.parse("F600\nG3 X0.02 Y0 I5 P4", "p.ngc"))[0] == pytest.approx((0.02, 0.0), abs=1e-9)
    assert move.segment.length_m == pytest.approx(4 * 2.0 * math.pi * 4.99e-3, rel=1e-5)


def test_dwell_goes_before_the_move_that_its_line_names() -> None:
    program = gcode.parse("F600\nG4 P.5 G1 X1", "p.ngc")
    assert program.items[0] == Dwell(0.5, 2)
    assert ends_mm(program) == [(1.0, 0.0)]


def test_what_cannot_be_read_is_refused_once_for_its_line() -> None:
    found = problems("F600\nG10 L2 P#5 X1\nG4 P[1+2]\nG81 X1 R#2\nG1 X1")
    assert [(line, problem.split(";")[0]) for line, problem in found] == [
        (2, "variables and expressions are not understood"),
        (4, "drilling cycles move in z"),
    ]
    _, refusals = gcode.read("F600\n#5=1\nG1 X#5\no100 sub\no101 if [1]\nG1 X1", "p.ngc")
    assert [(error.line, count) for error, count in refusals] == [(2, 2), (4, 2)]


def test_feed_above_any_machine_is_taken_since_limits_rule() -> None:
    (move,) = gcode.parse("G1 X1 F1000000000", "p.ngc").moves
    assert move.feed_mps == pytest.approx(1e9 / 6e4)


def test_centre_in_another_plane_is_told_by_the_plane() -> None:
    assert [problem for _, problem in problems("F600\nG18\nG2 X1 K1")] == ["arcs lie in the plane of x and y, G17"]
