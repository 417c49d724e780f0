# SPDX-License-Identifier: Apache-2.0
"""Logs of runs that never happened, with errors of known size, for the tests of logs and reports."""

from __future__ import annotations

from typing import Any

import numpy as np

from kontur.runs.log import RunLog

ROWS = 3000


def made_run(controller: str = "ccu", mean_um: float = 0.1, peak_um: float = 2.0, peak_row: int = 1200, *,
             truth: bool = True, rows: int = ROWS, part: tuple[float, float] | None = None, known: float | None = None,
             **meta: Any) -> RunLog:  # fmt: skip
    """A circle of 10 mm radius in 3 s; |error| is `mean_um` but for one row that has `peak_um`. `part`: from which to
    which share of the path the log says that it went, of which it knows `known`."""
    time_s = np.arange(ROWS) * 1e-3
    angle = 2.0 * np.pi * np.arange(ROWS) / (ROWS - 1)
    error_um = mean_um * np.where(np.arange(ROWS) % 2 == 0, 1.0, -1.0)
    error_um[peak_row] = peak_um
    x, y = 10.0 * np.cos(angle), 10.0 * np.sin(angle)
    true_x, true_y = x * (1 - error_um * 1e-4), y * (1 - error_um * 1e-4)
    every = {period: np.arange(ROWS) % period == 0 for period in (2, 20)}
    columns = {
        "tick": 700.0 + np.arange(ROWS),
        "time_s": time_s,
        "tangential_error_um": 0.5 * np.sin(3.0 * angle),
        "contour_error_um": np.round(error_um, 3),
        "position_x_mm": np.round(true_x, 6),
        "position_y_mm": np.round(true_y, 6),
        "reference_x_mm": x,
        "reference_y_mm": y,
        "rapid": np.where(np.arange(ROWS) < 50, 1.0, 0.0),
        "digital": np.where(np.arange(ROWS) < 50, 0.0, 9.0),
        "power": np.where(np.arange(ROWS) < 50, 0.0, 0.1234),
        "force_x_N": np.where(every[2], -40.0 * np.sin(angle), np.nan),
        "force_y_N": np.where(every[2], 40.0 * np.cos(angle), np.nan),
        "adaptive_gain_1_per_s": np.where(every[2], 100.0 + time_s, np.nan),
        "adaptive_gain_2_per_s": np.where(every[2], 100.0 - time_s, np.nan),
        "switching_gain_1_mps2": np.where(every[20], 1.0 + 0.1 * time_s, np.nan),
        "switching_gain_2_mps2": np.where(every[20], 1.0, np.nan),
        "energy_J": np.where(every[20], 5.0 + 7.0 * time_s, np.nan),
    }
    if truth:
        columns |= {
            "true_position_x_mm": true_x,
            "true_position_y_mm": true_y,
            "true_contour_error_um": error_um,
            "true_tangential_error_um": 2.0 + 0.0 * x,
        }
    head = {
        "program": "circle",
        "controller": controller,
        "status": "complete" if rows == ROWS else "interrupted",
        "trajectory": "ab" * 32,
        "machine": "Table 1",
        "plant": {"name": "Table 1", "x": {"mass_kg": 90.0}},
        "seed": 1,
        "firmware": "0.1.0",
        "num": "f32",
        "control_hz": 10000,
        "parameters": {"smc.lambda": 200.0},
        "frames_lost": 0,
        "accepted": rows,
        "rejected": {"crc": 0, "sequence": 0, "full": 0},
        "command": f"kontur run circle --controller {controller}",
    }
    if part is not None:
        first, last = part
        head["path"] = {"length_mm": 62.0, "from_mm": 62.0 * first, "to_mm": 62.0 * last,
                        "known_mm": 62.0 * (last - first if known is None else known)}  # fmt: skip
    return RunLog(head | meta, {name: values[:rows] for name, values in columns.items()})
