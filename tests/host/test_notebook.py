# SPDX-License-Identifier: Apache-2.0
"""The notebook and the page about Python run as they stand."""

import re
from pathlib import Path

import pytest
from run_notebook import executed, read, texts

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOK = ROOT / "examples" / "python.ipynb"
PAGE = ROOT / "docs" / "python.md"


def test_notebook_runs_and_prints_what_it_shows(tmp_path: Path) -> None:
    shown = texts(read(NOTEBOOK))
    assert shown
    assert texts(executed(read(NOTEBOOK), tmp_path)) == shown


def test_notebook_shows_its_pictures() -> None:
    outputs = [output for cell in read(NOTEBOOK).cells for output in cell.get("outputs", [])]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 3


def test_python_of_the_page_runs_from_top_to_bottom(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = re.findall(r"^```python\n(.*?)^```", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    assert len(code) > 5
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for number, block in enumerate(code, 1):
        exec(compile(block, f"{PAGE.name}, block {number}", "exec"), names)
    assert {file.name for file in tmp_path.iterdir()} == {"examples", "part.mf4", "part.html", "scope.png"}
