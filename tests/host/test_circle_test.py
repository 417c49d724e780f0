# SPDX-License-Identifier: Apache-2.0
"""`kontur circle-test`: what it finds on simulated machines, its files, its page and its messages."""

from __future__ import annotations

import html
import io
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browsers import problems_of
from click.testing import CliRunner, Result
from scipy.optimize import least_squares

from kontur import machine as machines
from kontur.cli import main
from kontur.drive.target import Target, tell
from kontur.errors import FileError, LogError, PathError
from kontur.experiments.circle_test import Setup, circle_test
from kontur.planning.bounds import limits
from kontur.report.circle_page import write_circle_report
from kontur.runs import circle_record
from kontur.runs.circle_record import Circle, CircleTest
from kontur.runs.runner import RunResult
from kontur.sim import process

QUICK = ("circle-test", "--radius", "2", "--feed", "20")


def machine(x: dict[str, float] | None = None, y: dict[str, float] | None = None) -> machines.Machine:
    """Table 1 without noise and with fine encoders, and what else each axis has."""
    table, quiet = machines.load(), {"force_noise_N": 0.0, "encoder_m": 1e-9}
    return replace(table, x=replace(table.x, **quiet, **(x or {})), y=replace(table.y, **quiet, **(y or {})))


def measured(
    where: machines.Machine, radius_m: float = 0.02, feed_mps: float = 0.1, controller: str = "ccu", **target: Any
) -> tuple[Circle, tuple[RunResult, RunResult]]:
    setup, feeds = Setup(radius_m, controller=controller), [feed_mps]
    [found] = circle_test(setup, feeds, limits(where), Target(machine=where, **target))
    return found


@pytest.fixture(scope="module")
def quiet() -> tuple[Circle, tuple[RunResult, RunResult]]:
    return measured(machine())


def made_test(shift_um: float = 0.0, **conditions: Any) -> CircleTest:
    """A test of an ellipse of 4 um, larger by `shift_um`."""
    t = np.arange(3600) * (2.0 * np.pi / 3600) + 0.001
    points = np.column_stack([(20.004 + shift_um * 1e-3) * np.cos(t), 20.0 * np.sin(t)])
    found = circle_record.trace(points, points[::-1], 20.0)
    head = {"controller": "ccu", "seed": 1} | conditions
    return CircleTest(20.0, head, (Circle(50.0, {"true": found, "drive": found}),))


def kontur(*arguments: str) -> Result:
    return CliRunner().invoke(main, arguments)


# --- what it finds ----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("radius_m", "feed_mps", "controller"), [(0.02, 0.1, "ccu"), (0.004, 0.005, "ccu"), (0.004, 0.02, "track")]
)
def test_g_is_that_of_an_independent_fit_of_the_true_positions(
    radius_m: float, feed_mps: float, controller: str
) -> None:
    """On the simulator without noise: by the true position, and by what the drive reports (ADR 63)."""
    circle, runs = measured(machine(), radius_m, feed_mps, controller)
    ranges = []
    for run in runs:
        assert run.truth is not None
        points = run.truth.pos_m * 1e3
        turns = np.abs(np.unwrap(np.arctan2(points[:, 1], points[:, 0])) - np.arctan2(points[0, 1], points[0, 0]))
        points = points[(turns >= np.pi) & (turns < 3.0 * np.pi)]
        start = [0.0, 0.0, radius_m * 1e3]
        fit = least_squares(lambda p, q=points: np.hypot(*(q - p[:2]).T) - p[2], start, xtol=1e-14)
        ranges.append(float(np.ptp(np.hypot(*(points - fit.x[:2]).T))) * 1e3)
    true, drive = circle.traces["true"].figures, circle.traces["drive"].figures
    assert (true.g_ccw_um, true.g_cw_um) == (pytest.approx(ranges[0], abs=1e-3), pytest.approx(ranges[1], abs=1e-3))
    assert (drive.g_ccw_um, drive.g_cw_um) == pytest.approx(ranges, abs=0.005)
    assert 0.2 < true.g_ccw_um < 50.0


