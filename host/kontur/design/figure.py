# SPDX-License-Identifier: Apache-2.0
"""The picture of a design: Nyquist's curve and the sensitivity of both axes, over all variants of the machine."""

from __future__ import annotations

import io

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from kontur.design import loop
from kontur.design.search import Design
from kontur.report.figures import FAINT, INK, plain_decades, style

_COLOURS = ("#0072B2", "#D55E00")


def picture(design: Design, ms: float, form: str) -> bytes:
    """The figure as 'png' or 'svg'; `ms` is the limit that is drawn."""
    out = io.BytesIO()
    with style():
        figure = draw(design, ms)
        if form == "png":
            figure.savefig(out, format="png", dpi=150, metadata={"Software": None})
        else:
            figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    return out.getvalue()


def draw(design: Design, ms: float) -> Figure:
    """Left the loop L, with the circle that it must stay out of; right |S|. Thin: other resonances and masses."""
    figure = Figure(figsize=(7.6, 3.6), layout="constrained")
    nyquist, sensitivity = figure.subplots(1, 2)
    nyquist.add_patch(Circle((-1.0, 0.0), 1.0 / ms, facecolor=FAINT, alpha=0.35, edgecolor="none"))
    nyquist.plot([-1.0], [0.0], "+", color=INK)
    sensitivity.axhline(ms, color=FAINT, lw=0.9, ls=(0, (4, 2)))
    for name, colour, axis in zip("xy", _COLOURS, design.axes, strict=True):
        for i, open_loop in enumerate(axis.loops):
            look = {"color": colour, "lw": 1.4 if i == 0 else 0.4, "label": name if i == 0 else None}
            nyquist.plot(open_loop.real, open_loop.imag, **look)
            sensitivity.loglog(axis.hz, 1.0 / np.abs(1.0 + open_loop), **look)
    nyquist.set(xlim=(-2.6, 1.1), ylim=(-2.2, 1.5), aspect="equal", xlabel="Re L", ylabel="Im L")
    sensitivity.set(xlabel="frequency, Hz", ylabel="|S|", xlim=(loop.LEAST_HZ, design.axes[0].hz[-1]), ylim=(1e-3, 4.0))
    plain_decades(sensitivity.xaxis, sensitivity.yaxis)
    sensitivity.legend(loc="lower right")
    figure.suptitle(f"{design.machine}: {design.controller}", color=FAINT)
    return figure
