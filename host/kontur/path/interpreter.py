# SPDX-License-Identifier: Apache-2.0
"""G-code by LinuxCNC's interpreter: `rs274`, a program of its own, expands parameters, expressions, subroutines, cycles
and cutter compensation. What it prints are calls of LinuxCNC's canonical machining functions; each becomes a block.

rs274 prints positions with four decimals in the unit of the program, so they are rounded to 0.1 um in a program in mm,
and to 2.5 um in one in inches. Each line gets its number as N word, by which rs274 says where a call comes from.
"""

from __future__ import annotations

import cmath
import math
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

from kontur.errors import FileError
from kontur.files import text_lines
from kontur.path.gcode_words import Block, Refusals

PROGRAM = "rs274"
_TIMEOUT_S = 120.0
_LEADING_N = re.compile(r"\s*(/?)\s*(?:[Nn][\s0-9.]*)?(.*)", re.DOTALL)
_CALL = re.compile(r" *[0-9]+ +N(?:\.{5}|([0-9]+)) *([A-Z_0-9]+)\((.*)\)")
_TOOL = "T{0} P{0} D0 Z0\n"
_TOOLS = 99

# Calls that become words, with the word that stands for them.
_SWITCHES = {
    "START_SPINDLE_CLOCKWISE": "M3",
    "START_SPINDLE_COUNTERCLOCKWISE": "M4",
    "STOP_SPINDLE_TURNING": "M5",
    "MIST_ON": "M7",
    "FLOOD_ON": "M8",
    "MIST_OFF": "M9",
    "FLOOD_OFF": "M9",
    "PROGRAM_STOP": "M0",
    "OPTIONAL_PROGRAM_STOP": "M1",
    "CHANGE_TOOL": "M6",
    "PROGRAM_END": "M2",
}
_PLANES = {"CANON_PLANE_XY": 170, "CANON_PLANE_XZ": 180, "CANON_PLANE_YZ": 190}
_OUTPUT = re.compile(r"(SET|CLEAR)_(MOTION|AUX)_OUTPUT_(BIT|VALUE)")  # M62 to M65, M67 and M68
_OFF = {5: {3, 4}, 9: {7, 8}}  # M codes that switch off, and what
# Calls that change nothing for two axes that go exactly on the path.
_NOTHING = (
    *("COMMENT", "MESSAGE", "ON_RESET", "SET_FEED_REFERENCE", "SET_FEED_MODE", "SET_SPINDLE_MODE", "START_CHANGE"),
    *("SET_MOTION_CONTROL_MODE", "SET_NAIVECAM_TOLERANCE", "USE_TOOL_LENGTH_OFFSET", "CHANGE_TOOL_NUMBER"),
    *("ENABLE_FEED_OVERRIDE", "ENABLE_SPEED_OVERRIDE", "SET_TOOL_TABLE_ENTRY", "PALLET_SHUTTLE", "SELECT_TOOL"),
    *("DISABLE_FEED_OVERRIDE", "DISABLE_SPEED_OVERRIDE", "FINISH"),
    *("STOP_SPEED_FEED_SYNCH", "TURN_PROBE_ON", "TURN_PROBE_OFF"),  # of what is refused
    *("ENABLE_FEED_HOLD", "DISABLE_ADAPTIVE_FEED", "LOG", "LOGOPEN", "LOGCLOSE", "LOGAPPEND"),
)

_SPINDLE = "motion tied to the turns of a spindle, which is a rotary axis, and the machine has none"
_REFUSED = {
    "START_SPEED_FEED_SYNC": _SPINDLE,
    "RIGID_TAP": _SPINDLE,
    "STRAIGHT_PROBE": "the machine has no probe; remove what probes",
}


def blocks(text: str, refusals: Refusals) -> Iterator[Block]:
    """The blocks of a program as rs274 understands it, in machine coordinates: each axis is told in each of them, and
    modes only where they change. What rs274 refuses is a refusal.

    Raises FileError: rs274 is not installed, or does not come to an end.
    """
    printed, said, code = _interpreted(text, refusals.name)
    calls = _Calls()
    for line in printed:
        call = _CALL.match(line)
        if call is None:
            said = [*said, line]
            continue
        number = int(call[1] or 0)
        block = calls.block(number, call[2], [word.strip() for word in call[3].split(",")])
        if isinstance(block, Block):
            yield block
        elif block is not None:
            refusals.add(block, number or None, call[2])
    said = [line for line in said if line.strip() and line.strip() != "executing"]
    if code and not said:
        said = [f"it ends with code {code}"]
    if said:
        at, words = _numbered(said[1] if len(said) > 1 else "")
        refusals.add(f"{PROGRAM} refuses it: {said[0].strip()}", at, words)


def _interpreted(text: str, name: str) -> tuple[list[str], list[str], int]:
    """What rs274 prints: the calls; what it says besides; its exit code."""
    program = shutil.which(PROGRAM)
    if program is None:
        what = (
            f"{PROGRAM} is not installed; it is in the Debian package linuxcnc-uspace (apt-get install linuxcnc-uspace)"
        )
        raise FileError(name, f"--interpreter: {what}")
    with tempfile.TemporaryDirectory(prefix="kontur-") as folder:
        files = {key: Path(folder, key) for key in ("program.ngc", "tools.tbl", "parameters.var")}
        files["program.ngc"].write_text(
            "\n".join(map(_with_number, *zip(*enumerate(text_lines(text), 1), strict=True)))
        )
        files["tools.tbl"].write_text("".join(_TOOL.format(tool) for tool in range(1, _TOOLS + 1)))
        files["parameters.var"].touch()
        for beside in Path(name).parent.glob("*.ngc"):
            if not os.path.lexists(Path(folder, beside.name)):
                Path(folder, beside.name).symlink_to(beside.absolute())
        environment = os.environ | {"HOME": folder}  # where rs274 maps a file of tools, which two runs must not share
        command = [program, "-g", "-t", "tools.tbl", "-v", "parameters.var", "program.ngc"]
        try:
            done = subprocess.run(
                command, capture_output=True, cwd=folder, env=environment, timeout=_TIMEOUT_S, check=False
            )
        except subprocess.TimeoutExpired as error:
            raise FileError(
                name, f"{PROGRAM} does not come to an end within {_TIMEOUT_S:g} s; does it loop?"
            ) from error
    printed, said = (output.decode(errors="replace").splitlines() for output in (done.stdout, done.stderr))
    return printed, said, done.returncode