def test_errors_of_the_machine_are_found_which_the_drive_does_not_see() -> None:
    x = {"lead_error": 100e-6, "squareness_rad": 50e-6, "backlash_m": 6e-6}
    circle, _ = measured(machine(x, {"lead_error": -50e-6, "backlash_m": 3e-6}), compensation=machines.RIGID)
    true, drive = circle.traces["true"].figures, circle.traces["drive"].figures
    assert true.scale_um_per_m == pytest.approx(150.0, abs=1.0)
    assert true.squareness_um_per_m == pytest.approx(50.0, abs=2.0)
    assert (true.backlash_x_um, true.backlash_y_um) == (pytest.approx(6.0, abs=0.1), pytest.approx(3.0, abs=0.1))
    assert true.d_um == pytest.approx(0.5, abs=0.1)  # (100 - 50) / 2 um/m of 20 mm
    assert abs(drive.scale_um_per_m) < 1.0
    assert abs(drive.backlash_x_um) < 0.1
    assert true.g_both_um > drive.g_both_um + 4.0


def test_own_g_of_a_drive_that_corrects_its_screws_is_that_of_the_tool() -> None:
    """The tool is then 2 um and more from where the encoders are."""
    circle, _ = measured(machine({"lead_error": 100e-6}, {"lead_error": -100e-6}))
    true, drive = circle.traces["true"].figures, circle.traces["drive"].figures
    assert (drive.g_ccw_um, drive.g_cw_um) == pytest.approx((true.g_ccw_um, true.g_cw_um), abs=0.01)
    assert true.g_ccw_um < 2.0


def test_both_senses_are_driven_one_back_the_way_of_the_other(
    quiet: tuple[Circle, tuple[RunResult, RunResult]],
) -> None:
    circle, (ccw, cw) = quiet
    assert circle.feed_mmps == 100.0
    first, last = ((one.log.columns["reference_x_mm"], one.log.columns["reference_y_mm"]) for one in (ccw, cw))
    for there, back in zip(first, last, strict=True):
        assert there[-1] == pytest.approx(back[0], abs=1e-3)
        assert there[0] == pytest.approx(back[-1], abs=1e-3)


def test_centre_and_turns_before_are_as_asked_for() -> None:
    where = machine()
    setup = Setup(0.005, centre_m=(0.01, -0.02), lead=0.3)
    [(circle, (run, _))] = circle_test(setup, [0.02], limits(where), Target(machine=where))
    assert np.mean(run.log.columns["reference_x_mm"]) == pytest.approx(10.0, abs=2.0)
    assert run.log.columns["time_s"][-1] == pytest.approx(1.6 * 2.0 * np.pi * 5.0 / 20.0, abs=0.1)
    assert abs(circle.traces["true"].figures.centre_x_um) < 0.1
    assert abs(circle.traces["true"].figures.f_max_ccw_um) < 5.0


def test_a_feed_that_is_not_held_over_the_measured_turn_is_refused_before_anything_moves() -> None:
    where = machine()
    shares: list[float] = []
    with pytest.raises(PathError, match=r"200 mm/s is not reached within 0.1 turns: .* Give --lead 0.2"):
        next(circle_test(Setup(0.01, lead=0.1), [0.01, 0.2], limits(where), Target(machine=where),
                         lambda _, share: shares.append(share)))  # fmt: skip
    assert not shares


def test_a_stop_ends_the_test_on_the_circle() -> None:
    where = machine()
    asked = iter([False] * 50)
    with pytest.raises(KeyboardInterrupt):
        list(circle_test(Setup(0.005), [0.02], limits(where), Target(machine=where),
                         stop_requested=lambda: next(asked, True)))  # fmt: skip


# --- its file ---------------------------------------------------------------------------------------------------------
def test_a_test_that_was_kept_is_read_as_it_was(tmp_path: Path) -> None:
    test = made_test()
    circle_record.save(test, tmp_path / "a.json")
    found = circle_record.load(tmp_path / "a.json")
    assert json.dumps(circle_record.figures(found)) == json.dumps(circle_record.figures(test))
    for by, one in test.circles[0].traces.items():
        assert np.max(np.abs(found.circles[0].traces[by].ccw_um - one.ccw_um)) < 1e-4
    assert found.at(50.01) is found.circles[0]
    assert found.at(51.0) is None


