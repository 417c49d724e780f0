# SPDX-License-Identifier: Apache-2.0
"""Small programs in the style of CAM posts: what their words do, and what of them is refused."""

from pathlib import Path

import numpy as np
import pytest

from kontur.errors import FileError
from kontur.path import gcode, programs
from kontur.path.geometry import Dwell, Program

CAM = Path(__file__).parent / "cam"


def load(name: str, z: str = "pen") -> Program:
    return programs.load(CAM / name, z=z)


def ends_mm(program: Program) -> list[tuple[float, float]]:
    ends = [1e3 * m.segment.point(np.array([m.segment.length_m]))[0] for m in program.moves]
    return [(round(float(x), 6), round(float(y), 6)) for x, y in ends]


def words(program: Program) -> str:
    return " ".join(event.word for event in program.events)


@pytest.mark.parametrize(
    ("name", "ends", "events"),
    [
        (
            "fusion.nc",
            [(10, -3), (10, 0), (5, 5), (0, 5), (0, 5), (0, 0)],
            "T1 M6 S5000 M3 M8 Z15 Z5 Z-1 Z15 M9 M5 Z0",
        ),
        ("inkscape.ngc", [(10.583333, 20.127976), (20.583333, 20.127976), (20.583333, 10), (0, 0)],
         "M3 Z5 Z-0.125 Z5 M5"),
        ("lightburn.gc", [(10, 10), (30, 10), (30, 20), (10, 20), (10, 10), (0, 0)], "M4 M8 S350 M9 S0 M5"),
        ("freecad.nc", [(-3, -3), (-3, 23), (0, 26), (20, 26)], "M5 T1 M6 S12000 M3 Z5 Z3 Z0 Z5 M5"),
        ("grbl.nc", [(5, 0.5), (25, 0.5), (30, 5.5), (30, 5.5), (30, 20), (5, 20), (0, 0)], "Z1 S255 M3 Z-0.2 Z1 M5"),
        ("estlcam.nc", [(12, 8), (14, 8), (14, 8), (100, 50), (105, 55), (105, 0)],
         "S24000 M3 Z5 Z0.5 S24000 Z-0.5 S24000 Z5 Z-0.5 Z5 M5"),
    ],
)  # fmt: skip
def test_program_of_a_post_goes_where_it_says_and_switches_in_order(
    name: str, ends: list[tuple[float, float]], events: str
) -> None:
    program = load(name)
    assert ends_mm(program) == ends
    assert words(program) == events
    tools = [event for event in program.events if event.word[0] == "T"]
    told = [f"Not executed, since the machine has no such thing: T; first in line {event.line}." for event in tools]
    assert list(program.notes) == told


@pytest.mark.parametrize(
    ("name", "refusals"),
    [
        ("vectric.tap", ["7: G70: this G code is not understood (docs/paths.md lists those that are); replace it"]),
        ("mach3.tap", ["9: F.9E+3: a number with an exponent; write it out, like X0.0015 in place of X1.5e-3"]),
    ],
)
def test_word_that_is_refused_is_the_only_one_of_its_program(name: str, refusals: list[str]) -> None:
    _, found = gcode.read((CAM / name).read_text(), "p")
    assert [str(error) for error, _ in found] == [f"p:{text}" for text in refusals]


# --- z ----------------------------------------------------------------------------------------------------------------
def read(text: str, z: str = "pen") -> Program:
    return gcode.parse("F600\n" + text, "p.ngc", z=z)


def order(program: Program) -> list[str]:
    """Items and events in their order."""
    found = []
    for number in range(len(program.items) + 1):
        found += [event.word for event in program.events if event.before == number]
        if number < len(program.items):
            found.append("stop" if isinstance(program.items[number], Dwell) else "move")
    return found


