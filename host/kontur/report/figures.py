# SPDX-License-Identifier: Apache-2.0
"""The pictures of a report, drawn with matplotlib from runs and their summaries. Draws only; writes no file.

A long signal is thinned to the smallest and greatest value of each short stretch of time, so that no peak is lost.
The log of a long run is thinned already, in the same way (kontur.runs.sample).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from kontur.drive.controllers import DESCRIPTIONS
from kontur.runs.log import RunLog
from kontur.runs.summary import Summary

Array = NDArray[np.float64]

INK, FAINT, PATH = "#1b1f24", "#8a9099", "#b9bec6"
_DASH, _TIMES = "\u2013", "\u00d7"
_LEAST_UM = 1e-6  # drawn where there is no error at all
_STRETCHES = 700  # of time in a picture; two points each
# Okabe and Ito's colours, distinguishable with any colour vision; the marker says the same without colour
_LOOKS = {
    "ccu": ("#0072B2", "o"),
    "cascade": ("#D55E00", "D"),
    "ccc": ("#E69F00", "v"),
    "cc": ("#009E73", "^"),
    "track": ("#CC79A7", "s"),
}
_MORE_LOOKS = (("#56B4E9", "P"), ("#000000", "X"), ("#F0E442", "h"))
_STYLE = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial"],  # the first comes with matplotlib: same layout everywhere
    "font.size": 8.5,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.titlesize": 8.5,
    "axes.titlelocation": "left",
    "grid.color": "#e3e6ea",
    "grid.linewidth": 0.6,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "lines.linewidth": 1.0,
    "legend.frameon": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "kontur",
    "text.parse_math": False,  # names come from outside
}


@dataclass(frozen=True, eq=False)  # two runs with equal figures are still two
class Entry:
    """A run in a report: its log and summary, and what it is called and looks like in every picture."""

    log: RunLog
    summary: Summary
    label: str
    colour: str
    marker: str

    @property
    def long_name(self) -> str:
        return DESCRIPTIONS.get(str(self.log.meta["controller"]), "")

    @property
    def mean_um(self) -> float:
        """Mean error; 0 where the run is not scored."""
        return self.summary.mean_um or 0.0

    @property
    def max_um(self) -> float:
        """Greatest error; 0 where the run is not scored."""
        return self.summary.max_um or 0.0

    @property
    def error_um(self) -> Array:
        """True contour error, or the drive's estimate where the truth is not known."""
        return self.log.columns["true_contour_error_um" if self.summary.truth else "contour_error_um"]


def looks(controllers: Sequence[str]) -> list[tuple[str, str]]:
    """Colour and marker for each of `controllers`; a controller keeps its own, a second run of it gets another."""
    unused = [*_MORE_LOOKS, *(look for name, look in _LOOKS.items() if name not in controllers)]
    out: list[tuple[str, str]] = []
    for i, name in enumerate(controllers):
        fresh = name in _LOOKS and name not in controllers[:i]
        out.append(_LOOKS[name] if fresh else unused[len(out) % len(unused)])
    return out


def number(value: float | None) -> str:
    """Three digits, without exponent: 0.0553, 22.4, 1840."""
    if value is None:
        return _DASH
    if value == 0.0 or not np.isfinite(value):
        return f"{value:g}"
    digits = max(0, 2 - int(np.floor(np.log10(abs(float(f"{value:.2e}"))))))
    return f"{value:.{min(digits, 6)}f}"


@contextmanager
def style() -> Iterator[None]:
    """Draw and save in the style of the report."""
    with matplotlib.rc_context(_STYLE):
        yield


def sizes(entries: Sequence[Entry]) -> Figure:
    """Mean, 95 % and max of the contour error of every controller on one logarithmic scale, and below the share of time
    with a smaller error."""
    bars, shares = 0.5 * len(entries) + 0.2, max(1.5, 4.0 - 0.5 * len(entries))
    figure = Figure(figsize=(5.6, bars + shares + 0.6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(bars, shares))
    draw_sizes(upper, entries)
    for entry in entries:
        error = np.sort(np.maximum(_sizes(entry), _LEAST_UM))
        few = np.unique(np.linspace(0, len(error) - 1, _STRETCHES).astype(int))
        lower.plot(error[few], 100.0 * (few + 1) / len(error), color=entry.colour, lw=1.4)
    lower.set_ylim(0.0, 100.0)
    lower.set_ylabel("% of the time below")
    lower.set_xlabel(f"{error_name(entries)} |e|, µm (logarithmic)")
    return figure


def plain_decades(*logarithmic: Any) -> None:
    """Label the decades of logarithmic axes with numbers: matplotlib's own labels need "text.parse_math"."""
    for axis in logarithmic:
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())


