# SPDX-License-Identifier: Apache-2.0
"""Recordings of an axis while it is commissioned: a fault that comes meanwhile, and a program that is late."""

from collections.abc import Iterator

import numpy as np
import pytest

from kontur.commissioning import first_moves, response
from kontur.commissioning.bias import Mover
from kontur.commissioning.identify import identify
from kontur.commissioning.recording import ScopeRecorder, scan
from kontur.drive import scope
from kontur.drive.device import Device
from kontur.drive.pdos import TELEMETRY
from kontur.drive.target import Target, open_drive
from kontur.errors import DeviceError, EmcyError
from kontur.machine import MACHINES, load

HEARTBEAT_LOST = 0x8130


@pytest.mark.parametrize("begun", [True, False], ids=["during the recording", "before it"])
def test_fault_is_reported_and_not_that_the_scope_keeps_its_capture(begun: bool) -> None:
    with open_drive(Target()) as device:
        recorder = ScopeRecorder(device, "x", 0.1)
        with device.axes.enabled():
            if begun:
                recorder.start()
            device.link.stop_heartbeat()
            assert device.link.wait(lambda: HEARTBEAT_LOST in device.link.reported, 2.0)
            device.link.wait(lambda: False, 0.5)
            with pytest.raises(EmcyError, match="heartbeat"):
                recorder.read() if begun else recorder.start()


@pytest.fixture
def mover() -> Iterator[Mover]:
    """Axis x between -30 and 30 mm, which at 20 mm/s is 3 s."""
    with open_drive(Target(machine=load(MACHINES / "ball_screw.toml"))) as device:
        device.select_controller("cascade")
        device.parameters.set({"position_limit_x.min": -30e6, "position_limit_x.max": 30e6})
        with device.axes.enabled(also=TELEMETRY):
            yield Mover(device, "x")


def late(monkeypatch: pytest.MonkeyPatch, times: int) -> None:
    """The program loses 1.5 s before it starts the scope, so many times."""
    arm, left = scope.arm, [times]

    def slowly(device: Device, setup: scope.Setup) -> None:
        if left[0]:
            left[0] -= 1
            device.link.wait(lambda: False, 1.5)
        arm(device, setup)

    monkeypatch.setattr(scope, "arm", slowly)


def test_scan_in_which_the_axis_came_to_its_soft_limit_is_done_again(
    mover: Mover, monkeypatch: pytest.MonkeyPatch
) -> None:
    late(monkeypatch, 1)
    found = scan(mover, 0.02, 4.0, 0.3)
    tenth = len(found.first_m) // 10
    ends = [np.polyfit(found.time_s[part], found.first_m[part], 1)[0] for part in (slice(tenth), slice(-tenth, None))]
    assert ends == pytest.approx([0.02, 0.02], rel=0.02)


def test_program_that_is_late_each_time_is_told_so(mover: Mover, monkeypatch: pytest.MonkeyPatch) -> None:
    late(monkeypatch, 99)
    with pytest.raises(DeviceError, match="axis x comes to the end of its travel before a measurement is done"):
        scan(mover, 0.02, 4.0, 0.3)


def test_windows_in_which_the_axis_was_held_back_are_measured_again(
    mover: Mover, monkeypatch: pytest.MonkeyPatch
) -> None:
    excite, seen = response.excite, []

    def slowly(*arguments: object) -> response.Complex:
        found = excite(*arguments)  # type: ignore[arg-type]
        if not seen:
            mover.pause(3.0)
        seen.append(mover.position_m())
        return found

    monkeypatch.setattr(response, "excite", slowly)
    setup = response.Setup((30.0, 90.0), 16.0, 0.02, 0.4, 1, 0.2)
    response.measure(mover.device, "x", setup)
    assert len(seen) == 3  # to and fro, and the first one twice
    assert seen[0] > 0.028
    assert seen[1] < 0.02


def test_nothing_but_the_status_is_sent_after_a_movement() -> None:
    with open_drive(Target()) as device:
        before = device.pdos.sent()
        for _ in range(2):
            with first_moves.moving(device, "x", lambda: False):
                assert len(device.pdos.sent()) > len(before)
            assert device.pdos.sent() == before


def fall_silent(device: Device) -> None:
    """Send no heartbeat any more, with power, until the drive is in fault."""
    with device.axes.enabled():
        device.link.stop_heartbeat()
        device.link.wait(lambda: False, 2.0)
        device.faults.check()


def test_identification_goes_on_after_a_fault_that_ended_one_before(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> float:
        raise KeyboardInterrupt

    monkeypatch.setattr(first_moves, "direction", interrupted)
    with open_drive(Target()) as device:
        with pytest.raises(EmcyError, match="heartbeat"):
            fall_silent(device)
        assert "fault" in device.axes.states()
        with pytest.raises(KeyboardInterrupt):  # it has come to its second step
            identify(device, "x", first_moves.Agreed(100.0))
        assert device.axes.states() == ("switch on disabled", "switch on disabled")
