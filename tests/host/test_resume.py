# SPDX-License-Identifier: Apache-2.0
"""`kontur run --resume`: another run goes on with the path on which the drive was stopped."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from kontur import machine
from kontur.cli import main
from kontur.drive.stream import Operator, stream
from kontur.drive.target import Target, open_drive
from kontur.errors import EmcyError, StreamError
from kontur.path import shapes
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.runs import log
from kontur.runs.log import RunLog
from kontur.runs.runner import RunOptions, run
from kontur.sim import process as sim_process

MACHINE = machine.load()
CIRCLE = plan(shapes.circle(0.02, 0.1), limits(MACHINE))
COMMAND = ("run", "circle", "--radius", "20", "--feed", "100", "--resume")


@pytest.fixture
def target() -> Iterator[Target]:
    """A drive that stays when a run has ended, and stands at the start of the circle."""
    at_start = MACHINE.starting_at(CIRCLE.program.start_m)
    with sim_process.start(slcan_tcp="0", pace="sync", machine=at_start) as sim:
        target = Target(machine=MACHINE, bus={"interface": sim.interface, "channel": sim.channel})
        with open_drive(target) as device, device.master.held():
            device.parameters.set(MACHINE.parameters(1))
        yield target


def interrupt(target: Target) -> None:
    """A run is asked to stop on its way."""
    shares = [0.0]
    result = run(
        CIRCLE, "ccu", target, operator=Operator(progress=shares.append, stop_requested=lambda: shares[-1] > 0.9)
    )
    assert not result.completed


def fall_silent(target: Target) -> None:
    """The host dies in the middle of the path, and leaves everything as it is."""
    with open_drive(target) as device:

        def silence(share: float) -> None:
            if share > 0.9:
                device.link.stop_heartbeat()

        device.axes.enable()
        with pytest.raises(EmcyError, match="8130h"):
            stream(device, CIRCLE.knots_nm, Operator(progress=silence))
        device.link.wait(lambda: device.axes.states() == ("fault", "fault"), 1.0)


def passed_s(target: Target) -> float:
    with open_drive(target) as device:
        executed = int(device.read("stream.executed"))
    assert 100 < executed < len(CIRCLE.knots_nm) - 100
    return executed * 1e-3


def expect_the_rest(rest: RunLog, begin_s: float) -> None:
    """The log begins where the path was left, and all along the axes are where it says that they are to be."""
    columns = rest.columns
    assert rest.meta["status"] == "complete"
    assert rest.meta["resumed_at_s"] == begin_s
    at_mm = [np.interp(begin_s * 1e3, np.arange(len(CIRCLE.position_m)), CIRCLE.position_m[:, i]) * 1e3 for i in (0, 1)]
    assert math.hypot(columns["reference_x_mm"][0] - at_mm[0], columns["reference_y_mm"][0] - at_mm[1]) < 0.2
    off_mm = np.hypot(
        columns["position_x_mm"] - columns["reference_x_mm"], columns["position_y_mm"] - columns["reference_y_mm"]
    )
    assert off_mm.max() < 0.2  # 2 ms of the way
    assert rest.meta["accepted"] == len(CIRCLE.knots_nm)


def test_run_goes_on_after_an_interrupted_one(target: Target) -> None:
    interrupt(target)
    begin_s = passed_s(target)
    result = run(CIRCLE, "ccu", target, RunOptions(resume=True))
    assert result.completed
    expect_the_rest(result.log, begin_s)


def test_command_goes_on_after_the_host_was_lost(target: Target, tmp_path: Path) -> None:
    fall_silent(target)
    begin_s = passed_s(target)
    assert target.bus is not None
    bus = ("-i", str(target.bus["interface"]), "-c", str(target.bus["channel"]))
    result = CliRunner().invoke(main, [*COMMAND, *bus, "--log", str(tmp_path / "rest.csv")])
    assert result.exit_code == 0, result.output
    expect_the_rest(log.read(tmp_path / "rest.csv"), begin_s)


def test_another_path_does_not_go_on_and_nothing_moves(target: Target) -> None:
    interrupt(target)
    begin_s = passed_s(target)
    other = plan(shapes.circle(0.02, 0.09), limits(MACHINE))
    with pytest.raises(StreamError, match="has left another path than this one"):
        run(other, "ccu", target, RunOptions(resume=True))
    assert passed_s(target) == begin_s


def test_new_run_may_begin_where_one_was_left(target: Target) -> None:
    interrupt(target)
    assert run(CIRCLE, "ccu", target, RunOptions(approach=limits(MACHINE))).completed


@pytest.mark.parametrize("more", [(), ("--controller", "cc", "--controller", "ccu", "-i", "slcan", "-c", "none")])
def test_what_cannot_go_on_is_wrong_usage(more: tuple[str, ...]) -> None:
    result = CliRunner().invoke(main, [*COMMAND, *more])
    assert result.exit_code == 2
    assert "--resume goes on with the one path on which a drive stopped" in result.stderr
