# SPDX-License-Identifier: Apache-2.0
"""A trajectory that is driven while it is planned: a thread goes on with the planning."""

from __future__ import annotations

import math
import threading
import time

import numpy as np
import numpy.typing as npt

from kontur.path.geometry import KNOT_S, FloatArray, Program
from kontur.planning.planner import Planning, Trajectory

_FASTER = 2.0  # planned path time a second, from which on the planning stays ahead
_FIRST_S = 2.0  # of path time that is planned before the start


class Ahead:
    """What Trajectory is, as far as it is planned. `share`: of the planning that is done, 0 to 1. `error`: why it ended
    before the end of the program."""

    def __init__(self, planning: Planning) -> None:
        self.program: Program = planning.program
        self.error: Exception | None = None
        self.share = 0.0
        self._planning = planning
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
        return planned_s >= max(_FIRST_S, _FASTER * (time.monotonic() - self._began_s))

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

    def done(self, knots: int) -> float:
        """The share of the path that so many knots are."""
        return float(self.path_s_m[knots - 1]) / self._length_m if knots else 0.0


Planned = Trajectory | Ahead