def draw_sizes(axes: Any, entries: Sequence[Entry], mark: float = 1.0) -> None:
    axes.set_xscale("log")
    for row, entry in enumerate(entries):
        p95 = float(np.percentile(_sizes(entry), 95.0))
        draw_size(axes, row, (entry.colour, entry.marker), entry.mean_um, entry.max_um, mark, p95)
    axes.set_yticks(range(len(entries)), [entry.label for entry in entries], weight="bold")
    axes.set_ylim(len(entries) - 0.5, -0.7)
    low, high = min(e.mean_um for e in entries), max(e.max_um for e in entries)
    axes.set_xlim(max(low, _LEAST_UM) / 3.0, max(high, _LEAST_UM) * 2.5)
    plain_decades(axes.xaxis)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="y", visible=False)


def draw_size(
    axes: Any,
    row: int,
    look: tuple[str, str],
    mean: float,
    greatest: float,
    mark: float = 1.0,
    p95: float | None = None,
) -> None:
    """A row of a logarithmic picture of errors in um: marker mean, bar 95 %, tip max. `look`: colour and marker."""
    colour, marker = look
    left, right = max(mean, _LEAST_UM), max(greatest, _LEAST_UM)
    axes.plot([left, right], [row, row], color=colour, alpha=0.35, lw=5.0 * mark, solid_capstyle="butt")
    axes.plot(left, row, marker, color=colour, ms=9 * mark)
    if p95 is not None:
        axes.plot(max(p95, _LEAST_UM), row, "|", color=colour, ms=13 * mark, mew=2.0 * mark)
    axes.plot(right, row, ">", color=colour, ms=7 * mark)
    axes.annotate(number(mean), (left, row), (0, 8 * mark), textcoords="offset points", ha="center", weight="bold")
    axes.annotate(number(greatest), (right, row), (7, -3), textcoords="offset points")


def where(entries: Sequence[Entry]) -> Figure:
    """The path and on it the point of the greatest error of every controller."""
    figure = Figure(figsize=(5.6, 4.8), layout="constrained")
    axes = figure.add_subplot()
    _path(axes, _longest(entries), color=INK, lw=1.1)
    for i, entry in enumerate(entries):
        summary = entry.summary
        if summary.worst_x_mm is None or summary.worst_y_mm is None:
            continue
        label = f"{entry.label} {number(entry.max_um)} µm"
        axes.plot(summary.worst_x_mm, summary.worst_y_mm, entry.marker, ms=8 + 2.5 * i, mfc="none", mec=entry.colour,
                  mew=2.0, clip_on=False, zorder=10 - i, label=label)  # fmt: skip
    axes.set_xlabel("x, mm")
    axes.set_ylabel("y, mm")
    axes.set_aspect("equal")
    axes.margins(0.06)
    legend = figure.legend(loc="outside lower center", ncols=3, handletextpad=0.4, columnspacing=1.6)
    for line in legend.get_lines():
        line.set_markersize(8)
    return figure


def magnified(entries: Sequence[Entry]) -> Figure:
    """Two rows of pictures of the path with the error drawn on it along the normal: all at the scale of the worst
    controller, and each at a scale of its own. The scale stands over each picture."""
    rows = 1 if len(entries) == 1 else 2
    longest = _longest(entries)
    size = _extent(longest)
    ratio = (size[1] + 0.5 * max(size)) / (size[0] + 0.3 * max(size))
    height = min(11.2 / len(entries) * ratio, 4.2 if rows == 1 else 3.4)
    figure = Figure(figsize=(11.2, rows * (height + 0.3)), layout="constrained")
    grid = figure.subplots(rows, len(entries), squeeze=False)
    common = _scale(entries, size)
    for axes, entry in zip(grid[0], entries, strict=True):
        _magnified_panel(axes, entry, longest, common)
    for axes, entry in zip(grid[-1], entries, strict=True):
        _magnified_panel(axes, entry, longest, _scale([entry], size))
    return figure


