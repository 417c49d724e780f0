# SPDX-License-Identifier: Apache-2.0
"""The report of one or more runs of the same path: one HTML file that needs nothing else, and a picture for a README.

Everything in it comes from the logs, so a report made right after a run and one made from its files are the same.
"""

from __future__ import annotations

import io
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from kontur.errors import LogError, visible
from kontur.files import write_atomically
from kontur.report import column, figures
from kontur.report.closer import closer, script_hash
from kontur.report.figures import Entry, number
from kontur.report.sheet import document, pictured
from kontur.runs.log import RunLog
from kontur.runs.summary import ALIKE_PERCENT, TRACKING, Summary, summarise, tracking

_COLUMNS = (  # key of Summary, heading, unit
    ("mean_um", "mean", "µm"),
    ("rms_um", "rms", "µm"),
    ("max_um", "max", "µm"),
    ("tangential_mean_um", "along the path, mean", "µm"),
    ("energy_J", "energy", "J"),
    ("force_max_N", "max force", "N"),
    ("force_step_N", "mean |Δu| a step", "N"),
    ("frames_lost", "frames lost", ""),
)


def write_report(
    path: str | Path, runs: Sequence[RunLog], title: str | None = None, command: str | None = None
) -> None:
    """Write one self-contained HTML file about `runs` of one path, the best first. `command` makes it again; by
    default the commands of the runs are given.

    Raises LogError: no run, runs of different trajectories; FileError.
    """
    entries = _entries(runs)
    title = title or f"Contour report: {entries[0].log.meta['program']}"
    write_atomically(Path(path), visible(_page(entries, title, command)).encode())


def commands_of(runs: Sequence[RunLog]) -> list[str]:
    """The commands that make `runs` again, as far as their logs know them, each once."""
    return list(dict.fromkeys(str(run.meta["command"]) for run in runs if run.meta.get("command")))


def picture(path: str | Path, runs: Sequence[RunLog]) -> None:
    """Write one picture that shows the answer of a report.

    PNG: how large the errors are, and the error drawn on the path. SVG and PDF: the errors over time and their sizes,
    in the size of a column of a paper. Raises LogError: no run, runs of different trajectories; FileError.
    """
    entries = [entry for entry in _entries(runs) if entry.summary.scored]
    if not entries:
        raise LogError("no axis has moved along the path in these logs, so there is no error to draw")
    form = Path(path).suffix.lower()[1:]
    if form != "png":
        with column.column_style():
            write_atomically(Path(path), column.as_file(column.for_column(entries), form))
        return
    if not _has_path(entries):
        raise LogError("the logs do not have the path (reference_x_mm, reference_y_mm), so there is nothing to draw on")
    with figures.style():
        out = io.BytesIO()
        figures.overview(entries).savefig(out, format="png", dpi=160, metadata={"Software": None})
    write_atomically(Path(path), out.getvalue())


def _entries(runs: Sequence[RunLog]) -> list[Entry]:
    if not runs:
        raise LogError("a report needs at least one log")
    first = runs[0]
    for run in runs[1:]:
        for key in ("program", "trajectory"):
            if run.meta.get(key) != first.meta.get(key):
                raise LogError(
                    f"{run.meta['controller']} ran another {key} ({run.meta.get(key)}) than {first.meta['controller']} "
                    f"({first.meta.get(key)}); only runs of the same path can be compared"
                )
    controllers = [visible(run.meta["controller"]) for run in runs]
    summaries = [summarise(run) for run in runs]
    labels = _labels(runs, controllers)
    if not all(summary.same_part(summaries[0]) for summary in summaries):
        labels = [f"{label}, {s.part}" if s.part else label for label, s in zip(labels, summaries, strict=True)]
    most = max(_percent(summary) for summary in summaries)

    def rank(entry: Entry) -> tuple[bool, bool, bool, float, float]:
        """Smallest mean error first; before others a run that moved and is complete, a true error, more of the path."""
        less = most - _percent(entry.summary)
        return *_kept_apart(entry), less if less > ALIKE_PERCENT else 0.0, entry.mean_um

    named = zip(runs, summaries, labels, figures.looks(controllers), strict=True)
    return sorted((Entry(run, summary, label, *look) for run, summary, label, look in named), key=rank)


