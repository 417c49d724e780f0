# SPDX-License-Identifier: Apache-2.0
"""A path that a drive has left is gone on with while the rest of it is planned."""

import pytest
from cam_paths import letters
from click.testing import CliRunner
from gated_planning import LIMITS, MACHINE, Gate, all_planned_when_it_moves, kept_drive, opened_on_the_way
from test_resume import creep

from kontur.cli import main, planned
from kontur.drive.stream import Operator
from kontur.drive.target import open_drive
from kontur.errors import StreamError
from kontur.path import gcode, programs, smoothing
from kontur.path.smoothing import TOLERANCE_M
from kontur.planning import ahead as ahead_of_drive
from kontur.planning.ahead import Ahead
from kontur.planning.planner import Planning, plan
from kontur.runs.runner import RunOptions, run

PROGRAM = letters(40)
RESUME = RunOptions(resume=True)

drive = pytest.fixture(kept_drive)


@pytest.fixture(autouse=True)
def small_windows(monkeypatch):
    monkeypatch.setattr(smoothing, "_WINDOWS_S", (0.5,))


@pytest.fixture
def whole():
    return plan(PROGRAM, LIMITS, tolerance_m=TOLERANCE_M)


def stop_on_the_way(drive, path):
    """Returns how many knots the drive has accepted then, and about how many it has executed."""
    shares = [0.0]
    operator = Operator(progress=shares.append, stop_requested=lambda: shares[-1] > 0.01)
    result = run(path, "ccu", drive, operator=operator)
    assert not result.completed
    return result.log.meta["accepted"], round(result.log.columns["time_s"][-1] * 1e3)


@pytest.mark.parametrize("told", [True, False], ids=["total known", "total not known"])
def test_a_path_goes_on_before_it_is_planned(drive, whole, monkeypatch, told):
    if told:
        accepted, executed = stop_on_the_way(drive, whole)
    else:
        before = Gate(PROGRAM, knots=3000)
        ahead = Ahead(before.planning)
        assert before.waits.wait(300.0)
        accepted, executed = stop_on_the_way(drive, ahead)
        before.opened.set()
    ahead, total_before = opened_on_the_way(Gate(PROGRAM, knots=accepted + 2100), monkeypatch)
    assert len(ahead.knots_nm) < 0.5 * len(whole.knots_nm)
    result = run(ahead, "ccu", drive, RESUME)
    assert total_before == [len(whole.knots_nm) if told else 0]
    assert result.completed
    assert result.log.meta["resumed_at_s"] == pytest.approx(executed * 1e-3, abs=0.06)
    assert result.log.meta["accepted"] == len(whole.knots_nm)
    assert result.log.meta["trajectory"] == whole.digest
    end_mm = whole.position_m[-1] * 1e3
    assert [result.log.columns[f"position_{axis}_mm"][-1] for axis in "xy"] == pytest.approx(end_mm, abs=1e-3)


@pytest.mark.parametrize("letter", ["fewer", "more"])
def test_a_path_whose_end_turns_out_to_be_another_one_is_stopped(drive, whole, monkeypatch, letter):
    accepted, _ = stop_on_the_way(drive, whole)
    other = letters(30 if letter == "fewer" else 50)
    ahead, total_before = opened_on_the_way(Gate(other, knots=accepted + 2100), monkeypatch)
    with pytest.raises(StreamError, match="another path than this one, whose end is different; give the file"):
        run(ahead, "ccu", drive, RESUME)
    assert total_before == [len(whole.knots_nm)]
    with open_drive(drive) as device:
        assert device.read("stream.state") == 5  # stopped on the path
        assert 0 < device.read("stream.executed") < min(len(whole.knots_nm), len(ahead.knots_nm)) - 1000


def test_axes_that_have_crept_wait_for_all_of_the_path(drive, whole, monkeypatch):
    accepted, executed = stop_on_the_way(drive, whole)
    creep(drive, 3e-5)
    gate = Gate(PROGRAM, knots=accepted + 2100)
    ahead = Ahead(gate.planning)
    assert gate.waits.wait(300.0)
    ended = ahead.ended

    def waited(timeout_s=None):
        gate.opened.set()
        return ended(timeout_s)

    monkeypatch.setattr(ahead, "ended", waited)
    result = run(ahead, "ccu", drive, RESUME)
    assert result.completed
    assert result.log.meta["accepted"] < len(whole.knots_nm) - 0.4 * executed  # a new stream
    assert result.log.meta["trajectory"] == whole.digest


def test_another_path_is_refused_when_all_of_it_is_planned(drive, whole):
    stop_on_the_way(drive, whole)
    other = Ahead(Planning(letters(40, feed_mps=0.04), LIMITS, tolerance_m=TOLERANCE_M))
    with pytest.raises(StreamError, match=r"another path than this one, at knot \d+; give the file and the options"):
        run(other, "ccu", drive, RESUME)


def test_outputs_go_on_while_the_path_is_planned(drive, monkeypatch):
    """Other outputs than those that the drive has switched are refused before anything moves."""
    ends = [move.segment.end_m for move in PROGRAM.moves]
    program, other = (
        gcode.parse("\n".join(["G1 F3000 M3", *(f"X{1e3 * x:.3f} Y{1e3 * y:.3f} S{s}" for s, (x, y) in ends)]), "p.ngc")
        for ends in (list(enumerate(ends, first)) for first in (1, 2))
    )
    whole = plan(program, LIMITS, tolerance_m=TOLERANCE_M)
    accepted, _ = stop_on_the_way(drive, whole)
    ahead, _ = opened_on_the_way(Gate(other, knots=accepted + 2100), monkeypatch)
    with pytest.raises(StreamError, match="other outputs so far than this program does"):
        run(ahead, "ccu", drive, RESUME)
    ahead, total_before = opened_on_the_way(Gate(program, knots=accepted + 2100), monkeypatch)
    assert run(ahead, "ccu", drive, RESUME).completed  # the drive has counted each change once
    assert total_before == [len(whole.knots_nm)]


def test_the_command_goes_on_before_the_end_of_the_planning(drive, tmp_path, monkeypatch):
    file = tmp_path / "letters.ngc"
    ends = (move.segment.end_m for move in PROGRAM.moves)
    file.write_text("G1 F3000\n" + "\n".join(f"X{x * 1e3:.3f} Y{y * 1e3:.3f}" for x, y in ends) + "\n")
    bus = ("-i", drive.bus["interface"], "-c", drive.bus["channel"])
    nothing = CliRunner().invoke(main, ["run", str(file), "--resume", *bus])
    assert nothing.exit_code != 0
    assert "the drive cannot go on with the path: it did not stop on it" in nothing.stderr
    whole = plan(programs.load(file), LIMITS, travel_m=MACHINE.soft_limits_m, tolerance_m=TOLERANCE_M)
    accepted, _ = stop_on_the_way(drive, whole)
    started, found = [], []
    may_start = Ahead.may_start.fget

    def asked(ahead):
        enough = may_start(ahead)
        started.append(ahead)
        found.append((ahead.complete, len(ahead.knots_nm)))
        return enough

    monkeypatch.setattr(Ahead, "may_start", property(asked))
    all_planned_when_it_moves(started, monkeypatch)
    monkeypatch.setattr(planned, "_SHOWN_S", 0.0)
    monkeypatch.setattr(ahead_of_drive, "_FASTER", 0.0)  # however busy the processor is
    result = CliRunner().invoke(main, ["run", str(file), "--resume", "--json", *bus])
    assert result.exit_code == 0, result.output
    complete, knots = found[-1]
    assert not complete
    assert accepted + 2000 <= knots < len(whole.knots_nm)
