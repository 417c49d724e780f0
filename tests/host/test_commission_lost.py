# SPDX-License-Identifier: Apache-2.0
"""`kontur commission` loses its bus, or the drive its power: what is said, and that it goes on.

What a step finds is made up, as in test_commission_ends.
"""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from test_commission_ends import Steps, commission, on, state

from kontur.drive.target import Target, open_drive
from kontur.machine import MACHINES
from kontur.sim import process

BALL = MACHINES / "ball_screw.toml"
LOST = "The drive has not got its parameters back"


def steps_that_lose(monkeypatch: pytest.MonkeyPatch, lose: Callable[[Any], None]) -> Steps:
    """Identification of y ends by what `lose` does to the device."""
    steps = Steps(monkeypatch)

    def identify(device: Any, axis: str, agreed: Any, say: Any, stop_requested: Any) -> Any:
        say(f"{axis}: a made-up step")
        found = steps.identify(device, axis, agreed, say, stop_requested)
        if axis == "y":
            lose(device)
            device.read("clock.tick")
        return found

    monkeypatch.setattr("kontur.commissioning.session.identify", identify)
    return steps


def hang_up(device: Any) -> None:
    """Break the TCP connection."""
    with socket.socket(fileno=os.dup(device.link.bus.serialPortOrig.fileno())) as connection:
        connection.shutdown(socket.SHUT_RDWR)


def test_drive_that_has_lost_its_power_is_told_with_the_step_and_the_same_command_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flash = tmp_path / "flash"
    with process.start(slcan_tcp="0", pace="sync", machine=BALL, store=flash) as drive:
        steps_that_lose(monkeypatch, lambda device: drive.end())
        done = commission(tmp_path / "out", *on(drive))
        text = json.loads(done.stdout)["diagnosis"]["text"]
        assert done.exit_code == 1
        assert "the other end has closed the connection" in text
        assert "It came at this step: y: a made-up step. A drive that hears nothing of its host stops its axes." in text
        assert "the same command goes on after the last step that was finished" in text
        assert done.stderr.count(LOST) == 1
    with process.start(slcan_tcp="0", pace="sync", machine=BALL, store=flash) as drive:
        steps = Steps(monkeypatch)
        assert commission(tmp_path / "out", *on(drive)).exit_code == 0
        assert steps.did == ["identify x", "identify y", "tune", "prove"]


def test_connection_that_breaks_leaves_the_drive_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with process.start(slcan_tcp="0", pace="sync", machine=BALL) as drive:
        before = state(drive)
        steps_that_lose(monkeypatch, hang_up)
        done = commission(tmp_path, *on(drive))
        assert done.exit_code == 1
        assert "It came at this step: y: a made-up step." in done.stderr
        assert LOST not in done.stderr
        assert state(drive) == before


def test_parameters_that_a_drive_without_power_has_forgotten_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Steps(monkeypatch, "tune")
    with process.start(slcan_tcp="0", pace="sync", machine=BALL) as drive:
        with open_drive(Target(bus=drive.options())) as device:
            device.parameters.set({"plant_x.encoder": 0.5, "wiring_y.invert_force": 1.0})
        commission(tmp_path, *on(drive))
    with process.start(slcan_tcp="0", pace="sync", machine=BALL) as drive:
        done = commission(tmp_path, *on(drive))
    assert done.exit_code == 1
    assert (
        "was broken off with another wiring; where the drive has lost its power since, set again what it has not "
        "stored (`kontur param set plant_x.encoder=0.5 wiring_y.invert_force=1`), name another folder"
    ) in done.stderr
