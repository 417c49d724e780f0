# SPDX-License-Identifier: Apache-2.0
"""Reports: their numbers, what stands on top in odd cases, that no peak is lost, and that a browser shows it all."""

from __future__ import annotations

import html
import re
from pathlib import Path

import numpy as np
import pytest
from browsers import Tab, problems_of
from click.testing import CliRunner
from made_runs import ROWS, made_run
from PIL import Image

from kontur.cli import main
from kontur.errors import FileError, LogError
from kontur.report import figures
from kontur.report.page import picture, write_report
from kontur.runs import log
from kontur.runs.log import RunLog
from kontur.runs.summary import summarise


def five_runs() -> list[RunLog]:
    return [
        made_run("track", 5.8, 22.0, 300),
        made_run("cc", 6.0, 23.0, 900),
        made_run("ccu", 0.05, 1.9, 1500),
        made_run("cascade", 0.5, -17.6, 2100),
        made_run("ccc", 0.25, 7.7, 2700),
    ]


def text_of(page: str) -> str:
    text = re.sub(r"<(style|script).*?</\1>", "", page, flags=re.S)
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", text)).split())


def report_of(tmp_path: Path, runs: list[RunLog], command: str | None = None) -> str:
    write_report(tmp_path / "report.html", runs, command=command)
    return (tmp_path / "report.html").read_text()


@pytest.fixture(scope="module")
def page_of_five(tmp_path_factory: pytest.TempPathFactory) -> str:
    return report_of(tmp_path_factory.mktemp("five"), five_runs())


def test_summary_without_a_score_comes_from_the_rows() -> None:
    summary = summarise(made_run("ccu", mean_um=0.1, peak_um=-2.0, peak_row=1200))
    assert summary.mean_um == pytest.approx((0.1 * (ROWS - 1) + 2.0) / ROWS)
    assert summary.rms_um == pytest.approx(((0.01 * (ROWS - 1) + 4.0) / ROWS) ** 0.5)
    assert summary.max_um == pytest.approx(2.0)
    assert summary.tangential_mean_um == pytest.approx(2.0)
    assert summary.worst_time_s == pytest.approx(1.2)
    assert summary.energy_J == pytest.approx(7.0 * 2.98)
    assert summary.force_max_N == pytest.approx(40.0, abs=0.01)
    assert summary.force_step_N is None
    assert summary.frames_lost == 0
    assert summary.truth


def test_summary_takes_what_was_scored_at_the_control_rate() -> None:
    score = {"mean_um": 0.2, "rms_um": 0.3, "max_um": 4.0, "tangential_mean_um": 5.0}
    score |= {"max_time_s": 0.6, "max_x_mm": 7.0, "max_y_mm": 8.0, "from_s": 0.3}
    summary = summarise(made_run(score=score, force_max_N=99.0, force_step_N=1.5))
    assert (summary.mean_um, summary.rms_um, summary.max_um, summary.tangential_mean_um) == (0.2, 0.3, 4.0, 5.0)
    assert (summary.worst_time_s, summary.worst_x_mm, summary.worst_y_mm, summary.from_s) == (0.6, 7.0, 8.0, 0.3)
    assert (summary.force_max_N, summary.force_step_N) == (99.0, 1.5)


def test_the_answer_names_the_best_by_how_much_and_its_worst_point(page_of_five: str) -> None:
    page = text_of(page_of_five)
    assert "ccu keeps closest to the path: 0.0506 µm off the programmed path on average, 9.99 times closer" in page
    assert "closer than cascade (0.506 µm), 9.77 times by rms and 9.26 times by max. Its worst" in page
    assert "Its worst point is 1.90 µm off, at t = 1.50 s, x = -10.000 mm, y = -0.010 mm." in page


def test_rows_of_the_table_go_from_the_best_to_the_worst(page_of_five: str) -> None:
    table = re.search(r"<tbody>.*?</tbody>", page_of_five, re.S)
    assert table is not None
    names = re.findall(r"</svg>(\w+)", table[0])
    assert names == ["ccu", "ccc", "cascade", "track", "cc"]
    assert table[0].count("best</span>") == 1