def _percent(summary: Summary) -> float:
    return 100.0 if summary.path_percent is None else summary.path_percent


def _kept_apart(entry: Entry) -> tuple[bool, bool, bool]:
    return not entry.summary.scored, not _complete(entry), not entry.summary.truth


def _has_path(entries: Sequence[Entry]) -> bool:
    names = ("reference_x_mm", "reference_y_mm")
    return all(name in e.log.columns and np.all(np.isfinite(e.log.columns[name])) for e in entries for name in names)


def _labels(runs: Sequence[RunLog], controllers: Sequence[str]) -> list[str]:
    """The controller; where it ran more than once with its seed, back end, what it was told, or number."""
    labels = list(controllers)
    for key in ("seed", "num", "told", "compensation"):
        twice = Counter(labels)
        values = [run.meta.get(key) for run in runs]
        if len(set(map(str, values))) > 1:
            labels = [f"{label}, {key} {value}" if twice[label] > 1 else label
                      for label, value in zip(labels, values, strict=True)]  # fmt: skip
    twice = Counter(labels)
    return [f"{label} #{labels[: i + 1].count(label)}" if twice[label] > 1 else label for i, label in enumerate(labels)]


def _page(entries: Sequence[Entry], title: str, command: str | None) -> str:
    with figures.style():
        pictures = "\n".join(_pictures(entries))
    scored = [entry for entry in entries if entry.summary.scored]
    look = closer(scored) if scored and _has_path(scored) else ""
    content = f"{_table(entries)}\n{look}\n{pictures}\n{_measured(entries, command)}"
    return document(title, _answer(entries), content, script_hash())


def _comparable(entries: Sequence[Entry]) -> list[Entry]:
    """The runs that may be compared with the first: of the same part of the path, as complete, and known as well."""
    first = entries[0]
    return [e for e in entries if _kept_apart(e) == _kept_apart(first) and e.summary.same_part(first.summary)]


_MEASURES = {"mean_um": "mean", "rms_um": "rms", "max_um": "max"}


def _by(entries: Sequence[Entry], measure: str) -> list[Entry]:
    """`entries`, the least error first."""
    return sorted(entries, key=lambda entry: _value(entry, measure))


def _value(entry: Entry, measure: str) -> float:
    return float(getattr(entry.summary, measure) or 0.0)


def _best(entries: Sequence[Entry]) -> Entry | None:
    """The run that is best by mean, rms and max of those that may be compared; None: there is none, or one run only."""
    first, *others = _comparable(entries)
    if not others or not first.summary.scored:
        return None
    return first if all(_value(first, m) <= _value(e, m) for e in others for m in _MEASURES) else None


def _answer(entries: Sequence[Entry]) -> str:
    compared = _comparable(entries)
    best, *others = compared
    summary = best.summary
    if not summary.scored:
        return "No axis has moved along the path, so there is no error of it."
    mean = f"<b>{number(summary.mean_um)} µm</b>"
    kind = "off the programmed path on average" if summary.truth else "off the path on average by the drive's estimate"
    if _best(entries):
        other = next((e for e in others if e.log.meta["controller"] == "cascade"), others[0])
        times = {m: _value(other, m) / _value(best, m) if _value(best, m) > 0.0 else float("inf") for m in _MEASURES}
        text = (f"<b>{escape(best.label)}</b> keeps closest to the path: {mean} {kind}, "
                f"{number(times['mean_um'])} times closer than {escape(other.label)} "
                f"({number(other.summary.mean_um)} µm), {number(times['rms_um'])} times by rms and "
                f"{number(times['max_um'])} times by max.")  # fmt: skip
    elif others:
        text = "Which run keeps closest to the path depends on the measure."
        for measure, name in _MEASURES.items():
            least, second, *_ = _by(compared, measure)
            text += (f" By {name} it is <b>{escape(least.label)}</b>: <b>{number(_value(least, measure))} µm</b>, "
                     f"before {escape(second.label)} with {number(_value(second, measure))} µm.")  # fmt: skip
    else:
        text = f"<b>{escape(best.label)}</b> was {mean} {kind}."
    if _best(entries) or not others:
        text += (f" Its worst point is <b>{number(summary.max_um)} µm</b> off, at t = {summary.worst_time_s:.2f} s"
                 f"{_place(summary)}.")  # fmt: skip
    left_out = [e for e in entries if e is not best and e not in others]
    if left_out:
        text += f" Not compared, for the reason in the table: {escape(', '.join(e.label for e in left_out))}."
    if summary.part or not _complete(best):
        text += f" This holds for {summary.part or 'the part of the path that was run'}."
    return text


