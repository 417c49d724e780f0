# SPDX-License-Identifier: Apache-2.0
"""A circle whose frames wait in a transmit queue that is too short for a burst of knots."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

import can
import pytest
from rig import Rig, checksum
from targets import Process, Target

from kontur.can.bad_bus import BadBus, BusFaults
from kontur.drive.stream import stream

pytestmark = pytest.mark.motion

# Hardly more frames than a stream needs, so that a slow host fills the queue, too
SHORT = BusFaults(txqueuelen=10, frames_per_s=1300.0)
LAPS = 3.0
_FRAME_BYTES = 16  # of a classic frame in Linux
_QUEUE = f"rate 320kbit burst {10 * _FRAME_BYTES} limit {10 * _FRAME_BYTES}"  # 2,500 frames a second


def run_circle(rig: Rig) -> None:
    knots_nm = rig.circle(LAPS)
    with rig.device.axes.enabled():
        result = stream(rig.device, knots_nm)
        assert result.completed
        assert result.executed == len(knots_nm)
        assert rig.device.read_stable("stream.checksum") == checksum(knots_nm)


def test_circle_through_a_queue_of_ten_frames_is_complete(target: Target) -> None:
    if isinstance(target, Process) and target.is_vcan:
        pytest.skip("has a queue of the kernel, which fills however slow this machine is: the next test")
    with target.power_on() as drive, Rig(drive) as rig:
        bus = BadBus(inner=rig.bus, faults=SHORT)
        rig.connect(bus)
        run_circle(rig)
        assert bus.to_drive.refused > 0


@contextmanager
def short_queue(channel: str) -> Iterator[None]:
    """An interface whose queue fills: vcan has none by itself."""
    tc = shutil.which("tc", path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin")
    if tc is None or os.geteuid() != 0:
        pytest.skip("giving vcan a queue needs root, and `tc` of iproute2")
    qdisc = [tc, "qdisc"]
    subprocess.run([*qdisc, "add", "dev", channel, "root", "tbf", *_QUEUE.split()], check=True)
    try:
        yield
    finally:
        subprocess.run([*qdisc, "del", "dev", channel, "root"], check=True)


def test_circle_through_a_queue_of_the_kernel_that_fills_is_complete(
    target: Target, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is the drive's queue, too: on vcan both ends send into the same one."""
    if not isinstance(target, Process) or not target.is_vcan:
        pytest.skip("needs an interface of SocketCAN on this machine: --target vcan")
    with target.power_on() as drive, Rig(drive) as rig, short_queue(target.bus["can"]):
        full: list[can.CanError] = []
        send = rig.bus.send

        def noted(message: can.Message, timeout: float | None = None) -> None:
            try:
                send(message, timeout)
            except can.CanError as error:
                full.append(error)
                raise

        monkeypatch.setattr(rig.bus, "send", noted)
        run_circle(rig)
        if not full:
            pytest.skip("this machine sends too slowly to fill the queue: run it on a kernel that has vcan itself")
