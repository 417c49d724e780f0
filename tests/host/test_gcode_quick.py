# SPDX-License-Identifier: Apache-2.0
"""Lines of G0, G1, x, y and F are read by a quick way of their own, which gives what the reader of all words gives."""

import gc
import itertools
import random

import pytest

from kontur.path import gcode, gcode_words
from kontur.path.gcode_words import Refusals
from kontur.path.geometry import Program

MODES = (
    *("G20", "G21", "G90", "G91", "G93", "G94", "G54", "G55", "G61", "G61.1", "G64 P0.01", "G92 X1 Y2", "G92.1", "G80"),
    *(
        "G10 L2 P1 X3 Y4",
        "G10 L2 P2 R30",
        "G10 L2 P2 R0",
        "M3 S5",
        "G0 Z5",
        "G1 Z0",
        "G2 X1 Y0 R9",
        "G4 P1",
        "(a)",
        "%",
    ),
    *("M0", "G28.1", "G28 X1", "F0", "F0.0", "F1#", "G53 G0 X0 Y0"),
)


def number(rng: random.Random) -> str:
    return rng.choice((f"{rng.uniform(-9, 9):.{rng.randrange(5)}f}", ".5", "+1.", "-.25", "0", "1e3", "12345678901"))


def line(rng: random.Random) -> str:
    if rng.random() < 0.3:
        return rng.choice(MODES)
    words = [rng.choice(("G0", "G1", "g01", "G00", "")), *(f"{letter}{number(rng)}" for letter in "XY")]
    words = [rng.choice(("", "N5", "n07 ")), *(word for word in words if rng.random() < 0.8)]
    words += [f"F{rng.choice(('100', '.5', '6000.', '0'))}"] if rng.random() < 0.3 else []
    return rng.choice(("", " ")).join(words) + rng.choice(("", "", " ", "\t", " (a)", ";b"))


def both(text: str) -> list[tuple[Program, list[tuple[str, int]]]]:
    read = (gcode.read(text, "p.ngc", source=source) for source in (None, gcode_words.blocks))
    return [(program, [(str(error), count) for error, count in refusals]) for program, refusals in read]


@pytest.mark.parametrize("seed", range(50))
def test_quick_way_gives_the_same_program_and_refusals(seed: int) -> None:
    rng = random.Random(seed)
    for _ in range(20):
        quick, slow = both("F600\n" + "\n".join(line(rng) for _ in range(30)))
        assert quick == slow


def test_lines_of_cam_programs_go_the_quick_way() -> None:
    text = "G21 G90\nG1 F600\n" + "X1.5Y-2\nG1 X3\nN50 G01 X1.000 Y2.000 F900\nG0 X5 Y5\n" * 100
    reader = gcode._Reader(Refusals("p.ngc"), (0.0, 0.0), "pen")
    blocks = 0
    for block in gcode_words.blocks(text, Refusals("p.ngc"), reader.step):
        reader.run(block)
        blocks += 1
    assert blocks == 1
    assert len(reader.items) == 400


def test_neighbours_share_the_point_between_them() -> None:
    moves = gcode.parse("G1 X1 F600\nX2\nG2 X4 R5\nG1 X5\nX6", "p.ngc").moves
    ends = [(a.segment, b.segment) for a, b in itertools.pairwise(moves)]
    assert ends[0][0].end_m is ends[0][1].start_m  # type: ignore[attr-defined]
    assert ends[3][0].end_m is ends[3][1].start_m  # type: ignore[attr-defined]


def test_collection_of_garbage_goes_on_after_a_file() -> None:
    assert gc.isenabled()
    with pytest.raises(ValueError, match="broken"):
        gcode.read("G0 X1", "p.ngc", source=lambda *_: (_ for _ in ()).throw(ValueError("broken")))
    assert gc.isenabled()