@pytest.mark.parametrize(
    "edit",
    [
        lambda r: r.pop("kontur_circle_test"),
        lambda r: r.update(kontur_circle_test=2),
        lambda r: r.update(circles=[]),
        lambda r: r["circles"][0].update(feed_mmps=float("nan")),
        lambda r: r["circles"][0].update(feed_mmps=True),
        lambda r: [r["circles"][0].pop(by) for by in ("true", "drive")],
        lambda r: r["circles"][0]["true"].pop("g_both_um"),
        lambda r: r["circles"][0]["true"]["spikes"].pop(),
        lambda r: r["circles"][0]["true"]["spikes"][0].update(place="z+"),
        lambda r: r["circles"][0]["true"]["cw_um"].pop(),
        lambda r: r["circles"][0]["true"].update(cw_um=["1"] * 1440),
        lambda r: r.update(conditions=[1]),
        lambda r: r["conditions"].update(controller={"a": 1}),
        lambda r: r["conditions"].update(controller="x" * 5000),
    ],
)
def test_a_file_that_is_no_test_is_one_message(tmp_path: Path, edit: Callable[[Any], Any]) -> None:
    file = tmp_path / "a.json"
    circle_record.save(made_test(), file)
    record = json.loads(file.read_text())
    edit(record)
    file.write_text(json.dumps(record))
    with pytest.raises(FileError, match="is no circular test; write one with"):
        circle_record.load(file)


@pytest.mark.parametrize("content", ["", "[]", "3", "{}", "[" * 5000, "9" * 5000, "\x00"])
def test_a_file_of_something_else_is_one_message(tmp_path: Path, content: str) -> None:
    (tmp_path / "a.json").write_text(content)
    with pytest.raises(FileError, match="is no circular test"):
        circle_record.load(tmp_path / "a.json")


# --- its page ---------------------------------------------------------------------------------------------------------
def page_of(tmp_path: Path, test: CircleTest, before: CircleTest | None = None) -> str:
    write_circle_report(tmp_path / "c.html", test, before)
    return (tmp_path / "c.html").read_text()


def text_of(page: str) -> str:
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", re.sub(r"<style>.*?</style>", "", page, flags=re.S))).split())


def test_the_answer_has_g_of_both_senses_the_greatest_spike_and_the_change(tmp_path: Path) -> None:
    text = text_of(page_of(tmp_path, made_test(2.0), made_test()))
    assert "Both senses together deviate by G(b) = 6.00 µm at 50 mm/s by the true position." in text
    assert "The drive itself sees 6.00 µm. Before it was 4.00 µm. The greatest spike is" in text
    assert "true, before 4 " in text
    assert "x longer than y, µm/m" in text


def test_the_plots_say_their_scale(tmp_path: Path) -> None:
    from kontur.report.circle_page import polar

    found = made_test(0.4).circles[0].traces["true"]
    texts = [text.get_text() for text in polar("true position", found, None, 20.0).axes[0].texts]
    assert "1 division = 1 µm" in texts
    assert "deviation ×1,600" in texts  # 0.4 of the radius, 8 mm, for five divisions
    assert {"+5", "−5", "X+", "Y−"} <= set(texts)


def test_title_of_a_plot_with_a_test_before_is_whole() -> None:
    from kontur.report.circle_page import polar
    from kontur.report.figures import style

    found, svg = made_test(0.4).circles[0].traces["true"], io.StringIO()
    with style():
        polar("true position", found, found, 20.0).savefig(svg, format="svg")
    title = re.search(r' y="([\d.]+)"[^>]*>By the true position', svg.getvalue())
    assert title
    assert float(title[1]) > 8.5  # the height of its letters, from the top


def test_what_a_file_says_cannot_break_the_page(tmp_path: Path) -> None:
    page = page_of(tmp_path, made_test(), made_test(machine='<script>"&', controller="<b>"))
    assert "<script>" not in page
    assert "&lt;script&gt;" in page


