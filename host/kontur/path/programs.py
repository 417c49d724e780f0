# SPDX-License-Identifier: Apache-2.0
"""Reads a program from a file, G-code or a table of points by its suffix. The command line and scripts use it."""

from __future__ import annotations

from pathlib import Path

from kontur.errors import FileError
from kontur.files import read_text
from kontur.path import csv, gcode
from kontur.path.geometry import Program

GCODE_SUFFIXES = (".ngc", ".nc", ".gcode", ".tap")


def load(file: str | Path, feed_mps: float | None = None) -> Program:
    """The program in `file`: G-code, or a table of points (.csv), which may need a feed.

    Raises FileError: cannot be read, another suffix, or a mistake in it.
    """
    path = Path(file)
    suffix = path.suffix.lower()
    if suffix != ".csv" and suffix not in GCODE_SUFFIXES:
        raise FileError(path, f"neither G-code ({', '.join(GCODE_SUFFIXES)}) nor a table of points (.csv)")
    text = read_text(path)
    if suffix == ".csv":
        return csv.parse(text, str(path), feed_mps)
    if feed_mps is not None:
        raise FileError(path, "the feed of G-code stands in the file (F); leave out --feed")
    return gcode.parse(text, str(path))
