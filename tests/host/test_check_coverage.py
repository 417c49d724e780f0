# SPDX-License-Identifier: Apache-2.0
"""tests/unit/check_coverage.py: a branch that no test takes is found, and so is an entry that is no longer true."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

UNIT = Path(__file__).resolve().parents[1] / "unit"
sys.path.insert(0, str(UNIT))
import check_coverage  # noqa: E402

SOURCE = "if (a) {"
ENTRY = f'[[branch]]\nfile = "firmware/core/a.c"\nfunction = "f"\nsource = "{SOURCE}"\nmissed = 1\nreason = "why"\n'


def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, counts: list[int], listed: str, most: int = 40) -> int:
    """The check of firmware/core/a.c: a line with branches of these counts, and another with `most` that are taken."""
    folder = tmp_path / "firmware" / "core"
    folder.mkdir(parents=True)
    (folder / "a.c").write_text(f"\n    {SOURCE}\nrest\n")
    lines = [
        {"line_number": 2, "function_name": "f", "branches": [{"count": count} for count in counts]},
        {"line_number": 3, "function_name": "f", "branches": [{"count": 1}] * most},
    ]
    coverage = tmp_path / "coverage.json"
    coverage.write_text(json.dumps({"files": [{"file": "firmware/core/a.c", "lines": lines}]}))
    uncovered = tmp_path / "uncovered.toml"
    uncovered.write_text(listed)
    monkeypatch.setattr(sys, "argv", ["check_coverage.py", str(coverage), str(uncovered), "--source", str(tmp_path)])
    return check_coverage.main()


def test_all_branches_taken_passes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(tmp_path, monkeypatch, [3, 1], "") == 0


def test_a_branch_not_taken_fails_and_its_entry_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, monkeypatch, [3, 0], "") == 1
    told = capsys.readouterr().out
    assert "firmware/core/a.c:2: branches that no test takes: 1, listed: 0" in told
    assert f"source = '{SOURCE}'" in told


def test_a_listed_branch_passes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(tmp_path, monkeypatch, [3, 0], ENTRY) == 0


def test_a_listed_branch_that_is_taken_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, monkeypatch, [3, 1], ENTRY) == 1
    assert "branches listed as not taken: 1, found: 0" in capsys.readouterr().out


def test_another_branch_of_a_listed_line_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(tmp_path, monkeypatch, [0, 0], ENTRY) == 1


def test_too_many_listed_branches_fail(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, monkeypatch, [3, 0], ENTRY, most=10) == 1
    assert "firmware/core: 11 of 12 branches taken, at least 95% must be" in capsys.readouterr().out


def test_an_entry_without_a_reason_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, monkeypatch, [3, 0], ENTRY.replace("why", " ")) == 1
    assert "no reason" in capsys.readouterr().out