def test_pen_goes_up_before_a_rapid_and_down_after_it_and_the_path_rests() -> None:
    assert order(read("G1 X1\nG0 X2 Z5\nG0 X3 Z-1\nG1 X4")) == [
        *("move", "Z5", "stop", "move"),
        *("move", "Z-1", "stop", "move"),
    ]


@pytest.mark.parametrize("text", ["G1 X1 Z-1", "G2 X2 I1 Z-1", "G91 G1 X1 Z1"])
def test_z_that_changes_while_x_and_y_cut_is_refused_unless_it_is_flattened(text: str) -> None:
    with pytest.raises(
        FileError, match=r"p\.ngc:2: Z-?1: z changes while x and y cut, and the machine has no z; see --z"
    ):
        read(text)
    program = read(text, "ignore")
    assert order(program) == [program.events[0].word, "move"]


def test_z_that_stays_is_no_event() -> None:
    assert order(read("G1 Z0 X1\nG0 Z5\nG1 X2 Z5\nG91 X1 Z0\nG90 G92 Z0\nG1 X4 Z0")) == [
        *("move", "Z5", "stop", "move", "move", "move"),
    ]


def test_rotary_axis_that_moves_is_refused_and_one_that_stays_is_not() -> None:
    assert order(read("G1 X1 A0 B0")) == ["move"]
    with pytest.raises(FileError, match=r"A90: a rotary axis moves, and the machine has none"):
        read("G1 X1 A90")
    assert order(read("G20\nF9\nG1 X1 A90", "ignore")) == ["A90", "move"]


@pytest.mark.parametrize("word", ["Z5", "A0", "B0", "C0"])
def test_every_other_axis_is_refused_on_demand(word: str) -> None:
    with pytest.raises(FileError, match=rf"p\.ngc:2: {word}: the machine has two axes"):
        read(f"G1 X1 {word}", "refuse")


# --- events, holds, feeds ---------------------------------------------------------------------------------------------
def test_events_stand_before_the_motion_of_their_line_and_stops_behind_it() -> None:
    assert order(read("M7 M8\nG1 X1 S5 M3\nM9")) == ["M7", "M8", "S5", "M3", "move", "M9"]
    assert order(read("M0\nG4 P0\nT1 M6\nG1 X1")) == ["M0", "T1", "M6", "move"]


@pytest.mark.parametrize("word", ["M0", "M1", "M6", "M60"])
def test_path_rests_at_a_hold_on_the_way(word: str) -> None:
    program = read(f"G1 X1\n{word}\nX2")
    assert order(program) == ["move", word, "stop", "move"]
    assert [item.duration_s for item in program.items if isinstance(item, Dwell)] == [0.7]


def test_inverse_time_gives_each_move_its_duration() -> None:
    moves = read("G93\nG1 X30 F6\nG2 X30 I-15 F2\nG0 X0\nG94 F60\nG1 X6").moves
    durations = [move.segment.length_m / move.feed_mps for move in moves]
    assert durations == pytest.approx([10.0, 30.0, 0.0, 6.0])
    with pytest.raises(FileError, match=r"p\.ngc:4: X2: with G93 each move needs its F"):
        read("G93\nG1 X1 F6\nX2")
    with pytest.raises(FileError, match=r"p\.ngc:4: X2: no feed yet"):
        read("G93\nG1 X1 F6\nG94 X2")