def _place(summary: Summary) -> str:
    if summary.worst_x_mm is None or summary.worst_y_mm is None:
        return ""
    return f", x = {summary.worst_x_mm:.3f} mm, y = {summary.worst_y_mm:.3f} mm"


def _short_place(summary: Summary) -> str:
    if summary.worst_x_mm is None or summary.worst_y_mm is None:
        return ""
    return f"<br>({summary.worst_x_mm:.2f}, {summary.worst_y_mm:.2f})"


def _table(entries: Sequence[Entry]) -> str:
    compared = _comparable(entries)
    least = {}
    for key, _, _ in _COLUMNS:
        values = [getattr(entry.summary, key) for entry in compared]
        least[key] = min((v for v in values if v is not None), default=None) if len(compared) > 1 else None
    body = []
    for entry in entries:
        best = entry is _best(entries)
        cells = [_name_cell(entry, best), f"<td>{number(entry.summary.path_percent)}</td>"]
        for key, _, _ in _COLUMNS:
            value = getattr(entry.summary, key)
            text = str(value) if isinstance(value, int) else number(value)
            mark = key != "frames_lost" and value is not None and value == least[key] and entry in compared
            cells.append(f"<td>{f'<b>{text}</b>' if mark else text}</td>")
            if key == "max_um":
                place = f"{entry.summary.worst_time_s:.2f} s{_short_place(entry.summary)}"
                cells.append(f'<td class="place">{place if entry.summary.scored else number(None)}</td>')
        body.append(f"<tr{' class=best' if best else ''}>{''.join(cells)}</tr>")
    heads = []
    for key, text, unit in _COLUMNS:
        heads.append(f'<th scope="col">{text}{f"<small>{unit}</small>" if unit else ""}</th>')
        if key == "max_um":
            heads.append('<th scope="col">where<small>t, (x, y) in mm</small></th>')
    kind = _kind(entries)
    group = _ERRORS[kind]
    bold = " Bold: least of its column." if len(compared) > 1 else ""
    return f"""<div class="scroll"><table class="scores">
<thead><tr><th scope="col" rowspan="2">controller</th><th scope="col" rowspan="2">path<small>%</small></th>
<th scope="colgroup" colspan="4" class="group">{group}</th>
<th colspan="5"></th></tr><tr>{"".join(heads)}</tr></thead>
<tbody>{"".join(body)}</tbody></table></div>
<p class="note">Means of absolute values, over the part of the path that the column <i>path</i> says.{bold}
{_NOTES[kind]}</p>"""


def _name_cell(entry: Entry, best: bool) -> str:
    badges = ['<span class="badge">best</span>'] if best else []
    if not _complete(entry):
        badges.append(
            f'<span class="badge warn">{entry.log.meta["status"]} at {entry.log.columns["time_s"][-1]:.2f} s</span>'
        )
    if not entry.summary.scored:
        badges.append('<span class="badge warn">did not move</span>')
    elif entry.summary.part:
        badges.append(f'<span class="badge warn">{entry.summary.part}</span>')
    if not entry.summary.truth:
        badges.append('<span class="badge warn">estimate</span>')
    return (f'<th scope="row"><svg class="key" viewBox="0 0 10 10" aria-hidden="true"><circle cx="5" cy="5" r="5" '
            f'fill="{entry.colour}"/></svg>{escape(entry.label)} {"".join(badges)}'
            f'<small>{escape(entry.long_name)}</small></th>')  # fmt: skip