def over_time(entries: Sequence[Entry]) -> Figure:
    """The error over time, a row for each controller: left all at one scale, right each at its own."""
    columns = 1 if len(entries) == 1 else 2
    figure = Figure(figsize=(11.2, 0.6 + 1.25 * len(entries)), layout="constrained")
    panels = figure.subplots(len(entries), columns, sharex=True, squeeze=False)
    greatest = max(entry.max_um for entry in entries)
    for row, entry in zip(panels, entries, strict=True):
        for axes, limit in zip(row[::-1], (entry.max_um, greatest), strict=False):
            _error_panel(axes, entry, limit)
        row[0].set_ylabel("µm")
    titles = ("one scale", "each at its own scale") if columns == 2 else ("",)
    for axes, entry, text in ((panels[i, j], e, t) for i, e in enumerate(entries) for j, t in enumerate(titles)):
        summary = entry.summary
        axes.set_title(f"{entry.label}, {text}" if text == titles[0] and text else
                       f"{entry.label}: mean {number(entry.mean_um)}, max {number(entry.max_um)} µm "
                       f"at {summary.worst_time_s:.2f} s", pad=3.0, weight="bold")  # fmt: skip
    time_axes(panels[-1], entries)
    return figure


def _error_panel(axes: Any, entry: Entry, limit: float) -> None:
    summary = entry.summary
    time_s = entry.log.columns["time_s"]
    keep = thinned(time_s, entry.error_um)
    axes.plot(time_s[keep], entry.error_um[keep], color=entry.colour, lw=0.8)
    sign = np.sign(entry.error_um[np.argmin(np.abs(time_s - summary.worst_time_s))]) or 1.0
    axes.plot(summary.worst_time_s, sign * entry.max_um, "o", ms=7, mfc="none", mec=INK, mew=1.0, clip_on=False,
              zorder=5)  # fmt: skip
    if summary.from_s > time_s[0]:
        axes.axvspan(time_s[0], summary.from_s, color="#eef0f3", zorder=0)
    axes.set_ylim(-1.15 * max(limit, _LEAST_UM), 1.15 * max(limit, _LEAST_UM))
    axes.yaxis.set_major_locator(MaxNLocator(4, symmetric=True))


def time_axes(panels: Any, entries: Sequence[Entry]) -> None:
    first = min(float(entry.log.columns["time_s"][0]) for entry in entries)
    last = max(float(entry.log.columns["time_s"][-1]) for entry in entries)
    beside = 0.005 * max(last - first, 1e-3)
    for axes in panels:
        axes.set_xlabel("time, s")
        axes.set_xlim(first - beside, last + beside)


def forces(entries: Sequence[Entry]) -> Figure | None:
    """Force of both axes over time, a row for each controller. None: no log has forces."""
    entries = [entry for entry in entries if _known(entry, "force_x_N", "force_y_N")]
    if not entries:
        return None
    figure = Figure(figsize=(11.2, 0.6 + 0.95 * len(entries)), layout="constrained")
    panels = figure.subplots(len(entries), 2, sharex=True, sharey=True, squeeze=False)
    for row, entry in zip(panels, entries, strict=True):
        for axes, axis in zip(row, "xy", strict=True):
            _signal(axes, entry, f"force_{axis}_N", lw=0.6)
            axes.set_title(f"{entry.label}, {axis}", pad=2.0)
        row[0].set_ylabel("N")
    time_axes(panels[-1], entries)
    return figure


def gains(entries: Sequence[Entry]) -> Figure | None:
    """Adaptive gains over time, of the controllers that use them. None: of no run here."""
    quantities = (
        ("adaptive_gain_{}_per_s", "adaptive gain k̂, 1/s", ("track", "cc", "ccu")),
        ("switching_gain_{}_mps2", "switching gain µ, m/s²", ("ccu",)),
    )
    shown = []
    for name, text, users in quantities:
        using = [e for e in entries if e.log.meta["controller"] in users and _known(e, name.format(1), name.format(2))]
        if using:
            shown.append((name, text, using))
    if not shown:
        return None
    figure = Figure(figsize=(11.2, 0.5 + 1.9 * len(shown)), layout="constrained")
    panels = figure.subplots(len(shown), 2, sharex=True, sharey="row", squeeze=False)
    for row, (name, text, adapting) in zip(panels, shown, strict=True):
        for axes, index, direction in zip(row, (1, 2), ("along the path", "across the path"), strict=True):
            for entry in adapting:
                _signal(axes, entry, name.format(index), label=entry.label)
            axes.set_title(f"{text.split(',')[0]} {direction}", pad=2.0)
        row[0].set_ylabel(text)
        row[1].legend(loc="upper right", ncols=len(adapting))
    time_axes(panels[-1], entries)
    return figure


