# SPDX-License-Identifier: Apache-2.0
"""`kontur bench plan`: what the planner makes of paths of short lines, against the least time, and how fast it is."""

from __future__ import annotations

import itertools
import math
import re
import resource
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from kontur.path import programs, shapes
from kontur.path.geometry import Dwell, FloatArray, Line, Move, Program
from kontur.path.polyline import Polyline
from kontur.path.smoothing import TOLERANCE_M
from kontur.planning.bounds import Limits
from kontur.planning.planner import Planning, plan

FEED_MPS = 0.1
LIMITS = Limits()
_ROW_M, _STEP_M = 0.08, 1e-4
_TURN = 2.0 * math.pi
_BEND_MIN, _BEND_MAX = 0.005, 0.2  # of arcs, in 1/mm

LEAST_S = {"circle r 20": 1.319, "circle r 4": 0.3198, "rosette": 1.912, "spiral": 2.425, "trochoid": 1.368}
"""Least times at FEED_MPS within LIMITS, by tests/host/time_optimum.py, which a test compares."""
LEAST_WITHIN_S = {"square of 40 mm": 1.831, "square of 10 mm": 0.635, "raster of 5 rows": 1.380, "text": 1.189}
"""The same, of any motion within TOLERANCE_M of the paths WITHIN, by tests/host/tube_optimum.py."""
TEXT_STOPS_S = 1.414
"""The same of the text, with stops at its corners."""

CurveFormula = Callable[[FloatArray, int], FloatArray]
"""A curve by its parameter (n,), or its derivative of some order: (n, 2) in m."""


def circle_curve(radius_m: float) -> CurveFormula:
    """The circle by its angle."""
    return lambda u, order: radius_m * np.stack([np.cos(u + order * np.pi / 2), np.sin(u + order * np.pi / 2)], axis=1)


def rosette_curve(u: FloatArray, order: int) -> FloatArray:
    """Radius 20 mm (1 + 0.3 cos 5u)."""
    parts = ((0.02, 1j), (0.003, 6j), (0.003, -4j))
    return _plane(sum((size * turns**order * np.exp(turns * u) for size, turns in parts), np.zeros(len(u))))


def spiral_curve(u: FloatArray, order: int) -> FloatArray:
    """From a radius of 5 mm, by 5 mm a turn."""
    growth = 0.005 / _TURN
    lag = order * growth * 1j ** max(order - 1, 0)
    return _plane(np.exp(1j * u) * (1j**order * (0.005 + growth * u) + lag))


def trochoid_curve(u: FloatArray, order: int) -> FloatArray:
    """Radius 1 mm, by 0.3 mm a turn."""
    forward = 3e-4 / _TURN * (u if order == 0 else np.full(len(u), float(order == 1)))
    return _plane(1e-3 * 1j**order * np.exp(1j * u) + forward)


def _plane(z: Any) -> FloatArray:
    return np.stack([z.real, z.imag], axis=1)


def lines(points_m: FloatArray, feed_mps: float = FEED_MPS, digits: int = 9) -> Program:
    """A program of lines through points (n, 2), rounded to so many digits of a metre."""
    points = [(float(x), float(y)) for x, y in np.round(points_m, digits)]
    pairs = [(a, b) for a, b in itertools.pairwise(points) if a != b]
    return Program("lines", tuple(Move(Line(a, b), feed_mps, line=i + 1) for i, (a, b) in enumerate(pairs)), points[0])


def of_curve(curve: CurveFormula, end_u: float, count: int, feed_mps: float = FEED_MPS) -> Program:
    """A curve from 0 to `end_u` in so many lines, whose points are rounded to 0.1 um."""
    return lines(curve(np.linspace(0.0, end_u, count + 1), 0), feed_mps, digits=7)