def test_where_mean_rms_and_max_disagree_all_three_are_said_and_no_run_is_the_best(tmp_path: Path) -> None:
    runs = [made_run("ccu", 0.035, 7.0), made_run("cascade", 0.054, 0.5), made_run("track", 1.0, 9.0)]
    html_page = report_of(tmp_path, runs)
    page = text_of(html_page)
    assert "Which run keeps closest to the path depends on the measure." in page
    assert "By mean it is ccu : 0.0373 µm , before cascade with 0.0541 µm." in page
    assert "By rms it is cascade : 0.0548 µm , before ccu with 0.133 µm." in page
    assert "By max it is cascade : 0.500 µm , before ccu with 7.00 µm." in page
    assert "closer than" not in page
    assert "best</span>" not in html_page
    assert "class=best" not in html_page


def test_part_of_the_path_stands_beside_the_figures_and_other_parts_are_not_compared(tmp_path: Path) -> None:
    runs = [made_run("ccu", 0.01, part=(0.48, 1.0)), made_run("cascade", 0.5, part=(0.0, 1.0)),
            made_run("ccc", 0.3, part=(0.0, 0.999))]  # fmt: skip
    page = text_of(report_of(tmp_path, runs))
    assert "ccc keeps closest to the path" in page
    assert "Not compared, for the reason in the table: ccu, 48 to 100 % of the path." in page
    rows = re.findall(r"</svg>(\w+).*?<td>([\d.]+)</td>", report_of(tmp_path, runs))
    assert rows == [("ccc", "99.9"), ("cascade", "100"), ("ccu", "52.0")]


def test_runs_that_have_covered_the_same_part_are_compared_and_the_part_is_said(tmp_path: Path) -> None:
    page = text_of(report_of(tmp_path, [made_run("ccu", part=(0.2, 1.0)), made_run("ccc", 0.5, part=(0.202, 1.0))]))
    assert "ccu keeps closest to the path" in page
    assert "This holds for 20 to 100 % of the path." in page


def test_run_whose_axes_did_not_move_is_not_scored_and_never_best(tmp_path: Path) -> None:
    still = made_run("ccu", 1e-14, 1e-13, rows=300, status="fault", part=(0.0, 0.0))
    summary = summarise(still)
    assert (summary.mean_um, summary.rms_um, summary.max_um, summary.tangential_mean_um) == (None,) * 4
    assert summary.path_percent == 0.0
    assert summary.energy_J is not None
    page = text_of(report_of(tmp_path, [still, made_run("cascade", 0.5, part=(0.0, 1.0))]))
    assert "cascade was 0.500 µm off the programmed path on average." in page
    assert "did not move" in page
    alone = text_of(report_of(tmp_path, [still]))
    assert "No axis has moved along the path" in alone
    assert "Error over time" not in alone
    with pytest.raises(LogError, match="no axis has moved along the path"):
        picture(tmp_path / "a.png", [still])


def test_telemetry_that_was_lost_without_truth_is_missing_in_the_part(tmp_path: Path) -> None:
    run = made_run("ccu", truth=False, part=(0.0, 1.0), known=0.9)
    page = text_of(report_of(tmp_path, [run]))
    assert "This holds for 0 to 100 %, without 10 % whose telemetry was lost, of the path." in page


def test_log_that_does_not_know_its_part_is_compared_by_its_status(tmp_path: Path) -> None:
    page = text_of(report_of(tmp_path, [made_run("ccu", 0.05), made_run("cascade", 0.5, part=(0.0, 1.0))]))
    assert "ccu keeps closest to the path" in page


def test_an_interrupted_run_is_marked_and_not_compared(tmp_path: Path) -> None:
    page = text_of(report_of(tmp_path, [made_run("ccu", 0.05, rows=1500), made_run("cascade", 0.5)]))
    assert "interrupted at 1.50 s" in page
    assert "Not compared, for the reason in the table: ccu." in page
    assert "closer than" not in page