_ERRORS = {
    "truth": "true contour error",
    "estimate": "contour error, estimate of the drive",
    "mixed": "contour error, true or estimated",
}
_NOTES = {
    "truth": "The true error is the distance of the simulated machine's true position to the programmed path, which "
    "neither the encoder nor the drive sees.",
    "estimate": "There is no truth on a real drive: the error is the drive's own estimate from its encoders, "
    "which does not see what the encoders do not see.",
    "mixed": "True errors and the drive's own estimates stand side by side here; the latter are marked and do not "
    "see what the encoders do not see.",
}


def _kind(entries: Sequence[Entry]) -> str:
    truths = {entry.summary.truth for entry in entries}
    return "mixed" if len(truths) > 1 else ("truth" if True in truths else "estimate")


def _pictures(entries: Sequence[Entry]) -> list[str]:
    everyone, entries = entries, [entry for entry in entries if entry.summary.scored]
    out = _error_pictures(entries) if entries else []
    for draw, heading, note in (
        (figures.forces, "Force", "Asked for by the drive."),
        (figures.gains, "Adaptive gains", "Of the controllers that use them."),
        (figures.energy, "Energy", "By the drive's energy model, both axes."),
    ):
        drawn = draw(everyone)
        if drawn is not None:
            out.append(pictured(drawn, heading, note, f"{heading} over time for {_names(everyone)}."))
    return out


def _names(entries: Sequence[Entry]) -> str:
    return ", ".join(entry.label for entry in entries)


def _error_pictures(entries: Sequence[Entry]) -> list[str]:
    """The pictures of the contour error, of runs that have one."""
    names = _names(entries)
    worst = "; ".join(f"{e.label} {number(e.summary.max_um)} µm{_place(e.summary)}" for e in entries)
    means = ", ".join(f"{e.label} {number(e.summary.mean_um)} µm" for e in entries)
    scales = ("the scale stands over each picture" if len(entries) == 1 else
              "upper row: one scale for all, to compare; lower row: each at its own scale, to see where")  # fmt: skip
    has_rapid = any(np.any(e.log.columns.get("rapid", 0.0)) for e in entries)
    rapid = " Rapid moves are dashed; they are scored like all others." if has_rapid else ""
    rapid_error = " On rapid moves it is not drawn." if has_rapid else ""
    has_path = _has_path(entries)
    out = [
        '<div class="pair">',
        pictured(
            figures.sizes(entries),
            "How good",
            "Marker: mean, bar: 95 % of the time below, tip: max.",
            f"Mean of the {_ERRORS[_kind(entries)]}: {means}.",
        ),
    ]
    if has_path:
        out.append(pictured(figures.where(entries), "Where it is worst", "The path, and on it the greatest error of "
                           "each run." + rapid, f"Path with the worst point of each run: {worst}."))  # fmt: skip
    out.append("</div>")
    if has_path:
        note = (f"The error is drawn from the path (grey) along its normal, magnified; {scales}. The bar shows how "
                f"long an error of that size is drawn.{rapid_error}")  # fmt: skip
        out.append(pictured(figures.magnified(entries), "The path with its error magnified", note,
                           f"Path with magnified {_ERRORS[_kind(entries)]} for {names}."))  # fmt: skip
    shaded = " What is shaded is not scored." if any(e.summary.from_s > 0.0 for e in entries) else ""
    sides = (
        "" if len(entries) == 1 else "Pictures on the left: one scale for all; on the right: each at its own scale. "
    )
    out.append(pictured(figures.over_time(entries), "Error over time", sides + "Left of the path is positive. The line "
                       "goes through the smallest and the greatest value of every stretch of time; the ring is the max."
                       + shaded, f"{_ERRORS[_kind(entries)].capitalize()} over time for {names}."))  # fmt: skip
    return out


