# SPDX-License-Identifier: Apache-2.0
"""`kontur run --resume`: another run goes on with the path on which the drive was stopped."""

import itertools
import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from kontur import machine
from kontur.cli import main
from kontur.drive.stream import Operator, stream
from kontur.drive.target import Target, open_drive
from kontur.errors import DeviceError, EmcyError, StreamError
from kontur.path import shapes
from kontur.path.smoothing import TOLERANCE_M
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.runs import log, resume
from kontur.runs.log import RunLog
from kontur.runs.runner import RunOptions, run
from kontur.runs.summary import summarise
from kontur.sim import process as sim_process

MACHINE = machine.load()
CIRCLE = plan(shapes.circle(0.02, 0.1), limits(MACHINE), tolerance_m=TOLERANCE_M)
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
        CIRCLE, "ccu", target, operator=Operator(progress=shares.append, stop_requested=lambda: shares[-1] > 0.5)
    )
    assert not result.completed


def fall_silent(target: Target) -> None:
    """The host dies in the middle of the path, and leaves everything as it is."""
    with open_drive(target) as device:

        def silence(share: float) -> None:
            if share > 0.5:
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


def test_same_command_with_resume_keeps_the_log_and_the_report_of_the_part_before(
    target: Target, tmp_path: Path
) -> None:
    interrupt(target)
    assert target.bus is not None
    bus = ("-i", str(target.bus["interface"]), "-c", str(target.bus["channel"]))
    before = {tmp_path / name: name.encode() for name in ("a.csv", "a.html", "a-part-2.csv")}
    for path, content in before.items():
        path.write_bytes(content)
    output = ("--log", str(tmp_path / "a.csv"), "--report", str(tmp_path / "a.html"))
    result = CliRunner().invoke(main, [*COMMAND, *bus, *output])
    assert result.exit_code == 0, result.output
    assert {path: path.read_bytes() for path in before} == before
    assert log.read(tmp_path / "a-part-3.csv").meta["status"] == "complete"
    assert (tmp_path / "a-part-2.html").exists()
    assert "a.csv has the part before; this one goes to" in result.stderr


def test_another_path_does_not_go_on_and_nothing_moves(target: Target) -> None:
    interrupt(target)
    begin_s = passed_s(target)
    other = plan(shapes.circle(0.02, 0.09), limits(MACHINE))
    with pytest.raises(StreamError, match=r"another path than this one, at knot \d+; give the file and the options"):
        run(other, "ccu", target, RunOptions(resume=True))
    assert passed_s(target) == begin_s


def creep(target: Target, at_least_m: float) -> float:
    """Time passes, in which friction vanishes now and then and axes without power float away; returns how far."""
    with open_drive(target) as device:
        before_m = device.position_m()
        for _ in range(60):
            device.link.wait(lambda: False, 10.0)
            off_m = math.dist(device.position_m(), before_m)
            if off_m > at_least_m:
                return off_m
    raise AssertionError(f"the axes have crept {off_m * 1e6} um only")


def test_axes_that_have_crept_go_back_to_the_path_before_it_goes_on(target: Target) -> None:
    interrupt(target)
    begin_s = passed_s(target)
    off_m = creep(target, 3e-5)
    notices: list[str] = []
    result = run(CIRCLE, "ccu", target, RunOptions(resume=True), Operator(notice=notices.append))
    assert result.completed
    rest = result.log
    assert rest.meta["status"] == "complete"
    assert rest.meta["resumed_at_s"] == pytest.approx(begin_s - 1e-3)
    assert rest.meta["trajectory"] == CIRCLE.digest
    found = summarise(rest)
    assert found.path_from_percent == pytest.approx(
        CIRCLE.path_s_m[round(begin_s * 1e3)] / CIRCLE.path_s_m[-1] * 100, abs=0.2
    )
    assert found.path_to_percent == pytest.approx(100.0, abs=0.01)
    at_mm = CIRCLE.position_m[round(begin_s * 1e3) - 1] * 1e3
    columns = rest.columns
    assert columns["reference_x_mm"][0] == pytest.approx(at_mm[0], abs=1e-4)
    assert columns["reference_y_mm"][0] == pytest.approx(at_mm[1], abs=1e-4)
    radius_mm = np.hypot(columns["position_x_mm"], columns["position_y_mm"])
    assert np.abs(radius_mm - 20.0).max() < 0.005
    assert columns["reference_x_mm"][-1] == pytest.approx(20.0, abs=1e-4)
    assert columns["time_s"][-1] == pytest.approx(CIRCLE.duration_s - begin_s + 0.05, abs=0.01)
    (notice,) = notices
    assert "from where they left the path, since axes without power creep. They go back in a straight line" in notice
    told = re.search(r"stand (\d+) µm from", notice)
    assert told is not None
    assert float(told[1]) == pytest.approx(off_m * 1e6, abs=100.0)  # 1 ms of the way


def test_path_that_went_on_after_creeping_goes_on_after_a_second_stop_and_a_third(target: Target) -> None:
    interrupt(target)
    parts: list[RunLog] = []
    for stops in (150, 150, 1_000_000):  # times that the operator is asked
        creep(target, 3e-5)
        asked = itertools.count()
        operator = Operator(stop_requested=lambda: next(asked) > stops)  # noqa: B023
        parts.append(run(CIRCLE, "ccu", target, RunOptions(resume=True), operator).log)
    assert [part.meta["status"] for part in parts] == ["interrupted", "interrupted", "complete"]
    ways = [np.unwrap(np.arctan2(part.columns["reference_y_mm"], part.columns["reference_x_mm"])) for part in parts]
    for before, after in itertools.pairwise(ways):
        assert len(before) > 100
        gap_mm = (after[0] - before[-1]) * 20.0
        assert -0.3 < gap_mm < 0.1  # where the one ended: some ms of the way twice, and nothing left out


def test_axes_too_far_from_the_path_get_no_power_and_go_back_only_with_approach(target: Target) -> None:
    interrupt(target)
    off_m = creep(target, 3e-5)
    left = resume.RETURN_MAX_M
    resume.RETURN_MAX_M = 2e-5
    try:
        with pytest.raises(
            DeviceError, match=r"the axes stand 0\.\d+ mm from where they left.*add --approach"
        ) as caught:
            run(CIRCLE, "ccu", target, RunOptions(resume=True))
    finally:
        resume.RETURN_MAX_M = left
    told = re.search(r"stand ([0-9.]+) mm", str(caught.value))
    assert told is not None
    assert float(told[1]) == pytest.approx(off_m * 1e3, abs=0.1)  # 1 ms of the way
    with open_drive(target) as device:
        assert device.read("stream.state") == 5  # still there: no axis has had power
    assert run(CIRCLE, "ccu", target, RunOptions(resume=True, approach=limits(MACHINE))).completed


def test_new_run_may_begin_where_one_was_left(target: Target) -> None:
    interrupt(target)
    assert run(CIRCLE, "ccu", target, RunOptions(approach=limits(MACHINE))).completed


@pytest.mark.parametrize("more", [(), ("--controller", "cc", "--controller", "ccu", "-i", "slcan", "-c", "none")])
def test_what_cannot_go_on_is_wrong_usage(more: tuple[str, ...]) -> None:
    result = CliRunner().invoke(main, [*COMMAND, *more])
    assert result.exit_code == 2
    assert "--resume goes on with the one path on which a drive stopped" in result.stderr
