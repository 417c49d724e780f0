# SPDX-License-Identifier: Apache-2.0
"""The least time of any motion within a tolerance of a polygon, by linear programs: no curve is chosen before.

A reference for the planner, of another kind than it and than time_optimum: the unknowns are the control points of a
cubic B-spline in time, evenly spaced by an unknown step h, and h. Velocity, acceleration and jerk are bounded by V h,
A h^2 and J h^3; these are convex in h, so that their tangents at the last h lie below them, and the motion of each
program is within the true bounds and faster than the one before. The feed is a polygon of FEED_SIDES sides around its
circle.

Each point, and each one half way between two, belongs to one line of the polygon, or to two where it passes from one to
the other, and is within the tolerance of it: in a band along the line, whose ends are half octagons around its ends.
So a motion that is a little beyond the tolerance around a corner is allowed.

`python tests/host/tube_optimum.py` computes the times that kontur.experiments.bench_plan holds, in 12 s of processor
time. With steps of 4 ms in place of 3 they are 0.3 % longer for the square and 1.3 % for the raster.
"""

import math

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_matrix, vstack

from kontur.experiments.bench_plan import FEED_MPS, LIMITS, raster
from kontur.path import shapes
from kontur.path.smoothing import TOLERANCE_M
from kontur.planning.planner import plan

FEED_SIDES = 24
_REST = 3  # equal control points at either end
_ROUNDS = 12


def duration_s(points_m, owner, feed, limits, tolerance_m, step_s):
    """Least duration along the polygon `points_m` (m + 1, 2), where point i of the motion belongs to the line
    `owner` (n,), which never falls. `step_s`: a step of time that is long enough."""
    n = len(owner)
    size = 2 * n + 1  # x and y of the control points in mm, and the step in units of step_s
    rows, right = [], []

    def bound(weights, first, upper, of_h=0.0):
        """`weights` (axis, offset, weight) at each of `first` (k,) <= upper (k,) + of_h (k,) h."""
        k = len(first)
        data, row, column = [], [], []
        for axis, offset, weight in weights:
            data.append(np.broadcast_to(weight, k))
            row.append(np.arange(k))
            column.append(2 * (first + offset) + axis)
        data.append(-np.broadcast_to(of_h, k))
        row.append(np.arange(k))
        column.append(np.full(k, 2 * n))
        rows.append(coo_matrix((np.concatenate(data), (np.concatenate(row), np.concatenate(column))), (k, size)))
        right.append(np.broadcast_to(upper, k))

    start, end = points_m[:-1] * 1e3, points_m[1:] * 1e3
    length = np.hypot(*(end - start).T)
    along = (end - start) / length[:, None]
    tolerance = tolerance_m * 1e3
    inner = np.arange(1, n - 1)
    halves = np.arange(1, n - 2)
    crossing = np.flatnonzero(np.diff(owner)) + 1
    point = ((-1, 1 / 6), (0, 4 / 6), (1, 1 / 6))
    between = ((-1, 1 / 48), (0, 23 / 48), (1, 23 / 48), (2, 1 / 48))
    for at, of, kernel in (
        (inner, owner[inner], point),
        (crossing, owner[crossing - 1], point),
        (halves, owner[halves], between),
    ):
        for angle in np.arange(8) * math.pi / 4.0:
            cos, sin = math.cos(angle), math.sin(angle)
            normal = cos * along[of] + sin * np.stack([-along[of][:, 1], along[of][:, 0]], axis=1)
            corner = end[of] if cos > 1e-9 else start[of]
            weights = [(axis, offset, w * normal[:, axis]) for offset, w in kernel for axis in (0, 1)]
            bound(weights, at, np.sum(normal * corner, axis=1) + tolerance)
    for angle in np.arange(FEED_SIDES) * 2.0 * math.pi / FEED_SIDES:
        cos, sin = math.cos(angle), math.sin(angle)  # the polygon has the circle inside
        bound([(0, 1, cos), (0, 0, -cos), (1, 1, sin), (1, 0, -sin)], np.arange(n - 1), 0.0, feed * 1e3 * step_s)
    for axis in (0, 1):
        for sign in (1.0, -1.0):
            bound([(axis, 1, sign), (axis, 0, -sign)], np.arange(n - 1), 0.0, limits.velocity_mps[axis] * 1e3 * step_s)
    fixed, fixed_right = list(rows), list(right)

    ends = np.zeros((size, 2))
    ends[:, 0], ends[:, 1] = -np.inf, np.inf
    for i in range(_REST):
        ends[2 * i : 2 * i + 2] = start[0][:, None]
        ends[2 * (n - 1 - i) : 2 * (n - i)] = end[-1][:, None]
    ends[-1] = 0.0, 2.0
    cost = np.zeros(size)
    cost[-1] = 1.0
    h = 1.0
    for _ in range(_ROUNDS):
        rows, right = [], []
        for axis in (0, 1):
            a = limits.acceleration_mps2[axis] * 1e3 * step_s**2
            j = limits.jerk_mps3[axis] * 1e3 * step_s**3
            for sign in (1.0, -1.0):
                second = [(axis, k, sign * w / a) for k, w in ((-1, 1.0), (0, -2.0), (1, 1.0))]
                bound(second, inner, -(h**2), 2.0 * h)
                third = [(axis, k, sign * w / j) for k, w in ((-1, -1.0), (0, 3.0), (1, -3.0), (2, 1.0))]
                bound(third, halves, -2.0 * h**3, 3.0 * h**2)
        found = linprog(
            cost,
            A_ub=vstack([*fixed, *rows]).tocsr(),
            b_ub=np.concatenate([*fixed_right, *right]),
            bounds=ends,
            method="highs",
        )
        assert found.status == 0, found.message
        new = float(found.x[-1])
        if h - new < 2e-4 * h:
            h = new
            break
        h = new
    return (n - 3) * h * step_s  # it moves from the second point to the last but one


def of_program(program, limits, tolerance_m, step_s):
    """duration_s() of a program of lines, whose points belong to its lines as those of the planner's motion do."""
    points_m = np.array([program.start_m, *(move.segment.end_m for move in program.moves)])
    path_s_m = plan(program, limits).path_s_m
    owner = owners(points_m, path_s_m, step_s)
    return duration_s(points_m, owner, program.moves[0].feed_mps, limits, tolerance_m, 1.05 * step_s)


def owners(points_m, path_s_m, step_s):
    """Which line of the polygon a motion that is at `path_s_m` (n,) each millisecond is on, each `step_s`."""
    edge = np.append(0.0, np.cumsum(np.hypot(*np.diff(points_m, axis=0).T)))
    at = path_s_m[:: round(step_s * 1e3)]
    return np.clip(np.searchsorted(edge, at, side="right") - 1, 0, len(points_m) - 2)


if __name__ == "__main__":
    for name, program in (("square", shapes.square(0.04, 0.0, FEED_MPS)), ("raster", raster(5))):
        print(name, round(of_program(program, LIMITS, TOLERANCE_M, 3e-3), 3))
