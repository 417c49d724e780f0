# SPDX-License-Identifier: Apache-2.0
"""The words of G-code: lines to blocks of numbers by letter. Which words there are, and why others are refused.

A refusal is collected, and reading goes on behind its word, so that a file's refusals come all at once.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from kontur.errors import FileError
from kontur.files import text_lines

_COMMENT = re.compile(r"\([^()]*\)|;.*")
_WORD = re.compile(r"([A-Za-z])([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))")
_EXPONENT = re.compile(r"[eE][+-]?[0-9]+")
_PROGRAM_NUMBER = re.compile(r"[Oo:][0-9]+$")
_CODE = re.compile(r"[GgMm][0-9.]+$")
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)")

# Modal groups of the G codes that are known, by ten times their number.
_GROUP = {
    **dict.fromkeys((0, 10, 20, 30), "motion"),
    800: "cycle",
    **dict.fromkeys((40, 100, 280, 281, 300, 301, 530, 920, 921, 922, 923), "non-modal"),
    **dict.fromkeys((170, 180, 190), "plane"),
    **dict.fromkeys((200, 210), "units"),
    400: "cutter compensation",
    **dict.fromkeys((430, 490), "tool length"),
    **dict.fromkeys((540, 550, 560, 570, 580, 590, 591, 592, 593), "coordinate system"),
    **dict.fromkeys((610, 611, 640), "path control"),
    **dict.fromkeys((900, 910), "distance"),
    **dict.fromkeys((901, 911), "arc centre"),
    **dict.fromkeys((930, 940), "feed mode"),
    970: "spindle mode",
    **dict.fromkeys((980, 990), "retract mode"),
}
KNOWN_M = frozenset((0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 30, 48, 60, 62, 63, 64, 65, 67, 68))
_INTERPRETER = "read the file by LinuxCNC's interpreter (--interpreter)"
_COMPENSATION = f"there is no cutter compensation; {_INTERPRETER}, or let the CAM program offset the path"
_CYCLE = f"drilling cycles move in z; {_INTERPRETER}, or let the CAM program write single moves"
_REFUSED_G = {
    **dict.fromkeys((410, 411, 420, 421), _COMPENSATION),
    950: "the feed is in units per minute (G94) or inverse time (G93); there is none per revolution",
    960: "the speed of a spindle cannot follow the path; use G97",
    **dict.fromkeys((730, 740, 760, *range(810, 900, 10)), _CYCLE),
}
_NOT_UNDERSTOOD = (
    "subroutines and loops (O words) are not understood",
    "variables and expressions are not understood",
)
_REFUSED_M = dict.fromkeys((98.0, 99.0), f"subroutines are not understood; {_INTERPRETER}")
_REFUSED_LETTER = {
    **dict.fromkeys("UVW", "the machine has two axes, x and y; remove the word"),
}
_LETTERS = frozenset("NXYZABCIJKRFPQSTHDLE")
_NUMBER_MAX = 1e12


def known(letter: str, value: float) -> bool:
    """Whether a word is one of those in docs/paths.md, whatever it is beside."""
    return _g(value) in _GROUP if letter == "G" else value in KNOWN_M if letter == "M" else letter in _LETTERS


def _g(value: float) -> int:
    """Ten times the number of a G code; -1: there is none of this number."""
    return round(10.0 * value) if value < 1000.0 and abs(10.0 * value - round(10.0 * value)) < 1e-6 else -1


@dataclass
class Block:
    """One line: its G codes (ten times the number) by group, its M codes, and the number and text of each other word by
    letter."""

    line: int
    codes: dict[str, int] = field(default_factory=dict)
    m: list[int] = field(default_factory=list)
    values: dict[str, float] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)


class Refusals:
    """What a file is refused for: the first of each kind, and how many there are of it."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._closed = 0  # the last line whose words are not all understood
        self._found: dict[tuple[str | None, str], tuple[FileError, int]] = {}

    def close(self, line: int) -> None:
        """Leave out what else this line is refused for: it follows from what has been refused."""
        self._closed = line

    def add(self, problem: str, line: int | None = None, word: str | None = None) -> None:
        if line is not None and line == self._closed:
            return
        word_kind = word if word is None or _CODE.match(word) else _NUMBER.sub("", word)
        kind = None if problem.startswith(_NOT_UNDERSTOOD) else word_kind
        key = kind, _NUMBER.sub("", problem)
        first, count = self._found.get(key, (None, 0))
        self._found[key] = first or FileError(self.name, problem, line, word), count + 1

    def __bool__(self) -> bool:
        return bool(self._found)

    def __iter__(self) -> Iterator[tuple[FileError, int]]:
        """The first of each kind and the number of that kind, by line."""
        return iter(sorted(self._found.values(), key=lambda found: found[0].line or 0))

    def error(self) -> FileError:
        """The first refusal; how many other kinds there are is said, too."""
        (first, _), *others = self
        if not others:
            return first
        also = f"{first.problem} (`kontur check` lists this and what else the file is refused for: {len(others)} more)"
        return FileError(self.name, also, first.line, first.word)


