# SPDX-License-Identifier: Apache-2.0
"""The circular test: circles in both senses on a drive, and what they say of its axes (kontur.runs.circularity).

Each sense is a run of its own. It begins at 45 degrees, where no axis reverses, with an arc in which the axes speed up,
goes one whole turn that is measured, and slows down in another arc. The second sense goes back the same way.

The drive's own figures are of its contour error, the distance to the circle, in all control periods: of each
millisecond it sends the least and the greatest one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from kontur.drive.stream import Operator
from kontur.drive.target import Target
from kontur.errors import PathError
from kontur.path.geometry import KNOT_S, Arc, Move, Point, Program
from kontur.planning.bounds import Limits
from kontur.planning.planner import Trajectory, plan
from kontur.runs.circle_record import Circle, trace
from kontur.runs.circularity import SENSES, Floats, lap
from kontur.runs.log import RANGE
from kontur.runs.recorder import Watcher
from kontur.runs.runner import RunOptions, RunResult, run

_START_RAD = 0.25 * math.pi
_STEADY = 0.999  # least of the greatest speed within the measured turn


@dataclass(frozen=True)
class Setup:
    """What is driven: circles of `radius_m` about `centre_m`, `lead` turns before and after the measured one. What the
    runs themselves are scored for begins at `score_from_s`."""

    radius_m: float
    centre_m: Point = (0.0, 0.0)
    lead: float = 0.5
    controller: str = "ccu"
    parameters: Mapping[str, float] = field(default_factory=dict)
    approach: Limits | None = None
    score_from_s: float = 0.0


def circle_test(
    setup: Setup,
    feeds_mps: Sequence[float],
    bounds: Limits,
    target: Target,
    progress: Callable[[str, float], None] = lambda what, share: None,
    stop_requested: Callable[[], bool] = lambda: False,
    watch: Watcher | None = None,
) -> Iterator[tuple[Circle, tuple[RunResult, RunResult]]]:
    """Run both senses at each feed, planned within `bounds`; the circle of a feed, and its runs.

    All feeds are planned before the first one moves. Raises PathError: a feed is not held over the measured turn; what
    plan() and run() raise; LogError: positions are missing; KeyboardInterrupt when the stop was requested.
    """
    planned = [
        tuple(_planned(setup, feed, sense, bounds, target.machine.soft_limits_m) for sense in SENSES)
        for feed in feeds_mps
    ]
    for feed, both in zip(feeds_mps, planned, strict=True):
        runs = []
        for sense, trajectory in zip(SENSES, both, strict=True):
            what = f"{feed * 1e3:g} mm/s, {sense}"
            progress(what, 0.0)
            operator = Operator(_named(progress, what), stop_requested)
            options = RunOptions(
                parameters=setup.parameters, approach=setup.approach, score_from_s=setup.score_from_s, watch=watch,
                error_range=True,
            )  # fmt: skip
            runs.append(run(trajectory, setup.controller, target, options, operator))
            if not runs[-1].completed:
                raise KeyboardInterrupt
        yield _measured(setup, float(np.max(_turn(setup, both[0]))), runs[0], runs[1]), (runs[0], runs[1])


def _planned(setup: Setup, feed_mps: float, sense: str, bounds: Limits, travel_m: tuple[Point, Point]) -> Trajectory:
    sweep = 2.0 * math.pi * (1.0 + 2.0 * setup.lead)
    start, turn = (_START_RAD, sweep) if sense == "ccw" else (_START_RAD + sweep, -sweep)
    arc = Arc(setup.centre_m, setup.radius_m, start, turn)
    x, y = arc.point(np.zeros(1))[0]
    trajectory = plan(
        Program(f"circle {sense}", (Move(arc, feed_mps),), (float(x), float(y))), bounds, travel_m=travel_m
    )
    speed = _turn(setup, trajectory)
    if np.min(speed) < _STEADY * np.max(speed):
        raise PathError(
            f"{feed_mps * 1e3:g} mm/s is not reached within {setup.lead:g} turns: the measured turn would begin at "
            f"{np.min(speed) * 1e3:.3g} mm/s. Give --lead {2.0 * setup.lead:g}, a lower feed, or a greater radius"
        )
    return trajectory


def _turn(setup: Setup, trajectory: Trajectory) -> Floats:
    """Planned speed in m/s at each knot of the measured turn."""
    around_m = 2.0 * math.pi * setup.radius_m
    inside = (trajectory.path_s_m >= setup.lead * around_m) & (trajectory.path_s_m <= (setup.lead + 1.0) * around_m)
    return np.diff(trajectory.path_s_m[inside]) / KNOT_S


def _measured(setup: Setup, feed_mps: float, ccw: RunResult, cw: RunResult) -> Circle:
    centre_mm = (setup.centre_m[0] * 1e3, setup.centre_m[1] * 1e3)
    traces = {}
    reported = (_reported_mm(ccw, setup, 1.0), _reported_mm(cw, setup, -1.0))
    for by, positions in (("true", (_true_mm(ccw), _true_mm(cw))), ("drive", reported)):
        laps = [lap(position, centre_mm, setup.lead) for position in positions if position is not None]
        if laps:
            traces[by] = trace(laps[0], laps[1], setup.radius_m * 1e3)
    return Circle(round(feed_mps * 1e3, 3), traces)


def _true_mm(run: RunResult) -> Floats | None:
    """At the control rate; None on a real drive."""
    return run.truth.pos_m * 1e3 if run.truth is not None else None


def _reported_mm(run: RunResult, setup: Setup, sense: float) -> Floats:
    """Two points (2 n, 2) a millisecond, where the drive was furthest in and out.

    The contour error is positive on the left, which is inside the circle where `sense` is 1, counter-clockwise.
    """
    columns = run.log.columns
    away = np.column_stack([columns[f"position_{axis}_mm"] for axis in "xy"]) - np.array(setup.centre_m) * 1e3
    middle = 0.5 * (away[1:] + away[:-1])
    error_mm = np.column_stack([columns[name][1:] for name in RANGE]) * 1e-3
    known = np.isfinite(error_mm[:, 0])
    direction = middle[known] / np.hypot(middle[known, 0], middle[known, 1])[:, None]
    radius_mm = setup.radius_m * 1e3 - sense * error_mm[known]
    points = radius_mm[:, :, None] * direction[:, None, :] + np.array(setup.centre_m) * 1e3
    return np.asarray(points.reshape(-1, 2))


def _named(progress: Callable[[str, float], None], what: str) -> Callable[[float], None]:
    return lambda share: progress(what, share)
