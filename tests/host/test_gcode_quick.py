# SPDX-License-Identifier: Apache-2.0
"""Lines of G0 to G3, X, Y, I, J, F and S, and dwells, are read by a quick way of their own, which gives what the reader
of all words gives."""

import gc
import itertools
import math
import random
from dataclasses import replace
from pathlib import Path

import pytest

from kontur.path import gcode, gcode_words, plain_lines, programs
from kontur.path.gcode_words import Refusals
from kontur.path.geometry import Curve, Move, MoveTable, Program

MODES = (
    *("G20", "G21", "G90", "G91", "G93", "G94", "G54", "G55", "G61", "G61.1", "G64 P0.01", "G92 X1 Y2", "G92.1", "G80"),
    *(
        "G10 L2 P1 X3 Y4",
        "G10 L2 P2 R30",
        "G10 L2 P2 R0",
        "G18",
        "G17",
        "G90.1",
        "G91.1",
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
    return rng.choice(
        (f"{rng.uniform(-9, 9):.{rng.randrange(5)}f}", ".5", "+1.", "-.25", "0", "1") * 5 + ("1e3", "12345678901")
    )


def line(rng: random.Random, other: float) -> str:
    if rng.random() < other:
        return rng.choice(MODES)
    if rng.random() < 0.2:
        return arc(rng)
    if rng.random() < 0.1:
        return dwell(rng)
    words = [rng.choice(("G0", "G1", "g01", "G00", "")), *(f"{letter}{number(rng)}" for letter in "XY")]
    words += [f"S{number(rng)}"] if rng.random() < 0.2 else []
    words = [rng.choice(("", "N5", "n07 ")), *(word for word in words if rng.random() < 0.8)]
    words += [f"F{rng.choice(('100', '.5', '6000.', '70') * 4 + ('0',))}"] if rng.random() < 0.3 else []
    return rng.choice(("", " ")).join(words) + rng.choice(
        ("", "", " ", "\t", " (a)", ";b", "(a) (b)", "(a(b)", "(", ";(", "(;)")
    )


def arc(rng: random.Random) -> str:
    """Mostly one that begins and ends on its circle, wherever it begins: a full one. Others are refused."""
    words = [f"{rng.choice('GGg')}{rng.choice(('2', '3', '03'))}", f"I{number(rng)}", f"J{number(rng)}"]
    words += [f"X{number(rng)}"] if rng.random() < 0.1 else []
    kept = [word for word in words if rng.random() < 0.9]
    rng.shuffle(kept)
    return rng.choice(("", " ", "(c)")).join([*kept, f"S{rng.randrange(3)}"] if rng.random() < 0.3 else kept)


def dwell(rng: random.Random) -> str:
    """Mostly one that is alone on its line."""
    words = [rng.choice(("G4", "g04", "G4.0")), f"P{rng.choice(('1', '.25', '0', '-0', '-1', '0.125'))}"]
    words += [rng.choice(("X1", "F5", "S3", "I0", "P1", "G1"))] if rng.random() < 0.1 else []
    kept = ["N7 "] * (rng.random() < 0.1) + [word for word in words if rng.random() < 0.95]
    rng.shuffle(kept)
    return rng.choice(("", " ")).join(kept)


def chain(rng: random.Random) -> str:
    """Lines and arcs one after the other, each arc from where it begins to a place on its circle."""
    out, x, y = ["G1 F600 X0 Y0"], 0.0, 0.0
    for _ in range(40):
        radius, begin, end = rng.uniform(0.1, 9.0), rng.uniform(0.0, 7.0), rng.uniform(0.0, 7.0)
        i, j = -radius * math.cos(begin), -radius * math.sin(begin)
        if rng.random() < 0.6:
            x, y = x + i + radius * math.cos(end), y + j + radius * math.sin(end)
            off = rng.choice((0.0, 0.0, 0.01, 0.05))
            digits = rng.choice((2, 4, 6))
            x, y = round(x + off, digits), round(y, digits)
            out.append(f"G{rng.choice((2, 3))} X{x:.6f} Y{y:.6f} I{i:.4f} J{j:.4f}")
        else:
            x, y = round(x + i, 3), round(y + j, 3)
            out += [f"G4 P{rng.randrange(3) / 8}"] if rng.random() < 0.3 else []
            out.append(f"G{rng.choice((0, 1))} X{x:.3f} Y{y:.3f} S{rng.randrange(1000) / 4}")
    return "\n".join(out)


def both(text: str, z: str = "pen") -> list[tuple[Program, list[tuple[str, int]]]]:
    read = (gcode.read(text, "p.ngc", z=z, source=source) for source in (None, gcode_words.blocks))
    return [(comparable(program), [(str(error), count) for error, count in refusals]) for program, refusals in read]


def comparable(program: Program) -> Program:
    """With arcs whose radius changes as what they are made of: a Curve is equal to itself alone."""
    items = tuple(
        replace(item, segment=(item.segment.formula.args, item.segment.length_m))  # type: ignore[attr-defined]
        if isinstance(item, Move) and isinstance(item.segment, Curve)
        else item
        for item in program.items
    )
    return replace(program, items=items)


@pytest.mark.parametrize("seed", range(30))
def test_quick_way_gives_the_same_program_and_refusals(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = random.Random(seed)
    for _ in range(20):
        monkeypatch.setattr(plain_lines, "_CHARACTERS", rng.choice((1, 7, 40, 1 << 19)))
        monkeypatch.setattr(gcode, "_SPAN", rng.choice((1, 4, 64)))
        other = rng.choice((0.02, 0.1, 0.3))
        text = rng.choice("\n\r").join(line(rng, other) for _ in range(40))
        quick, slow = both(rng.choice(("F600\n", "F600\r\n\n", "\ufeffG0 F600\n", "")) + text)
        assert quick == slow


@pytest.mark.parametrize("seed", range(20))
def test_arcs_and_powers_are_those_of_the_reader_of_all_words(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = random.Random(seed)
    monkeypatch.setattr(gcode, "_SPAN", rng.choice((1, 4, 64)))
    text = chain(rng)
    quick, slow = both(text)
    assert quick == slow
    items = gcode.read(text, "p.ngc")[0].items
    assert isinstance(items, MoveTable)
    assert items.at == sorted(items.at)
    assert quick[0].moves
    assert quick[0].events


def test_points_nearer_than_a_nanometre_are_one_however_many_there_are() -> None:
    steps = itertools.accumulate(itertools.cycle((1e-3, 4e-7, 4e-7, 4e-7, 5e-4)), initial=0.0)
    quick, slow = both(
        "G1 F600\n" + "\n".join(f"X{x:.9f}Y{x / 2:.9f}" for x, _ in zip(steps, range(500), strict=False))
    )
    assert quick == slow
    assert 200 < len(quick[0].moves) < 400


@pytest.mark.parametrize(
    "word",
    ["X1.2.3", "X.", "X-", "X+-1", "X1 2", "X 1", "X1-2", "1X", "X1X2", "G2", "G4", "I5", "J0", "G2I1J1J1", "G3 X1",
     "G2 I0 J0", "G2 R5 X9", "X1(a)2", "X1 (a) 2", "S5(a)", "S-1", "S1e3", "S999999999999", "S1S2",
     "G3 I1 S0.1234567", "G0.5", "G1.0", "G-1", "F-1", "F0", "F1e-9", "F." + 330 * "0" + "1", "X1e12",
     "X1000000000000", "X-999999999999", "N-5", "N1.5", "N1N2", "X\u0661", "X1_0", "x1\x0b", "X1\x00", "Xnan",
     "G4P1", "P1", "G4 P-1", "G4P1X5", "G4P1F5", "G4P1S5", "G4G1P1", "G1P1X5", "G4P1P1", "G4.1P1", "G4P1(a)",
     "Xinf", "X1,5", "/X5", "*", "X1\u2028Y2", "\ud800"],
)  # fmt: skip
def test_word_beside_the_plain_ones_is_read_as_ever(word: str) -> None:
    plain = "".join(f"G1 X{i}.5 Y-{i}\n" for i in range(10))
    quick, slow = both(f"F600\n{plain}{word}\n{plain}Y3 {word}\n{plain}{word}")
    assert quick == slow


@pytest.mark.parametrize(
    "mode", ["G91", "G93", "G61.1", "G10 L2 P1 R30", "G2 X1 Y1 R5", "G81 Z1", "G20", "G92 X1", "G53"]
)
def test_plain_lines_behind_a_mode_are_carried_out_in_it(mode: str) -> None:
    plain = "".join(f"X{i}.5 Y-{i} F{i + 1}\n" for i in range(10))
    quick, slow = both(f"G1 F600\n{plain}{mode}\n{plain}G1 X1\n{plain}G0\n{plain}")
    assert quick == slow


def test_dwells_without_a_motion_are_refused_and_hold_nothing() -> None:
    for text in ("F600 G1\n" + 9 * "G4 P1\n", "F600 G1\n" + 9 * "G4 P1\n" + "M0\nX1\nM0"):
        quick, slow = both(text)
        assert quick == slow


def test_command_line_reads_plain_lines_many_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "G21 G90\nG1 F600\n" + "X1.5Y-2 S7 (a)\nG1 X3; b\nN50 G02 I2. J0 F900\nG4 P.5\nG0 X5 Y5\n" * 100
    file = tmp_path / "long.ngc"
    file.write_text(text)
    one_by_one = []
    read = gcode_words._block

    def counted(code: str, line: int, refusals: Refusals) -> gcode_words.Block:
        one_by_one.append(code)
        return read(code, line, refusals)

    monkeypatch.setattr(gcode_words, "_block", counted)
    program = programs.load(file)
    assert (len(program.moves), len(program.events), len(program.items)) == (400, 100, 500)
    assert one_by_one == ["G21G90"]


def test_collection_of_garbage_goes_on_after_a_file() -> None:
    assert gc.isenabled()
    with pytest.raises(ValueError, match="broken"):
        gcode.read("G0 X1", "p.ngc", source=lambda *_: (_ for _ in ()).throw(ValueError("broken")))
    assert gc.isenabled()
