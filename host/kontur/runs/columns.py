# SPDX-License-Identifier: Apache-2.0
"""The columns of a log: telemetry and reference of each row, and the true errors where the true position is known."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kontur.can import signals
from kontur.can.simulated import Truth
from kontur.can.wire import Telemetry
from kontur.path.geometry import KNOT_S
from kontur.planning.planner import Trajectory
from kontur.runs import scoring
from kontur.runs.clock import RunClock

Floats = NDArray[np.float64]

# From the SI units of the telemetry to the units of the columns
_SCALE = {
    **{("m", "um"): 1e6, ("m", "mm"): 1e3},
    **{(unit, unit): 1.0 for unit in ("N", "1/s", "m/s2", "J")},
}


def columns(telemetry: Telemetry, time_s: Floats, trajectory: Trajectory, clock: RunClock) -> dict[str, Floats]:
    """The columns of the rows between start and end of the path, by their names in kontur.runs.log.

    `time_s` (n,) are the times of the telemetry rows since the start.
    """
    rows = (time_s >= 0.0) & (time_s <= clock.end_s)
    time_s = time_s[rows]
    knot = clock.path_time(time_s) / KNOT_S
    number = np.arange(len(trajectory.position_m))
    path_s_m = np.interp(knot, number, trajectory.path_s_m)
    found: dict[str, Floats] = {
        "tick": telemetry.tick[rows].astype(np.float64),
        "time_s": time_s,
        "rapid": scoring.on_rapid(trajectory.program, path_s_m).astype(np.float64),
    }
    for i, axis in enumerate("xy"):
        found[f"reference_{axis}_mm"] = np.interp(knot, number, trajectory.position_m[:, i]) * 1e3
    for signal in signals.SIGNALS:
        if signal.telemetry is not None and signal.column is not None:
            scale = _SCALE[signal.telemetry.unit, signal.column.unit]
            found[signal.column.name] = telemetry.values[signal.name][rows] * scale
    return found


def of_the_path(truth: Truth, first: int, clock: RunClock) -> Truth:
    """The rows of the path alone, both ends included; `first` is the control period of the first row."""
    start = clock.start_period - first
    return Truth(*(getattr(truth, f.name)[start : start + clock.periods + 1] for f in dataclasses.fields(truth)))


def add_truth(
    found: dict[str, Floats], truth: Truth, trajectory: Trajectory, clock: RunClock, from_s: float
) -> dict[str, Any]:
    """Score the truth at the control rate, from `from_s` on; adds its columns to `found` and returns the meta entries.

    A run that stopped before `from_s` is scored from its start.
    """
    time_s = np.arange(len(truth.pos_m)) / clock.control_hz
    knot = clock.path_time(time_s) / KNOT_S
    path_s_m = np.interp(knot, np.arange(len(trajectory.path_s_m)), trajectory.path_s_m)
    error = scoring.contour_error(trajectory.program, truth.pos_m, path_s_m)
    if from_s > time_s[-1]:
        from_s = 0.0
    force_max_N, force_step_N = scoring.force_effort(truth.force_N[time_s >= from_s])
    at = np.rint(found["time_s"] * clock.control_hz).astype(np.int64)
    found |= {
        "true_position_x_mm": truth.pos_m[at, 0] * 1e3,
        "true_position_y_mm": truth.pos_m[at, 1] * 1e3,
        "true_contour_error_um": error.normal_m[at] * 1e6,
        "true_tangential_error_um": error.tangential_m[at] * 1e6,
    }
    return {
        "score": dataclasses.asdict(scoring.score(error, time_s, truth.pos_m, from_s)),
        "force_max_N": force_max_N,
        "force_step_N": force_step_N,
    }
