# SPDX-License-Identifier: Apache-2.0
"""Path time as the host works it out, against the firmware's."""

import numpy as np
import pytest
from direct_drive import FEED_OVERRIDE, HALT, KNOT, MACHINE, Drive

from kontur.drive.state_machine import RUN_PATH
from kontur.path import shapes
from kontur.planning import path_time, planner
from kontur.planning.bounds import limits

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
        knots = path_time.curve(wanted, now, 100 * KNOT)[1][-1] / KNOT
        assert drive.stream(8) == pytest.approx(knots, abs=1.0)  # as many have been passed a millisecond ago at most
