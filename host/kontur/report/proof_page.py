# SPDX-License-Identifier: Apache-2.0
"""The report of a commissioning, to be filed: what was measured on which drive, before and after, with pictures.

One HTML file that needs nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from kontur.errors import visible
from kontur.files import write_atomically
from kontur.report.circle_page import polar
from kontur.report.figures import FAINT, number, plain_decades, style
from kontur.report.sheet import document, pictured
from kontur.runs.circle_record import CircleTest

_COLOURS = ("#0072B2", "#D55E00")
_LEAST_S = 1e-2
_HEADINGS = {
    "case": "circle", "controller": "controller", "before_um": "mean before, µm", "after_um": "mean after, µm",
    "ms_predicted": "Ms predicted", "ms_measured": "Ms measured", "iso_before_um": "G(b) before, µm",
    "iso_after_um": "G(b) after, µm",
}  # fmt: skip
_NOTE = (
    "Mean: contour error over the circle, the true one of a simulation, the drive's own estimate on a bus. G(b): "
    "circular deviation of both senses after ISO 230-4, by the true position where it is known. Ms: largest "
    "sensitivity of both axes."
)


@dataclass(frozen=True, eq=False)
class Curve:
    """|S| of an axis: measured at `hz` with its standard deviation, and predicted at `predicted_hz`."""

    hz: NDArray[np.float64]
    measured: NDArray[np.float64]
    sigma: NDArray[np.float64]
    predicted_hz: NDArray[np.float64]
    predicted: NDArray[np.float64]


def write_proof_report(
    path: Path,
    verdict: str,
    facts: Mapping[str, str],
    proof: Sequence[Mapping[str, Any]],
    curves: Mapping[str, tuple[Curve, Curve]],
    circles: Mapping[tuple[str, str], tuple[CircleTest | None, CircleTest | None]],
    parameters: Sequence[Mapping[str, Any]],
    stops: Sequence[str] = (),
) -> None:
    """Write the report. `verdict`: one sentence; `proof`, `parameters`: rows of tables; `curves`: of x and y by
    controller; `circles`: tests before and after by controller and circle; `stops`: where and why the drive stopped.

    Raises FileError."""
    with style():
        pictures = [
            pictured(_sensitivity(pair), f"{name}: sensitivity", "Lines: predicted; points: measured on the drive.",
                     f"Sensitivity of both axes under {name}")
            for name, pair in curves.items()
        ]  # fmt: skip
        pictures += [
            pictured(
                polar("position, after" if before is None else "position, after; grey: before", after.circles[0].best,
                      None if before is None else before.circles[0].best, after.radius_mm),
                f"{name}: {case}", "", f"Polar plot of {case} under {name}",
            )
            for (name, case), (before, after) in circles.items() if after is not None
        ]  # fmt: skip
    shown = "".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in facts.items())
    stopped = "".join(f"<li>{escape(text)}</li>" for text in stops)
    content = "\n".join(
        [
            _table("Proof", proof, _NOTE),
            f"<section><h2>Where the drive stopped</h2><ul>{stopped}</ul></section>" if stops else "",
            f'<div class="pair">{"".join(pictures)}</div>',
            f'<section><h2>What was measured</h2><dl class="facts">{shown}</dl></section>',
            _table("Parameters that changed", parameters, "") if parameters else "",
        ]
    )
    write_atomically(path, visible(document("Commissioning", escape(verdict), content)).encode())


def _sensitivity(pair: tuple[Curve, Curve]) -> Figure:
    figure = Figure(figsize=(5.6, 4.0), layout="constrained")
    axes = figure.subplots()
    for name, colour, one in zip("xy", _COLOURS, pair, strict=True):
        axes.loglog(one.predicted_hz, one.predicted, color=colour, lw=0.9)
        axes.errorbar(one.hz, one.measured, one.sigma, fmt="o", ms=3.5, color=colour, lw=0.8, label=name)
    axes.axhline(1.0, color=FAINT, lw=0.6)
    axes.set(xlabel="frequency, Hz", ylabel="|S|", ylim=(_LEAST_S, 4.0), xlim=(5.0, 1000.0))
    plain_decades(axes.xaxis, axes.yaxis)
    axes.legend(loc="lower right")
    return figure


def _table(heading: str, rows: Sequence[Mapping[str, Any]], note: str) -> str:
    heads = "".join(f'<th scope="col">{escape(_HEADINGS.get(name, name))}</th>' for name in rows[0])
    body = "".join(f"<tr>{''.join(f'<td>{_cell(value)}</td>' for value in row.values())}</tr>" for row in rows)
    below = f'<p class="note">{escape(note)}</p>' if note else ""
    return (f'<figure><figcaption><h2>{escape(heading)}</h2></figcaption><div class="scroll"><table class="scores">'
            f"<thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table></div>{below}</figure>")  # fmt: skip


def _cell(value: Any) -> str:
    if value is None:
        return "the drive stopped"
    return number(value) if isinstance(value, float) else escape(str(value))
