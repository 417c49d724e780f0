# SPDX-License-Identifier: Apache-2.0
"""The paper's Figures 3 to 9 from our runs. Draws only; writes no file."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from kontur.experiments.paper import MU_FROM_0, Job, Results
from kontur.report import figures
from kontur.runs.log import RunLog

Array = NDArray[np.float64]
PAPERS = ("track", "cc", "ccu")
_COLOURS = dict(zip(PAPERS, (colour for colour, _ in figures.looks(PAPERS)), strict=True))
_AXES = ("#0072B2", "#D55E00")  # x and y, or along and across


def pictures(results: Results) -> Iterator[tuple[str, str, bytes]]:
    """Name, caption and PNG of every figure whose runs there are; the slow circle for 3 to 8, the fast ones for 9."""
    slow = _logs(results, results.cases[0])
    with figures.style():
        for number, caption, draw in _FIGURES:
            if number < 9:
                yield f"figure-{number}", caption, _png(draw(results, slow))
        for case in results.cases[1:]:
            logs = {name: log for name, log in _logs(results, case).items() if name != "track"}
            caption = f"Figure 9 — e_n1 (along) and e_n2 (across), fast: {case}"
            yield f"figure-9-{case}", caption, _png(_errors(results, logs))


def _logs(results: Results, case: str) -> dict[str, RunLog]:
    outcomes = {name: results.outcomes[Job(case, name)] for name in PAPERS}
    return {name: outcome.log for name, outcome in outcomes.items() if outcome.log is not None}


def _reference(_: Results, logs: Mapping[str, RunLog]) -> Figure:
    columns = next(iter(logs.values())).columns
    figure, (left, right) = _panels(1)
    for axis, colour in zip("xy", _AXES, strict=True):
        left.plot(columns["time_s"], columns[f"reference_{axis}_mm"], color=colour, label=f"{axis}_r")
    left.set_ylabel("mm")
    left.set_xlabel("time, s")
    left.legend(loc="upper right", ncols=2)
    right.plot(columns["reference_x_mm"], columns["reference_y_mm"], color=figures.INK)
    right.set_aspect("equal")
    right.set_xlabel("x_r, mm")
    right.set_ylabel("y_r, mm")
    return figure


def _tracking(_: Results, logs: Mapping[str, RunLog]) -> Figure:
    return _rows(
        logs, "µm", ("e_x", "e_y"), lambda c, i: (c[f"position_{'xy'[i]}_mm"] - c[f"reference_{'xy'[i]}_mm"]) * 1e3
    )


def _errors(_: Results, logs: Mapping[str, RunLog]) -> Figure:
    return _rows(logs, "µm", ("e_n1", "e_n2"), lambda c, i: c[("tangential_error_um", "contour_error_um")[i]])


def _inputs(_: Results, logs: Mapping[str, RunLog]) -> Figure:
    return _rows(logs, "N", ("u_x", "u_y"), lambda c, i: c[f"force_{'xy'[i]}_N"])


def _gain(results: Results, logs: Mapping[str, RunLog]) -> Figure:
    printed = next((v for v in results.variants if v.name == MU_FROM_0), None)
    shown = {"ours": logs.get("ccu")}
    if printed is not None:
        outcome = results.outcomes[Job(results.cases[0], printed.controller, printed.parameters)]
        shown["printed law (25)"] = outcome.log
    figure, panels = _panels(1)
    for axes, (title, log) in zip(panels, shown.items(), strict=False):
        axes.set_title(f"µ, {title}")
        axes.set_xlabel("time, s")
        for i, colour in enumerate(_AXES if log is not None else ()):
            assert log is not None
            _line(axes, log.columns["time_s"], log.columns[f"switching_gain_{i + 1}_mps2"], colour, f"µ_{i + 1}")
        axes.set_ylim(bottom=0.0)
        axes.legend(loc="lower right", ncols=2)
    panels[0].set_ylabel("m/s²")
    return figure


def _friction(results: Results, logs: Mapping[str, RunLog]) -> Figure:
    outcome = results.outcomes[Job(results.cases[0], "ccu")]
    figure = Figure(figsize=(7.6, 2.2), layout="constrained")
    axes = figure.add_subplot()
    if outcome.log is not None and outcome.friction_N is not None:
        time_s = outcome.log.columns["time_s"]
        for i, colour in enumerate(_AXES):
            _line(axes, time_s, np.abs(outcome.friction_N[:, i]), colour, f"L_{'xy'[i]}")
    axes.set_ylabel("N")
    axes.set_xlabel("time, s")
    axes.legend(loc="upper left", ncols=2)
    return figure


_FIGURES: tuple[tuple[int, str, Callable[[Results, Mapping[str, RunLog]], Figure]], ...] = (
    (3, "Figure 3 — reference, slow circle", _reference),
    (4, "Figure 4 — tracking errors, slow circle", _tracking),
    (5, "Figure 5 — e_n1 (along) and e_n2 (across), slow circle", _errors),
    (6, "Figure 6 — control input, slow circle", _inputs),
    (7, "Figure 7 — gain µ of the compensator, slow circle", _gain),
    (8, "Figure 8 — friction that acted on each axis, slow circle", _friction),
)


def _rows(
    logs: Mapping[str, RunLog], unit: str, names: tuple[str, str], values: Callable[[Mapping[str, Array], int], Array]
) -> Figure:
    """A row for each run, both components beside each other, each run at its own scale."""
    figure, panels = _panels(max(len(logs), 1))
    for row, (name, log) in enumerate(logs.items()):
        for i in range(2):
            axes = panels[2 * row + i]
            _line(axes, log.columns["time_s"], values(log.columns, i), _COLOURS[name])
            axes.set_title(f"{names[i]}, {name}")
        panels[2 * row].set_ylabel(unit)
    for axes in panels[-2:]:
        axes.set_xlabel("time, s")
    return figure


def _panels(rows: int) -> tuple[Figure, list[Any]]:
    figure = Figure(figsize=(7.6, 0.6 + 1.6 * rows), layout="constrained")
    return figure, list(figure.subplots(rows, 2, squeeze=False).ravel())


def _line(axes: Any, time_s: Array, values: Array, colour: str, label: str | None = None) -> None:
    known = np.isfinite(values)
    time_s, values = time_s[known], values[known]
    keep = figures.thinned(time_s, values)
    axes.plot(time_s[keep], values[keep], color=colour, lw=0.8, label=label)


def _png(figure: Figure) -> bytes:
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=110, metadata={"Software": None})
    return out.getvalue()
