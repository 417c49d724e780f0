# SPDX-License-Identifier: Apache-2.0
"""What is checked of a program before it is planned, and of its motion afterwards, independently of the planner."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from kontur.errors import KonturError, PathError, shown
from kontur.path.arc_columns import ArcColumns
from kontur.path.geometry import DURATION_MAX_S, KNOT_S, Arc, Curve, FloatArray, Move, Program
from kontur.path.moves import arcs, feeds_mps, is_scheduled, others
from kontur.path.polyline import Polyline
from kontur.planning import knots
from kontur.planning.bounds import Limits, Piece, sampled

RING = 16  # knots after which the spline's response to a step in acceleration has decayed
Travel = tuple[tuple[float, float], tuple[float, float]]
"""((x least, x greatest), (y least, y greatest)) in m."""
_ARCS = 1 << 15  # looked at at once, to bound memory


class PlannerError(KonturError):
    """The planner's own check failed: a defect of kontur, not of the input."""


def check_duration(program: Program, total_s: float) -> None:
    if total_s > DURATION_MAX_S:
        raise PathError(
            f"{program.name}: it takes {shown(total_s / 3600.0, 1)} h; at most {DURATION_MAX_S / 3600.0:.0f} h can be "
            "planned: raise the feed or the limits, or split it"
        )


def check_connected(program: Program, polyline: Polyline) -> None:
    moves = program.moves
    feed = feeds_mps(moves)
    wrong = np.flatnonzero(~((np.diff(polyline.edge_m) > 0.0) & (feed > 0.0)))
    if wrong.size:
        raise PathError(f"{program.where(moves[wrong[0]].line)}: a move needs a length and a feed above zero")
    at_start = float(np.max(np.abs(polyline.ends_m[0] - program.start_m)))
    for i, gap_m in [(0, at_start)] * (not at_start <= 1e-9) + polyline.gaps_m:
        raise PathError(
            f"{program.where(moves[i].line)}: the move starts {shown(gap_m * 1e3, 6)} mm from "
            "where the one before it ends"
        )


def _extent(move: Move, where: str) -> FloatArray:
    """Points (n, 2) among which are the outermost of the move, for a Curve to about a micrometre."""
    segment = move.segment
    s = np.array([0.0, segment.length_m])
    if move.schedule is not None:
        s = move.schedule.distance_m
    elif isinstance(segment, Arc):
        return np.asarray(arcs([move]).extremes_m()[0])
    elif isinstance(segment, Curve):
        s, _ = sampled(segment, where)
    return segment.point(s)


def _arcs(program: Program) -> Iterator[ArcColumns]:
    """The arcs of a program without a time law of its own, some at a time to bound memory."""
    found = arcs(() if is_scheduled(program.moves) else program.moves)
    for first in range(0, len(found), _ARCS):
        yield found.chosen(slice(first, first + _ARCS))


def extent_m(program: Program) -> FloatArray:
    """The least and the greatest (2, 2) x and y that the path reaches."""
    moves = program.moves
    points = [Polyline(moves).ends_m]
    for found in _arcs(program):
        extremes = found.extremes_m().reshape(-1, 2)
        points.append(np.stack([np.min(extremes, axis=0), np.max(extremes, axis=0)]))
    rest = range(len(moves)) if is_scheduled(moves) else others(moves)
    points += [_extent(moves[i], program.where(moves[i].line)) for i in rest]
    every = np.concatenate(points)
    return np.stack([np.min(every, axis=0), np.max(every, axis=0)])


def check_travel(program: Program, polyline: Polyline, travel_m: Travel) -> None:
    moves = program.moves
    least_m, greatest_m = np.transpose(travel_m)

    def within(points: FloatArray) -> npt.NDArray[np.bool_]:
        inside = (points >= least_m - 1e-9) & (points <= greatest_m + 1e-9)
        return np.asarray(inside[..., 0] & inside[..., 1])

    ends = within(polyline.ends_m)
    inside = polyline.straight & ends[1:] & ends[:-1]
    for found in _arcs(program):
        center, radius = found.values[:2].T, found.values[2, :, None]
        circle = within(center - radius) & within(center + radius)
        rest = found.chosen(~circle)
        inside[found.at] = circle
        inside[rest.at] = np.all(within(rest.extremes_m()), axis=1)
    for i in np.flatnonzero(~inside).tolist():
        move = moves[i]
        points = _extent(move, program.where(move.line))
        for axis, (least, greatest) in enumerate(travel_m):
            beyond = np.maximum(least - points[:, axis], points[:, axis] - greatest)
            row = int(np.argmax(beyond))
            if beyond[row] > 1e-9:
                line = move.line if move.schedule is None else int(move.schedule.line[row])
                raise PathError(
                    f"{program.where(line)}: the path reaches {'xy'[axis]} = {shown(points[row, axis] * 1e3)} mm, "
                    f"outside the travel of {least * 1e3:.3f} .. {greatest * 1e3:.3f} mm; move or shrink the part"
                )


