# SPDX-License-Identifier: Apache-2.0
"""Path time as the host works it out, against the firmware's."""

import numpy as np
import pytest
from direct_drive import FEED_OVERRIDE, HALT, KNOT, MACHINE, Drive, path_time

from kontur.drive.state_machine import RUN_PATH
from kontur.path import shapes
from kontur.planning import planner
from kontur.planning.bounds import limits
from kontur.planning.path_time import PathTime

CIRCLE = planner.plan(shapes.circle(0.02, 0.05, duration_s=4.0), limits(MACHINE))


def test_path_time_is_that_of_the_drive_wherever_it_is_slowed_held_and_sped_up() -> None:
    draw = np.random.default_rng(3)
    drive = Drive(CIRCLE)
    wanted, now, held, override = [(0, 1.0)], 0, False, 1.0
    for _ in range(12):
        wait = int(draw.integers(1, 2500))
        drive.run(wait)
        now += wait
        if draw.random() < 0.4:
            held = not held
            drive.command(HALT if held else RUN_PATH)
        else:
            override = float(draw.integers(1, 1201)) / 1000
            drive.download(FEED_OVERRIDE, 0, round(override * 1000).to_bytes(2, "little"))
        wanted.append((now, 0.0 if held else override))
        drive.run(KNOT)
        now += KNOT
        knots = path_time(wanted, now, 100 * KNOT).at(np.array([now]))[0] / KNOT
        assert drive.stream(8) == pytest.approx(knots, abs=1.0)  # as many have been passed a millisecond ago at most


def test_path_time_is_the_same_in_one_go_and_piece_by_piece_with_the_past_forgotten() -> None:
    draw = np.random.default_rng(4)
    wanted = [(0, 1.0), (900, 0.37), (1500, 0.0), (4000, 1.2), (4100, 0.61)]
    end, stop = 9000, 1000
    at = np.arange(end + 1.0)
    whole = path_time(wanted, end, stop)
    pieces, found, now = PathTime(1.0, stop), [np.zeros(1)], 0
    while now < end:
        step = int(draw.integers(1, 400))
        for begin, goal, until in zip(
            [p for p, _ in wanted], [r for _, r in wanted], [*[p for p, _ in wanted[1:]], end], strict=True
        ):
            if begin < now + step and until > now:
                pieces.advance(goal, min(until, now + step))
        found.append(pieces.at(at[now + 1 : now + step + 1]))
        now += step
        pieces.forget(now)
    np.testing.assert_array_equal(np.concatenate(found), whole.at(at))
    reached = whole.reaches(3000.0)
    assert reached is not None
    assert whole.at(np.array([reached]))[0] == pytest.approx(3000.0)
    assert whole.reaches(1e6) is None