class Words:
    """Makes blocks of the lines of a program, without its comments. `ended`: its second % has come."""

    def __init__(self, refusals: Refusals) -> None:
        self._refusals = refusals
        self._percents = 0

    @property
    def ended(self) -> bool:
        return self._percents == 2

    def block(self, raw: str, line: int) -> Block | None:
        """That of the line `raw`; None: there is no word in it."""
        code = _COMMENT.sub("", raw).replace(" ", "").replace("\t", "")
        if "(" in code or ")" in code:
            self._refusals.add("a comment in parentheses must end on its line and hold no other", line, raw.strip())
        elif code == "%":
            self._percents += 1
        elif code and not _PROGRAM_NUMBER.match(code):
            return _block(code.removeprefix("/"), line, self._refusals)
        return None


def blocks(text: str, refusals: Refusals) -> Iterator[Block]:
    """The blocks of a program up to its second %."""
    words = Words(refusals)
    for line, raw in enumerate(text_lines(text), start=1):
        block = words.block(raw, line)
        if block is not None:
            yield block
        if words.ended:
            return


def _block(code: str, line: int, refusals: Refusals) -> Block:
    block, refused = Block(line), False

    def refuse(what: str, word: str) -> None:
        nonlocal refused
        refused = True
        refusals.add(what, line, word)

    at = 0
    while at < len(code):
        match = _WORD.match(code, at)
        if match is None or match[1] in "Oo":
            refuse(_unreadable(code[at : at + 2]), code[at : at + 12])
            break
        at = match.end()
        exponent = None if match[1] in "Mm" else _EXPONENT.match(code, at)  # M67 E0
        if exponent is not None:
            what = "a number with an exponent; write it out, like X0.0015 in place of X1.5e-3"
            refuse(what, match[0] + exponent[0])
            at = exponent.end()
            continue
        problem = _taken(block, match[1].upper(), float(match[2]), match[0])
        if problem is not None:
            refuse(problem, match[0])
    if refused:
        refusals.close(line)
    return block


def _unreadable(start: str) -> str:
    if start[0] in "Oo":
        return f"{_NOT_UNDERSTOOD[0]}; {_INTERPRETER}"
    if "#" in start or "[" in start:
        return f"{_NOT_UNDERSTOOD[1]}; {_INTERPRETER}, or write numbers"
    return "not a word; words are a letter and a decimal number, like X12.5"


def _taken(block: Block, letter: str, value: float, text: str) -> str | None:
    """Put one word into its block; why not, where it is refused."""
    if letter == "G":
        code = _g(value)
        group = _GROUP.get(code)
        if group is None:
            return _REFUSED_G.get(
                code, "this G code is not understood (docs/paths.md lists those that are); replace it"
            )
        if group in block.codes:
            return f"a second {group} word on the line; put it on a line of its own"
        block.codes[group] = code
    elif letter == "M":
        if value not in KNOWN_M:
            return _REFUSED_M.get(
                value, "this M code is not understood (docs/paths.md lists those that are); remove it"
            )
        block.m.append(int(value))
    elif letter not in _LETTERS:
        return _REFUSED_LETTER.get(letter, "this word is not understood; remove it")
    elif letter in block.values:
        return f"a second {letter} word on the line; put it on a line of its own"
    elif not abs(value) < _NUMBER_MAX:
        return "the number is too large"
    else:
        block.values[letter] = value
        block.texts[letter] = text
    return None
