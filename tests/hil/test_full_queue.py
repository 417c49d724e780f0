# SPDX-License-Identifier: Apache-2.0
"""A circle whose frames wait in a transmit queue that is too short for a burst of knots."""

import os
import shutil
import subprocess
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import can
import pytest
from rig import PATIENCE_S, Rig, checksum
from targets import Process, Target

from kontur.can import link, wire
from kontur.can.bad_bus import BadBus, BusFaults
from kontur.drive.stream import stream

pytestmark = pytest.mark.motion

# Hardly more frames than a stream needs, so that a slow host fills the queue, too
SHORT = BusFaults(txqueuelen=10, frames_per_s=1300.0)
LAPS = 3.0
FLOWS, STANDS = "320kbit", "8bit"  # 2,500 frames a second, and one in 16 s
FULL_EACH = 300  # frames of an identifier that the host sends
NOBODYS = 0x6FF  # an identifier that CiA 301 gives to nobody
_QUEUE_BYTES = str(10 * 16)  # ten classic frames of Linux


def run_circle(rig: Rig) -> None:
    knots_nm = rig.circle(LAPS)
    with rig.device.axes.enabled():
        result = stream(rig.device, knots_nm)
        assert result.completed
        assert result.executed == len(knots_nm)
        assert rig.device.read_stable("stream.checksum") == checksum(knots_nm)


def test_circle_through_a_queue_of_ten_frames_is_complete(target: Target) -> None:
    if isinstance(target, Process) and target.is_vcan:
        pytest.skip("--target inproc or slcan has the model of a queue; on vcan the next test fills the kernel's own")
    with target.power_on() as drive, Rig(drive) as rig:
        bus = BadBus(inner=rig.bus, faults=SHORT)
        rig.connect(bus)
        run_circle(rig)
        assert bus.to_drive.refused > 0


@contextmanager
def short_queue(channel: str) -> Iterator[Callable[[str], None]]:
    """An interface with a queue, of which vcan has none by itself; gives what sets the rate at which frames leave."""
    tc = shutil.which("tc", path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin")
    if tc is None:
        pytest.skip("giving vcan a queue needs tc: sudo apt-get install iproute2")
    if os.geteuid() != 0:
        pytest.skip("giving vcan a queue needs root: sudo make test-hil TARGET=vcan")

    def qdisc(verb: str, *words: str) -> None:
        subprocess.run([tc, "qdisc", verb, "dev", channel, "root", *words], check=True)

    def set_rate(rate: str, verb: str = "change") -> None:
        qdisc(verb, "tbf", "rate", rate, "burst", _QUEUE_BYTES, "limit", _QUEUE_BYTES)

    set_rate(FLOWS, "add")
    try:
        yield set_rate
    finally:
        qdisc("del")


def fill(bus: can.BusABC) -> None:
    """Send until there is no room for one more frame."""
    with suppress(can.CanError):
        for _ in range(100):
            bus.send(can.Message(arbitration_id=NOBODYS, is_extended_id=False))


def test_circle_through_a_queue_of_the_kernel_that_fills_is_complete(
    target: Target, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is the drive's queue, too: on vcan both ends send into the same one. Another node fills it, so that it is full
    on every machine, however slow, when the host sends."""
    if not isinstance(target, Process) or not target.is_vcan:
        pytest.skip("needs an interface of SocketCAN on this machine: --target vcan")
    channel = target.bus["can"]
    with (
        target.power_on() as drive,
        Rig(drive) as rig,
        can.Bus(interface="socketcan", channel=channel) as other,
        short_queue(channel) as set_rate,
    ):
        sent, full = Counter[int](), set()
        send = rig.bus.send

        def send_each(message: can.Message, timeout: float | None = None) -> None:
            sent[message.arbitration_id] += 1
            if sent[message.arbitration_id] % FULL_EACH:
                send(message, timeout)
                return
            set_rate(STANDS)
            fill(other)
            with pytest.raises(can.CanError) as refused:
                send(message, timeout)
            full.add(message.arbitration_id)
            set_rate(FLOWS)
            raise refused.value

        monkeypatch.setattr(rig.bus, "send", send_each)
        monkeypatch.setattr(link, "_QUEUE_FULL_S", PATIENCE_S)  # `tc` takes long on a busy machine
        run_circle(rig)
        assert {wire.RPDO2 + drive.node_id, wire.SYNC} <= full
