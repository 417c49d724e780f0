# SPDX-License-Identifier: Apache-2.0
"""The picture of a capture: one panel a unit, the trigger marked. Draws only; writes no file."""

from __future__ import annotations

import io

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from kontur.can.emcy import faults
from kontur.can.signals import Signal
from kontur.drive.scope import Capture
from kontur.report.figures import FAINT, INK, style

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8a9099")
_UNITS = {"um": "µm", "m/s2": "m/s²"}


def picture(capture: Capture, form: str) -> bytes:
    """The figure as 'png' or 'svg'."""
    out = io.BytesIO()
    with style():
        figure = draw(capture)
        if form == "png":
            figure.savefig(out, format="png", dpi=150, metadata={"Software": None})
        else:
            figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    return out.getvalue()


def draw(capture: Capture) -> Figure:
    """A panel for each unit, in the order of the signals; time in ms from the trigger."""
    groups: dict[str, list[Signal]] = {}
    for signal in capture.signals:
        groups.setdefault(signal.unit or signal.name, []).append(signal)
    figure = Figure(figsize=(7.2, 0.9 + 1.6 * len(groups)), layout="constrained")
    panels = figure.subplots(len(groups), 1, sharex=True, squeeze=False)[:, 0]
    time_ms = capture.time_s * 1e3
    left = capture.trigger_frame > len(capture.values) / 2
    last = capture.trigger_frame > 0.85 * len(capture.values)  # no room for a word behind it
    for axes, (unit, signals) in zip(panels, groups.items(), strict=True):
        for signal, colour in zip(signals, _COLOURS, strict=False):
            axes.plot(time_ms, capture[signal.name], color=colour, lw=1.0, label=signal.name)
        axes.axvline(0.0, color=INK, lw=0.9, ls=(0, (4, 2)))
        axes.set_ylabel(_UNITS.get(unit, unit))
        axes.yaxis.set_major_locator(MaxNLocator(5))
        axes.legend(loc="center left" if left else "center right", fontsize=8)
    label = f" {capture.fault:04X}h" if capture.fault else " trigger"
    panels[0].annotate(
        f"{label} ", (0.0, 1.0), (0, -3), xycoords=("data", "axes fraction"), textcoords="offset points",
        ha="right" if last else "left", va="top", color=INK, weight="bold",
    )  # fmt: skip
    panels[0].set_title(_title(capture), color=FAINT)
    panels[-1].set_xlabel("time from the trigger, ms")
    panels[-1].set_xlim(time_ms[0], time_ms[-1])
    return figure


def _title(capture: Capture) -> str:
    rate = f"{capture.control_hz / capture.periods / 1e3:g} kHz, {len(capture.values)} frames"
    known = faults().get(capture.fault)
    text = known.fault if known else ""
    return f"{rate}: {text}" if text else rate
