# SPDX-License-Identifier: Apache-2.0
"""The section of a report to look closer, in a browser: time and place are linked, and values are those of the log."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from browsers import Tab, problems_of
from made_runs import made_run

from kontur.report import closer
from kontur.report.page import write_report
from kontur.runs.log import RunLog

_BOX = "(b => [b.x, b.y])(document.getElementById('{}').getBoundingClientRect())"


class Report:
    """A report in a browser, with its pictures in view."""

    def __init__(self, tab: Tab, folder: Path, runs: list[RunLog]) -> None:
        self.tab, self.file = tab, folder / "report.html"
        write_report(self.file, runs)
        tab.open(self.file.as_uri())
        tab.wait("window.kontur && kontur.ready")
        tab.value("document.getElementById('closer').scrollIntoView(), 1")

    def mouse(self, kind: str, canvas: str, x: float, y: float = 80.0, buttons: int = 0) -> None:
        """A mouse event at (x, y) pixels within a canvas."""
        left, top = self.tab.value(_BOX.format(canvas))
        button = "none" if kind == "mouseMoved" else "left"
        self.tab.call("Input.dispatchMouseEvent", type=kind, x=left + x, y=top + y, button=button, buttons=buttons,
                      clickCount=1)  # fmt: skip

    def at_time(self, time_s: float) -> float:
        """Pixels from the left of the picture over time."""
        return self.tab.value(
            "(t => { const c = document.getElementById('closer-time'); const { left, right } = c.frame;"
            "return left + (t - kontur.from) / (kontur.to - kontur.from) * (c.clientWidth - left - right) })"
            f"({time_s})"
        )

    def values(self) -> dict[str, list[str]]:
        """The cells of the table of values, by run."""
        rows = self.tab.value("[...document.querySelectorAll('#closer-values tr')].map(r => r.innerText.split('\\t'))")
        return {name: cells for name, *cells in rows}


@pytest.fixture(scope="module")
def runs() -> list[RunLog]:
    return [made_run("ccu", 0.05, 1.9, 1500), made_run("cascade", 0.5, -17.6, 2100)]


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tab]:
    with Tab(tmp_path_factory.mktemp("tab")) as tab:
        yield tab


@pytest.fixture
def report(tab: Tab, tmp_path: Path, runs: list[RunLog]) -> Iterator[Report]:
    yield Report(tab, tmp_path, runs)
    assert tab.log == []


def test_spike_in_time_is_seen_on_the_path_with_its_values(report: Report, runs: list[RunLog]) -> None:
    run = runs[1]
    peak = int(np.argmax(np.abs(run.columns["true_contour_error_um"])))
    time_s = run.columns["time_s"][peak]
    report.mouse("mouseMoved", "closer-time", report.at_time(time_s))
    at_s = report.tab.value("kontur.at")
    row = int(np.argmin(np.abs(run.columns["time_s"] - at_s)))
    assert abs(at_s - time_s) < 3.0 / 1000  # a pixel
    shown = report.values()["cascade"]
    for text, name, digits in zip(
        shown,
        ("true_contour_error_um", "true_tangential_error_um", "force_x_N", "force_y_N", "reference_x_mm",
         "reference_y_mm"),
        (3, 3, 1, 1, 4, 4),
        strict=True,
    ):  # fmt: skip
        assert float(text) == pytest.approx(run.columns[name][row], abs=0.51 * 10.0**-digits + 1e-3 * (digits == 3))
    assert report.tab.value("document.getElementById('closer-at').textContent") == f"t = {at_s:.3f} s"


def test_place_on_the_path_is_seen_in_time(report: Report, runs: list[RunLog]) -> None:
    columns = runs[0].columns
    x, y = (columns[f"reference_{axis}_mm"][700] for axis in "xy")
    at = report.tab.value(f"(f => [f.x({x}), f.y({y})])(document.getElementById('closer-path').frame)")
    report.tab.value("document.getElementById('closer-path').scrollIntoView(), 1")
    report.mouse("mouseMoved", "closer-path", *at)
    found_s = report.tab.value("kontur.at")
    row = int(np.argmin(np.abs(columns["time_s"] - found_s)))
    away_mm = np.hypot(columns["reference_x_mm"][row] - x, columns["reference_y_mm"][row] - y)
    extent_mm = max(np.ptp(columns["reference_x_mm"]), np.ptp(columns["reference_y_mm"]))
    assert away_mm < 0.01 * extent_mm


def test_dragging_zooms_and_the_button_shows_the_whole_run(report: Report) -> None:
    before = report.tab.value("[kontur.from, kontur.to]")
    report.mouse("mousePressed", "closer-time", report.at_time(1.0), buttons=1)
    report.mouse("mouseMoved", "closer-time", report.at_time(1.2), buttons=1)
    report.mouse("mouseReleased", "closer-time", report.at_time(1.5))
    assert report.tab.value("[kontur.from, kontur.to]") == pytest.approx([1.0, 1.5], abs=0.005)
    report.tab.value("document.getElementById('closer-whole').click()")
    assert report.tab.value("[kontur.from, kontur.to]") == before


def test_controllers_are_switched_on_and_off(report: Report) -> None:
    report.mouse("mouseMoved", "closer-time", report.at_time(1.0))
    assert set(report.values()) == {"ccu", "cascade"}
    report.tab.value("document.querySelectorAll('#closer-runs input')[1].click()")
    assert set(report.values()) == {"ccu"}
    assert report.tab.value("document.getElementById('closer-scale').textContent") == "error × 1,000"


def test_other_signal_is_shown_with_its_unit(report: Report) -> None:
    choose = "(s => { s.value = 'force_x'; s.onchange() })(document.getElementById('closer-signal'))"
    report.tab.value(choose)
    assert report.tab.value("document.getElementById('closer-unit').textContent") == "N"


def test_names_from_outside_inject_nothing(tmp_path: Path) -> None:
    bad = "</script><img src=x onerror=alert(1)><!--"
    run = made_run("ccu")
    run = dataclasses.replace(run, meta=run.meta | {"controller": bad, "program": bad, "command": bad})
    with Tab(tmp_path) as tab:
        report = Report(tab, tmp_path, [run])
        report.mouse("mouseMoved", "closer-time", report.at_time(1.0))
        assert list(report.values()) == [bad]
        assert tab.value("[...document.images].filter(i => !i.src.startsWith('data:')).length") == 0
        tab.value("document.body.insertAdjacentHTML('beforeend', '<img src=data:x onerror=\"document.title=1\">')")
        blocked = tab.wait("1") and "Content Security Policy" in "".join(tab.log)
        assert tab.value("document.title") != "1"
        assert blocked


def test_long_runs_keep_the_greatest_error_and_the_page_stays_small() -> None:
    count = 200_000
    noise = np.random.default_rng(1).normal(size=(6, count))
    time_s = np.arange(count) * 1e-3
    noise[0, 123_456] = 77.7
    names = ("true_contour_error_um", "true_tangential_error_um", "force_x_N", "force_y_N")
    columns = dict(zip(names, noise, strict=False)) | {
        "tick": np.arange(count, dtype=float),
        "time_s": time_s,
        "tangential_error_um": noise[4],
        "contour_error_um": noise[5],
        "reference_x_mm": 50.0 * np.cos(time_s),
        "reference_y_mm": 50.0 * np.sin(time_s),
    }

    @dataclasses.dataclass
    class Summary:
        truth: bool = True

    @dataclasses.dataclass
    class Entry:
        log: RunLog
        summary: Summary
        label: str = "r"
        colour: str = "#000"
        error_um: np.ndarray = dataclasses.field(default_factory=lambda: noise[0])

    entries = [Entry(RunLog(made_run("ccu").meta, columns), Summary()) for _ in range(5)]
    section = closer.closer(entries)  # type: ignore[arg-type]
    assert len(section) < 1.8e6
    keep = closer.thinned(time_s, noise[0], closer.ROWS_MAX // 5 // 2 - 1)
    assert len(keep) <= closer.ROWS_MAX // 5
    assert 123_456 in keep


@pytest.mark.parametrize("width", [1280, 400])
def test_page_fits_its_window_without_network_or_error(tmp_path: Path, runs: list[RunLog], width: int) -> None:
    write_report(tmp_path / "report.html", runs)
    assert problems_of((tmp_path / "report.html").read_text(), tmp_path, width, pictures=7) == []