def energy(entries: Sequence[Entry]) -> Figure | None:
    """Energy of both axes over time, and what each controller took more than the most frugal one. None: not logged."""
    entries = [entry for entry in entries if entry.summary.energy_J is not None]
    if not entries:
        return None
    figure = Figure(figsize=(11.2, 2.5), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.0))
    for entry in entries:
        known = np.flatnonzero(np.isfinite(entry.log.columns["energy_J"]))
        joule = entry.log.columns["energy_J"][known]
        few = np.unique(np.linspace(0, len(known) - 1, 2 * _STRETCHES).astype(int))
        left.plot(entry.log.columns["time_s"][known][few], (joule - joule[0])[few], color=entry.colour,
                  label=entry.label)  # fmt: skip
    time_axes([left], entries)
    left.set_ylabel("energy, J")
    left.legend(loc="upper left")
    totals = np.array([entry.summary.energy_J for entry in entries], dtype=float)
    least = float(np.min(totals))
    more = (totals / least - 1.0) * 100.0 if least > 0.0 else totals * 0.0
    for row, entry in enumerate(entries):
        right.plot([0.0, more[row]], [row, row], color=entry.colour, lw=5.0, alpha=0.35, solid_capstyle="butt")
        right.plot(more[row], row, entry.marker, color=entry.colour, ms=8)
        share = f"+{more[row]:.2f} %" if more[row] > 0.0 else "least"
        right.annotate(f"{number(entry.summary.energy_J)} J, {share}", (more[row], row), (9, -3),
                       textcoords="offset points")  # fmt: skip
    right.set_yticks(range(len(entries)), [entry.label for entry in entries], weight="bold")
    right.set_ylim(len(entries) - 0.5, -0.5)
    right.set_xlim(0.0, max(1.0, float(np.max(more))) * 1.5)
    right.tick_params(axis="y", length=0)
    right.grid(axis="y", visible=False)
    right.set_xlabel("energy more than the least, %")
    return figure


def overview(entries: Sequence[Entry]) -> Figure:
    """One picture for a page that has room for one: sizes of the errors, and the errors of two runs on the path."""
    best = entries[0]
    other = next((e for e in entries if e.log.meta["controller"] == "cascade"), entries[-1])
    shown = [best] if other is best else [other, best]
    longest = _longest(entries)
    scale = _scale(shown, _extent(longest))
    figure = Figure(figsize=(11.2, 3.6), layout="constrained")
    panels = figure.subplots(1, 1 + len(shown), width_ratios=[1.2, *([1.0] * len(shown))])
    draw_sizes(panels[0], entries)
    panels[0].set_xlabel(f"{error_name(entries)}, µm (log): marker mean, bar 95 %, tip max")
    for axes, entry in zip(panels[1:], shown, strict=True):
        _magnified_panel(axes, entry, longest, scale)
    return figure


def thinned(time_s: Array, values: Array, stretches: int = _STRETCHES) -> NDArray[np.intp]:
    """Rows to draw: the smallest and the greatest value of each stretch of time, in order; a stretch without a known
    value keeps one row, so that a gap stays a gap."""
    edges = np.linspace(time_s[0], time_s[-1], stretches + 1)[1:-1]
    starts = np.unique(np.concatenate([[0], np.searchsorted(time_s, edges)]))
    starts = starts[starts < len(time_s)]
    keep = [0, len(time_s) - 1]
    for first, last in zip(starts, [*starts[1:], len(time_s)], strict=True):
        stretch = values[first:last]
        if np.all(np.isnan(stretch)):
            keep.append(int(first))
        else:
            keep += [int(first + np.nanargmin(stretch)), int(first + np.nanargmax(stretch))]
    return np.unique(np.array(keep, dtype=np.intp))


def _magnified_panel(axes: Any, entry: Entry, longest: RunLog, scale: int) -> None:
    """The path of the log `longest`, the error on it, magnified `scale` times, and a bar that shows the scale in µm."""
    _path(axes, longest, color=PATH, lw=1.4)
    columns = entry.log.columns
    x, y = columns["reference_x_mm"], columns["reference_y_mm"]
    drawn = (columns["time_s"] >= entry.summary.from_s) & ~_rapid(entry.log)
    error = np.where(drawn, entry.error_um, np.nan)
    keep = thinned(columns["time_s"], error)
    normal = _normal(x, y)
    away = scale * error * 1e-3
    axes.plot((x + away * normal[0])[keep], (y + away * normal[1])[keep], color=entry.colour, lw=0.8)

    x, y = longest.columns["reference_x_mm"], longest.columns["reference_y_mm"]
    size = max(_extent(longest))
    left, low = float(np.min(x)), float(np.min(y))
    bar_um = nice(0.25 * size * 1e3 / scale)
    bar_y = low - 0.27 * size
    axes.plot([left, left + bar_um * 1e-3 * scale], [bar_y, bar_y], color=INK, lw=1.6, solid_capstyle="butt")
    axes.annotate(f"{bar_um:g} µm", (left + bar_um * 1e-3 * scale, bar_y), (5, -3), textcoords="offset points")
    axes.set_xlim(left - 0.15 * size, float(np.max(x)) + 0.15 * size)
    axes.set_ylim(low - 0.35 * size, float(np.max(y)) + 0.15 * size)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title(f"{entry.label}, error {_TIMES}{scale:,}", weight="bold", loc="center", pad=2.0)


