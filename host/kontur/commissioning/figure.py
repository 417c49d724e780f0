# SPDX-License-Identifier: Apache-2.0
"""The picture of a measured frequency response: machine, sensitivity and Nyquist's curve."""

from __future__ import annotations

import io

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from kontur.commissioning.response import Response
from kontur.report.column import COLUMN_M, as_file, column, column_style
from kontur.report.figures import FAINT, INK, plain_decades, style

_FIRST, _SECOND = "#0072B2", "#D55E00"


def for_column(response: Response, title: str, form: str) -> bytes:
    """The figure as 'svg' or 'pdf', as wide as a column of a paper."""
    with column_style():
        return as_file(draw(column(COLUMN_M), response, title), form)


def picture(response: Response, title: str, form: str) -> bytes:
    """The figure as 'png' or 'svg', for a screen."""
    out = io.BytesIO()
    with style():
        figure = draw(Figure(figsize=(7.6, 6.2), layout="constrained"), response, title)
        metadata: dict[str, None] = {"Software": None} if form == "png" else {"Date": None, "Creator": None}
        figure.savefig(out, format=form, dpi=150, metadata=metadata)
    return out.getvalue()


def draw(figure: Figure, response: Response, title: str) -> Figure:
    """Above magnitude and phase of the machine, below |S| and L. Bars are one standard deviation."""
    (size, sensitivity), (phase, nyquist) = figure.subplots(2, 2)
    hz = response.hz
    for name, colour, plant, sigma in zip(
        ("encoder", "second encoder"), (_FIRST, _SECOND), response.plant, response.plant_sigma, strict=True
    ):
        if not np.any(plant):
            continue
        size.errorbar(hz, np.abs(plant), sigma, fmt=".-", color=colour, lw=0.8, ms=3, label=name)
        phase.plot(hz, np.degrees(np.unwrap(np.angle(plant))), ".-", color=colour, lw=0.8, ms=3)
    size.set(xscale="log", yscale="log", ylabel="|P|, m/N")
    size.legend(loc="lower left")
    phase.set(xscale="log", xlabel="frequency, Hz", ylabel="phase of P, °")
    sensitivity.errorbar(
        hz, np.abs(response.sensitivity), response.sensitivity_sigma, fmt=".-", color=_FIRST, lw=0.8, ms=3
    )
    sensitivity.axhline(1.0, color=FAINT, lw=0.6)
    sensitivity.set(xscale="log", yscale="log", xlabel="frequency, Hz", ylabel="|S|")
    plain_decades(size.xaxis, size.yaxis, phase.xaxis, sensitivity.xaxis, sensitivity.yaxis)
    sensitivity.yaxis.set_minor_formatter(FuncFormatter(lambda y, _: f"{y:.1g}" if f"{y:.0e}"[0] in "26" else ""))
    nyquist.plot(response.open_loop.real, response.open_loop.imag, ".-", color=_FIRST, lw=0.8, ms=3)
    nyquist.plot([-1.0], [0.0], "+", color=INK)
    nyquist.set(xlim=(-2.6, 1.1), ylim=(-2.2, 1.5), aspect="equal", xlabel="Re L", ylabel="Im L")
    figure.suptitle(title, color=FAINT)
    return figure