def check_smoothed(program: Program, position_m: FloatArray, travel_m: Travel) -> None:
    """The path itself is inside, but the tolerance may lead outside."""
    for axis, (least, greatest) in enumerate(travel_m):
        beyond = max(least - np.min(position_m[:, axis]), np.max(position_m[:, axis]) - greatest)
        if beyond > 1e-9:
            raise PathError(
                f"{program.name}: within its tolerance the path leaves the travel in {'xy'[axis]} by "
                f"{shown(beyond * 1e6)} µm; move the part, or use --tolerance 0"
            )


def _motion(control: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Speed and acceleration (n-2, 2) at the inner knots, jerk (n-3, 2) between two of them."""
    return (
        (control[2:] - control[:-2]) / (2.0 * KNOT_S),
        np.diff(control, 2, axis=0) / KNOT_S**2,
        np.diff(control, 3, axis=0) / KNOT_S**3,
    )


def jumps_m(pieces: list[Piece]) -> FloatArray:
    """The distances (n,) at which curvature or direction jumps."""
    edge = np.cumsum([piece.length for piece in pieces])[:-1]
    return np.asarray(edge[[piece.jump for piece in pieces[1:]]])


def away_from_jumps(s: FloatArray, jumps_m: FloatArray) -> npt.NDArray[np.bool_]:
    """Which of the rows with distances `s` (n,) are not near `jumps_m`: there the jerk is limited."""
    jumps = np.searchsorted(s, jumps_m[(jumps_m >= s[0]) & (jumps_m <= s[-1])])
    smooth = np.ones(len(s), dtype=bool)
    for offset in range(-RING, RING + 1):
        smooth[np.clip(jumps + offset, 0, len(s) - 1)] = False
    return smooth


def check_motion(limits: Limits, control: FloatArray, smooth: npt.NDArray[np.bool_], first_ms: int) -> None:
    """Check the motion `control` (n, 2) against the limits, the jerk where it is `smooth` (n,). Its first row is that
    of `first_ms`."""
    for first in range(0, max(1, len(control) - 3), knots.ROWS):
        rows = slice(first, first + knots.ROWS + 3)
        _check_part(limits, control[rows], smooth[rows], first_ms + first)


def _check_part(limits: Limits, control: FloatArray, smooth: npt.NDArray[np.bool_], first: int) -> None:
    speed, acceleration, jerk = _motion(control)
    jerk = jerk * smooth[1:-2, None]
    checked = [
        ("velocity", speed, limits.velocity_mps),
        ("acceleration", acceleration, limits.acceleration_mps2),
        ("jerk", jerk, limits.jerk_mps3),
    ]
    if limits.force is not None:
        mass, viscous, coulomb = (
            np.array([getattr(one, name) for one in limits.force]) for name in ("mass_kg", "viscous_Nspm", "coulomb_N")
        )
        force = mass * acceleration + viscous * speed + coulomb * np.sign(speed)
        checked.append(("force", force, (limits.force[0].limit_N, limits.force[1].limit_N)))
    for name, values, limit in checked:
        excess = np.abs(values) / np.array(limit)
        if not np.all(excess <= 1.0 + 1e-6):
            row, axis = np.unravel_index(np.argmax(excess), excess.shape)
            raise PlannerError(
                f"planner defect: {name} of axis {'xy'[axis]} is {excess[row, axis]:.4f} of its limit at "
                f"{first + row + 1} ms; nothing is moved; please report this with the file and the limits"
            )


def check_schedule(program: Program, limits: Limits, control: FloatArray) -> None:
    speed, acceleration, _ = _motion(control)
    schedule = program.moves[0].schedule
    assert schedule is not None
    for name, unit, values, limit in (
        ("velocity", "m/s", speed, limits.velocity_mps),
        ("acceleration", "m/s2", acceleration, limits.acceleration_mps2),
    ):
        excess = np.abs(values) / np.array(limit)
        if not np.all(excess <= 1.0):
            row, axis = np.unravel_index(np.argmax(excess), excess.shape)
            time = int(np.clip(row + 1 - RING, 0, len(schedule.line) - 1))
            raise PathError(
                f"{program.where(int(schedule.line[time]))}: {time * KNOT_S:.3f} s after its start the {name} in "
                f"{'xy'[axis]} is {abs(values[row, axis]):.4g} {unit}, the limit is {limit[axis]:.4g}; "
                "slow it down, and let it start and end at rest"
            )
