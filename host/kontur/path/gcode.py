# SPDX-License-Identifier: Apache-2.0
"""G-code to a program: the two-axis subset of RS-274 (LinuxCNC's reading of it), one block a line.

Words: G0 G1 G2 G3 (X Y, I J or R, F), G4 P (seconds), G17, G20 G21, G61, G90 G91, G90.1 G91.1, M2 M30, N; comments in
( ) and after `;`; `%` around the program. Letters may be upper or lower case, and spaces may stand anywhere.
Every other word is refused, since a program with a word skipped would cut another part.

At the start: G17 G21 G61 G90 G91.1, no motion mode, no feed. F is in units (mm or inch) per minute. G0 goes on a
straight line as fast as the machine may. kontur.path.arcs has the arcs.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from kontur.errors import FileError
from kontur.files import text_lines
from kontur.path import arcs
from kontur.path.geometry import Dwell, Line, Move, Point, Program, Segment

_COMMENT = re.compile(r"\([^()]*\)|;.*")
_WORD = re.compile(r"([A-Za-z])([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))")
_EXPONENT = re.compile(r"[eE][+-]?[0-9]+")
_INCH_M = 25.4e-3
_SAME_M = 1e-9  # points nearer than this are one point
_LONG_DWELL_S = 10.0

# Modal groups of the G codes that are known, by ten times their number.
_GROUP = {
    **dict.fromkeys((0, 10, 20, 30), "motion"),
    40: "dwell",
    170: "plane",
    **dict.fromkeys((200, 210), "units"),
    610: "path control",
    **dict.fromkeys((900, 910), "distance"),
    **dict.fromkeys((901, 911), "arc centre"),
}
_KNOWN_G = "G0 G1 G2 G3 G4 G17 G20 G21 G61 G90 G91 G90.1 G91.1"
_REFUSED_G = {
    180: "the machine has two axes, x and y; arcs lie in the plane G17",
    190: "the machine has two axes, x and y; arcs lie in the plane G17",
    640: "corners cannot be blended yet; use G61 (exact path)",
    611: "there is no exact stop mode; G61 stops at every corner that is not tangent",
    410: "there is no cutter compensation; let the CAM program offset the path",
    420: "there is no cutter compensation; let the CAM program offset the path",
    930: "the feed is always in units per minute; convert F and remove the word",
    950: "the feed is always in units per minute; convert F and remove the word",
}
_REFUSED_LETTER = {
    **dict.fromkeys("ZABCUVW", "the machine has two axes, x and y; remove the word"),
    **dict.fromkeys("ST", "there is no spindle and no tool changer; remove the word"),
    "K": "arcs lie in the plane of x and y: their centre is given by I and J",
}


@dataclass
class _Block:
    """One line: its G codes (ten times the number) by group, and the number and text of each other word by letter."""

    line: int
    codes: dict[str, int] = field(default_factory=dict)
    values: dict[str, float] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)
    end: bool = False


def parse(text: str, name: str, start_m: Point = (0.0, 0.0)) -> Program:
    """The program of the G-code `text`, for a machine that stands at `start_m`. `name` is the file's, for messages.

    Raises FileError: anything that is not understood, with line and word; a file without motion.
    """
    reader = _Reader(name, start_m)
    for block in _blocks(text, name):
        reader.run(block)
        if block.end:
            break
    if not any(isinstance(item, Move) for item in reader.items):
        raise FileError(name, "there is no motion in this file; it needs a line like G1 X10 Y5 F1000")
    return Program(name, tuple(reader.items), start_m, _notes(reader.items))


def _notes(items: list[Move | Dwell]) -> tuple[str, ...]:
    """What a user should know of a program that can be run."""
    long = [item for item in items if isinstance(item, Dwell) and item.duration_s > _LONG_DWELL_S]
    if not long:
        return ()
    how_many = "1 dwell waits" if len(long) == 1 else f"{len(long)} dwells wait"
    where = f"in line {long[0].line}" if len(long) == 1 else f"the first in line {long[0].line} and the longest"
    longest = max(item.duration_s for item in long)
    return (
        f"{how_many} for more than {_LONG_DWELL_S:g} s, {where} for {longest:g} s: P is in seconds. "
        "Some programs mean milliseconds.",
    )


def _blocks(text: str, name: str) -> Iterator[_Block]:
    percents = 0
    for line, raw in enumerate(text_lines(text), start=1):
        code = _COMMENT.sub("", raw).replace(" ", "").replace("\t", "")
        if "(" in code or ")" in code:
            raise FileError(name, "a comment in parentheses must end on its line and hold no other", line, raw.strip())
        if code == "%":
            percents += 1
            if percents == 2:
                return
        elif code:
            yield _block(code, line, name)


def _block(code: str, line: int, name: str) -> _Block:
    block = _Block(line)
    at = 0
    while at < len(code):
        match = _WORD.match(code, at)
        if match is None:
            raise FileError(name, _unreadable(code[at : at + 2]), line, code[at : at + 12])
        exponent = _EXPONENT.match(code, match.end())
        if exponent is not None:
            what = "a number with an exponent; write it out, like X0.0015 in place of X1.5e-3"
            raise FileError(name, what, line, match[0] + exponent[0])
        _take(block, match[1].upper(), float(match[2]), match[0], name)
        at = match.end()
    return block


def _unreadable(start: str) -> str:
    if start[0] == "/":
        return "lines cannot be skipped by a switch; remove the line or the slash"
    if "#" in start or "[" in start:
        return "variables and expressions are not understood; write numbers"
    return "not a word; words are a letter and a decimal number, like X12.5"


def _take(block: _Block, letter: str, value: float, text: str, name: str) -> None:
    """Put one word into its block."""

    def problem(what: str) -> FileError:
        return FileError(name, what, block.line, text)

    if letter == "G":
        code = round(10.0 * value) if value < 1000.0 and abs(10.0 * value - round(10.0 * value)) < 1e-6 else -1
        group = _GROUP.get(code)
        if group is None:
            raise problem(_REFUSED_G.get(code, f"this G code is not understood ({_KNOWN_G} are); remove or replace it"))
        if group in block.codes:
            raise problem(f"a second {group} word on the line; put it on a line of its own")
        block.codes[group] = code
    elif letter == "M":
        if value not in (2.0, 30.0):
            raise problem("this M code is not understood (M2 and M30 are); remove it")
        block.end = True
    elif letter not in "NXYIJRFP":
        raise problem(_REFUSED_LETTER.get(letter, "this word is not understood; remove it"))
    elif letter in block.values:
        raise problem(f"a second {letter} word on the line; put it on a line of its own")
    elif not abs(value) < 1e9:
        raise problem("the number is too large")
    else:
        block.values[letter] = value
        block.texts[letter] = text


class _Reader:
    """The modal state, and the program so far."""

    def __init__(self, name: str, start_m: Point) -> None:
        self.name = name
        self.here = start_m
        self.items: list[Move | Dwell] = []
        self.unit_m = 1e-3
        self.motion: int | None = None
        self.feed_mps: float | None = None
        self.relative = False
        self.center_absolute = False

    def run(self, block: _Block) -> None:
        """Carry out one block: units, feed and modes first, then the dwell or the move."""
        codes, values = block.codes, block.values

        def problem(letter: str, what: str) -> FileError:
            return FileError(self.name, what, block.line, block.texts.get(letter))

        unit_m = {200: _INCH_M, 210: 1e-3}.get(codes.get("units", 0), self.unit_m)
        if unit_m != self.unit_m and "F" in values:
            raise problem(
                "F",
                "a feed on the line that changes the unit; controls differ about its unit, so put it on the next line",
            )
        self.unit_m = unit_m
        self.motion = codes.get("motion", self.motion)
        if "distance" in codes:
            self.relative = codes["distance"] == 910
        if "arc centre" in codes:
            self.center_absolute = codes["arc centre"] == 901
        if "F" in values:
            if not values["F"] > 0.0:
                raise problem("F", "the feed must be above zero")
            self.feed_mps = values["F"] * self.unit_m / 60.0

        arc_word = next((letter for letter in "IJR" if letter in values), None)
        move_word = next((letter for letter in "XY" if letter in values), arc_word)
        if "P" in values and "dwell" not in codes:
            raise problem("P", "P belongs to G4 (dwell), in seconds; remove it")
        if "dwell" in codes:
            if "P" not in values or values["P"] < 0.0:
                raise problem("P", "G4 needs the time to wait in seconds, not negative, like G4 P0.5")
            if move_word is not None or "motion" in codes:
                raise problem(move_word or "", "a dwell and a move on one line; put them on two lines")
            if values["P"] > 0.0:
                self.items.append(Dwell(values["P"], block.line))
        elif move_word is not None:
            if self.motion is None:
                raise problem(move_word, "no motion mode yet; write G0, G1, G2 or G3 before it")
            if arc_word is not None and self.motion < 20:
                raise problem(arc_word, f"{arc_word} belongs to an arc, but the motion mode is G{self.motion // 10}")
            if self.motion > 0 and self.feed_mps is None:
                raise problem(move_word, "no feed yet; give one on this line or before it, like F1000")
            self._move(block)

    def _move(self, block: _Block) -> None:
        base = self.here if self.relative else (0.0, 0.0)
        x, y = (
            base[axis] + block.values[letter] * self.unit_m if letter in block.values else self.here[axis]
            for axis, letter in enumerate("XY")
        )
        same = math.dist((x, y), self.here) < _SAME_M
        end = self.here if same else (x, y)
        segment: Segment
        if self.motion in (20, 30):
            segment = self._arc(block, end)
        elif same:
            return
        else:
            segment = Line(self.here, end)
        rapid = self.motion == 0
        feed_mps = math.inf if rapid or self.feed_mps is None else self.feed_mps
        self.items.append(Move(segment, feed_mps, rapid, block.line))
        self.here = end

    def _arc(self, block: _Block, end: Point) -> Segment:
        values, here, left = block.values, complex(*self.here), self.motion == 30
        to = complex(*end)

        def problem(what: str) -> FileError:
            words = " ".join(text for letter, text in block.texts.items() if letter in "XYIJR")
            return FileError(self.name, what, block.line, words)

        if "R" in values:
            if "I" in values or "J" in values:
                raise problem("an arc has R or I and J, not both")
            if to == here:
                raise problem("an arc with R must end elsewhere than it starts; for a full circle use I and J")
            center = arcs.center_from_radius(here, to, values["R"] * self.unit_m, left)
            if center is None:
                raise problem(
                    f"the radius is less than half the distance to the end, {abs(to - here) / 2.0 / self.unit_m:.4f}"
                )
        else:
            if not ("I" in values or "J" in values) or (self.center_absolute and not ("I" in values and "J" in values)):
                raise problem("an arc needs R, or I and J (with G90.1 both of them)")
            center = complex(values.get("I", 0.0), values.get("J", 0.0)) * self.unit_m
            if not self.center_absolute:
                center += here
        start_r, end_r = abs(here - center), abs(to - center)
        if start_r < _SAME_M:
            raise problem("the centre of the arc is its start; correct I and J")
        if not arcs.on_arc(start_r, end_r, self.unit_m == _INCH_M):
            raise problem(
                f"the end is not on the arc: the radius is {start_r / self.unit_m:.4f} at its start and "
                f"{end_r / self.unit_m:.4f} at its end; correct X, Y, I or J, or give more digits"
            )
        return arcs.segment(here, to, center, left)
