# SPDX-License-Identifier: Apache-2.0
"""The report of a circular test: polar plots with a magnified radial scale, the deviations unrolled, and the figures.

One HTML file that needs nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from kontur.errors import visible
from kontur.files import write_atomically
from kontur.report.column import COLUMN_M, as_file, column, column_style
from kontur.report.figures import FAINT, INK, nice, number, style
from kontur.report.sheet import document, pictured
from kontur.runs.circle_record import (
    CAUSES,
    DEVIATIONS,
    HEADINGS,
    Circle,
    CircleTest,
    Trace,
    rows,
    spike_rows,
)
from kontur.runs.circularity import PROFILE

_COLOURS = {"ccw": "#0072B2", "cw": "#D55E00"}
_TIMES, _MINUS = "\u00d7", "\u2212"
_NAMES = {"true": "true position", "drive": "position that the drive reports"}
_DIVISIONS = 4  # of the greatest deviation, at most
_DEPTH = 0.4  # of the radius of a plot, for the greatest deviation
_LEAST_UM = 1e-3


def write_circle_report(path: Path, test: CircleTest, before: CircleTest | None = None) -> None:
    """Write the report of `test`, beside an earlier test of the same radius. Raises FileError.

    The suffix .svg or .pdf asks for the polar plot of the worst circle alone, as wide as a column of a paper.
    """
    if (form := path.suffix.lower()[1:]) != "html":
        with column_style():
            write_atomically(path, as_file(_for_column(test, before), form))
        return
    title = f"Circular test: radius {test.radius_mm:g} mm, {test.conditions.get('controller', '')}"
    with style():
        pictures = "\n".join(_pictures(test, one, before) for one in test.circles)
    content = "\n".join(
        [
            _table("Deviations, µm", rows(test, before, DEVIATIONS), _DEVIATIONS_NOTE),
            pictures,
            _table("Causes, estimated", rows(test, before, CAUSES), _CAUSES_NOTE),
            _table("Spikes at the reversals: height in µm, width", spike_rows(test, before), _SPIKES_NOTE),
            _conditions(test, before),
        ]
    )
    write_atomically(path, visible(document(title, _answer(test, before), content)).encode())


def polar(name: str, found: Trace, before: Trace | None, radius_mm: float) -> Figure:
    """A polar plot whose radial scale stands in it. The traces of the test `before` are grey."""
    height = 6.0 if before is None else 6.3  # the legend has two lines then
    figure = Figure(figsize=(5.6, height), layout="constrained")
    _polar_panel(figure.add_subplot(), name, found, before, radius_mm)
    return figure


def _for_column(test: CircleTest, before: CircleTest | None) -> Figure:
    worst = max(test.circles, key=lambda one: one.best.figures.g_both_um)
    earlier = before.at(worst.feed_mmps) if before is not None else None
    by, found = next(iter(worst.traces.items()))
    figure = column(COLUMN_M * 1.07)
    _polar_panel(figure.add_subplot(), _NAMES[by], found, earlier.traces.get(by) if earlier else None, test.radius_mm)
    return figure


def _polar_panel(axes: Any, name: str, found: Trace, before: Trace | None, radius_mm: float) -> None:
    curves = [(one, sense, colour) for one in (before, found) if one is not None for sense, colour in _COLOURS.items()]
    greatest = max(float(np.max(np.abs(getattr(one, f"{sense}_um")))) for one, sense, _ in curves)
    division = nice(max(greatest, _LEAST_UM) / _DIVISIONS) if greatest > _LEAST_UM else _LEAST_UM
    count = max(1, int(np.ceil(greatest / division - 1e-9)))
    per_um = _DEPTH / (count * division)

    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    for ring in range(-count, count + 1):
        radius = 1.0 + ring * division * per_um
        nominal = ring == 0
        axes.plot(radius * np.cos(turn), radius * np.sin(turn), color=INK if nominal else "#e3e6ea",
                  lw=1.0 if nominal else 0.6, ls=(0, (5, 3)) if nominal else "-", zorder=1)  # fmt: skip
        if abs(ring) == count:
            place = radius * np.cos(0.25 * np.pi)
            axes.annotate(_signed(ring * division), (place, place), ha="center", va="center", color=FAINT, fontsize=7.5,
                          zorder=2)  # fmt: skip
    for text, x, y in (("X+", 1.0, 0.0), ("Y+", 0.0, 1.0), ("X" + _MINUS, -1.0, 0.0), ("Y" + _MINUS, 0.0, -1.0)):
        axes.plot([0.5 * x, 1.45 * x], [0.5 * y, 1.45 * y], color="#e3e6ea", lw=0.6, zorder=1)
        axes.annotate(text, (1.55 * x, 1.55 * y), ha="center", va="center", weight="bold")
    angle = np.arange(PROFILE + 1) * (2.0 * np.pi / PROFILE)
    for one, sense, colour in curves:
        deviation = getattr(one, f"{sense}_um")
        drawn = 1.0 + per_um * np.append(deviation, deviation[0])
        label = {"ccw": "counter-clockwise", "cw": "clockwise"}[sense]
        look = {"color": colour, "lw": 1.1, "label": label, "zorder": 4}
        if one is before:
            look = {"color": FAINT, "lw": 0.8, "label": f"before, {sense}", "zorder": 3}
            look["ls"] = "-" if sense == "ccw" else ":"
        axes.plot(drawn * np.cos(angle), drawn * np.sin(angle), **look)
    axes.annotate(f"1 division = {division:g} µm", (0.0, 0.06), ha="center", weight="bold")
    axes.annotate(f"deviation {_TIMES}{per_um * radius_mm * 1e3:,.0f}", (0.0, -0.08), ha="center")
    axes.set_xlim(-1.65, 1.65)
    axes.set_ylim(-1.65, 1.65)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title(f"By the {name}: G(b) = {number(found.figures.g_both_um)} µm", weight="bold", loc="center")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.02), ncols=2)


def unrolled(traces: Mapping[str, Trace], before: Mapping[str, Trace]) -> Figure:
    """Radial deviation by angle, a row for each of `traces`; the spikes are marked with their heights."""
    figure = Figure(figsize=(11.2, 0.6 + 2.2 * len(traces)), layout="constrained")
    angle = np.arange(PROFILE) * (360.0 / PROFILE)
    panels = figure.subplots(len(traces), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (by, found) in zip(panels, traces.items(), strict=True):
        for sense, colour in _COLOURS.items():
            if by in before:
                axes.plot(angle, getattr(before[by], f"{sense}_um"), color=FAINT, lw=0.7)
            axes.plot(angle, getattr(found, f"{sense}_um"), color=colour, lw=0.9)
        axes.set_ylabel("µm, outwards")
        axes.set_title(f"By the {_NAMES[by]}", weight="bold", pad=3.0)
    panels[-1].set_xticks(np.arange(0, 361, 45))
    panels[-1].set_xlim(0.0, 360.0)
    panels[-1].set_xlabel("angle, degrees; an axis reverses at 0, 90, 180 and 270")
    return figure


def _pictures(test: CircleTest, one: Circle, before: CircleTest | None) -> str:
    circle = before.at(one.feed_mmps) if before is not None else None
    earlier = circle.traces if circle is not None else {}
    feed = f"{one.feed_mmps:g} mm/s"
    grey = " Grey: the earlier test." if earlier else ""
    plots = "".join(
        pictured(
            polar(_NAMES[by], found, earlier.get(by), test.radius_mm),
            f"{feed}, by the {_NAMES[by]}",
            f"Dashed: the programmed circle; what deviates from it is magnified.{grey}",
            f"Polar plot at {feed} by the {_NAMES[by]}: G(b) {number(found.figures.g_both_um)} um.",
        )
        for by, found in one.traces.items()
    )
    return f'<div class="pair">{plots}</div>' + pictured(
        unrolled(one.traces, earlier),
        f"{feed}, over the angle",
        f"Blue: counter-clockwise; orange: clockwise.{grey}",
        f"Radial deviation over the angle at {feed}, by the {', and by the '.join(_NAMES[by] for by in one.traces)}.",
    )


def _answer(test: CircleTest, before: CircleTest | None) -> str:
    worst = max(test.circles, key=lambda one: one.best.figures.g_both_um)
    by = next(iter(worst.traces))
    found = worst.best.figures
    spike = max(found.spikes, key=lambda one: abs(one.height_um))
    text = (f"Both senses together deviate by G(b) = <b>{number(found.g_both_um)} µm</b> at {worst.feed_mmps:g} mm/s "
            f"by the {_NAMES[by]}.")  # fmt: skip
    if by == "true" and "drive" in worst.traces:
        text += f" The drive itself sees {number(worst.traces['drive'].figures.g_both_um)} µm."
    earlier = before.at(worst.feed_mmps) if before is not None else None
    if earlier is not None and by in earlier.traces:
        text += f" Before it was {number(earlier.traces[by].figures.g_both_um)} µm."
    return text + (f" The greatest spike is <b>{_signed(float(f'{spike.height_um:.3g}'))} µm</b> at {spike.place}, "
                   f"{spike.width_deg:.2g}° wide, {spike.sense}.")  # fmt: skip


_DEVIATIONS_NOTE = """G: circular deviation, about the least-squares centre. G(b): of both senses, about their common
centre. F: radial deviation from the programmed circle, outwards positive. D: mean of both radii less the programmed one
(ISO 230-4)."""
_CAUSES_NOTE = """Fitted to both senses, without what is within 15° of a reversal. Squareness is positive where the
angle between the positive axes is below 90°. Backlash includes all that an axis is left behind after its reversal, such
as friction that the drive does not make up for."""
_SPIKES_NOTE = "Height beyond the levels before and after the reversal, outwards positive; width at half of it."


def _table(heading: str, table: Sequence[Mapping[str, Any]], note: str) -> str:
    return (f'<figure><figcaption><h2>{heading}</h2></figcaption><div class="scroll"><table class="scores">'
            f'{_rows(table)}</table></div><p class="note">{note}</p></figure>')  # fmt: skip


def _rows(table: Sequence[Mapping[str, Any]]) -> str:
    heads = "".join(f'<th scope="col">{escape(HEADINGS.get(name, name))}</th>' for name in table[0])
    body = "".join(f"<tr>{''.join(f'<td>{_cell(value)}</td>' for value in row.values())}</tr>" for row in table)
    return f"<thead><tr>{heads}</tr></thead><tbody>{body}</tbody>"


def _cell(value: Any) -> str:
    if not isinstance(value, float):
        return escape(str(value))
    return (f"{round(value, 3) + 0.0:.3f}" if abs(value) < 1.0 else f"{value:.4g}").replace("-", _MINUS)


def _signed(value: float) -> str:
    return f"{'+' if value > 0.0 else _MINUS if value < 0.0 else ''}{abs(value):g}"


def _conditions(test: CircleTest, before: CircleTest | None) -> str:
    names = list(dict.fromkeys([*test.conditions, *(before.conditions if before is not None else ())]))
    shown = ""
    for name in names:
        now = str(test.conditions.get(name, ""))
        then = str(before.conditions.get(name, "")) if before is not None else now
        text = now if now == then else f"{now}; before: {then or 'not known'}"
        shown += f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>"
    return f'<section><h2>What was measured</h2><dl class="facts">{shown}</dl></section>'