@pytest.mark.filterwarnings("error")
def test_a_circle_without_any_deviation_still_makes_a_page(tmp_path: Path) -> None:
    t = np.arange(3600) * (2.0 * np.pi / 3600)
    points = 20.0 * np.column_stack([np.cos(t), np.sin(t)])
    found = circle_record.trace(points, points[::-1], 20.0)
    assert "G(b)" in page_of(tmp_path, CircleTest(20.0, {}, (Circle(50.0, {"drive": found}),)))


@pytest.mark.parametrize("width", [1280, 500])
def test_a_browser_shows_the_page_without_network_or_error(tmp_path: Path, width: int) -> None:
    page = page_of(tmp_path, made_test(2.0), made_test())
    assert len(page) < 3_000_000
    assert problems_of(page, tmp_path, width, pictures=3) == []


# --- the command ------------------------------------------------------------------------------------------------------
def test_command_prints_tables_keeps_the_test_and_compares_it(tmp_path: Path) -> None:
    file, page = tmp_path / "a.json", tmp_path / "a.html"
    first = kontur(*QUICK, "--save", str(file), "--report", str(page))
    assert first.exit_code == 0, first.output
    for text in ("G(b)", "backlash x, µm", "Spikes at the reversals"):
        assert text in first.stdout
    assert "Circular test: radius 2 mm, ccu" in page.read_text()
    again = kontur(*QUICK, "--json", "--compare", str(file))
    assert again.exit_code == 0, again.output
    found = json.loads(again.stdout)
    assert found["before"]["circles"] == found["circles"]  # the same seed: the same figures
    assert set(found["circles"][0]) == {"feed_mmps", "true", "drive"}
    shown = kontur(*QUICK, "--compare", str(file))
    assert "true, before" in shown.stdout


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--radius", "200"), "200"),
        (("--controller", "all"), "a test is of one controller"),
        (("--compare", "nowhere.json"), "nowhere.json: cannot be read"),
        (("--save", "a.txt"), "a.txt: must end in .json"),
        (("--report", "no/a.html"), "the folder no does not exist"),
        (("-i", "virtual", "-c", "nobody"), "does not answer"),
    ],
)
def test_command_refuses_what_it_cannot_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, more: tuple[str, ...], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    result = kontur(*QUICK, *more)
    assert result.exit_code != 0
    assert message in result.stderr.replace("\n", " ")
    assert not list(tmp_path.iterdir())


def test_command_says_which_feed_the_machine_does_not_reach() -> None:
    result = kontur(*QUICK, "--feed", "250")
    assert result.exit_code == 0, result.output
    assert "Feed 250 mm/s is not reached: 64.31 mm/s, limited by the jerk" in result.stdout
    assert "Feed 20" not in result.stdout


def test_command_refuses_to_compare_another_radius(tmp_path: Path) -> None:
    circle_record.save(made_test(), tmp_path / "a.json")
    result = kontur(*QUICK, "--compare", str(tmp_path / "a.json"))
    assert "is of radius 20 mm, this test of 2 mm" in result.stderr


def test_on_a_bus_there_are_the_figures_by_the_drive_alone() -> None:
    with process.start(slcan_tcp="0") as drive:
        tell(Target(bus=drive.options()))
        result = kontur(*QUICK, "--radius", "1", "--json", "--approach", "-i", drive.interface, "-c", drive.channel)
    assert result.exit_code == 0, result.output
    [circle] = json.loads(result.stdout)["circles"]
    assert set(circle) == {"feed_mmps", "drive"}
    assert 0.0 < circle["drive"]["g_both_um"] < 100.0


def test_a_lap_with_lost_telemetry_is_refused_with_a_message() -> None:
    from kontur.runs.circularity import lap

    t = np.delete(np.linspace(0.0, 4.0 * np.pi, 4000), np.s_[2000:2050])
    with pytest.raises(LogError, match="on a bus see that no telemetry is lost"):
        lap(np.column_stack([np.cos(t), np.sin(t)]), (0.0, 0.0), 0.5)