def raster(rows: int) -> Program:
    """Rows of 20 mm along x, to and fro, 0.5 mm apart."""
    corner = np.arange(2 * rows)
    return lines(np.stack([0.02 * ((corner + 1) // 2 % 2), 5e-4 * (corner // 2)], axis=1))


def text() -> Program:
    """Four letters, round ones of 36 and 24 lines and pointed ones, and moves from one to the next."""
    points = [(0.0, 0.0)]
    for x, radius, count in ((0.002, 1.5e-3, 36), (0.004, 0.0, 4), (0.01, 0.8e-3, 24), (0.011, 0.0, 3)):
        angle = np.linspace(0.0, 0.9 * _TURN, count + 1)
        zigzag = np.arange(count + 1)
        letter = (radius * np.sin(angle), radius * np.cos(angle)) if radius else (1e-3 * zigzag, 4e-3 * (zigzag % 2))
        points += list(zip(x + letter[0], letter[1], strict=True))
    return lines(np.array(points), digits=6)


WITHIN = {
    "square of 40 mm": shapes.square(0.04, 0.0, FEED_MPS),
    "square of 10 mm": shapes.square(0.01, 0.0, FEED_MPS),
    "raster of 5 rows": raster(5),
    "text": text(),
}
"""Paths with true corners."""


@dataclass(frozen=True)
class Case:
    """A path, and the least time of the smooth curve that it stands for, by the reference of the tests
    (tests/host/time_optimum.py), of any motion within the tolerance, or with exact stops at its corners."""

    name: str
    program: Program
    least_s: float


def stops_s(program: Program) -> float:
    """Least time of lines with a stop at the end of each, at FEED_MPS and below the acceleration."""
    starts, ends = (np.array([getattr(move.segment, name) for move in program.moves]) for name in ("start_m", "end_m"))
    step_m = np.abs(ends - starts)
    length_m = np.hypot(step_m[:, 0], step_m[:, 1])
    jerk = LIMITS.jerk_mps3[0] * length_m / np.max(step_m, axis=1)
    top = np.minimum((0.5 * length_m * np.sqrt(jerk)) ** (2.0 / 3.0), FEED_MPS)
    return float(np.sum(length_m / top + 2.0 * np.sqrt(top / jerk)))


def stopping(program: Program) -> Program:
    """`program` with a stop at each of its true corners."""
    polyline = Polyline(program.moves)
    items: list[Move | Dwell] = list(program.moves)
    for joint in np.flatnonzero(polyline.corners(np.full(len(polyline.turn), TOLERANCE_M)))[::-1]:
        items.insert(int(joint) + 1, Dwell(0.0))
    return replace(program, items=tuple(items))


def cases() -> Iterator[Case]:
    """The paths, with the limits of Table 1 at 100 mm/s."""
    of = {
        "circle r 20": (circle_curve(0.020), _TURN, (90, 360, 1000, 4000, 20_000), LEAST_S["circle r 20"]),
        "circle r 4": (circle_curve(0.004), _TURN, (360,), LEAST_S["circle r 4"]),
        "rosette": (rosette_curve, _TURN, (244, 545, 2433), LEAST_S["rosette"]),
        "spiral": (spiral_curve, 3.0 * _TURN, (800,), LEAST_S["spiral"]),
        "trochoid": (trochoid_curve, 10.0 * _TURN, (2000,), LEAST_S["trochoid"]),
    }
    for name, (curve, end_u, counts, least_s) in of.items():
        for count in counts:
            yield Case(f"{name}, {count} lines", of_curve(curve, end_u, count), least_s)
    yield Case("circle r 20, one arc", shapes.circle(0.020, FEED_MPS), LEAST_S["circle r 20"])
    yield Case("circle r 4, one arc", shapes.circle(0.004, FEED_MPS), LEAST_S["circle r 4"])
    line = lines(np.array([[0.0, 0.0], [0.04, 0.0]]))
    yield Case("line of 40 mm, 4000 pieces", lines(np.linspace([0.0, 0.0], [0.04, 0.0], 4001)), stops_s(line))
    for name, program in WITHIN.items():
        yield Case(f"{name}, stops", stopping(program), TEXT_STOPS_S if name == "text" else stops_s(program))
        yield Case(name, program, LEAST_WITHIN_S[name])


def waves(count: int) -> str:
    """G-code of rows of waves in `count` lines of 0.1 mm, without a true corner but at the ends of the rows."""
    parts = [f"G21 G90 G1 F{FEED_MPS * 6e4:g}\n"]
    for first in range(0, count + 1, 10_000):
        x = np.arange(first, min(first + 10_000, count + 1)) * _STEP_M
        along = np.abs((x + _ROW_M) % (2.0 * _ROW_M) - _ROW_M)
        across = 5e-4 * np.floor(x / _ROW_M) + 1e-3 * np.sin(300.0 * along)
        parts += ["".join(f"X{a:.3f}Y{b:.3f}\n" for a, b in 1e3 * np.stack([along, across], axis=1))]
    return "".join(parts)


def spiral_lines(count: int) -> str:
    """G-code of a spiral in `count` lines of 0.1 mm, from a radius of 5 mm and by 0.5 mm a turn, without any stop."""
    parts = [f"G21 G90 G0 X5 Y0\nG1 F{FEED_MPS * 6e4:g}\n"]
    for first in range(1, count + 1, 10_000):
        length = np.arange(first, min(first + 10_000, count + 1)) * _STEP_M
        radius = np.sqrt(25e-6 + length * 5e-4 / math.pi)
        angle = _TURN * (radius - 5e-3) / 5e-4
        points = 1e3 * radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        parts += ["".join(f"X{a:.4f}Y{b:.4f}\n" for a, b in points)]
    return "".join(parts)


def wave_arcs(count: int) -> str:
    """G-code of the same rows as waves(), with two arcs after each line. An arc has the curvature of the wave there."""
    text = waves(count).splitlines()
    number = re.compile("[XY]([-0-9.]+)")
    points = np.array([[float(value) for value in number.findall(line)] for line in text[1:]])
    chord = np.diff(points, axis=0)
    heading = np.unwrap(np.arctan2(chord[:, 1], chord[:, 0]))
    bend = np.clip(np.gradient(heading) / np.hypot(*chord.T), -_BEND_MAX, _BEND_MAX)
    left, radius = bend > 0.0, 1.0 / np.maximum(np.abs(bend), _BEND_MIN)
    half = 0.5 * np.hypot(*chord.T)
    height = np.where(left, 1.0, -1.0) * np.sqrt(radius**2 - half**2) / (2.0 * half)
    centre = 0.5 * chord + height[:, None] * np.stack([-chord[:, 1], chord[:, 0]], axis=1)
    out = text[:2]
    for row, line in enumerate(text[2:]):
        if row % 3 == 0:
            out.append(f"G1{line}")
        else:
            out.append(f"G{3 if left[row] else 2}{line}I{centre[row, 0]:.3f}J{centre[row, 1]:.3f}")
    return "\n".join(out) + "\n"


def laser_raster(count: int) -> str:
    """G-code of rows to and fro in `count` lines of 0.1 mm, as a laser burns an image: with an S in each line."""
    columns = round(_ROW_M / _STEP_M)
    out = [f"G21 G90 G1 F{FEED_MPS * 6e4:g}"]
    for item in range(count):
        row, column = divmod(item, columns + 1)
        x = column if row % 2 == 0 else columns - column
        power = (7 * item) % 1000
        out.append(f"X{x / 10:.1f}S{power}" if column else f"X{x / 10:.1f}Y{row / 10 + 0.1:.1f}S0")
    return "\n".join(out) + "\n"


KINDS: dict[str, Callable[[int], str]] = {
    "lines": waves,
    "arcs": wave_arcs,
    "raster": laser_raster,
    "spiral": spiral_lines,
}
"""Long files by their kind. Only the spiral has no stop on its way."""


def bench(count: int, progress: Callable[[float], None], kind: str = "lines") -> dict[str, Any]:
    """The ratios of all cases, and the time and memory to read and plan `count` lines of one of KINDS: these first,
    since memory is the most that this process has had. `first_knots_s`: from when the file is opened until all of it
    has been read and checked, and its first knots are planned."""
    found = _long(KINDS[kind](count), progress)
    return {"tolerance_um": TOLERANCE_M * 1e6, "kind": kind, "paths": [_ratio(case) for case in cases()]} | found


def _ratio(case: Case) -> dict[str, Any]:
    trajectory = plan(case.program, LIMITS, tolerance_m=TOLERANCE_M)
    return {
        "path": case.name,
        "lines": len(case.program.moves),
        "duration_s": trajectory.duration_s,
        "least_s": case.least_s,
        "ratio": trajectory.duration_s / case.least_s,
        "deviation_um": trajectory.deviation_m * 1e6,
    }


def _long(text: str, progress: Callable[[float], None]) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="kontur-") as folder:
        file = Path(folder, "lines.ngc")
        file.write_text(text)
        del text
        started, cpu = time.perf_counter(), time.process_time()
        program = programs.load(file)
        read = time.perf_counter()
    planning = Planning(program, LIMITS, progress, tolerance_m=TOLERANCE_M)
    steps = planning.steps()
    while not planning.rows.count:
        next(steps)
    first = time.perf_counter()
    for _ in steps:
        pass
    trajectory = planning.trajectory()
    planned, cpu = time.perf_counter(), time.process_time() - cpu
    return {
        "lines": len(program.moves),
        "read_s": read - started,
        "plan_s": planned - read,
        "total_s": planned - started,
        "first_knots_s": first - started,
        "cpu_s": cpu,
        "us_per_line": (planned - started) / len(program.moves) * 1e6,
        "motion_s": trajectory.duration_s,
        "peak_MiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
    }
