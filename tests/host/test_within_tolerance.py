# SPDX-License-Identifier: Apache-2.0
"""Random programs whose tolerance changes on the way: the knots of each stay within the tolerance of its moves.

`python tests/host/test_within_tolerance.py 500` tries so many.
"""

import math
import sys

import numpy as np
import pytest
from scipy.spatial import cKDTree

from kontur.path import gcode
from kontur.path.smoothing import TOLERANCE_M
from kontur.planning.planner import Limits, plan

DENSE_M = 2e-6
APART_M = 5e-8  # points of a motion that are nearer are one
ROUNDED_M = 3e-9  # knots are rounded to 1 nm, and arcs of 0.2 mm are chords here
BETWEEN_M = 1e-7  # between milliseconds the spline is off where curvature jumps, and a chord from the motion


def random_program(seed):
    """Lines, runs of short lines and arcs, tangent to what is before them or not, cuts and rapid moves."""
    random = np.random.default_rng(seed)
    rows, heading, feed = ["G21 G91 G1 F3000"], 0.0, 3000
    for _ in range(random.integers(8, 16)):
        if random.integers(3) == 0:
            tolerance = 10.0 ** random.uniform(-3.0, -1.0)
            rows.append(str(random.choice(["G61", "G64", f"G64 P{tolerance:.4f}", f"G64 P{tolerance:.4f}"])))
        if random.integers(2) == 0:
            heading += random.uniform(-math.pi, math.pi)
        kind = random.integers(4)
        length = 10.0 ** random.uniform(-0.7, 1.0)
        if kind == 0:
            left, angle = random.choice([-1, 1]), random.uniform(0.3, 5.0)
            turned = heading + left * angle
            i, j = -left * length * math.sin(heading), left * length * math.cos(heading)
            x, y = i + left * length * math.sin(turned), j - left * length * math.cos(turned)
            rows.append(f"G{2 if left < 0 else 3} X{x:.4f} Y{y:.4f} I{i:.4f} J{j:.4f} F{feed}")
            heading = turned
        elif kind == 1:
            turn, step = random.uniform(-0.1, 0.1), random.uniform(0.01, 0.3)
            for _ in range(random.integers(5, 30)):
                heading += turn
                rows.append(f"G1 X{step * math.cos(heading):.4f} Y{step * math.sin(heading):.4f} F{feed}")
        else:
            rows.append(f"G{kind - 2} X{length * math.cos(heading):.4f} Y{length * math.sin(heading):.4f}")
            feed = random.choice([1000, 3000, 6000])
    return gcode.parse("\n".join(rows), f"seed {seed}")


def dense(program):
    """Points DENSE_M apart along the program, and the move that each is on."""
    points, moves = [], []
    for number, move in enumerate(program.moves):
        length = move.segment.length_m
        points.append(move.segment.point(np.linspace(0.0, length, 2 + int(length / DENSE_M))))
        moves.append(np.full(len(points[-1]), number))
    return np.concatenate(points), np.concatenate(moves)


def evenly(points):
    """Points DENSE_M apart along the line through some."""
    at = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    s = np.unique(np.concatenate([np.rint(at / APART_M) * APART_M, np.arange(0.0, at[-1], DENSE_M)]))
    return np.stack([np.interp(s, at, points[:, axis]) for axis in (0, 1)], axis=1)


def beyond_m(program, trajectory):
    """How far the spline of the knots is beyond the tolerance at most, or the path beyond it from that."""
    tolerance = np.array([TOLERANCE_M if m.tolerance_m is None else m.tolerance_m for m in program.moves])
    rapid = np.array([move.rapid for move in program.moves])
    cut = np.pad(~rapid, 1)
    tolerance = np.where(
        rapid & ~cut[:-2] & ~cut[2:], np.maximum(tolerance, np.minimum(10.0 * tolerance, 100e-6)), tolerance
    )
    point, move = dense(program)
    knots = 1e-9 * np.pad(trajectory.knots_nm.astype(float), ((1, 2), (0, 0)), mode="edge")
    u = np.arange(4)[:, None, None] / 4.0
    basis = ((1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3)
    count = len(trajectory.knots_nm)
    spline = sum(b * knots[i : i + count] for i, b in enumerate(basis)) / 6.0
    driven = spline.transpose(1, 0, 2).reshape(-1, 2)
    s = np.pad(trajectory.path_s_m, (1, 2), mode="edge")
    edge = np.append(0.0, np.cumsum([one.segment.length_m for one in program.moves]))
    first, last = (np.clip(np.searchsorted(edge, x, "right") - 1, 0, len(tolerance) - 1) for x in (s[:-3], s[3:]))
    most = np.array([np.max(tolerance[a : b + 1]) for a, b in zip(first, last, strict=True)])
    beyond = to_polyline(driven, point) - np.repeat(most, 4)
    behind = to_polyline(point, evenly(driven)) - tolerance[move]
    return max(np.max(beyond[::4]), np.max(beyond) - BETWEEN_M, np.max(behind) - BETWEEN_M)


def to_polyline(point, of):
    """Distances from points (n, 2) to the line through the points `of`, near the closest of these."""
    _, near = cKDTree(of).query(point, k=8)
    best = np.full(len(point), np.inf)
    for column in near.T:
        for begin in (np.maximum(column - 1, 0), np.minimum(column, len(of) - 2)):
            chord, gap = of[begin + 1] - of[begin], point - of[begin]
            share = np.sum(gap * chord, axis=1) / np.maximum(np.sum(chord**2, axis=1), 1e-30)
            gap = gap - np.clip(share, 0.0, 1.0)[:, None] * chord
            best = np.minimum(best, np.hypot(gap[:, 0], gap[:, 1]))
    return best


@pytest.mark.parametrize("seed", range(12))
def test_the_motion_stays_within_the_tolerance_of_each_move(seed):
    program = random_program(seed)
    trajectory = plan(program, Limits(), tolerance_m=TOLERANCE_M)
    assert beyond_m(program, trajectory) < ROUNDED_M


if __name__ == "__main__":
    for number in range(1000, 1000 + int(sys.argv[1])):
        one = random_program(number)
        try:
            out = beyond_m(one, plan(one, Limits(), tolerance_m=TOLERANCE_M))
        except Exception as error:
            print(number, type(error).__name__, error, flush=True)
            continue
        if out > ROUNDED_M:
            print(number, "beyond by nm", 1e9 * out, flush=True)
    print("done", flush=True)