def _path(axes: Any, log: RunLog, **line: Any) -> None:
    """Feed moves as a line, rapid moves thin and dashed."""
    x, y = log.columns["reference_x_mm"], log.columns["reference_y_mm"]
    rapid = _rapid(log)
    axes.plot(np.where(rapid, np.nan, x), y, **line)
    axes.plot(np.where(rapid, x, np.nan), y, color=FAINT, lw=0.6, ls=(0, (4, 3)))


def _rapid(log: RunLog) -> NDArray[np.bool_]:
    rapid = log.columns.get("rapid")
    return np.zeros(len(log), dtype=np.bool_) if rapid is None else rapid > 0.0


def _signal(axes: Any, entry: Entry, name: str, **line: Any) -> None:
    values = entry.log.columns[name]
    known = np.flatnonzero(np.isfinite(values))  # slower signals have a value in some rows only
    time_s, values = entry.log.columns["time_s"][known], values[known]
    keep = thinned(time_s, values)
    axes.plot(time_s[keep], values[keep], color=entry.colour, **line)
    axes.yaxis.set_major_locator(MaxNLocator(4))


def _known(entry: Entry, *names: str) -> bool:
    return all(name in entry.log.columns and np.any(np.isfinite(entry.log.columns[name])) for name in names)


def _scored(entry: Entry, values: Array) -> Array:
    known = np.isfinite(values)
    scored = known & (entry.log.columns["time_s"] >= entry.summary.from_s)
    return values[scored if np.any(scored) else known]


def _sizes(entry: Entry) -> Array:
    """Sizes of the error that are evenly spaced in time, so that shares of time can be counted by them."""
    even = entry.log.even
    return np.abs(_scored(entry, entry.error_um if even is None else np.where(even, entry.error_um, np.nan)))


def error_name(entries: Sequence[Entry]) -> str:
    return "true contour error" if all(entry.summary.truth for entry in entries) else "contour error (estimate)"


def _longest(entries: Sequence[Entry]) -> RunLog:
    """The log with the most rows: its references are the path as far as any run got."""
    return max((entry.log for entry in entries), key=len)


def _extent(log: RunLog) -> tuple[float, float]:
    x, y = log.columns["reference_x_mm"], log.columns["reference_y_mm"]
    longest = max(float(np.ptp(x)), float(np.ptp(y)), 1e-6)
    return max(float(np.ptp(x)), 1e-3 * longest), max(float(np.ptp(y)), 1e-3 * longest)


def _scale(entries: Sequence[Entry], size: tuple[float, float]) -> int:
    """How many times to draw the errors of `entries` so that their greatest covers an eighth of the path's size."""
    greatest_um = max(float(np.max(np.abs(_scored(entry, entry.error_um)))) for entry in entries)
    return max(1, int(nice(0.125 * max(size) * 1e3 / max(greatest_um, _LEAST_UM))))


def nice(value: float) -> float:
    """The greatest of 1, 2, 5 times a power of ten that is not above `value`."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step for step in (1.0, 2.0, 5.0) if step * power <= value * (1.0 + 1e-9)) * power)


def _normal(x: Array, y: Array) -> Array:
    """Unit normal (2, n) to the left of the path; where the path rests it keeps the last direction."""
    if len(x) < 2:
        return np.stack([np.zeros_like(x), np.ones_like(y)])
    dx, dy = np.gradient(x), np.gradient(y)
    length = np.hypot(dx, dy)
    moving = length > 1e-7
    if not np.any(moving):
        return np.stack([np.zeros_like(x), np.ones_like(y)])
    last = np.maximum.accumulate(np.where(moving, np.arange(len(x)), np.argmax(moving)))
    return np.stack([-dy[last], dx[last]]) / length[last]
