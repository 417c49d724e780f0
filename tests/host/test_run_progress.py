# SPDX-License-Identifier: Apache-2.0
"""What `kontur run` shows on a terminal while it runs, and before."""

import json
import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from kontur.cli import main
from kontur.runs import log

PART = "M3 S500\nG1 X30 F1200\nG3 X30 Y20 J10\nG0 X0\nG4 P0.3\nM5\nG1 Y0 F3000\n"
NOW = re.compile(r"x (-?\d+\.\d{3}) y (-?\d+\.\d{3}) mm  (\d+\.\d) of (\d+\.\d) mm/s  (\d+\.\d\d) µm")


def on_a_terminal(command: list[str], folder: Path) -> tuple[int, str]:
    """Exit status of a command, and what it shows."""
    terminal, its_terminal = pty.openpty()
    environment = os.environ | {"COLUMNS": "100", "TERM": "xterm", "PYTHONUNBUFFERED": "1"}
    shown = b""
    with subprocess.Popen(
        [sys.executable, "-m", "kontur.cli", *command],
        stdin=subprocess.DEVNULL, stdout=its_terminal, stderr=its_terminal, env=environment, cwd=folder,
    ) as process:  # fmt: skip
        os.close(its_terminal)
        try:
            while piece := os.read(terminal, 4096):
                shown += piece
        except OSError:  # it has ended
            pass
        os.close(terminal)
        return process.wait(60.0), shown.decode(errors="replace")


def test_terminal_shows_time_before_and_position_feed_and_error_while_it_runs(tmp_path: Path) -> None:
    (tmp_path / "part.ngc").write_text(PART)
    status, shown = on_a_terminal(["run", "part.ngc", "--log", "a.csv"], tmp_path)
    assert status == 0
    run = log.read(tmp_path / "a.csv")
    took_s = run.columns["time_s"][-1]
    before = re.search(r"part\.ngc takes (\d+\.\d\d) s", shown)
    assert before is not None
    assert float(before[1]) == pytest.approx(took_s, rel=0.01)
    assert shown.index(before[0]) < shown.index("ccu ")
    found = [tuple(map(float, match)) for match in NOW.findall(shown)]
    assert len(found) >= 4
    assert {asked for *_, asked, _ in found} == {20.0, 50.0}
    assert any(abs(reached - 20.0) < 0.2 for *_, reached, asked, _ in found if asked == 20.0)
    assert "mm/s, rapid," in shown.replace(", rapid, mm/s", " mm/s, rapid,")
    x, y = run.columns["position_x_mm"], run.columns["position_y_mm"]
    for at_x, at_y, _, _, error in found:
        assert min((x - at_x) ** 2 + (y - at_y) ** 2) < 0.002**2
        assert error <= max(abs(run.columns["true_contour_error_um"])) + 0.005


def test_nothing_is_shown_where_no_terminal_is(tmp_path: Path) -> None:
    (tmp_path / "part.ngc").write_text(PART)
    result = CliRunner().invoke(main, ["run", str(tmp_path / "part.ngc")])
    assert result.exit_code == 0
    assert result.stderr == ""


@pytest.mark.parametrize("override", ["100", "50"])
def test_checked_time_is_the_time_of_the_run(tmp_path: Path, override: str) -> None:
    file = tmp_path / "part.ngc"
    file.write_text(PART)
    checked = json.loads(CliRunner().invoke(main, ["check", str(file), "--json"]).stdout)
    ran = CliRunner().invoke(main, ["run", str(file), "--override", override, "--log", str(tmp_path / "a.csv")])
    assert ran.exit_code == 0
    took_s = log.read(tmp_path / "a.csv").columns["time_s"][-1]
    assert took_s * float(override) / 100.0 == pytest.approx(checked["duration_s"], rel=0.01)
