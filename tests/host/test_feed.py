# SPDX-License-Identifier: Apache-2.0
"""Feed hold, feed override and going on after a fault, as the host asks for them, on the simulated drive."""

import math
import os
import signal
from collections.abc import Iterator

import numpy as np
import pytest

from kontur import machine
from kontur.cli.live_page import Panel
from kontur.cli.options import held_by_signals
from kontur.drive.device import Device
from kontur.drive.stream import UNATTENDED, Operator, stream
from kontur.drive.target import Target, open_drive
from kontur.errors import EmcyError, ParameterError, StreamError
from kontur.path import shapes
from kontur.planning import planner
from kontur.planning.bounds import limits
from kontur.runs import resume
from kontur.runs.runner import run

MACHINE = machine.load().starting_at((0.02, 0.0))
CIRCLE = planner.plan(shapes.circle(0.02, 0.1, duration_s=2.0), limits(MACHINE))


@pytest.fixture
def device() -> Iterator[Device]:
    with open_drive(Target(MACHINE)) as device:
        device.axes.enable()
        yield device


def rate_by_time(device: Device, *changes: tuple[float, float]):  # type: ignore[no-untyped-def]
    """The rate asked for, from so many seconds after now on."""
    begin_s = device.link.time_s
    return lambda: [rate for at_s, rate in ((-1.0, 1.0), *changes) if at_s <= device.link.time_s - begin_s][-1]


def test_path_that_is_held_and_slowed_is_finished_with_every_knot(device: Device) -> None:
    result = stream(
        device, CIRCLE.knots_nm, Operator(feed_override=rate_by_time(device, (1.0, 0.0), (2.0, 0.5), (2.5, 1.2)))
    )
    assert result.completed  # by the checksum of the executed knots, too
    assert [rate for _, rate in result.rates] == [1.0, 0.0, 0.5, 1.2]


def test_held_drive_stops_on_the_path_when_asked_to(device: Device) -> None:
    rate = rate_by_time(device, (1.0, 0.0))
    begin_s = device.link.time_s
    result = stream(
        device, CIRCLE.knots_nm, Operator(feed_override=rate, stop_requested=lambda: device.link.time_s - begin_s > 2.0)
    )
    assert not result.completed
    assert 500 < result.executed < 1000


def test_override_out_of_range_is_refused(device: Device) -> None:
    with pytest.raises(ParameterError, match=r"feed override 121 % is out of range; it must be 0\.\.120 %"):
        device.override_feed(1.21)


@pytest.mark.parametrize("percent", [50, 120])
def test_run_under_an_override_takes_its_time_and_is_scored_on_the_path(percent: int) -> None:
    result = run(CIRCLE, "ccu", Target(machine=MACHINE), operator=Operator(feed_override=lambda: percent / 100))
    assert result.completed
    assert result.log.columns["time_s"][-1] == pytest.approx(CIRCLE.duration_s * 100 / percent, abs=2e-3)
    assert result.log.meta["score"]["tangential_mean_um"] < 1.0  # where the drive was when the log says so
    along = np.hypot(result.log.columns["reference_x_mm"], result.log.columns["reference_y_mm"])
    assert np.abs(along - 20.0).max() < 1e-3


def fall_silent(device: Device) -> EmcyError:
    """The host's heartbeat ceases in the middle of the path."""

    def silence(share: float) -> None:
        if share > 0.75:
            device.link.stop_heartbeat()

    with pytest.raises(EmcyError, match="8130h") as caught:
        stream(device, CIRCLE.knots_nm, Operator(progress=silence))
    device.link.wait(lambda: device.axes.states() == ("fault", "fault"), 1.0)
    device.axes.enable()
    return caught.value


def test_path_goes_on_after_a_fault_and_every_knot_is_executed_once(device: Device) -> None:
    fall_silent(device)
    stood = device.read("stream.executed")
    assert 0 < stood < len(CIRCLE.knots_nm)
    result = stream(device, CIRCLE.knots_nm, resume=True)
    assert result.completed
    assert result.executed == len(CIRCLE.knots_nm)


def test_path_does_not_go_on_with_other_knots(device: Device) -> None:
    fall_silent(device)
    other = CIRCLE.knots_nm.copy()
    other[3] += 1
    with pytest.raises(StreamError, match=r"has left another path than this one"):
        stream(device, other, resume=True)


def test_axes_that_crept_without_power_go_back_in_a_straight_line_and_on(device: Device) -> None:
    share = [0.0]
    assert not stream(device, CIRCLE.knots_nm, Operator(share.append, lambda: share[-1] > 0.75)).completed
    device.axes.disable()
    device.link.wait(lambda: False, 40.0)
    left = resume.left_by(device, CIRCLE, resume.RETURN_MAX_M)
    crept_m = math.dist(device.position_m(), left.at_m)
    assert crept_m > 2e-5
    device.axes.enable()
    rest, has_knots = resume.return_to(device, left, limits(MACHINE), UNATTENDED)
    assert not has_knots
    assert math.dist(device.position_m(), left.at_m) < 2e-6
    assert stream(device, rest.trajectory.knots_nm).completed
    assert math.dist(device.position_m(), CIRCLE.position_m[-1]) < 2e-6


def test_path_on_which_the_axes_lost_their_power_is_not_gone_on_with(device: Device) -> None:
    device.axes.disable()
    device.parameters.set({"following_window_x": 1000, "plant_x.force_limit": 60.0})
    device.axes.enable()
    with pytest.raises(EmcyError, match="8611h: an axis was further"):
        stream(device, CIRCLE.knots_nm)
    device.link.wait(lambda: False, 1.0)
    with pytest.raises(StreamError, match=r"further from its reference.*lost their power on the way; plan anew"):
        resume.left_by(device, CIRCLE, resume.RETURN_MAX_M)


def test_path_that_was_not_left_does_not_go_on(device: Device) -> None:
    with pytest.raises(StreamError, match=r"cannot go on with the path.*plan anew from where they stand"):
        stream(device, CIRCLE.knots_nm, resume=True)


def test_signals_hold_and_let_go() -> None:
    panel = Panel(percent=80.0)
    with held_by_signals(panel):
        assert panel.rate() == 0.8
        os.kill(os.getpid(), signal.SIGUSR1)
        assert panel.rate() == 0.0
        os.kill(os.getpid(), signal.SIGUSR2)
        assert panel.rate() == 0.8
