# SPDX-License-Identifier: Apache-2.0
"""G-code by rs274, LinuxCNC's interpreter; and Kontur's own reader against it, where it is installed."""

import math
import os
import random
import shutil
import stat
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from kontur.cli import main
from kontur.errors import FileError
from kontur.path import gcode, interpreter
from kontur.path.gcode_words import Block, Refusals
from kontur.path.geometry import Dwell, Line, Move, Program

CAM = Path(__file__).parent / "cam"
needs_rs274 = pytest.mark.skipif(
    shutil.which("rs274") is None and "CI" not in os.environ,
    reason="rs274 is not installed: apt-get install linuxcnc-uspace (80 MB)",
)
MM = 1e-3


def by_rs274(text: str, z: str = "pen") -> Program:
    return gcode.parse(text, "p.ngc", z=z, source=interpreter.blocks)


def ends_mm(program: Program) -> list[tuple[float, float]]:
    ends = [1e3 * m.segment.point(np.array([m.segment.length_m]))[0] for m in program.moves]
    return [(round(float(x), 4), round(float(y), 4)) for x, y in ends]


# --- without rs274 ----------------------------------------------------------------------------------------------------
def fake(folder: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    """Put a program rs274 into PATH that does what `script` says."""
    program = folder / "rs274"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}/usr/bin{os.pathsep}/bin")


def calls(*lines: str) -> str:
    """A script that prints these calls."""
    return "cat <<'END'\n" + "\n".join(f"    {n} {line}" for n, line in enumerate(lines, 1)) + "\nEND"


def test_without_rs274_one_message_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    file = tmp_path / "a.ngc"
    file.write_text("#1=5\nG0 X#1\n")
    result = CliRunner().invoke(main, ["run", str(file), "--interpreter"])
    assert result.exit_code == 1
    assert result.stderr == (
        f"Error: {file}: --interpreter: rs274 is not installed; it is in the Debian package linuxcnc-uspace "
        "(apt-get install linuxcnc-uspace)\n"
    )
    result = CliRunner().invoke(main, ["run", str(file)])
    assert "variables and expressions are not understood; read the file by LinuxCNC's interpreter (--interpreter)" in (
        result.stderr
    )


def test_calls_become_moves_in_machine_coordinates_with_the_lines_they_come_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = calls(
        "N..... USE_LENGTH_UNITS(CANON_UNITS_INCHES)",
        "N..... SET_G5X_OFFSET(1, 1.0000, 0.0000, 0.0000, 0.0000, 0.0000, 0.0000)",
        "N..... SET_G92_OFFSET(0.0000, 2.0000, 0.0000, 0.0000, 0.0000, 0.0000)",
        "N3     SET_FEED_RATE(60.0000)",
        "N3     START_SPINDLE_CLOCKWISE(0)",
        "N123456STRAIGHT_FEED(1.0000, -2.0000, 0.0000, 0.0000, 0.0000, 0.0000)",
        "N7     ARC_FEED(1.0000, -1.0000, 1.0000, -1.5000, -1, 0.0000, 0.0000, 0.0000, 0.0000)",
        "N8     STRAIGHT_TRAVERSE(1.0000, -1.0000, 1.0000, 0.0000, 0.0000, 0.0000)",
        "N9     DWELL(2.5000)",
        "N9     STOP_SPINDLE_TURNING(0)",
        "N9     FLOOD_OFF()",
        "N..... PROGRAM_END()",
        "N..... STRAIGHT_FEED(9.0000, 9.0000, 0.0000, 0.0000, 0.0000, 0.0000)",
    )
    fake(tmp_path, monkeypatch, script)
    program = by_rs274("rubbish")
    assert ends_mm(program) == [(50.8, 0.0), (50.8, 25.4)]
    assert [(move.line, round(move.feed_mps, 9)) for move in program.moves] == [(123456, 0.0254), (7, 0.0254)]
    assert program.moves[1].segment.length_m == pytest.approx(math.pi * 12.7 * MM)
    assert [(event.word, event.line) for event in program.events] == [("M3", 3), ("Z1", 8), ("M5", 9)]
    assert program.items[-1] == Dwell(2.5, 9)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        ("N4 NURBS_FEED(4, ...)", "p.ngc:4: NURBS_FEED: this canonical function has no meaning for two axes"),
        ("N4 RIGID_TAP(0, 0, -5)", "p.ngc:4: RIGID_TAP: motion tied to the turns of a spindle"),
        ("N4 STRAIGHT_FEED(1, 1, 5, 0, 0, 0)", "p.ngc:4: Z5: z changes while x and y cut"),
    ],
)
def test_call_without_a_meaning_for_two_axes_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str, message: str
) -> None:
    fake(tmp_path, monkeypatch, calls("N1 SET_FEED_RATE(60.0000)", call))
    with pytest.raises(FileError) as caught:
        by_rs274("rubbish")
    assert str(caught.value).startswith(message)