def _with_number(number: int, line: str) -> str:
    """A line with its number as N word, in place of another one."""
    match = _LEADING_N.fullmatch(line)
    assert match is not None
    slash, code = match.groups()
    return line if not code or code[0] in "%(;" else f"{slash}N{number} {code}"


def _numbered(line: str) -> tuple[int | None, str | None]:
    """The number of a line that got one, and its text."""
    match = re.match(r"/?N([0-9]+) (.*)", line.strip())
    return (int(match[1]), match[2]) if match else (None, line.strip() or None)


class _Calls:
    """The state of LinuxCNC's canonical machine as far as it has a meaning here."""

    def __init__(self) -> None:
        self.unit_mm = 1.0
        self.plane = 170
        self.on: set[int] = set()  # M codes that have switched something on
        self.g5x_mm = self.g92_mm = [0.0] * 6
        self.turn = 1.0 + 0.0j

    def block(self, line: int, name: str, words: list[str]) -> Block | str | None:
        """The block of a call, None where it needs none, or why it is refused."""
        block = Block(line)
        if name in ("STRAIGHT_TRAVERSE", "STRAIGHT_FEED"):
            block.codes["motion"] = 0 if name == "STRAIGHT_TRAVERSE" else 10
            self._put(block, "XYZABC", [float(word) for word in words[:6]])
        elif name == "ARC_FEED":
            return self._arc(block, [float(word) for word in words])
        elif name in _SWITCHES:
            block.m.append(int(_SWITCHES[name][1:]))
            if block.m[0] in _OFF and not self.on & _OFF[block.m[0]]:
                return None  # rs274 switches off at the end whatever is on
            self.on = self.on - _OFF.get(block.m[0], set()) | {block.m[0]}
            if name == "CHANGE_TOOL":
                self._say(block, "T", float(words[0]))
        elif match := _OUTPUT.fullmatch(name):
            at_once, analog = match[2] == "AUX", match[3] == "VALUE"
            block.m.append((67 if analog else 62 if match[1] == "SET" else 63) + at_once * (1 if analog else 2))
            for letter, value in zip("EQ" if analog else "P", words, strict=False):
                self._say(block, letter, float(value))
        elif name == "SET_SPINDLE_SPEED":
            self._say(block, "S", float(words[-1]))
        elif name == "SET_FEED_RATE":
            if float(words[0]) <= 0.0:
                return None
            self._say(block, "F", float(words[0]))
        elif name == "USE_LENGTH_UNITS":
            inch = words[0] == "CANON_UNITS_INCHES"
            self.unit_mm, block.codes["units"] = (25.4, 200) if inch else (1.0, 210)
        elif name == "DWELL":
            block.codes["non-modal"] = 40
            self._say(block, "P", float(words[0]))
        else:
            return self._modes(name, words)
        return block

    def _modes(self, name: str, words: list[str]) -> str | None:
        """A call that only changes the state, or that is refused."""
        if name == "SELECT_PLANE":
            self.plane = _PLANES[words[0]]
        elif name == "SET_G5X_OFFSET":
            self.g5x_mm = self._mm([float(word) for word in words[1:7]])
        elif name == "SET_G92_OFFSET":
            self.g92_mm = self._mm([float(word) for word in words[:6]])
        elif name == "SET_XY_ROTATION":
            self.turn = cmath.rect(1.0, math.radians(float(words[0])))
        elif name not in _NOTHING:
            return _REFUSED.get(name, "this canonical function has no meaning for two axes; remove what causes it")
        return None

    def _mm(self, values: list[float]) -> list[float]:
        """Six values of axes; x, y and z in mm."""
        return [value * (self.unit_mm if axis < 3 else 1.0) for axis, value in enumerate(values)]

    def _put(self, block: Block, letters: str, values: list[float]) -> None:
        """Positions of axes, given in the coordinates of the program, in those of the machine."""
        places = [value + shift for value, shift in zip(self._mm(values), self.g92_mm, strict=False)]
        xy = complex(*places[:2]) * self.turn
        for axis, (letter, place) in enumerate(zip(letters, [xy.real, xy.imag, *places[2:]], strict=True)):
            self._say(block, letter, (place + self.g5x_mm[axis]) / (self.unit_mm if axis < 3 else 1.0))

    def _arc(self, block: Block, values: list[float]) -> Block:
        """ARC_FEED(first_end, second_end, first_axis, second_axis, rotation, axis_end_point, a, b, c)"""
        first, second, center_first, center_second, turns, third, a, b, c = values
        block.codes |= {"motion": 30 if turns > 0.0 else 20, "arc centre": 901, "plane": self.plane}
        ends = {170: (first, second, third), 180: (second, third, first), 190: (third, first, second)}
        self._put(block, "XYZABC", [*ends[self.plane], a, b, c])
        self._put(block, "IJ", [center_first, center_second])
        self._say(block, "P", abs(turns))
        return block

    @staticmethod
    def _say(block: Block, letter: str, value: float) -> None:
        block.values[letter] = value
        block.texts[letter] = f"{letter}{value:.6g}"
