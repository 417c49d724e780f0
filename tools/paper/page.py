# SPDX-License-Identifier: Apache-2.0
"""docs/paper.md from the results of kontur.experiments.paper. Every figure of a run in it is one of these results."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from kontur.drive.controllers import CONTROLLERS, DESCRIPTIONS
from kontur.errors import FileError
from kontur.experiments.circles import CASES
from kontur.experiments.estimator import BINS, LAG_M, PLANNED_SUFFIX, Cell, worst
from kontur.experiments.paper import (
    FACTORS,
    NOISE,
    NUMS,
    PAPER_CHANGE,
    PAPER_TABLE_2,
    Job,
    Outcome,
    Results,
    sensitivity_job,
    varied,
)
from kontur.report.figures import number
from paper import figures, words

IMAGES = Path("img/paper")
_SAME = 0.02  # relative change that is called none
_LITTLE = 0.2
_WORDS = {"track": "Track", "cc": "CC", "ccu": "CCU", "cascade": "P-PI cascade", "ccc": "the same, cross-coupled"}
_LONG = DESCRIPTIONS | _WORDS  # the paper's own words for its laws
_LEARNING = "CCU with learned feedforward"
_COLUMNS = ("e_n1_max_mm", "e_n2_max_mm", "e_n1_mean_mm", "e_n2_mean_mm")


def write(results: Results, file: Path) -> None:
    """Write the page to `file` and its pictures to img/paper beside it. Raises FileError."""
    try:
        folder = file.parent / IMAGES
        folder.mkdir(parents=True, exist_ok=True)
        shown = []
        for name, caption, png in figures.pictures(results):
            (folder / f"{name}.png").write_bytes(png)
            shown.append((name, caption))
        file.write_text(page(results, shown), "utf-8")
    except OSError as error:
        raise FileError(file, f"cannot be written ({error.strerror}); name a file in a folder that can") from error


def page(results: Results, shown: Iterable[tuple[str, str]]) -> str:
    """The whole page; `shown` are names and captions of the pictures."""
    parts = [words.HEAD, *_table_2(results), "## Figures 3 to 9\n"]
    parts += [f"**{caption}**\n\n![{caption}]({IMAGES.as_posix()}/{name}.png)\n" for name, caption in shown]
    parts += [*_printed(results), *_sensitivity(results), *_estimator(results), *_made(results)]
    return "\n".join(parts)


# --- Table 2 ----------------------------------------------------------------------------------------------------------


def _table_2(results: Results) -> Iterator[str]:
    yield "## Table 2\n"
    yield (
        "Errors in mm by the drive's own estimate, as in the paper; the energy; and what the paper does not have: the "
        "true contour error in µm, the distance of the plant's true position to the circle.\n"
    )
    for case in results.cases:
        yield f"**{_circle(case)}**\n"
        head = ("", "max e_n1", "max e_n2", "mean e_n1", "mean e_n2", "energy", "true mean", "true max")
        rows: list[Sequence[str]] = []
        for name in CONTROLLERS:
            if case == "low" and name in PAPER_TABLE_2:
                *errors, energy = PAPER_TABLE_2[name]
                rows.append(
                    (f"*paper: {_LONG[name]}*", *(f"*{v:.4f}*" for v in errors), f"*{energy:.4f} µJ*", "–", "–")
                )
            rows.append((_LONG[name], *_table_2_cells(results.outcomes[Job(case, name)])))
            if name == "ccu":
                rows.append((_LEARNING, *_table_2_cells(results.outcomes[Job(case, learning=True)])))
        yield _table(head, rows)
        yield from _changes(results, case)


def _table_2_cells(outcome: Outcome) -> Sequence[str]:
    if outcome.fault is not None:
        return (f"**ended in a fault**: {_first(outcome.fault)}", *[""] * 6)
    values = outcome.figures
    errors = (number(values[name]) for name in _COLUMNS)
    return (*errors, f"{number(values['energy_J'])} J", f"{number(values['mean_um'])}", f"{number(values['max_um'])}")


def _changes(results: Results, case: str) -> Iterator[str]:
    cc, ccu = (results.outcomes[Job(case, name)].figures for name in ("cc", "ccu"))
    if not cc or not ccu:
        return
    ours = [(ccu[name] / cc[name] - 1.0) * 100.0 for name in ("e_n2_mean_mm", "e_n2_max_mm", "energy_J")]
    text = f"CC to CCU: mean e_n2 {ours[0]:+.2f} %, max e_n2 {ours[1]:+.2f} %, energy {ours[2]:+.2f} %"
    if case in PAPER_CHANGE:
        mean, greatest = PAPER_CHANGE[case]
        text += f"; the paper prints {mean:+.2f} % and {greatest:+.2f} %"
        text += "" if case == "low" else ", for a radius that it does not give"
    if case == "low":
        text += f", energy {(PAPER_TABLE_2['ccu'][4] / PAPER_TABLE_2['cc'][4] - 1.0) * 100.0:+.2f} %"
    yield text.replace("-", "−") + ".\n"


# --- the laws as printed ----------------------------------------------------------------------------------------------


def _printed(results: Results) -> Iterator[str]:
    if not results.variants:
        return
    yield words.PRINTED
    head = ("", *(f"{case}: mean / max µm, step N, J" for case in results.cases))
    shipped = (_cell(results.outcomes[Job(case, learning=True)]) for case in results.cases)
    rows: list[Sequence[str]] = [(_LEARNING, *shipped)]
    bases: list[tuple[str, object]] = []
    for v in results.variants:
        if (v.controller, v.base) not in bases:
            bases.append((v.controller, v.base))
            name = f"**{v.controller}, ours**" + (f", k̄ as in “{v.name}”" if v.base else "")
            rows.append((name, *(_cell(results.outcomes[Job(case, v.controller, v.base)]) for case in results.cases)))
        cells = (_cell(results.outcomes[Job(case, v.controller, v.parameters)]) for case in results.cases)
        rows.append((f"{v.controller}: {v.name}", *cells))
    yield _table(head, rows)
    yield "What is seen, each against ours under the same controller:\n"
    for v in results.variants:
        pairs = [
            (
                case,
                results.outcomes[Job(case, v.controller, v.base)],
                results.outcomes[Job(case, v.controller, v.parameters)],
            )
            for case in results.cases
        ]
        yield f"- **{v.name}**, {v.controller}: {_seen(pairs)} Why: {v.why}."
    yield words.NOT_SHOWN


def _cell(outcome: Outcome) -> str:
    if outcome.fault is not None:
        return f"**ended in a fault**: {_first(outcome.fault)}"
    v = outcome.figures
    return f"{number(v['mean_um'])} / {number(v['max_um'])}, {number(v['force_step_N'])}, {number(v['energy_J'])}"


def _seen(pairs: Sequence[tuple[str, Outcome, Outcome]]) -> str:
    """One sentence: where it faults, else how mean error, max error, force step and energy change."""
    faults = [case for case, base, other in pairs if base.fault is not None or other.fault is not None]
    if faults:
        return f"**does not run**: {', '.join(faults)} ends in a fault."
    parts, most = [], 0.0
    for key, text in (
        ("mean_um", "mean error"),
        ("max_um", "max error"),
        ("force_step_N", "force step"),
        ("energy_J", "energy"),
    ):
        ratios = [other.figures[key] / base.figures[key] for _, base, other in pairs]
        change = max(abs(r - 1.0) for r in ratios)
        most = max(most, change)
        if change > _SAME:
            parts.append(f"{text} {_range(ratios)}")
    if not parts:
        return f"no matter here: all within {_SAME * 100:.0f} %."
    return f"{'**it matters**' if most > _LITTLE else 'it matters little'}: {', '.join(parts)}."


def _range(ratios: Sequence[float]) -> str:
    low, high = number(min(ratios)), number(max(ratios))
    return f"×{low}" if low == high else f"×{low} to ×{high}"


# --- values that the paper does not give ------------------------------------------------------------------------------


def _sensitivity(results: Results) -> Iterator[str]:
    if not results.sensitivities:
        return
    yield words.SENSITIVITY
    head = ("", "chosen", "", *(f"{case}: mean / max µm, step N" for case in results.cases), "mean error")
    base = [results.outcomes[Job(case)] for case in results.cases]
    rows: list[Sequence[str]] = [("**as chosen**", "", "", *(_short(outcome) for outcome in base), "")]
    for name in results.sensitivities:
        for factor in FACTORS:
            jobs = [sensitivity_job(case, name, factor, results.defaults) for case in results.cases]
            outcomes = [results.outcomes[job] for job in jobs]
            pairs = zip(base, outcomes, strict=True)
            ratios = [b.figures["mean_um"] / a.figures["mean_um"] for a, b in pairs if a.figures and b.figures]
            what = f"×{factor:g}"
            if name != NOISE:
                along = [other for other, _ in varied(name, factor, results.defaults) if other != name]
                what += "".join(f", {other.split('.')[1]} along" for other in along)
            change = "same" if all(abs(r - 1.0) <= _SAME for r in ratios) else _range(ratios)
            chosen = _chosen(results, name)
            first = factor == FACTORS[0]
            cells = (_short(outcome) for outcome in outcomes)
            rows.append((name if first else "", chosen if first else "", what, *cells, change if ratios else "–"))
    yield _table(head, rows)


def _chosen(results: Results, name: str) -> str:
    if name == NOISE:
        noise = {axis.force_noise_N for axis in results.target.machine.axes}
        return f"{' and '.join(f'{value:g}' for value in sorted(noise))} N"
    return f"{results.defaults[name]:g}"


def _short(outcome: Outcome) -> str:
    if outcome.fault is not None:
        return f"*{_first(outcome.fault)}*"
    v = outcome.figures
    return f"{number(v['mean_um'])} / {number(v['max_um'])}, {number(v['force_step_N'])}"


# --- estimator --------------------------------------------------------------------------------------------------------


def _estimator(results: Results) -> Iterator[str]:
    greatest = ", ".join(f"{number(worst(results.cells[name]))} nm ({name})" for name in NUMS)
    yield words.ESTIMATOR.format(greatest=greatest)
    bins = ["≤ 0.05", "≤ 0.1", "≤ 0.2", "> 0.2"]
    drive_ms = results.defaults["contour.lag_max"]
    head = ("curve", "mm/s", *(f"lag/radius {text}" for text in bins), f"in the drive, lag over {drive_ms:g} ms")
    by_row: dict[tuple[str, float], dict[str, list[Cell]]] = {}
    for name in NUMS:
        for cell in results.cells[name]:
            by_row.setdefault((cell.curve, cell.speed_mps), {}).setdefault(name, []).append(cell)
    rows = []
    for (curve, speed_mps), cells in by_row.items():
        texts = []
        for f32, fix in zip(*(cells[name] for name in NUMS), strict=True):
            values = (f32.newton_nm, fix.newton_nm, f32.paper_nm)
            texts.append(" · ".join(f"{v:.2f}" if v < 10.0 else f"{v:.0f}" for v in values) if f32.rows else "–")
        drive = [cell.drive_nm for cell in cells[NUMS[0]] if cell.rows and cell.lag_over_radius <= 0.2]
        over = speed_mps * drive_ms * 1e-3 < LAG_M and not curve.endswith(PLANNED_SUFFIX)
        rows.append((curve, f"{speed_mps * 1e3:g}", *texts, _length(max(drive)) if over else "none"))
    assert len(bins) == len(BINS)
    yield _table(head, rows)
    off = ", ".join(
        f"{curve} {number(nm)} nm" for curve, nm in results.spline_nm.items() if not curve.endswith(PLANNED_SUFFIX)
    )
    yield f"Not part of the above: how far the spline, through one sample a ms, leaves the ideal curve: {off}.\n"


def _length(nm: float) -> str:
    return f"{nm:.2f} nm" if nm < 1000.0 else f"{number(nm * 1e-3)} µm"


# --- how it was made --------------------------------------------------------------------------------------------------


def _made(results: Results) -> Iterator[str]:
    yield "## How this page was made\n"
    yield "- Command: `python tools/paper_page.py docs/paper.md`."
    yield f"- Machine: {results.target.machine.name} (`host/kontur/machines`), simulated; seed {results.target.seed}."
    yield f"- Numeric back end: {results.num}; the estimator's table: {', '.join(NUMS)}."
    yield f"- Firmware build: {results.build}\n"


def _first(fault: str) -> str:
    """A message without its advice."""
    return fault.split(";")[0]


def _circle(case: str) -> str:
    c = CASES[case]
    scored = f", scored from {c.score_from_s:g} s on" if c.score_from_s else ""
    return f"{case}: {c.feed_mps * 1e3:g} mm/s, r {c.radius_m * 1e3:g} mm{scored}"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
