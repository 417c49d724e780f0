# SPDX-License-Identifier: Apache-2.0
"""Feed hold at 200 random moments of the demo part and of a circle of 4 mm at 100 mm/s, measured by the true position.

Each stop has a run of its own, from power-on to the end of the path.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from direct_drive import HALT, KNOT, MACHINE, Drive, path_time
from numpy.typing import NDArray

from kontur.drive.state_machine import RUN_PATH
from kontur.path import programs, shapes
from kontur.path.geometry import Program
from kontur.planning import planner
from kontur.planning.bounds import limits
from kontur.runs import scoring

PART = Path(__file__).resolve().parents[2] / "examples/part.ngc"
COUNT_UM = MACHINE.x.encoder_m * 1e6
STOP = 100 * KNOT  # path_stop_time
STANDING = 50 * KNOT
MOMENTS = 200
FINAL = 200 * KNOT  # so much at least is left, where what is left is judged by itself


@dataclass(frozen=True)
class Run:
    """Rows in order of time: the control period, the distance from the path in um, whether path time ran."""

    period: NDArray[np.int64]
    contour_um: NDArray[np.float64]
    moving: NDArray[np.bool_]

    def mean_um(self, begin: int = 0) -> float:
        """Over the motion from a period on, a row a millisecond."""
        return float(self.contour_um[self.moving & (self.period >= begin) & (self.period % KNOT == 0)].mean())

    def max_um(self, begin: int = 0, end: int = 1 << 31) -> float:
        """Over periods begin..end."""
        return float(self.contour_um[(self.period >= begin) & (self.period < end)].max())


class Case:
    def __init__(self, program: Program) -> None:
        self.trajectory = planner.plan(program, limits(MACHINE))
        self.periods = (len(self.trajectory.knots_nm) - 1) * KNOT

    @cached_property
    def undisturbed(self) -> Run:
        return self._run([(0, 1.0)], self.periods, (0, self.periods))

    def moments(self) -> list[int]:
        return [int(m) for m in np.random.default_rng(1).integers(0, self.periods, MOMENTS)]

    def stopped(self, moment: int) -> Run:
        """Feed hold in control period `moment`, and on again when the axes have stood for a while. Every millisecond
        is looked at, and of the stop every control period."""
        again = moment + STOP + STANDING
        return self._run([(0, 1.0), (moment, 0.0), (again, 1.0)], self.periods + STOP + STANDING, (moment, again))

    def _run(self, wanted: list[tuple[int, float]], periods: int, closely: tuple[int, int]) -> Run:
        drive = Drive(self.trajectory)
        done = 0
        for period, rate in wanted[1:]:
            drive.run(period - done)
            drive.command(RUN_PATH if rate else HALT)
            done = period
        drive.run(periods + 2 * STOP - done)
        path_s = path_time(wanted, periods + STOP, STOP).at(np.arange(periods + STOP + 1)) * 1e-4
        rows = np.union1d(np.arange(0, periods + STOP, KNOT), np.arange(*closely))
        knot_s = np.arange(len(self.trajectory.path_s_m)) * 1e-3
        expected_m = np.interp(path_s[rows], knot_s, self.trajectory.path_s_m)
        error = scoring.contour_error(self.trajectory.program, drive.finish()[rows], expected_m)
        return Run(rows, np.abs(error.normal_m) * 1e6, (np.diff(path_s)[rows] > 0.0) & (path_s[rows] < knot_s[-1]))


def test_stop_at_200_moments_of_the_part_stays_on_it_and_the_part_is_finished_as_well() -> None:
    """The mean error of the whole motion is that of the run without a stop, or less, to a tenth of an encoder count.
    It may be less by more than that: friction steps by the clock, and now finds the axes elsewhere on the path."""
    case = Case(programs.load(PART))
    before = case.undisturbed
    for moment in case.moments():
        run = case.stopped(moment)
        assert run.max_um(moment, moment + STOP + STANDING) <= before.max_um() + COUNT_UM, moment
        assert run.mean_um() - before.mean_um() <= 0.1 * COUNT_UM, moment


def test_stop_at_200_moments_of_a_circle_stays_on_it_and_what_is_left_is_as_good_as_without() -> None:
    """The whole motion has the mean error of the run without a stop to an encoder count. It is so short that a way
    down and up again is a sixth of it, with errors of its own, as the run has them at its start and end: from a stop
    time after the rate is 1 again, over the same way, the means agree to a tenth of a count."""
    case = Case(shapes.circle(0.004, 0.100, duration_s=1.0))
    before = case.undisturbed
    judged = 0
    for moment in case.moments():
        run = case.stopped(moment)
        assert run.max_um(moment, moment + STOP + STANDING) <= before.max_um() + COUNT_UM, moment
        assert abs(run.mean_um() - before.mean_um()) <= COUNT_UM, moment
        same_way = moment + 2 * STOP  # a stop and the way back take STOP longer
        if same_way + FINAL < case.periods:
            judged += 1
            after = run.mean_um(same_way + STOP + STANDING)
            assert abs(after - before.mean_um(same_way)) <= 0.1 * COUNT_UM, moment
    assert judged > MOMENTS / 2
