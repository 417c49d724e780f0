# SPDX-License-Identifier: Apache-2.0
"""A run that a fault of the drive ends keeps its log up to there."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from kontur import machine
from kontur.cli import main
from kontur.drive.target import Target
from kontur.errors import EmcyError
from kontur.path import shapes
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.runs import log
from kontur.runs.runner import RunOptions, run

TARGET = Target(machine=machine.load())
TOO_FAST = {"limits.velocity": 0.05}


def test_fault_ends_the_log_and_is_in_it() -> None:
    trajectory = plan(shapes.circle(0.02, 0.1), limits(TARGET.machine))
    result = run(trajectory, "ccu", TARGET, RunOptions(parameters=TOO_FAST, raise_fault=False))
    assert not result.completed
    assert isinstance(result.fault, EmcyError)
    assert result.fault.code == 0x8400
    meta, columns = result.log.meta, result.log.columns
    assert meta["status"] == "fault"
    assert "8400h" in meta["fault"]
    assert 0.02 < columns["time_s"][-1] < 0.3
    before = columns["time_s"] < 0.04
    assert np.abs(columns["true_contour_error_um"][before]).max() < 30.0  # up to the fault, a run like any other


def test_fault_is_raised_where_nobody_requested_the_log() -> None:
    trajectory = plan(shapes.circle(0.02, 0.1), limits(TARGET.machine))
    with pytest.raises(EmcyError, match="8400h"):
        run(trajectory, "ccu", TARGET, RunOptions(parameters=TOO_FAST))


def test_command_writes_log_and_report_and_fails_with_the_fault(tmp_path: Path) -> None:
    paths = {"--log": tmp_path / "f.csv", "--report": tmp_path / "f.html"}
    args = ["run", "circle", "--radius", "20", "--feed", "100", "--set", "limits.velocity=0.05"]
    result = CliRunner().invoke(main, [*args, *(str(word) for pair in paths.items() for word in pair)])
    assert result.exit_code == 1
    assert "8400h: an axis was faster than limits.velocity" in result.stderr
    assert log.read(paths["--log"]).meta["status"] == "fault"
    assert "fault at 0." in paths["--report"].read_text()