def test_arc_in_another_plane_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plane, arc = "N2 SELECT_PLANE(CANON_PLANE_XZ)", "N4 ARC_FEED(0, 1, 0, 0.5, 1, 1, 0, 0, 0)"
    fake(tmp_path, monkeypatch, calls("N1 SET_FEED_RATE(60.0000)", plane, arc))
    with pytest.raises(FileError, match=r"p\.ngc:4: X1 Y1 I0 J0\.5: arcs lie in the plane of x and y, G17"):
        by_rs274("rubbish")


def test_what_rs274_refuses_is_told_with_its_words_and_the_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake(tmp_path, monkeypatch, "echo executing >&2; echo Bad thing used; echo 'N17 G1 X#'; exit 1")
    with pytest.raises(FileError, match=r"^p\.ngc:17: G1 X#: rs274 refuses it: Bad thing used"):
        by_rs274("rubbish")
    fake(tmp_path, monkeypatch, "exit 3")
    with pytest.raises(FileError, match=r"^p\.ngc: rs274 refuses it: it ends with code 3"):
        by_rs274("rubbish")


def test_program_that_does_not_end_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake(tmp_path, monkeypatch, "exec sleep 60")
    monkeypatch.setattr(interpreter, "_TIMEOUT_S", 0.2)
    with pytest.raises(FileError, match=r"^p\.ngc: rs274 does not come to an end within 0\.2 s; does it loop\?"):
        by_rs274("rubbish")


