# SPDX-License-Identifier: Apache-2.0
"""A trajectory that is driven while it is planned: a thread goes on with the planning."""

from __future__ import annotations

import math
import threading
import time

import numpy as np
import numpy.typing as npt

from kontur.path.geometry import KNOT_S, FloatArray, Program
from kontur.path.moves import dwells_in, feeds_mps, lengths_m
from kontur.planning.planner import Planning, Trajectory

_FASTER = 2.0  # planned path time a second, from which on the planning stays ahead
FIRST_S = 2.0
"""Path time that is planned before the start."""


class Ahead:
    """What Trajectory is, as far as it is planned. `share`: of the planning that is done, 0 to 1. `error`: why it ended
    before the end of the program. The motion begins behind so many `passed` knots."""

    def __init__(self, planning: Planning, passed: int = 0) -> None:
        self.program: Program = planning.program
        self.error: Exception | None = None
        self.share = 0.0
        self._planning, self._passed = planning, passed
        self._length_m = planning.length_m
        self._whole: Trajectory | None = None
        self._ended = threading.Event()
        self._began_s = time.monotonic()
        threading.Thread(target=self._plan, name="planning", daemon=True).start()

    def _plan(self) -> None:
        try:
            for _ in self._planning.steps():
                self.share = float(self.path_s_m[-1]) / self._length_m if len(self.path_s_m) else 0.0
            self._whole = self._planning.trajectory()
        except Exception as error:
            self.error = error
        finally:
            self._ended.set()

    def ended(self, timeout_s: float | None = None) -> bool:
        """Whether the planning ends within `timeout_s`; None: it does."""
        return self._ended.wait(timeout_s)

    def trajectory(self) -> Trajectory:
        """All of it, when it is planned. Raises what the planning raised."""
        self._ended.wait()
        if self._whole is None:
            assert self.error is not None
            raise self.error
        return self._whole

    @property
    def may_start(self) -> bool:
        """Whether the motion can start without catching up with its planning."""
        planned_s = len(self.knots_nm) * KNOT_S
        return planned_s >= max(self._passed * KNOT_S + FIRST_S, _FASTER * (time.monotonic() - self._began_s))

    @property
    def complete(self) -> bool:
        return self._whole is not None

    @property
    def knots_nm(self) -> npt.NDArray[np.int32]:
        return self._planning.rows.planned()[0]

    @property
    def position_m(self) -> FloatArray:
        return self._planning.rows.planned()[1]

    @property
    def path_s_m(self) -> FloatArray:
        return self._planning.rows.planned()[2]

    @property
    def duration_s(self) -> float:
        """Infinite as long as it is not known."""
        return math.inf if self._whole is None else self._whole.duration_s

    def about_s(self) -> float:
        """About what all of it takes: the rest as much longer than at its feeds as what is planned so far."""
        if self._whole is not None:
            return self._whole.duration_s
        planned_s, planned_m = (len(self.knots_nm) - 1) * KNOT_S, float(self.path_s_m[-1])
        place_m, time_s = _at_feeds(self.program, self._planning.top_mps)
        return planned_s * float(time_s[-1] / np.interp(planned_m, place_m, time_s))

    def done(self, knots: int) -> float:
        """The share of the path that so many knots are."""
        return float(self.path_s_m[knots - 1]) / self._length_m if knots else 0.0


def _at_feeds(program: Program, top_mps: float) -> tuple[FloatArray, FloatArray]:
    """Distances (n + 1,) of the ends of all moves, and when they were reached at the feeds, and at most `top_mps`."""
    moves = program.moves
    length_m, waits_s = lengths_m(moves), np.zeros(len(moves) + 1)
    for number, (row, dwell) in enumerate(dwells_in(program.items)):
        waits_s[row - number] += dwell.duration_s
    time_s = np.append(0.0, np.cumsum(length_m / np.minimum(feeds_mps(moves), top_mps))) + np.cumsum(waits_s)
    return np.append(0.0, np.cumsum(length_m)), time_s


Planned = Trajectory | Ahead
