# SPDX-License-Identifier: Apache-2.0
"""Reads a program from a file, G-code or a table of points by its suffix. The command line and scripts use it."""

from __future__ import annotations

from pathlib import Path

from kontur.errors import FileError
from kontur.files import read_text
from kontur.path import csv, gcode
from kontur.path import interpreter as linuxcnc
from kontur.path.gcode_words import Refusals
from kontur.path.geometry import Program

GCODE_SUFFIXES = (".ngc", ".nc", ".gcode", ".gc", ".tap", ".cnc")


def load(file: str | Path, feed_mps: float | None = None, z: str = "pen", interpreter: bool = False) -> Program:
    """The program in `file`: G-code, or a table of points (.csv), which may need a feed. `z` says what becomes of other
    axes than x and y in G-code (kontur.path.gcode.Z_MODES). `interpreter`: read G-code by LinuxCNC's rs274.

    Raises FileError: cannot be read, another suffix, or a mistake in it.
    """
    program, refusals = check(file, feed_mps, z, interpreter)
    if refusals:
        raise refusals.error()
    return program


def check(
    file: str | Path, feed_mps: float | None = None, z: str = "pen", interpreter: bool = False
) -> tuple[Program, Refusals]:
    """The same, and all that the file is refused for; the program lacks what is refused.

    Raises FileError: cannot be read, another suffix, a mistake in a table of points, or no rs274 here.
    """
    path = Path(file)
    suffix = path.suffix.lower()
    if suffix != ".csv" and suffix not in GCODE_SUFFIXES:
        raise FileError(path, f"neither G-code ({', '.join(GCODE_SUFFIXES)}) nor a table of points (.csv)")
    text = read_text(path)
    if suffix == ".csv":
        return csv.parse(text, str(path), feed_mps), Refusals(str(path))
    if feed_mps is not None:
        raise FileError(path, "the feed of G-code stands in the file (F); leave out --feed")
    source = linuxcnc.blocks if interpreter else None
    return gcode.read(text, str(path), z=z, source=source)