def test_without_truth_the_error_is_called_an_estimate(tmp_path: Path) -> None:
    page = text_of(report_of(tmp_path, [made_run("ccu", truth=False), made_run("cascade", 0.5, truth=False)]))
    assert "by the drive's estimate" in page
    assert "contour error, estimate" in page
    assert "true contour error" not in page


def test_a_single_run_is_not_called_the_best(tmp_path: Path) -> None:
    page = text_of(report_of(tmp_path, [made_run("ccu")]))
    assert "ccu was 0.101 µm off the programmed path on average." in page
    assert "best" not in page


def test_two_runs_of_one_controller_are_distinguished_by_their_seed(tmp_path: Path) -> None:
    page = report_of(tmp_path, [made_run("ccu", seed=1), made_run("ccu", 0.2, seed=2), made_run("cascade", 0.5)])
    assert re.findall(r"</svg>([^<]+?) <", page) == ["ccu, seed 1", "ccu, seed 2", "cascade"]


def test_runs_with_equal_figures_are_compared(tmp_path: Path) -> None:
    page = report_of(tmp_path, [made_run("cc"), made_run("cc"), made_run("ccu")])
    cells = re.findall(r"<td><b>(.*?)</b></td>", page)
    assert cells
    assert len(cells) % 2 == 0  # the least of a column is bold in both rows


@pytest.mark.filterwarnings("error")
def test_gains_are_shown_of_the_controllers_that_use_them(tmp_path: Path) -> None:
    assert "Adaptive gains" not in report_of(tmp_path, [made_run("cascade")])
    assert "Adaptive gains" in report_of(tmp_path, [made_run("cc")])


def test_a_log_without_path_forces_gains_and_energy_still_makes_a_report(tmp_path: Path) -> None:
    run = made_run("ccu", truth=False)
    bare = RunLog(
        {key: run.meta[key] for key in log.REQUIRED_META},
        {column.name: run.columns[column.name] for column in log.COLUMNS if column.required},
    )
    page = text_of(report_of(tmp_path, [bare]))
    assert "Error over time" in page
    assert "Energy" not in page


@pytest.mark.filterwarnings("error")
def test_a_run_at_rest_with_no_error_at_all_still_makes_a_report(tmp_path: Path) -> None:
    run = made_run("ccu", 0.0, 0.0)
    still = RunLog(run.meta, {**run.columns, "reference_x_mm": np.zeros(ROWS), "reference_y_mm": np.zeros(ROWS)})
    assert "0 µm" in text_of(report_of(tmp_path, [still]))


def test_runs_of_different_paths_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="only runs of the same path"):
        write_report(tmp_path / "a.html", [made_run("ccu"), made_run("cascade", trajectory="cd" * 32)])
    with pytest.raises(LogError, match="at least one log"):
        write_report(tmp_path / "a.html", [])


def test_what_a_log_says_cannot_break_the_page(tmp_path: Path) -> None:
    page = report_of(tmp_path, [made_run("ccu", program='<script>"&', machine="<b>", firmware="<i>")])
    assert "<script>" not in page
    assert "&lt;script&gt;" in page


def test_thinning_keeps_every_peak_and_every_gap() -> None:
    time_s = np.arange(100_000) * 1e-3
    values = np.random.default_rng(3).normal(size=time_s.size)
    values[[12_345, 77_777]] = 50.0, -60.0
    values[40_000:41_000] = np.nan
    keep = figures.thinned(time_s, values)
    assert keep.size < 2000
    assert {12_345, 77_777} <= set(keep.tolist())
    assert np.isnan(values[keep]).any()
    assert np.all(np.diff(keep) > 0)


