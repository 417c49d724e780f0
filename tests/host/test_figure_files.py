# SPDX-License-Identifier: Apache-2.0
"""Pictures for papers, and logs for MATLAB: their size, that they need nothing else, and that they are made alike."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from click.testing import CliRunner
from made_runs import made_run

from kontur.cli import main
from kontur.errors import LogError
from kontur.report import column
from kontur.runs import log

_POINTS_PER_M = 72.0 / 0.0254


@pytest.fixture
def logs(tmp_path: Path) -> list[str]:
    files = []
    for run in (made_run("ccu", 0.05, 1.9), made_run("cascade", 0.5, -17.6)):
        files.append(str(tmp_path / f"{run.meta['controller']}.csv"))
        log.write(run, files[-1])
    return files


def made(tmp_path: Path, words: list[str], name: str) -> bytes:
    """The file `name` that a command writes, which is the same when it is written again."""
    contents = []
    for _ in range(2):
        result = CliRunner().invoke(main, [*words, str(tmp_path / name)])
        assert result.exit_code == 0, result.output
        contents.append((tmp_path / name).read_bytes())
    assert contents[0] == contents[1]
    return contents[0]


def fonts_outside(content: bytes) -> list[bytes]:
    """The fonts of a PDF whose glyphs are not in it, as TrueType."""
    objects = dict(re.findall(rb"(\d+) 0 obj\s*(<<.*?)\s*endobj", content, re.S))
    fonts = [value for value in objects.values() if re.search(rb"/Type /Font\b(?!D)", value)]
    assert fonts, "there is no text"
    outside = []
    for font in fonts:
        if b"/DescendantFonts" in font:  # its glyphs are those of another font
            continue
        descriptor = re.search(rb"/FontDescriptor (\d+) 0 R", font)
        file = re.search(rb"/FontFile2 (\d+) 0 R", objects[descriptor[1]]) if descriptor else None
        if not file or b"stream" not in objects[file[1]]:
            outside.append(font)
    return outside


def check_pdf(content: bytes) -> None:
    """A column wide, with all of its fonts in it."""
    size = re.search(rb"/MediaBox \[ ?0 0 ([0-9.]+) ([0-9.]+) ?\]", content)
    assert size
    assert float(size[1]) == pytest.approx(0.088 * _POINTS_PER_M, abs=0.1)
    assert fonts_outside(content) == []
    assert b"CreationDate" not in content


def check_svg(content: bytes) -> None:
    """A column wide, with text as outlines, and nothing to load."""
    text = content.decode()
    size = re.search(r'width="([0-9.]+)pt"', text)
    assert size
    assert float(size[1]) == pytest.approx(0.088 * _POINTS_PER_M, abs=0.1)
    assert "<text" not in text
    assert set(re.findall(r'href="(.)', text)) == {"#"}


def test_report_for_a_column_as_pdf(tmp_path: Path, logs: list[str]) -> None:
    check_pdf(made(tmp_path, ["report", *logs, "-o"], "r.pdf"))


def test_report_for_a_column_as_svg(tmp_path: Path, logs: list[str]) -> None:
    check_svg(made(tmp_path, ["report", *logs, "-o"], "r.svg"))


@pytest.mark.parametrize(("name", "check"), [("c.pdf", check_pdf), ("c.svg", check_svg)])
def test_circular_test_for_a_column(tmp_path: Path, name: str, check: object) -> None:
    words = ["circle-test", "--radius", "2", "--feed", "20", "--report"]
    assert callable(check)
    check(made(tmp_path, words, name))


@pytest.mark.parametrize(("name", "check"), [("b.pdf", check_pdf), ("b.svg", check_svg)])
def test_frequency_response_for_a_column(tmp_path: Path, name: str, check: object) -> None:
    assert callable(check)
    check(made(tmp_path, ["bode", "x", "--points", "4", "--window", "0.1", "--from", "20", "-o"], name))


@pytest.mark.parametrize(("name", "check"), [("p.pdf", check_pdf), ("p.svg", check_svg)])
def test_circles_of_the_paper_for_a_column(tmp_path: Path, name: str, check: object) -> None:
    words = ["experiment", "paper", "--case", "high-tight", "--controller", "ccu", "--controller", "cc", "--seeds", "2"]
    assert callable(check)
    check(made(tmp_path, [*words, "--picture"], name))


def test_picture_of_the_circles_has_the_mean_of_all_seeds_and_the_greatest_error() -> None:
    rows = [
        {"case": "low", "controller": "ccu", "mean_um": 0.2, "max_um": 3.0},
        {"case": "low", "controller": "ccu", "mean_um": 0.4, "max_um": 7.0},
        {"case": "low", "controller": "cc", "mean_um": None, "max_um": None},
        {"case": "high", "controller": "cc", "mean_um": 5.0, "max_um": 20.0},
    ]
    panels = column.of_cases(rows).axes
    assert [[text.get_text() for text in panel.texts] for panel in panels] == [["0.300", "7.00"], ["5.00", "20.0"]]
    assert [panel.get_title() for panel in panels] == ["low", "high"]
    with pytest.raises(LogError, match="no axis has moved"):
        column.of_cases(rows[2:3])


def test_log_for_matlab_has_all_columns_and_what_was_run(tmp_path: Path, logs: list[str]) -> None:
    content = made(tmp_path, ["log", "convert", logs[0]], "r.mat")
    assert content.startswith(b"MATLAB 5.0 MAT-file, a log of kontur  ")  # SciPy's own head has the date
    run, found = log.read(logs[0]), scipy.io.loadmat(tmp_path / "r.mat")
    for name, values in run.columns.items():
        np.testing.assert_array_equal(found[name], values[:, None], err_msg=name)
    assert json.loads(found["meta"][0]) == run.meta