def _measured(entries: Sequence[Entry], command: str | None) -> str:
    rows = [
        ("what", _NOTES[_kind(entries)]),
        ("program", _meta(entries, "program")),
        ("feed", _meta(entries, "feed")),
        ("path", _meta(entries, "smoothing")),
        ("switched", _meta(entries, "switched")),
        ("of the error, tracking", "; ".join(filter(None, map(_tracking, entries)))),
        ("trajectory", _meta(entries, "trajectory")),
        ("machine", _meta(entries, "machine")),
        ("the drive was told", _told(entries)),
        ("seed of the noise", _meta(entries, "seed")),
        ("firmware", _meta(entries, "firmware")),
        ("numbers", _meta(entries, "num")),
        ("control rate, Hz", _meta(entries, "control_hz")),
        ("knots refused", _meta(entries, "rejected")),
        ("scored from", ", ".join(sorted({f"{e.summary.from_s:g} s" for e in entries}))),
        ("part of the path", "; ".join(f"{e.label}: {e.summary.part or 'all of it'}" for e in entries)),
    ]
    commands = command or "\n".join(commands_of([entry.log for entry in entries]))
    if commands:
        rows.append(("make it again", commands))
    facts = "".join(
        f"<dt>{escape(name)}</dt><dd>{f'<pre>{escape(text)}</pre>' if name == 'make it again' else escape(text)}</dd>"
        for name, text in rows
        if text
    )
    tables = "".join(_differences(entries, key, text) for key, text in
                     (("plant", "Machine"), ("parameters", "Parameters of the drive")))  # fmt: skip
    return f'<section><h2>What was measured</h2><dl class="facts">{facts}</dl>{tables}</section>'


def _tracking(entry: Entry) -> str:
    """The error against the smoothed path, in words; empty where the path is not smoothed."""
    of = tracking(entry.log)
    if not of:
        return ""
    mean, rms, most = (f"{of[name]:.3g}" for name in TRACKING)
    return f"{entry.label}: mean {mean}, rms {rms}, max {most} µm off the smoothed path"


def _meta(entries: Sequence[Entry], key: str) -> str:
    """The value all runs share, or each run's own."""
    texts = [_text(entry.log.meta[key]) if key in entry.log.meta else "" for entry in entries]
    if len(set(texts)) == 1:
        return texts[0]
    return "; ".join(f"{entry.label}: {text or 'not known'}" for entry, text in zip(entries, texts, strict=True))


def _told(entries: Sequence[Entry]) -> str:
    what, of = _meta(entries, "told"), _meta(entries, "compensation")
    return f"{what}, compensation {of}" if of else what


def _differences(entries: Sequence[Entry], key: str, heading: str) -> str:
    """A table of the values under `key`; one column if all runs share them."""
    tables = [_flat(entry.log.meta.get(key) or {}) for entry in entries]
    names = list(dict.fromkeys(name for table in tables for name in table))
    if not names:
        return ""
    same = all(table == tables[0] for table in tables)
    shown = tables[:1] if same else tables
    heads = "" if same else "<tr><th></th>" + "".join(f"<th>{escape(e.label)}</th>" for e in entries) + "</tr>"
    body = "".join(
        f"<tr><th scope=row>{escape(name)}</th>"
        + "".join(f"<td>{escape(_text(table[name])) if name in table else number(None)}</td>" for table in shown)
        + "</tr>"
        for name in names
    )
    return (f'<details><summary>{escape(heading)}</summary><div class="scroll"><table class="values">{heads}{body}'
            f'</table></div></details>')  # fmt: skip


def _flat(table: Mapping[str, Any]) -> dict[str, Any]:
    """Tables within the table as `outer.inner` names."""
    flat: dict[str, Any] = {}
    for name, value in table.items():
        flat |= {f"{name}.{n}": v for n, v in _flat(value).items()} if isinstance(value, Mapping) else {name: value}
    return flat


def _text(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_text(inner)}" for name, inner in value.items())
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _complete(entry: Entry) -> bool:
    return bool(entry.log.meta["status"] == "complete")
