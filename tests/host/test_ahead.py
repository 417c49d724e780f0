# SPDX-License-Identifier: Apache-2.0
"""A path that is driven while it is planned: the drive gets the knots of the whole, and in the end their number."""

import io
import json
import math
import re
import sys

import numpy as np
import pytest
from cam_paths import circle, letters
from click.testing import CliRunner
from gated_planning import LIMITS, MACHINE, Gate, all_planned_when_it_moves, kept_drive, opened_on_the_way

from kontur.cli import main, planned
from kontur.cli.live_page import Panel
from kontur.cli.run_progress import run_progress
from kontur.drive.stream import Operator
from kontur.drive.target import Target
from kontur.path import gcode, programs, smoothing
from kontur.path.smoothing import TOLERANCE_M
from kontur.planning.ahead import Ahead
from kontur.planning.planner import Planning, plan
from kontur.runs.log import read
from kontur.runs.runner import RunOptions, run

drive = pytest.fixture(kept_drive)


@pytest.fixture
def small_windows(monkeypatch):
    monkeypatch.setattr(smoothing, "_WINDOWS_S", (0.5,))


def test_knots_that_come_on_the_way_are_those_of_the_whole(small_windows, monkeypatch):
    program = letters(6)
    ahead, total_before = opened_on_the_way(Gate(program), monkeypatch)
    assert 300 < len(ahead.knots_nm) < 0.8 * len(plan(program, LIMITS, tolerance_m=TOLERANCE_M).knots_nm)
    result = run(ahead, "ccu", Target(MACHINE))
    whole = run(plan(program, LIMITS, tolerance_m=TOLERANCE_M), "ccu", Target(MACHINE))
    assert total_before == [0]
    assert result.completed
    for key in ("trajectory", "smoothing", "feed", "status", "accepted"):
        assert result.log.meta[key] == whole.log.meta[key]
    np.testing.assert_array_equal(result.log.columns["reference_x_mm"], whole.log.columns["reference_x_mm"])
    assert result.log.meta["score"]["mean_um"] == pytest.approx(whole.log.meta["score"]["mean_um"], rel=0.02)


def test_time_is_told_about_before_the_path_is_planned_and_exactly_then(small_windows, monkeypatch):
    """The feeds are lower, and the dwells are, where the planning has still to come."""
    wave = "".join(f"X{i / 5} Y{5 * math.sin(i / 20):.4f}\n" for i in range(100))
    text = "G1\n" + "".join(f"F{feed} {wave}G4 P0.1\nG0 X0 Y0\nG1\n" for feed in (1800, 2400, 1200, 600)) + "G4 P4\n"
    gate = Gate(gcode.parse(text, "p.ngc"))
    ahead = Ahead(gate.planning)
    while not len(ahead.knots_nm):
        assert not ahead.ended(0.01)
    planned_s = len(ahead.knots_nm) * 1e-3
    terminal = io.StringIO()
    terminal.isatty = lambda: True
    monkeypatch.setattr(sys, "stderr", terminal)
    with run_progress("ccu", ahead, Panel(), None) as (done, _):
        about = re.search(r"p\.ngc takes about (\d+(?:\.\d+)?) s; it is driven while", terminal.getvalue())
        done(0.1)
        gate.opened.set()
        duration_s = ahead.trajectory().duration_s
        done(0.2)
        done(0.3)
    assert about is not None
    assert planned_s < 0.3 * duration_s
    assert float(about[1]) == pytest.approx(duration_s, rel=0.05)
    assert ahead.about_s() == duration_s
    assert terminal.getvalue().count(f"p.ngc takes {duration_s:.2f} s") == 1


def test_a_planning_that_fails_on_the_way_stops_the_drive_on_the_path(small_windows, monkeypatch):
    ahead, _ = opened_on_the_way(Gate(letters(6), fails=True), monkeypatch)
    result = run(ahead, "ccu", Target(MACHINE), RunOptions(raise_fault=False))
    assert not result.completed
    assert str(result.error) == "p.ngc:7: it cannot be planned"
    assert result.log.columns["time_s"][-1] > 0.1
    speed = np.hypot(*(np.diff(result.log.columns[f"reference_{axis}_mm"][-4:]) for axis in "xy"))
    assert np.max(speed) < 1e-3


def test_what_is_planned_ahead_is_the_trajectory_at_the_end():
    program = circle(360)
    ahead = Ahead(Planning(program, LIMITS, tolerance_m=TOLERANCE_M))
    assert ahead.trajectory().digest == plan(program, LIMITS, tolerance_m=TOLERANCE_M).digest
    assert ahead.complete
    assert ahead.duration_s == ahead.trajectory().duration_s
    assert ahead.done(len(ahead.knots_nm)) == pytest.approx(1.0)
    assert ahead.done(0) == 0.0


def test_a_path_that_was_stopped_while_it_was_planned_is_resumed(small_windows, drive):
    gate = Gate(letters(5))
    ahead = Ahead(gate.planning)
    while not len(ahead.knots_nm):
        assert not ahead.ended(0.01)
    shares = [0.0]
    operator = Operator(progress=shares.append, stop_requested=lambda: shares[-1] > 0.0)
    assert not run(ahead, "ccu", drive, operator=operator).completed
    gate.opened.set()
    rest = run(ahead.trajectory(), "ccu", drive, RunOptions(resume=True)).log
    assert rest.meta["status"] == "complete"
    assert rest.meta["resumed_at_s"] > 0.0
    assert rest.meta["accepted"] == len(ahead.knots_nm)


@pytest.mark.parametrize("powers", [False, True])
def test_the_command_starts_before_the_end_of_the_planning(small_windows, drive, tmp_path, monkeypatch, powers):
    file = tmp_path / "letters.ngc"
    ends = [(*move.segment.end_m, f"S{i}" if powers else "") for i, move in enumerate(letters(6).moves)]
    text = "\n".join(f"X{x * 1e3:.3f} Y{y * 1e3:.3f} {s}" for x, y, s in ends)
    file.write_text(f"G1 F3000{' M3' if powers else ''}\n{text}\n")
    started, complete = [], []

    def may_start(ahead):
        enough = len(ahead.knots_nm) > 0
        if enough:
            started.append(ahead)
            complete.append(ahead.complete)
        return enough

    monkeypatch.setattr(Ahead, "may_start", property(may_start))
    monkeypatch.setattr(planned, "_SHOWN_S", 0.0)
    all_planned_when_it_moves(started, monkeypatch)
    bus = ("-i", drive.bus["interface"], "-c", drive.bus["channel"])
    result = CliRunner().invoke(main, ["run", str(file), "--json", *bus, "--log", str(tmp_path / "a.csv")])
    assert result.exit_code == 0, result.output
    assert complete == [False]
    found, meta = json.loads(result.stdout), read(tmp_path / "a.csv").meta
    whole = plan(programs.load(file), LIMITS, travel_m=MACHINE.soft_limits_m, tolerance_m=TOLERANCE_M)
    assert found["duration_s"] == whole.duration_s
    assert meta["trajectory"] == whole.digest
    assert meta["status"] == "complete"
