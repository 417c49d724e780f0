# SPDX-License-Identifier: Apache-2.0
"""A line in many pieces is one line for the planner, as far as its points are exact."""

import itertools
import math

import numpy as np
import pytest

from kontur import machine
from kontur.path.geometry import Arc, Line, Move, Program
from kontur.planning.bounds import limits
from kontur.planning.planner import Trajectory, plan

MACHINE = machine.load()


def planned(*moves: Move) -> Trajectory:
    x, y = moves[0].segment.point(np.zeros(1))[0]
    return plan(Program("p", moves, (float(x), float(y))), limits(MACHINE))


def pieces(count: int, angle: float, digits: int) -> list[Move]:
    """A line of 40 mm in `count` pieces, whose points are rounded to so many digits of a mm."""
    along = np.linspace(0.0, 40.0, count + 1)
    points = [
        (1e-3 * round(s * math.cos(angle), digits), 1e-3 * round(s * math.sin(angle), digits)) for s in along.tolist()
    ]
    return [Move(Line(a, b), 0.2) for a, b in itertools.pairwise(points)]


@pytest.mark.parametrize("count", [2, 40, 400, 4000])
@pytest.mark.parametrize(("angle", "digits"), [(0.0, 4), (0.25 * math.pi, 4), (0.3, 12)])
def test_line_in_pieces_takes_the_time_of_one_line(count: int, angle: float, digits: int) -> None:
    (whole,) = pieces(1, angle, digits)
    one, many = planned(whole), planned(*pieces(count, angle, digits))
    assert many.duration_s == pytest.approx(one.duration_s, rel=0.01)


def test_arc_in_pieces_takes_the_time_of_one_arc() -> None:
    arcs = [Move(Arc((0.0, 0.0), 0.02, 2.0 * math.pi / 400 * i, 2.0 * math.pi / 400), 0.2) for i in range(400)]
    one = planned(Move(Arc((0.0, 0.0), 0.02, 0.0, 2.0 * math.pi), 0.2))
    assert planned(*arcs).duration_s == pytest.approx(one.duration_s, rel=0.01)


def test_piece_with_a_lower_feed_keeps_it() -> None:
    moves = pieces(4, 0.0, 4)
    slow = Move(moves[2].segment, 0.05)
    trajectory = planned(*moves[:2], slow, moves[3])
    speed = np.diff(trajectory.path_s_m) / 1e-3
    inside = (trajectory.path_s_m[1:] > 0.0201) & (trajectory.path_s_m[1:] < 0.0299)
    assert np.max(speed[inside]) <= 0.05 * (1.0 + 1e-6)
    assert np.max(speed) > 0.15


def test_line_that_meets_an_arc_still_is_a_jump_of_the_curvature() -> None:
    line, arc = Move(Line((0.0, 0.0), (0.02, 0.0)), 0.2), Move(Arc((0.02, 0.004), 0.004, -0.5 * math.pi, math.pi), 0.2)
    trajectory = planned(line, arc)
    speed = np.diff(trajectory.path_s_m) / 1e-3
    at = int(np.searchsorted(trajectory.path_s_m, 0.02))
    assert speed[at] == pytest.approx(math.sqrt(MACHINE.centripetal_step_mps2 * 0.004), rel=0.02)
