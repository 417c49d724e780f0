# SPDX-License-Identifier: Apache-2.0
"""What part of the path a run has covered: without it no figure says of how much it is the mean or the greatest."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from kontur.path.geometry import Program
from kontur.runs.scoring import contour_error

Floats = NDArray[np.float64]


class Coverage:
    """From where to where on `program` the axes have moved after `from_s`; from the start where a run ended before.

    A place is that of the point of the path nearest to the axes, not where they were to be.
    """

    def __init__(self, program: Program, from_s: float) -> None:
        self._program, self._from_s = program, from_s
        self._all, self._scored = _Part(), _Part()

    def add(self, columns: Mapping[str, Floats], path_s_m: Floats) -> None:
        """Take in the next rows of the log, for which the axes were to be at `path_s_m` (n,) of the program."""
        self._all.add(columns, path_s_m, columns["time_s"] >= 0.0)
        self._scored.add(columns, path_s_m, columns["time_s"] >= self._from_s)

    def path(self) -> dict[str, float]:
        """The entry `path` of a log: the length of the program, and the part of it; `known_mm`, how much of that the
        figures know, is less where telemetry was lost and there is no truth. Empty: no rows."""
        part = self._scored if self._scored.ends is not None else self._all
        if part.ends is None:
            return {}
        position_m, path_s_m = (np.stack(both) for both in zip(*part.ends, strict=True))
        first_m, last_m = contour_error(self._program, position_m, path_s_m).foot_s_m
        return {
            "length_mm": self._program.length_m * 1e3,
            "from_mm": float(first_m) * 1e3,
            "to_mm": float(last_m) * 1e3,
            "known_mm": max(float(last_m - first_m) - part.lost_m, 0.0) * 1e3,
        }


class _Part:
    """The first and the last row of a part of a run, as position and path position, and how much of it was lost."""

    def __init__(self) -> None:
        self.ends: tuple[tuple[Floats, Floats], tuple[Floats, Floats]] | None = None
        self.lost_m = 0.0
        self._last = (np.empty(0), np.empty(0))  # tick and path position

    def add(self, columns: Mapping[str, Floats], path_s_m: Floats, which: NDArray[np.bool_]) -> None:
        rows = np.flatnonzero(which)
        if not rows.size:
            return
        has_truth = "true_position_x_mm" in columns
        names = [f"{'true_' if has_truth else ''}position_{axis}_mm" for axis in "xy"]
        first, last = (
            (np.array([columns[name][row] for name in names]) * 1e-3, path_s_m[row]) for row in rows[[0, -1]]
        )
        self.ends = (self.ends[0] if self.ends is not None else first, last)
        tick, path = (np.append(a, b) for a, b in zip(self._last, (columns["tick"][rows], path_s_m[rows]), strict=True))
        if not has_truth:
            self.lost_m += float(np.sum(np.diff(path)[np.diff(tick) > 1.0]))
        self._last = tick[-1:], path[-1:]
