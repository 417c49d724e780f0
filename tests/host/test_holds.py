# SPDX-License-Identifier: Apache-2.0
"""Holds on the path (M0, M1, M6): the axes stand there until the operator, or a master, lets them go on."""

import itertools
import os
import pty
import select
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from kontur import machine
from kontur.cli import main
from kontur.cli.holds import Release
from kontur.cli.live_page import Panel
from kontur.drive.stream import UNATTENDED, Operator
from kontur.drive.target import Target, open_drive
from kontur.errors import StreamError
from kontur.path import gcode
from kontur.path.smoothing import TOLERANCE_M
from kontur.planning.bounds import limits
from kontur.planning.outputs import SPINDLE, Tool, held, of_words, words
from kontur.planning.path_time import PathTime
from kontur.planning.planner import Trajectory, plan
from kontur.runs.runner import RunOptions, RunResult, run
from kontur.sim import process as sim_process

MACHINE = machine.load()
PROGRAM = "T1 M6\nM3 S500\nG1 X5 F3000\nM0\nX10\nT2 M6\nG1 X15\nM5\n"


def planned() -> Trajectory:
    return plan(gcode.parse(PROGRAM, "a.ngc"), limits(MACHINE), tolerance_m=TOLERANCE_M)


def test_hold_is_at_the_first_knot_of_its_rest_and_there_is_none_before_the_first_move() -> None:
    t = planned()
    assert [event.line for event in held(t.program)] == [4, 6]
    holds = of_words(words(t, SPINDLE)).holds
    assert t.position_m[holds, 0] == pytest.approx([5e-3, 10e-3], abs=1e-9)
    for hold in holds:
        assert np.ptp(t.position_m[hold : hold + 690, 0]) < 1e-9


def released_after(calls: int) -> tuple[RunResult, list[int]]:
    asked: list[int] = []
    counts = itertools.count(1)

    def release(hold: int) -> bool:
        asked.append(hold)
        return next(counts) % calls == 0

    operator = Operator(release=release)
    return run(planned(), "ccu", Target(machine=MACHINE, place_at_start=True), operator=operator), asked


def test_run_waits_at_each_hold_and_its_log_knows_where_the_axes_are() -> None:
    result, asked = released_after(100)
    assert result.completed
    assert asked == [-2] * 100 + [-1] * 100
    log = result.log.columns
    assert log["time_s"][-1] > planned().duration_s + 0.2
    off_mm = np.abs(log["position_x_mm"] - log["reference_x_mm"])
    assert off_mm.max() < 0.05
    assert result.log.meta["score"]["tangential_mean_um"] < 2.0
    truth = result.truth
    assert truth is not None
    last = np.rint(log["time_s"] * 1e4).astype(int)
    assert np.isclose(log["power"], truth.power[last], atol=1e-4).mean() > 0.998
    rests = np.flatnonzero(np.diff((truth.power > 0).astype(int)))
    assert len(rests) == 5  # off and on at each hold, off at the end
    for off, on in (rests[0:2], rests[2:4]):
        assert np.ptp(truth.pos_m[off:on, 0]) < 1e-6


def test_path_time_stops_at_its_hold_like_the_drive() -> None:
    path = PathTime(1.0, 1000.0)
    path.hold = 2000.0
    path.advance(1.0, 5000)
    assert path.at(np.array([1999.0, 4999.0])) == pytest.approx([1999.0, 2500.0], abs=1.5)
    path.hold = np.inf
    path.advance(1.0, 9000)
    assert path.at(np.array([9000.0])) == pytest.approx([2500.0 + 4000.0 - 500.0], abs=1.5)


def test_command_asks_and_yes_does_not(tmp_path: Path) -> None:
    file = tmp_path / "a.ngc"
    file.write_text(PROGRAM)
    result = CliRunner().invoke(main, ["run", str(file), "--yes"])
    assert result.exit_code == 0, result.output
    assert "held at" not in result.output


def test_operator_is_asked_once_and_goes_on_by_the_panel(capsys: pytest.CaptureFixture[str]) -> None:
    panel = Panel()
    release = Release(planned().program, panel, yes=False)
    assert not release(-2)
    assert panel.held
    assert not release(-2)
    assert capsys.readouterr().err.count("The path is held at M0 in line 4. Press Enter to go on") == 1
    panel.held = False  # SIGUSR2, or the live page
    assert release(-2)
    assert not release(-1)
    assert "M6 in line 6" in capsys.readouterr().err
    assert Release(planned().program, panel, yes=True)(-1)


def test_enter_from_before_a_hold_does_not_let_the_path_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    keyboard, terminal = pty.openpty()
    with os.fdopen(keyboard, "wb", buffering=0) as typed, os.fdopen(terminal, "r") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        release = Release(planned().program, Panel(), yes=False)
        typed.write(b"\n\n")
        assert select.select([stdin], [], [], 10.0)[0]
        assert not release(-2)
        typed.write(b"\n")
        assert select.select([stdin], [], [], 10.0)[0]
        assert release(-2)


def test_hold_without_standard_input_says_how_to_go_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", None)
    panel = Panel()
    release = Release(planned().program, panel, yes=False)
    assert not release(-2)
    assert f"kill -USR2 {os.getpid()}" in capsys.readouterr().err
    panel.held = False
    assert release(-2)


@pytest.fixture
def in_a_hold() -> Iterator[tuple[Target, Trajectory, Operator]]:
    """A drive on its bus that has been stopped in a hold of the path, and by whom: he lets no path go on."""
    with sim_process.start(slcan_tcp="0", pace="sync", machine=MACHINE) as sim:
        target = Target(machine=MACHINE, bus={"interface": sim.interface, "channel": sim.channel})
        with open_drive(target) as device, device.master.held():
            device.parameters.set(MACHINE.parameters(1))
        t, waits = planned(), itertools.count()
        stopped = Operator(release=lambda _: False, stop_requested=lambda: next(waits) > 700)
        assert not run(t, "ccu", target, RunOptions(approach=limits(MACHINE)), operator=stopped).completed
        yield target, t, stopped


def executed_knots(target: Target) -> float:
    with open_drive(target) as device:
        return device.read("stream.executed")


def test_resume_with_other_outputs_is_refused_before_anything_moves(
    in_a_hold: tuple[Target, Trajectory, Operator],
) -> None:
    target, t, _ = in_a_hold
    executed = executed_knots(target)
    with pytest.raises(StreamError, match=r"has switched other outputs so far.*--full-s"):
        run(t, "ccu", target, RunOptions(resume=True, tool=Tool(full_s=700.0)))
    assert executed_knots(target) == executed
    go = Operator(release=lambda _: True)
    assert run(t, "ccu", target, RunOptions(resume=True), operator=go).completed


def test_stop_in_a_hold_that_is_asked_for_again_when_the_path_is_resumed_moves_nothing(
    in_a_hold: tuple[Target, Trajectory, Operator],
) -> None:
    target, t, stopped = in_a_hold
    executed = executed_knots(target)
    with open_drive(target) as device:
        assert device.read("outputs.hold") > 0
    with pytest.raises(KeyboardInterrupt):
        run(t, "ccu", target, RunOptions(resume=True), operator=stopped)
    assert executed_knots(target) == executed
    assert run(t, "ccu", target, RunOptions(resume=True), operator=UNATTENDED).completed
