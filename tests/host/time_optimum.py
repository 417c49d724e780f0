# SPDX-License-Identifier: Apache-2.0
"""The least time along a smooth curve within velocity, acceleration and jerk of each axis, by linear programs.

A reference for the planner, of another kind: the path is a formula, the grid is one of the curve's parameter u, and the
solver is HiGHS. With b = (du/dt)^2 the acceleration p'' b + p' b'/2 is linear in b, and the jerk's bound,
|p''' b + 3/2 p'' b' + p' b''/2| <= jerk / sqrt(b), has a right side that is convex in b. Its tangent at the last b lies
below it, so that each program's solution is within the true bound, and faster than the one before.

The grid is fine where the motion starts and ends. In the first cells there the differences say little about the jerk:
b is bounded there by a start with the greatest jerk instead.
"""

import itertools

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_matrix, vstack

ROUNDS = 14
_START = 5  # nodes


def duration_s(curve, length_u, feed, limits, cells=500, rests=()):
    """Least duration along `curve(u, order)` (n, 2) for u from 0 to `length_u`, at rest at both ends and at `rests`."""
    ends = [0.0, *rests, length_u]
    each = max(60, cells // (len(ends) - 1))
    return sum(_stretch(curve, a, b, feed, limits, each) for a, b in itertools.pairwise(ends))


def _stretch(curve, begin, end, feed, limits, cells):
    x = np.linspace(0.0, 1.0, cells + 1)
    near = 0.12  # of the cells at each end are graded with the third power, as the distance grows with time
    graded = np.where(x < near, x**3 / (3.0 * near**2), x - 2.0 * near / 3.0)
    half = np.interp(0.5, x, graded)
    u = begin + (end - begin) * np.where(x < 0.5, graded, 2.0 * half - graded[::-1]) / (2.0 * half)
    p1, p2, p3 = (curve(u, order) for order in (1, 2, 3))
    step = np.diff(u)
    n = len(u)
    inner = np.arange(1, n - 1)
    below, above = step[:-1], step[1:]
    both = below + above
    rows = np.arange(n - 2)

    def matrix(before, at, behind):
        data = np.concatenate([before, at, behind])
        where = np.concatenate([rows, rows, rows]), np.concatenate([inner - 1, inner, inner + 1])
        return coo_matrix((data, where), (n - 2, n)).tocsr()

    first = (-above / (below * both), (above - below) / (above * below), below / (above * both))
    second = (2.0 / (below * both), -2.0 / (below * above), 2.0 / (above * both))
    speed = np.hypot(*p1.T)
    with np.errstate(divide="ignore"):
        top = np.minimum((feed / speed) ** 2, np.min((np.array(limits.velocity_mps) / np.abs(p1)) ** 2, axis=1))
    for node, near_u in [(i, u[i] - begin) for i in range(_START)] + [(-1 - i, end - u[-1 - i]) for i in range(_START)]:
        most = float(np.min(np.array(limits.jerk_mps3) / np.maximum(np.abs(p1[node]), 1e-12)))
        top[node] = min(top[node], (0.5 * most * (6.0 * near_u / most) ** (2.0 / 3.0)) ** 2)
    acceleration, jerk = [], []
    for axis in (0, 1):
        a1, a2, a3 = p1[inner, axis], p2[inner, axis], p3[inner, axis]
        acceleration.append(matrix(0.5 * a1 * first[0], a2 + 0.5 * a1 * first[1], 0.5 * a1 * first[2]))
        jerk.append(
            matrix(
                *(
                    1.5 * a2 * one + 0.5 * a1 * two + (a3 if i == 1 else 0.0)
                    for i, (one, two) in enumerate(zip(first, second, strict=True))
                )
            )
        )
    kept = slice(2, n - 4)

    def excess(b):
        worst = float(np.max(b / np.where(top > 0.0, top, 1.0)))
        for axis in (0, 1):
            worst = max(worst, float(np.max(np.abs(acceleration[axis] @ b))) / limits.acceleration_mps2[axis])
            swing = (np.abs(jerk[axis] @ b) * np.sqrt(b[inner]))[kept]
            worst = max(worst, float(np.max(swing / limits.jerk_mps3[axis])) ** (2.0 / 3.0))
        return worst

    def time(b):
        root = np.sqrt(b)
        return float(np.sum(2.0 * step / (root[1:] + root[:-1])))

    edge = np.minimum(u - begin, end - u)
    scale = 0.1 * (end - begin)
    b = 1e-3 * feed**2 * (edge / (edge + scale)) ** (4.0 / 3.0)
    b /= 1.05 * excess(b)
    for _ in range(ROUNDS):
        a_ub, b_ub = [], []
        at = b[inner]
        for axis in (0, 1):
            most = np.full(n - 2, limits.acceleration_mps2[axis])
            a_ub += [acceleration[axis], -acceleration[axis]]
            b_ub += [most, most]
            root = limits.jerk_mps3[axis] / np.sqrt(at)
            slope = matrix(np.zeros(n - 2), 0.5 * root / at, np.zeros(n - 2))
            for sign in (1.0, -1.0):
                a_ub.append((sign * jerk[axis] + slope)[kept])
                b_ub.append((1.5 * root)[kept])
        weight = np.zeros(n)
        weight[inner] = 0.5 * both * 0.5 * at**-1.5
        size = float(np.max(b))
        norm = [np.maximum(np.abs(m).max(axis=1).toarray().ravel() * size, 1e-300) for m in a_ub]
        found = linprog(
            -weight / np.max(weight),
            A_ub=vstack([m.multiply((size / w)[:, None]) for m, w in zip(a_ub, norm, strict=True)]).tocsr(),
            b_ub=np.concatenate([v / w for v, w in zip(b_ub, norm, strict=True)]),
            bounds=np.stack([np.zeros(n), np.where(np.arange(n) % (n - 1) == 0, 0.0, top / size)], axis=1),
            method="highs",
        )
        assert found.status == 0, found.message
        new = np.maximum(found.x * size, 0.0)
        shares = [2.0**-k for k in range(8)]
        tried = [b + share * (new - b) for share in shares]
        times = [time(one) if np.all(one[inner] > 0.0) else np.inf for one in tried]
        best = int(np.argmin(times))
        gain = time(b) - times[best]
        if gain <= 0.0:
            break
        b = tried[best]
        if gain < 1e-5 * times[best]:
            break
    return time(b)
