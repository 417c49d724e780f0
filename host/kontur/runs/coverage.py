# SPDX-License-Identifier: Apache-2.0
"""What part of the path a run has covered: without it no figure says of how much it is the mean or the greatest."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from kontur.path.geometry import KNOT_S
from kontur.planning.planner import Trajectory
from kontur.runs.clock import RunClock
from kontur.runs.scoring import contour_error

Floats = NDArray[np.float64]


def covered(driven: Trajectory, clock: RunClock, columns: Mapping[str, Floats], from_s: float) -> dict[str, float]:
    """The entry `path` of a log: the length of the program, and from where to where on it the axes have moved after
    `from_s`; `known_mm`, how much of that the figures know, is less where telemetry was lost and there is no truth.

    A place is that of the point of the path nearest to the axes, not where they were to be. Empty: no rows.
    """
    time_s = columns["time_s"]
    rows = np.flatnonzero(time_s >= (from_s if time_s.size and from_s <= time_s[-1] else 0.0))
    if not rows.size:
        return {}
    has_truth = "true_position_x_mm" in columns
    names = [f"{'true_' if has_truth else ''}position_{axis}_mm" for axis in "xy"]
    knot = clock.path_time(time_s[rows]) / KNOT_S
    path_s_m = np.interp(knot, np.arange(len(driven.path_s_m)), driven.path_s_m)
    ends = rows[[0, -1]]
    position_m = np.stack([columns[name][ends] for name in names], axis=1) * 1e-3
    first_m, last_m = contour_error(driven.program, position_m, path_s_m[[0, -1]]).foot_s_m
    gaps = np.diff(columns["tick"][rows]) > 1.0
    lost_m = 0.0 if has_truth else float(np.sum(np.diff(path_s_m)[gaps]))
    return {
        "length_mm": sum(move.segment.length_m for move in driven.program.moves) * 1e3,
        "from_mm": float(first_m) * 1e3,
        "to_mm": float(last_m) * 1e3,
        "known_mm": max(float(last_m - first_m) - lost_m, 0.0) * 1e3,
    }