# --- offsets ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("text", "end"),
    [
        ("G10 L2 P1 X5 Y6\nG1 X1", (6, 0)),
        ("G10 L2 P2 X5 Y6\nG1 X1", (1, 0)),
        ("G10 L2 P2 X5 Y6\nG55 G1 X1 Y1", (6, 7)),
        ("G10 L2 P9 X5\nG59.3 G1 X1", (6, 0)),
        ("G1 X10\nG10 L20 P0 X1\nG1 X2", (11, 0)),
        ("G1 X10\nG92 X0 Y5\nG1 X1 Y5", (11, 0)),
        ("G1 X10\nG92 X0\nG92.1\nG1 X1", (1, 0)),
        ("G1 X10\nG92 X0\nG92.2\nG1 X1\nG92.3\nX2", (12, 0)),
        ("G1 X10\nG92 X0\nG92.2\nG1 X1", (1, 0)),
        ("G92 X5\nG55\nG1 X6", (1, 0)),
        ("G10 L2 P1 X5\nG53 G1 X1", (1, 0)),
        ("G10 L2 P1 X5\nG28 Y3", (0, 0)),
        ("G1 X4 Y4\nG30.1\nX0 Y0\nG30 X1", (4, 0)),
        ("G1 X4 Y4\nG28", (0, 0)),
        ("G10 L2 P1 X1\nG90.1 G2 X1 Y2 I0 J1\nG1 X0 Y3", (1, 3)),
        ("G20\nG10 L2 P1 X1\nG21\nG1 X1", (26.4, 0)),
    ],
)
def test_offsets_are_those_of_linuxcnc(text: str, end: tuple[float, float]) -> None:
    assert ends_mm(read(text))[-1] == end


def test_g28_goes_by_way_of_its_point() -> None:
    assert ends_mm(read("G1 X4 Y4\nG91 G28 X1")) == [(4, 4), (5, 4), (0, 4)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("G92", "G92 needs the coordinates"),
        ("G10 L1 P1 X1", "L1: of G10, L2 and L20 with P0 to P9"),
        ("G10 L2 P10 X1", "L2: of G10, L2 and L20 with P0 to P9"),
        ("G10 L20 P1 R45", "R45: G10 L20 turns no coordinate system; use L2"),
        ("G92 X1 G0", "X1: G10 or G92 and a motion on one line"),
        ("G28 G0 X1", "G28 or G30 and a motion on one line"),
        ("G91 G53 G0 X1", "X1: G53 goes to a place of the machine"),
        ("G53 G2 X1 R5", "X1: G53 goes to a place of the machine"),
        ("G80\nX5", "X5: no motion mode yet"),
        ("G18 G2 X5 I2", "X5 I2: arcs lie in the plane of x and y, G17"),
        ("G1 X1 H5", "H5: H belongs to G43; remove it"),
        ("G1 X1 D5", "D5: D belongs to G41 and G42"),
        ("G1 X1 Q5", "Q5: Q belongs to G64"),
        ("G1 X1 L5", "L5: L belongs to G10"),
        ("G81 X1 Z-1 R1", "G81: drilling cycles move in z"),
        ("G95", "G95: the feed is in units per minute"),
        ("G96 S100", "G96: the speed of a spindle cannot follow"),
        ("M98 P100", "M98: subroutines are not understood; read the file by LinuxCNC's interpreter (--interpreter)"),
        ("o100 sub", "o100sub: subroutines and loops (O words)"),
        ("G1 U1", "U1: the machine has two axes"),
    ],
)
def test_what_has_no_meaning_here_is_refused(text: str, message: str) -> None:
    with pytest.raises(FileError, match=r"^p\.ngc:\d+: ") as caught:
        read(text + "\nG1 X7")
    assert message in str(caught.value)


def test_refusals_come_all_at_once_in_groups() -> None:
    text = "G41 D1\nG1 X1 F100\nM98 P5\nX[1+2]\nG41 D2\nG1 X1e2\nG2 X5 I1\nG2 X6 I1.5\nG41\n"
    _, refusals = gcode.read(text, "p.ngc")
    assert [(str(error).split(":")[1], error.word, count) for error, count in refusals] == [
        ("1", "G41", 3),
        ("3", "M98", 1),
        ("4", "X[1+2]", 1),
        ("6", "X1e2", 1),
        ("7", "X5 I1", 2),
    ]
    with pytest.raises(FileError, match=r"^p\.ngc:1: G41: .*lists this and what else the file is refused for: 4 more"):
        gcode.parse(text, "p.ngc")
