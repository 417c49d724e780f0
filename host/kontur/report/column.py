# SPDX-License-Identifier: Apache-2.0
"""Pictures for a column of a paper, as SVG or PDF that need no font."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from kontur.errors import LogError
from kontur.report.figures import (
    Entry,
    draw_size,
    draw_sizes,
    error_name,
    looks,
    plain_decades,
    style,
    thinned,
    time_axes,
)

COLUMN_M = 0.088
"""Width of a column of a journal: 88 mm (IEEE, Elsevier)."""
_INCH_M = 0.0254
_COLUMN_STYLE: dict[str, object] = {
    "font.size": 7.0,
    "axes.titlesize": 7.0,
    "lines.linewidth": 0.8,
    "svg.fonttype": "path",
    "pdf.fonttype": 42,
}
_METADATA: dict[str, dict[str, None]] = {
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


@contextmanager
def column_style() -> Iterator[None]:
    """Draw and save for a column of a paper: text of 7 pt, as TrueType in PDF and as outlines in SVG."""
    with style(), matplotlib.rc_context(_COLUMN_STYLE):
        yield


def column(height_m: float) -> Figure:
    """An empty figure as wide as a column."""
    return Figure(figsize=(COLUMN_M / _INCH_M, height_m / _INCH_M), layout="constrained")


def as_file(figure: Figure, form: str) -> bytes:
    """The figure as "svg" or "pdf", the same bytes each time."""
    out = io.BytesIO()
    figure.savefig(out, format=form, metadata=_METADATA[form])
    return out.getvalue()


def for_column(entries: Sequence[Entry]) -> Figure:
    """The contour error of all runs over time, and their mean, 95 % and max, for a column of a paper."""
    figure = column(0.05 + 0.006 * len(entries))
    upper, lower = figure.subplots(2, 1, height_ratios=(3.0, 0.5 * len(entries) + 0.5))
    for entry in reversed(entries):
        time_s = entry.log.columns["time_s"]
        keep = thinned(time_s, entry.error_um)
        upper.plot(time_s[keep], entry.error_um[keep], color=entry.colour, lw=0.6, label=entry.label)
    time_axes([upper], entries)
    upper.set_ylabel("contour error, µm")
    draw_sizes(lower, entries, mark=0.55)
    lower.set_xlabel(f"{error_name(entries)}, µm: mean, 95 %, max")
    return figure


def of_cases(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Mean and greatest true contour error of each controller, a panel for each case: `rows` of experiments.circles.

    Of several seeds it is the mean of the means, and the greatest of all. Raises LogError: no run is scored.
    """
    known = [row for row in rows if row["mean_um"] is not None]
    if not known:
        raise LogError("no axis has moved along the circles, so there is no error to draw")
    cases = list(dict.fromkeys(str(row["case"]) for row in known))
    names = list(dict.fromkeys(str(row["controller"]) for row in known))
    figure = column((0.012 + 0.006 * len(names)) * len(cases) + 0.006)
    panels = figure.subplots(len(cases), 1, sharex=True, squeeze=False)[:, 0]
    for axes, case in zip(panels, cases, strict=True):
        for place, (name, look) in enumerate(zip(names, looks(names), strict=True)):
            if runs := [row for row in known if (row["case"], row["controller"]) == (case, name)]:
                mean = sum(float(row["mean_um"]) for row in runs) / len(runs)
                draw_size(axes, place, look, mean, max(float(row["max_um"]) for row in runs), mark=0.55)
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.5, -0.8)
        axes.set_title(case)
        axes.tick_params(axis="y", length=0)
        axes.grid(axis="y", visible=False)
    panels[-1].set(xscale="log", xlabel="true contour error, µm: marker mean, tip max")
    panels[-1].set_xlim(min(row["mean_um"] for row in known) / 2.5, max(row["max_um"] for row in known) * 3.0)
    plain_decades(panels[-1].xaxis)
    return figure