def test_report_from_csv_and_mf4_files_is_the_one_from_the_runs(tmp_path: Path) -> None:
    runs = [made_run("ccu", 0.05, rows=500), made_run("cascade", 0.5, rows=500)]
    files = [tmp_path / "ccu.csv", tmp_path / "cascade.mf4"]
    for run, file in zip(runs, files, strict=True):
        log.write(run, file)
    from_files = report_of(tmp_path, [log.read(file) for file in files])
    assert text_of(from_files) == text_of(report_of(tmp_path, runs))


def test_equal_runs_make_equal_reports(tmp_path: Path) -> None:
    assert report_of(tmp_path, [made_run("ccu")]) == report_of(tmp_path, [made_run("ccu")])


def test_report_command_writes_html_or_a_picture_and_says_how_to_do_it_again(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    log.write(made_run("ccu"), file)
    page, drawn = tmp_path / "r.html", tmp_path / "r.png"
    for output in (page, drawn):
        result = CliRunner().invoke(main, ["report", str(file), "-o", str(output)])
        assert result.exit_code == 0, result.output
    assert f"kontur run circle --controller ccu\nkontur report {file} -o {page}" in page.read_text()
    with Image.open(drawn) as image:
        assert image.width > 1000
    missing = CliRunner().invoke(main, ["report", str(tmp_path / "b.csv"), "-o", str(page)])
    assert missing.exit_code != 0
    assert "b.csv" in missing.output


@pytest.mark.parametrize(
    ("output", "exit_code", "message"),
    [
        ("r.gif", 1, "r.gif: must end in .html or .png or .svg or .pdf"),
        (".", 2, "'.' is a directory"),
        ("no/r.html", 1, "the folder no does not exist"),
    ],
)
def test_report_command_refuses_what_it_cannot_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, output: str, exit_code: int, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    log.write(made_run("ccu"), "a.csv")
    result = CliRunner().invoke(main, ["report", "a.csv", "-o", output])
    assert result.exit_code == exit_code, result.output
    assert message in result.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["a.csv"]


def test_file_that_cannot_be_put_in_its_place_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "r.html").mkdir()
    for place in (".", "r.html", "no/r.html"):
        with pytest.raises(FileError, match="cannot be written"):
            write_report(place, [made_run("ccu")])
    assert [file.name for file in tmp_path.iterdir()] == ["r.html"]


@pytest.mark.parametrize("width", [1280, 500])
def test_a_browser_shows_all_pictures_without_network_or_error(tmp_path: Path, page_of_five: str, width: int) -> None:
    assert problems_of(page_of_five, tmp_path, width, pictures=7) == []


_SHOWN = """({
  tables: [...document.querySelectorAll(".scores")].map(e => e.getBoundingClientRect().right <= innerWidth),
  mean: document.querySelector(".scores tbody td:nth-child(3)").getBoundingClientRect().right <= innerWidth,
  smallest: Math.min(...[...document.images].map(i => i.clientWidth / i.naturalWidth)),
  closer: document.getElementById("closer").offsetParent !== null,
  parameters: document.querySelector("details .values").checkVisibility({ contentVisibilityAuto: true }),
})"""


def test_paper_has_the_whole_table_and_a_small_screen_can_be_read(tmp_path: Path, page_of_five: str) -> None:
    file = tmp_path / "report.html"
    file.write_text(page_of_five)
    with Tab(tmp_path) as tab:
        tab.open(file.as_uri())
        tab.wait("document.readyState === 'complete' && location.protocol === 'file:'")
        tab.wait("!document.getElementById('closer').hidden")
        tab.call("Emulation.setDeviceMetricsOverride", width=400, height=900, deviceScaleFactor=1, mobile=False)
        small = tab.value(_SHOWN)
        tab.call("Emulation.setDeviceMetricsOverride", width=718, height=900, deviceScaleFactor=1, mobile=False)
        tab.call("Emulation.setEmulatedMedia", media="print")
        paper = tab.value(_SHOWN)
    assert (small["mean"], small["closer"], small["parameters"]) == (True, True, False)
    assert small["smallest"] > 0.6  # of the pictures' text, which has 8.5 points
    assert (paper["tables"], paper["closer"], paper["parameters"]) == ([True], False, True)
