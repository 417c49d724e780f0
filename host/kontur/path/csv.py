# SPDX-License-Identifier: Apache-2.0
"""Paths from a table of points: comma-separated, with a header, coordinates in mm. `#` starts a comment.

`t,x,y` (t in s): the file fixes when to be where. The path is the cubic spline in time through the rows, at rest at
both ends; velocity and acceleration limits are checked when it is planned, the jerk is the file's.

`x,y` with a feed: points of a smooth curve. The path is the cubic spline through them, not the polygon: its parameter
is the distance from point to point, its ends are free ("not a knot"). Two points give a line, three a parabola.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import CubicSpline

from kontur.errors import FileError, shown
from kontur.files import text_lines
from kontur.path.geometry import DURATION_MAX_S, KNOT_S, Curve, FloatArray, Move, Program, Schedule

_LARGEST = 1e9
_SLOWEST_MPS, _FASTEST_MPS = 1e-9, 1e6
_SHORTEST_S = 1e-6
_NEAREST_M = 1e-9
_HEADERS = {("t", "x", "y"), ("x", "y")}


def parse(text: str, name: str, feed_mps: float | None = None) -> Program:
    """The program of a table `text`; `name` is the file's, for messages.

    Raises FileError: anything that cannot be read as above, with line and word.
    """
    columns, values, lines = _table(text, name)
    if "t" in columns:
        if feed_mps is not None:
            raise FileError(name, "the column t fixes the speed already; leave out the feed or the column")
        return _timed(values[:, 0], values[:, 1:] * 1e-3, np.array(lines), name)
    if feed_mps is None:
        raise FileError(name, f"a path of x,y needs a feed, or a column t: kontur run {name} --feed 20 (mm/s)")
    if not _SLOWEST_MPS <= feed_mps <= _FASTEST_MPS:
        raise FileError(name, f"the feed is {feed_mps:g} m/s; it must be {_SLOWEST_MPS:g}..{_FASTEST_MPS:g} m/s")
    return _points(values * 1e-3, lines, name, feed_mps)


def _table(text: str, name: str) -> tuple[tuple[str, ...], FloatArray, list[int]]:
    """Names of the columns, values (n, columns), and the line of each row; at least two rows."""
    columns: tuple[str, ...] = ()
    rows: list[list[float]] = []
    lines: list[int] = []
    for number, line in enumerate(text_lines(text), start=1):
        words = [word.strip() for word in line.partition("#")[0].split(",")]
        if words == [""]:
            continue
        if not columns:
            columns = tuple(word.lower() for word in words)
            if columns not in _HEADERS:
                raise FileError(name, "the first line must be t,x,y (s, mm) or x,y (mm)", number, line.strip())
            continue
        if len(words) != len(columns):
            raise FileError(name, f"expected {len(columns)} numbers, {','.join(columns)}", number, line.strip())
        rows.append([_number(word, name, number) for word in words])
        lines.append(number)
    if not columns:
        raise FileError(name, "the file is empty; it needs a header t,x,y or x,y and rows of numbers")
    if len(rows) < 2:
        raise FileError(name, "a path needs at least two rows of numbers after the header")
    return columns, np.array(rows), lines


def _number(word: str, name: str, line: int) -> float:
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not abs(value) < _LARGEST or "_" in word:
        problem = f"not a finite number below {_LARGEST:g}; correct or remove the row"
        raise FileError(name, problem, line, word or "(nothing)")
    return value


def _timed(time_s: FloatArray, position_m: FloatArray, lines: FloatArray, name: str) -> Program:
    stuck = np.flatnonzero(np.diff(time_s) < _SHORTEST_S)
    if stuck.size:
        row = stuck[0] + 1
        problem = "the time must rise from row to row, by a microsecond at least"
        raise FileError(name, problem, int(lines[row]), f"{time_s[row]:g}")
    time_s = time_s - time_s[0]
    duration = float(time_s[-1])
    if duration > DURATION_MAX_S:
        problem = f"the path takes {shown(duration, 0)} s; at most {DURATION_MAX_S:.0f} s can be run; split it"
        raise FileError(name, problem, int(lines[-1]))
    curve = Curve(CubicSpline(time_s, position_m, bc_type="clamped"), time_s)
    if curve.length_m == 0.0:
        raise FileError(name, "all points are the same; there is no motion", int(lines[0]))
    tick = np.minimum(np.arange(math.ceil(duration / KNOT_S - 1e-9) + 1) * KNOT_S, duration)
    row = np.searchsorted(time_s, tick, side="right") - 1
    schedule = Schedule(np.maximum.accumulate(curve.arc_length(tick)), lines[row])
    return _program(name, Move(curve, curve.length_m / duration, schedule=schedule), position_m[0])


def _points(position_m: FloatArray, lines: list[int], name: str, feed_mps: float) -> Program:
    step = np.hypot(*np.diff(position_m, axis=0).T)
    stuck = np.flatnonzero(step < _NEAREST_M)
    if stuck.size:
        row = stuck[0] + 1
        raise FileError(name, "the point is the same as the one before it; remove the row", lines[row])
    chord = np.append(0.0, np.cumsum(step))
    return _program(name, Move(Curve(CubicSpline(chord, position_m), chord), feed_mps), position_m[0])


def _program(name: str, move: Move, start_m: FloatArray) -> Program:
    return Program(name, (move,), (float(start_m[0]), float(start_m[1])))
