# SPDX-License-Identifier: Apache-2.0
"""The summary of a run, computed from its log: mean, RMS and greatest contour error, energy, forces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from kontur.errors import LogError
from kontur.machine import told_text
from kontur.runs.log import RunLog

SUMMARY = {
    "path_percent": "path %",
    "mean_um": "mean µm",
    "rms_um": "rms µm",
    "max_um": "max µm",
    "tangential_mean_um": "along µm",
    "energy_J": "energy J",
    "force_max_N": "max N",
    "force_step_N": "step N",
    "frames_lost": "lost",
}
"""The figures of a run that are printed and saved, with the headings of their columns."""

TRACKING = {
    "tracking_mean_um": "tracking mean µm",
    "tracking_rms_um": "rms",
    "tracking_max_um": "max",
}
"""Where the path is smoothed within a tolerance: the same by the distance to the smoothed path, after the others."""

_SCORES = ("mean_um", "rms_um", "max_um", "tangential_mean_um")  # as in the `score` of a log
NOT_MOVED = "the axes did not move along the path"
_MOVED_MM = 1e-3  # axes that went less of the path did not move along it
ALIKE_PERCENT = 1.0  # of the path: runs that differ by more have not covered the same part of it


@dataclass(frozen=True)
class Summary:
    """The figures of a run. `truth`: errors are distances of the true position to the programmed path; otherwise the
    drive's own estimates. None: not known. `worst_*` is where the greatest error was; scored from `from_s`.

    The figures hold for `path_percent` of the path, which lies between `path_from_percent` and `path_to_percent`. A run
    whose axes did not move along the path has no errors: they are None.
    """

    path_percent: float | None
    path_from_percent: float | None
    path_to_percent: float | None
    mean_um: float | None
    rms_um: float | None
    max_um: float | None
    tangential_mean_um: float | None
    energy_J: float | None
    force_max_N: float | None
    force_step_N: float | None
    frames_lost: int | None
    worst_time_s: float
    worst_x_mm: float | None
    worst_y_mm: float | None
    from_s: float
    truth: bool

    @property
    def scored(self) -> bool:
        """Whether there are errors: the axes moved along the path."""
        return self.mean_um is not None

    def same_part(self, other: Summary) -> bool:
        """Whether both runs have covered the same part of their path as far as is known, and may be compared."""
        mine, others = ((s.path_percent, s.path_from_percent, s.path_to_percent) for s in (self, other))
        return all(a is None or b is None or abs(a - b) <= ALIKE_PERCENT for a, b in zip(mine, others, strict=True))

    @property
    def part(self) -> str | None:
        """The part of the path that the figures hold for, in words; None: all of it, or not known."""
        percent, first, last = self.path_percent, self.path_from_percent, self.path_to_percent
        if percent is None or first is None or last is None:
            return None
        lost = last - first - percent
        if first <= ALIKE_PERCENT and last >= 100.0 - ALIKE_PERCENT and lost <= ALIKE_PERCENT:
            return None
        gaps = f", without {lost:.3g} % whose telemetry was lost," if lost > ALIKE_PERCENT else ""
        return f"{max(first, 0.0):.3g} to {last:.3g} %{gaps} of the path"


def summarise(run: RunLog) -> Summary:
    """The figures of a run: its `score` at the control rate if the log has one, else from the rows of the log.

    Without truth they are of the drive's own estimate. Raises LogError: no row with a known error.
    """
    columns, meta = run.columns, run.meta
    name = "true_contour_error_um" if run.has_truth else "contour_error_um"
    along = "tangential_error_um"
    if run.has_truth and "true_tangential_error_um" in columns:
        along = "true_tangential_error_um"
    error = columns[name]
    known = np.flatnonzero(np.isfinite(error))
    if not known.size:
        raise LogError(f"{meta['program']}, {meta['controller']}: no row of the log has a contour error")
    worst = known[np.argmax(np.abs(error[known]))]
    x, y = (_at(columns.get(f"reference_{axis}_mm", columns.get(f"position_{axis}_mm")), worst) for axis in "xy")
    score: dict[str, Any] = {
        "mean_um": run.total(name).mean_abs,
        "rms_um": run.total(name).rms,
        "max_um": float(np.abs(error[worst])),
        "tangential_mean_um": run.total(along).mean_abs,
        "max_time_s": float(columns["time_s"][worst]),
        "max_x_mm": x,
        "max_y_mm": y,
        "from_s": 0.0,
    }
    if run.has_truth:
        score |= meta.get("score", {})
    forces = [np.nanmax(np.abs(columns[name])) for name in ("force_x_N", "force_y_N") if _has(columns.get(name))]
    energy = columns.get("energy_J", np.empty(0))
    energy = energy[np.isfinite(energy)]
    path = meta.get("path", {})
    moved = not path or path["to_mm"] - path["from_mm"] > _MOVED_MM
    return Summary(
        **_percent(path),
        **{key: score[key] if moved else None for key in _SCORES},
        energy_J=float(energy[-1] - energy[0]) if energy.size else None,
        force_max_N=meta.get("force_max_N", float(max(forces)) if forces else None),
        force_step_N=meta.get("force_step_N"),
        frames_lost=meta.get("frames_lost"),
        worst_time_s=score["max_time_s"],
        worst_x_mm=score["max_x_mm"],
        worst_y_mm=score["max_y_mm"],
        from_s=score["from_s"],
        truth=run.has_truth,
    )


def summary(log: RunLog) -> dict[str, Any]:
    """The figures of SUMMARY of a run, name to value, and those of TRACKING where it has them; None where not known."""
    values = summarise(log)
    return {name: getattr(values, name) for name in SUMMARY} | tracking(log)


def tracking(log: RunLog) -> dict[str, float]:
    """The figures of TRACKING of a run, name to value; empty where it has none."""
    score = log.meta.get("tracking_score")
    return {name: score[name.removeprefix("tracking_")] for name in TRACKING} if score else {}


def heading(meta: Mapping[str, Any], truth: bool) -> str:
    """What the errors of a run are, whose log has this `meta`, and what the drive was told of its machine."""
    if not truth:
        return "contour error by the drive's own estimate"
    told = told_text(str(meta.get("told", "")), str(meta.get("compensation", "")))
    return "true contour error of the tool" + (f"; the drive was {told}" if told else "")


def _percent(path: Mapping[str, float]) -> dict[str, float | None]:
    if not path:
        return dict.fromkeys(("path_percent", "path_from_percent", "path_to_percent"))
    percent = 100.0 / path["length_mm"]
    return {
        f"path_{name}percent": round(percent * path[key], 3)
        for name, key in (("", "known_mm"), ("from_", "from_mm"), ("to_", "to_mm"))
    }


def _has(values: Any) -> bool:
    return values is not None and bool(np.any(np.isfinite(values)))


def _at(values: Any, row: int) -> float | None:
    return float(values[row]) if values is not None and np.isfinite(values[row]) else None
