# SPDX-License-Identifier: Apache-2.0
"""The columns of a log: telemetry and reference of each row, and the true errors where the true position is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kontur.can import signals
from kontur.can.outputs import BY_RATE, DIGITAL, FULL_POWER
from kontur.can.wire import Telemetry
from kontur.path.geometry import KNOT_S
from kontur.planning.ahead import Planned
from kontur.runs.scoring import ContourError, Rapids

Floats = NDArray[np.float64]

# From the SI units of the telemetry to the units of the columns
_SCALE = {
    **{("m", "um"): 1e6, ("m", "mm"): 1e3},
    **{(unit, unit): 1.0 for unit in ("N", "1/s", "m/s2", "J")},
}


def columns(
    telemetry: Telemetry, rows: NDArray[np.bool_], time_s: Floats, path_s: Floats, trajectory: Planned, rapid: Rapids
) -> dict[str, Floats]:
    """The columns of those `rows` (n,) of the telemetry, by their names in kontur.runs.log.

    `time_s` are the times of these rows since the start, `path_s` their path times.
    """
    found: dict[str, Floats] = {
        "tick": telemetry.tick[rows].astype(np.float64),
        "time_s": time_s,
        "rapid": rapid.at(along(trajectory.path_s_m, path_s)).astype(np.float64),
    }
    for i, axis in enumerate("xy"):
        found[f"reference_{axis}_mm"] = along(trajectory.position_m[:, i], path_s) * 1e3
    return found | {name: values[rows] for name, values in measured(telemetry).items()}


def measured(telemetry: Telemetry) -> dict[str, Floats]:
    """The columns (n,) of what the drive has measured."""
    return {
        signal.column.name: telemetry.values[signal.name] * _SCALE[signal.telemetry.unit, signal.column.unit]
        for signal in signals.SIGNALS
        if signal.telemetry is not None and signal.column is not None
    }


def true_columns(pos_m: Floats, error: ContourError) -> dict[str, Floats]:
    """The columns of the truth, from true positions (n, 2) and their errors (n,)."""
    return {
        "true_position_x_mm": pos_m[:, 0] * 1e3,
        "true_position_y_mm": pos_m[:, 1] * 1e3,
        "true_contour_error_um": error.normal_m * 1e6,
        "true_tangential_error_um": error.tangential_m * 1e6,
    }


def switched_columns(word: NDArray[np.uint32], path_s: Floats, rate: Floats) -> dict[str, Floats]:
    """The columns of the outputs: those of the knots (N,) at the path times `path_s` (n,), at this `rate` (n,)."""
    at = word[np.minimum(np.floor(path_s / KNOT_S + 1e-6).astype(np.int64), len(word) - 1)]
    by_rate = np.where(at & BY_RATE != 0, rate, 1.0)
    return {
        "digital": np.where(rate > 0.0, at & DIGITAL, 0).astype(np.float64),
        "power": np.where(rate > 0.0, np.minimum((at >> np.uint32(16)) / FULL_POWER * by_rate, 1.0), 0.0),
    }


def along(of_knots: Floats, path_s: Floats) -> Floats:
    """Values (n,) at the path times `path_s` (n,), interpolated between `of_knots` (N,), one a knot."""
    if not path_s.size:
        return np.empty(0)
    knot = path_s / KNOT_S
    first, last = int(knot.min()), int(np.ceil(knot.max())) + 2
    part = of_knots[first:last]
    return np.interp(knot, np.arange(first, first + len(part)), part)