def test_home_is_a_folder_of_its_own_so_that_two_runs_do_not_share_the_file_of_tools(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake(tmp_path, monkeypatch, f'echo "$HOME" > {tmp_path}/home; test "$PWD" = "$HOME"')
    with pytest.raises(FileError, match="no motion"):
        by_rs274("rubbish")
    home = Path((tmp_path / "home").read_text().strip())
    assert home.name.startswith("kontur-")
    assert not home.exists()


def test_each_line_gets_its_number_in_place_of_another_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake(tmp_path, monkeypatch, f"cp program.ngc {tmp_path}/seen")
    with pytest.raises(FileError, match="no motion"):
        by_rs274("%\nG0 X1\r\n n12.5 G1\n/N7X2\n\n(a)\n;b\no1 sub\n%")
    assert (tmp_path / "seen").read_text() == "%\nN2 G0 X1\nN3 G1\n/N4 X2\n\n(a)\n;b\nN8 o1 sub\n%"


# --- with rs274 -------------------------------------------------------------------------------------------------------
@needs_rs274
def test_parameters_loops_cycles_and_compensation_are_expanded() -> None:
    text = (
        "F600\n#1=3\no1 while [#1 gt 0]\nG1 X[#1*2] Y#1\n#1=[#1-1]\no1 endwhile\n"
        "G81 X1 Y1 Z-1 R1\nX2\nG80\nG41.1 D2\nG1 X5 Y5\nG1 X10\nG40\nG1 X20 Y0\nM2\n"
    )
    program = by_rs274(text)
    assert ends_mm(program) == [
        *((6.0, 3.0), (4.0, 2.0), (2.0, 1.0)),
        *((1.0, 1.0), (2.0, 1.0)),
        *((4.2, 5.6), (5.0, 6.0), (10.0, 6.0), (20.0, 0.0)),
    ]
    assert [event.word for event in program.events].count("Z-1") == 2


@needs_rs274
def test_arc_of_a_program_in_inches_may_miss_its_end_as_far_as_for_rs274() -> None:
    text = "G20\nF60\nG2 X5 Y0 I2.4986 J0\nM2\n"
    assert ends_mm(by_rs274(text)) == ends_mm(gcode.parse(text, "p.ngc")) == [(127.0, 0.0)]


@needs_rs274
def test_arc_in_another_plane_is_the_only_refusal_of_its_program() -> None:
    _, refusals = gcode.read("F600\nG18\nG2 X4 Z0 K2 I2\nG17\nG2 X6 Y0 I1\nM2\n", "p", source=interpreter.blocks)
    assert [error.line for error, _ in refusals] == [3]


@needs_rs274
def test_subroutines_in_files_beside_the_program_are_found(tmp_path: Path) -> None:
    (tmp_path / "there.ngc").write_text("o<there> sub\nG1 X#1 F600\no<there> endsub\nM2\n")
    program = gcode.parse("o<there> call [7]\nM2\n", str(tmp_path / "main.ngc"), source=interpreter.blocks)
    assert ends_mm(program) == [(7.0, 0.0)]


@needs_rs274
def test_rs274_names_the_line_it_refuses() -> None:
    with pytest.raises(FileError, match=r"^p\.ngc:3: G1 X5 E2: rs274 refuses it: E word with no"):
        by_rs274("F600\nG0 X1\nN99 G1 X5 E2\nG1 X6")


@needs_rs274
@pytest.mark.parametrize("file", sorted(CAM.glob("*")), ids=lambda file: file.name)
def test_own_reader_reads_cam_programs_as_rs274_does(file: Path) -> None:
    own, refused = gcode.read(file.read_text(), "p.ngc")
    if refused:
        with pytest.raises(FileError):
            by_rs274(file.read_text())
        return
    compare(own, file.read_text().replace(" K0.000", ""), 0.1e-6)  # rs274 takes no K in the plane of x and y


@needs_rs274
@pytest.mark.parametrize("seed", range(int(os.environ.get("KONTUR_RS274_PROGRAMS", "20"))))
def test_own_reader_reads_random_programs_as_rs274_does(seed: int) -> None:
    text = random_program(random.Random(seed), 100)
    own, refused = gcode.read(text, "p.ngc", z="ignore")
    assert not refused, str(refused.error())
    compare(own, text, 1e-9)


def compare(own: Program, text: str, end_m: float) -> None:
    """Same moves, ends within `end_m`, feeds; arcs within 0.2 um of the even change of radius about rs274's centre,
    which it rounds to four decimals."""
    unit_m = 25.4e-3 if "G20" in text else 1e-3
    digit_m = 1e-4 * unit_m
    arcs: list[Block] = []

    def source(text: str, refusals: Refusals):  # type: ignore[no-untyped-def]
        for block in interpreter.blocks(text, refusals):
            if "I" in block.values:
                arcs.append(block)
            yield block

    other = gcode.parse(text, "p.ngc", z="ignore", source=source)
    mine, theirs = ([i for i in p.items if not isinstance(i, Dwell) or i.duration_s] for p in (own, other))
    assert [(type(i), i.line) for i in mine] == [(type(i), i.line) for i in theirs]
    for a, b in zip(mine, theirs, strict=True):
        if isinstance(a, Dwell):
            assert a == b
            continue
        assert isinstance(b, Move)
        least = 1e3 * digit_m / 60.0  # LinuxCNC goes at 0.1 units a minute at least with G93
        assert (a.rapid, max(a.feed_mps, least)) == (
            b.rapid,
            pytest.approx(b.feed_mps, rel=1e-9, abs=digit_m / 60.0),
        ), a.line
        ends = [move.segment.point(np.array([move.segment.length_m]))[0] for move in (a, b)]
        np.testing.assert_allclose(ends[0], ends[1], atol=end_m, err_msg=f"line {a.line}")
        if not isinstance(a.segment, Line):
            check_arc(a, arcs.pop(0), unit_m, 0.2e-6 + 1.5 * digit_m)


def check_arc(move: Move, block: Block, unit_m: float, most_m: float) -> None:
    """An arc against the centre, the end and the sense that rs274 tells, by an own formula."""
    center = complex(block.values["I"], block.values["J"]) * unit_m
    x, y = move.segment.point(np.linspace(0.0, move.segment.length_m, 33)).T
    z = x + 1j * y - center
    turned = np.unwrap(np.angle(z)) - np.angle(z[0])
    assert np.all(np.diff(turned) * (1 if block.codes["motion"] == 30 else -1) > 0.0), move.line
    even = np.abs(z[0]) + (np.abs(z[-1]) - np.abs(z[0])) * turned / turned[-1]
    assert np.max(np.abs(np.abs(z) - even)) < most_m, move.line
    end = complex(block.values["X"], block.values["Y"]) * unit_m - center
    sweep = (np.angle(end / z[0]) * math.copysign(1.0, turned[-1])) % (2.0 * math.pi)
    if min(sweep, 2.0 * math.pi - sweep) > 1e-3:
        assert abs(turned[-1]) == pytest.approx(sweep, abs=1e-4)
    else:
        assert abs(turned[-1]) == pytest.approx(2.0 * math.pi, abs=2e-3)


class _Writer:
    """Where a random program is, as it writes itself."""

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng
        self.relative = False
        self.scale = 1.0

    def number(self, value: float) -> str:
        text = f"{value:.{self.rng.choice((4, 4, 3))}f}"
        style = self.rng.randrange(4)
        if style == 0 and "." in text:
            text = text.rstrip("0")
        if style == 1 and value >= 0.0:
            text = "+" + text
        return text.replace("0.", ".", 1) if style == 2 and text.startswith(("0.", "-0.")) else text

    def place(self) -> float:
        span = 5.0 if self.relative else 50.0
        return self.rng.uniform(-span, span) * self.scale

    def word(self, letter: str, value: float) -> str:
        letter = letter if self.rng.random() < 0.7 else letter.lower()
        return letter + self.number(value) + self.rng.choice(("", " ", "  "))

    def xy(self) -> str:
        axes = self.rng.choice(("X", "Y", "XY", "XY", "YX"))
        return "".join(self.word(axis, self.place()) for axis in axes)

    def arc(self) -> str:
        """By centre, an own program of absolute and relative words around it so that its end is known."""
        rng = self.rng
        code, turn = rng.choice((("G2", -1.0), ("G3", 1.0)))
        i, j = (round(rng.uniform(0.5, 9.0) * rng.choice((-1, 1)) * self.scale, 4) for _ in "ij")
        if rng.random() < 0.2:
            end = (0.0, 0.0)
        else:
            sweep = turn * rng.uniform(0.01, 6.2)
            end_z = complex(i, j) - complex(i, j) * complex(math.cos(sweep), math.sin(sweep))
            end = (round(end_z.real, 4), round(end_z.imag, 4))
        where = f"X{end[0]:.4f} Y{end[1]:.4f}" if end != (0.0, 0.0) or rng.random() < 0.5 else ""
        before, after = ("", "G90 ") if self.relative else ("G91\n", "\nG90")
        after = "" if self.relative else after
        return f"{before}{code} {where} I{i:.4f} J{j:.4f}{after}"

    def radius(self) -> str:
        rng = self.rng
        x, y = (round(rng.uniform(-9.0, 9.0) * self.scale, 4) for _ in "xy")
        r = math.hypot(x, y) / 2.0 * rng.uniform(1.01, 3.0) + 0.01 * self.scale
        before, after = ("", "") if self.relative else ("G91\n", "\nG90")
        return f"{before}G{rng.choice((2, 3))} X{x:.4f} Y{y:.4f} R{r * rng.choice((1, 1, -1)):.4f}{after}"

    def line(self) -> str:
        rng = self.rng
        kind = rng.randrange(24)
        if kind < 7:
            return f"{rng.choice(('G0', 'G00', 'g1', 'G01', 'G1'))} {self.xy()}"
        if kind < 10:
            return self.arc()
        if kind < 12:
            return self.radius()
        if kind == 12:
            self.relative = not self.relative
            return "G91" if self.relative else "G90"
        simple = {
            13: lambda: f"F{self.number(abs(self.place()) + 0.1)}",
            14: lambda: f"G4 P{rng.choice(('0', '.25', '2'))}",
            15: lambda: rng.choice(("G54", "G55", "G56", "G59", "G59.1", "G59.3")),
            16: lambda: f"G10 L2 P{rng.randrange(10)} {self.xy()}",
            17: lambda: f"G10 L20 P{rng.randrange(10)} {self.xy()}",
            18: lambda: f"G92 {self.xy()}",
            19: lambda: rng.choice(("G92.1", "G92.2", "G92.3")),
            20: lambda: (
                ("" if not self.relative else "G90\n") + f"G53 G0 {self.xy()}" + ("\nG91" if self.relative else "")
            ),
            21: lambda: rng.choice((f"G28 {self.xy()}", "G30", "G28.1", "G30.1", f"G30 X{self.number(1.0)}")),
            22: lambda: f"G93\nG1 {self.xy()} F{rng.choice(('2', '60', '.5'))}\nG94 F{self.number(100 * self.scale)}",
            23: lambda: rng.choice(("M3 S100", "M5", "M8", "G17", "G40", "G49", "(a)", "; b", "/G80", "", "G64 P.01")),
        }
        return simple[kind]()


def random_program(rng: random.Random, lines: int) -> str:
    """Moves, offsets and modes that both readers take."""
    writer = _Writer(rng)
    inch = rng.random() < 0.3
    writer.scale = 0.04 if inch else 1.0
    body = [writer.line() for _ in range(lines)]
    return "\n".join(
        ["G20" if inch else "G21", f"F{'20' if inch else '500'}", *body, "G90", "G0 X0 Y0", "G0 X1", "M2", ""]
    )
