# SPDX-License-Identifier: Apache-2.0
"""docs/paper.md from a reduced set of runs: tables are there, figures are those of the runs, faults are told."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from paper import page as paper_page
from paper_page import main

from kontur import machine
from kontur.drive.controllers import CONTROLLERS
from kontur.drive.target import Target
from kontur.errors import FileError
from kontur.experiments import paper
from kontur.experiments.paper import NOISE, Job, Outcome, Results, Variant

TRIPS = Variant("a window that no axis keeps", "it is 1 µm", (("following_window_x", 1000.0),), "cc")
WHOLE = next(v for v in paper.VARIANTS if "whole" in v.name)


@pytest.fixture(scope="module")
def results() -> Results:
    return paper.measure(
        Target(machine=machine.load()),
        cases=("low",),
        variants=(WHOLE, TRIPS),
        sensitivities=("observer.bandwidth", "smc.e_max", NOISE),
        stretches=2,
    )


@pytest.fixture
def page(results: Results, tmp_path: Path) -> str:
    file = tmp_path / "paper.md"
    paper_page.write(results, file)
    return file.read_text("utf-8")


def row(page: str, start: str) -> list[str]:
    line = next(line for line in page.splitlines() if line.startswith(f"| {start} |"))
    return [cell.strip() for cell in line.split("|")[2:-1]]


def test_page_has_the_tables_and_all_its_pictures(page: str, tmp_path: Path) -> None:
    for heading in ("Table 2", "Figures 3 to 9", "The laws as printed", "Where the paper gives no value"):
        assert f"## {heading}\n" in page
    pictures = re.findall(r"!\[.*?\]\((.*?)\)", page)
    assert len(pictures) == 6
    for name in pictures:
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    assert row(page, "*paper: CCU*")[3] == "*0.0016*"
    assert len(row(page, "CCU")) == 7
    assert page.count("| NURBS |") == 6


def test_the_compensator_does_what_the_paper_says_and_the_printed_model_undoes_it(results: Results) -> None:
    mean_um = {name: results.outcomes[Job("low", name)].figures["mean_um"] for name in CONTROLLERS}
    assert mean_um["ccu"] < 0.1 * mean_um["cc"]
    assert results.outcomes[Job("low", "ccu", WHOLE.parameters)].figures["mean_um"] > mean_um["cc"]


def test_ccu_is_the_papers_unless_it_is_said_to_learn(results: Results, page: str) -> None:
    papers, shipped = (results.outcomes[Job("low", learning=learns)].figures for learns in (False, True))
    assert shipped["mean_um"] < papers["mean_um"]
    assert row(page, "CCU with learned feedforward") != row(page, "CCU")


def test_every_figure_comes_from_the_runs(results: Results) -> None:
    job = Job("low", "ccu")
    altered = {**results.outcomes[job].figures, "mean_um": 7.77, "e_n2_max_mm": 0.0888}
    changed = replace(results, outcomes={**results.outcomes, job: Outcome(altered)})
    text = paper_page.page(changed, [])
    assert row(text, "CCU")[1] == "0.0888"
    assert row(text, "CCU")[5] == "7.77"
    assert row(text, "**ccu, ours**")[0].startswith("7.77 / ")
    assert text != paper_page.page(results, [])


def test_page_is_the_same_again_but_for_the_build(results: Results, page: str, tmp_path: Path) -> None:
    first = {file.name: file.read_bytes() for file in tmp_path.rglob("*.*")}
    paper_page.write(replace(results, build="another"), tmp_path / "paper.md")
    second = {file.name: file.read_bytes() for file in tmp_path.rglob("*.*")}
    changed = [
        (a, b) for a, b in zip(page.splitlines(), second["paper.md"].decode().splitlines(), strict=True) if a != b
    ]
    assert changed == [(f"- Firmware build: {results.build}", "- Firmware build: another")]
    del first["paper.md"], second["paper.md"]
    assert first == second


def test_a_run_that_ends_in_a_fault_is_reported_as_one(results: Results, page: str) -> None:
    fault = results.outcomes[Job("low", "cc", TRIPS.parameters)].fault
    assert fault is not None
    assert "8611h" in fault
    assert row(page, f"cc: {TRIPS.name}") == [f"**ended in a fault**: {fault.split(';')[0]}"]
    assert f"**{TRIPS.name}**, cc: **does not run**: low ends in a fault." in page


def test_a_value_that_the_drive_refuses_is_reported(page: str) -> None:
    line = next(line for line in page.splitlines() if "| ×2 | *smc.e_max: the value does not fit" in line)
    assert line.endswith("| – |")


def test_what_has_to_go_along_does() -> None:
    defaults = {"smc.k_bar": 1000, "smc.e_max": 4000.0, "observer.bandwidth": 1120.0}
    assert dict(paper.varied("smc.k_bar", 2.0, defaults)) == {"smc.k_bar": 2000.0, "smc.e_max": 2000.0}
    assert dict(paper.varied("observer.bandwidth", 0.5, defaults)) == {"observer.bandwidth": 560.0}


def test_noise_of_a_job_is_that_of_the_plant(results: Results) -> None:
    steps = [results.outcomes[Job("low", noise=noise)].figures["mean_um"] for noise in (0.5, 1.0, 2.0)]
    assert steps == sorted(steps)


def test_page_that_cannot_be_written_is_one_message(results: Results, tmp_path: Path) -> None:
    (tmp_path / "img").write_text("in the way")
    with pytest.raises(FileError, match=r"paper\.md: cannot be written"):
        paper_page.write(results, tmp_path / "paper.md")


def test_the_command_names_page_and_build(results: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(paper, "measure", lambda target, progress: results)
    answer = CliRunner().invoke(main, [str(tmp_path / "page.md")])
    assert answer.exit_code == 0, answer.output
    assert results.build in answer.output
    assert (tmp_path / "page.md").exists()
