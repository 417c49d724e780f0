# SPDX-License-Identifier: Apache-2.0
"""The least time of any motion within a tolerance of a polygon, by linear programs: no curve is chosen before.

A reference for the planner, of another kind than it and than time_optimum: the unknowns are the control points of a
cubic B-spline in time, evenly spaced by an unknown step h, and h. Velocity, acceleration and jerk are bounded by V h,
A h^2 and J h^3; these are convex in h, so that their tangents at the last h lie below them, and the motion of each
program is within the true bounds and faster than the one before. The feed is a polygon of FEED_SIDES sides around its
circle.

Each point, and each one half way between two, belongs to one line of the polygon, and is within the tolerance of it: in
a band along the line. At a true corner the band ends in half an octagon, and the point at which the motion passes to
the next line belongs to both. At other joints the band goes on, but a point moves by at most REACH_M along its line in
a program, and then belongs to the nearest line. So a motion that is a little beyond the tolerance around a joint is
allowed.

`python tests/host/tube_optimum.py` computes the times that kontur.experiments.bench_plan holds, in a minute of
processor time. With steps of 4 ms in place of 3 they are 0.3 % longer for the square and 1.3 % for the raster.
"""

import itertools
import math

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_matrix, vstack

from kontur.experiments.bench_plan import LIMITS, WITHIN, stops_s
from kontur.path.geometry import Program
from kontur.path.polyline import CORNER_RAD
from kontur.path.smoothing import TOLERANCE_M
from kontur.planning.planner import plan

FEED_SIDES = 24
REACH_M = 5e-5
_REST = 3  # equal control points at either end
_ROUNDS = 12


def duration_s(points_m, at_m, owner, feed, limits, tolerance_m, step_s):
    """Least duration along the polygon `points_m` (m + 1, 2) of a motion whose points `at_m` (n, 2) belong to the lines
    `owner` (n,), which never fall, to begin with. `step_s`: a step of time that is long enough."""
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
    cross = along[:-1, 0] * along[1:, 1] - along[:-1, 1] * along[1:, 0]
    sharp = np.abs(np.arctan2(cross, np.sum(along[:-1] * along[1:], axis=1))) > CORNER_RAD
    begins, ends_there = np.append(True, sharp), np.append(sharp, True)  # the stretch from corner to corner
    stretch = np.append(0, np.cumsum(sharp))
    tolerance = tolerance_m * 1e3
    inner = np.arange(1, n - 1)
    halves = np.arange(1, n - 2)
    point = ((-1, 1 / 6), (0, 4 / 6), (1, 1 / 6))
    between = ((-1, 1 / 48), (0, 23 / 48), (1, 23 / 48), (2, 1 / 48))

    def within(at, of, kernel):
        """The points (k,) are within the tolerance of the lines `of` (k,)."""
        for angle in np.arange(8) * math.pi / 4.0:
            cos, sin = math.cos(angle), math.sin(angle)
            chosen = np.ones(len(at), dtype=bool)
            if abs(cos) > 1e-9:
                chosen = (ends_there if cos > 0.0 else begins)[of]
            line, first = of[chosen], at[chosen]
            normal = cos * along[line] + sin * np.stack([-along[line][:, 1], along[line][:, 0]], axis=1)
            corner = end[line] if cos > 1e-9 else start[line]
            weights = [(axis, offset, w * normal[:, axis]) for offset, w in kernel for axis in (0, 1)]
            bound(weights, first, np.sum(normal * corner, axis=1) + tolerance)

    def near(at, of, was):
        """The points (k,) move little along their lines where these have a smooth end."""
        chosen = ~(begins & ends_there)[of]
        line, first = of[chosen], at[chosen]
        for sign in (1.0, -1.0):
            normal = sign * along[line]
            weights = [(axis, offset, w * normal[:, axis]) for offset, w in point for axis in (0, 1)]
            bound(weights, first, np.sum(normal * was[first], axis=1) + REACH_M * 1e3)

    def nearest(at, of):
        """The line (k,) of the same stretch, near `of` (k,), that is nearest to each of the points (k, 2)."""
        best, least = of.copy(), np.full(len(of), np.inf)
        for ahead in range(-3, 4):
            line = np.clip(of + ahead, 0, len(start) - 1)
            share = np.clip(np.sum((at - start[line]) * along[line], axis=1), 0.0, length[line])
            away = np.hypot(*(at - start[line] - share[:, None] * along[line]).T)
            better = (stretch[line] == stretch[of]) & (away < least)
            best[better], least[better] = line[better], away[better]
        return np.maximum.accumulate(best)

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
    was = at_m * 1e3
    for _ in range(_ROUNDS):
        rows, right = [], []
        within(inner, owner[inner], point)
        crossing = np.flatnonzero(np.diff(stretch[owner])) + 1
        within(crossing, owner[crossing - 1], point)
        within(halves, owner[halves], between)
        near(inner, owner[inner], was)
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
        control = found.x[:-1].reshape(n, 2)
        was = control.copy()
        was[1:-1] = (control[:-2] + 4.0 * control[1:-1] + control[2:]) / 6.0
        owner = nearest(was, owner)
        gain, h = h - new, new
        if gain < 2e-4 * h:
            break
    return (n - 3) * h * step_s  # it moves from the second point to the last but one


def of_program(program, limits, tolerance_m, step_s):
    """duration_s() of a program of lines, whose points belong to its lines as those of the planner's motion do, to
    begin with."""
    points_m = np.array([program.start_m, *(move.segment.end_m for move in program.moves)])
    first = plan(program, limits, tolerance_m=tolerance_m)
    every = slice(None, None, round(step_s * 1e3))
    at_m, owner = first.position_m[every], owners(points_m, first.path_s_m[every])
    return duration_s(points_m, at_m, owner, program.moves[0].feed_mps, limits, tolerance_m, 1.05 * step_s)


def with_stops_s(program, limits, tolerance_m, step_s):
    """Least duration of a program of lines with stops at its true corners, within the tolerance between these."""
    stretches = [[program.moves[0]]]
    for before, after in itertools.pairwise(program.moves):
        (x0, y0), (x1, y1) = (np.subtract(move.segment.end_m, move.segment.start_m) for move in (before, after))
        if abs(math.atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)) > CORNER_RAD:
            stretches.append([])
        stretches[-1].append(after)
    parts = [Program("p", tuple(moves), moves[0].segment.start_m) for moves in stretches]
    return sum(
        stops_s(part) if len(part.moves) == 1 else of_program(part, limits, tolerance_m, step_s) for part in parts
    )


def owners(points_m, path_s_m):
    """The lines (n,) of the polygon at the distances `path_s_m` (n,) along it."""
    edge = np.append(0.0, np.cumsum(np.hypot(*np.diff(points_m, axis=0).T)))
    return np.clip(np.searchsorted(edge, path_s_m, side="right") - 1, 0, len(points_m) - 2)


if __name__ == "__main__":
    for name, program in WITHIN.items():
        print(name, round(of_program(program, LIMITS, TOLERANCE_M, 3e-3), 3), flush=True)
    print("text, stops", round(with_stops_s(WITHIN["text"], LIMITS, TOLERANCE_M, 2e-3), 3))
