# SPDX-License-Identifier: Apache-2.0
"""The host dies, or its bus does: the drive stops on the path, switches off, and says 8130h to whoever listens."""

import json
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import can
import numpy as np
import pytest
from rig import PATIENCE_S, Knots, Rig
from stepped_stream import SteppedStream
from targets import Drive, Target, needs_clock

from kontur.can import wire
from kontur.can.bad_bus import BadBus
from kontur.errors import KonturError

pytestmark = pytest.mark.motion

HEARTBEAT_LOST = 0x8130
FAULT = 0x08  # of statusword's bits 4Fh
LAPS = 16.0
WAITING = 800  # knots or more in the queue, so that the heartbeat ceases before the knots do
# Where the drive's time goes by the wall clock: a busy machine may keep the host from running for a second. The drive
# waits longer than that for the heartbeat, and at this rate its queue lasts longer still.
_WATCH_MS, _RATE = 3000, 0.2
_START_S, _END_S = 90.0, PATIENCE_S


def assert_stopped_and_off(rig: Rig) -> None:
    """The drive has stopped on the path for want of a heartbeat, and told so."""
    fault = ("fault", "fault")
    assert rig.link.wait(lambda: rig.device.axes.states() == fault, _END_S), f"it is in {rig.device.axes.states()}"
    assert rig.device.info().error_code == (HEARTBEAT_LOST, HEARTBEAT_LOST)
    history = rig.link.node.sdo[0x1003]
    assert HEARTBEAT_LOST in [history[i + 1].raw & 0xFFFF for i in range(history[0].raw)]
    rig.assert_stopped_on_the_path()


def slow_down(rig: Rig) -> None:
    """Where the machine may keep the host from running, let the drive wait for its heartbeat, and its queue last."""
    if rig.muted:
        rig.link.node.sdo[0x1016][1].raw = wire.HOST_NODE_ID << 16 | _WATCH_MS
        rig.rate = _RATE


def stream_until(rig: Rig, knots_nm: Knots, share: float) -> None:
    """Start a stream and go on until the drive has executed a `share` of it, and WAITING knots are in its queue."""
    slow_down(rig)
    rig.device.override_feed(rig.rate)
    rig.device.axes.enable()
    rig.link.record_telemetry()
    stream = SteppedStream(rig.device, knots_nm)
    stream.start()
    stream.advance_to(share)
    rig.note_error()
    room = int(rig.device.read("ip_buffer_x.size")) - WAITING
    while rig.link.status.free > room:  # type: ignore[union-attr]
        stream.step()


@contextmanager
def host(drive: Drive, knots_nm: Knots, folder: Path, override: float) -> Iterator[subprocess.Popen[bytes]]:
    """Another process that streams the knots with this feed override; half of them are executed."""
    np.save(folder / "knots.npy", knots_nm)
    command = [sys.executable, str(Path(__file__).with_name("streamer.py")), json.dumps(drive.bus_options)]
    command += [str(drive.node_id), str(folder / "knots.npy"), str(WAITING), str(override)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        try:
            assert select.select([process.stdout], [], [], _START_S)[0], f"no motion within {_START_S:g} s"
            if process.stdout.readline() != b"running\n":
                raise AssertionError(process.stderr.read().decode())
            yield process
        finally:
            process.kill()


def wait_for_fault(bus: can.BusABC, node_id: int) -> None:
    """Until the drive says so, by its own time: an emulator's is slow on a busy machine."""
    end_s = time.monotonic() + _END_S
    while time.monotonic() < end_s:
        message = bus.recv(0.1)
        if message is None or message.arbitration_id != wire.TPDO1 + node_id:
            continue
        if all(word & 0x4F == FAULT for word in wire.unpack_status(bytes(message.data)).statusword):
            return
    raise AssertionError("the drive has noticed nothing")


def power_on(target: Target) -> AbstractContextManager[Drive]:
    """A drive whose time goes on without its host, or where nobody would see that, with the SYNC of the next one, which
    sends no heartbeat."""
    return target.power_on("clock" if target.watched else "sync")


def test_killed_host_stops_the_drive_on_the_path(target: Target, tmp_path: Path) -> None:
    if not target.outlives_host:
        pytest.skip("the simulated drive in this process dies with the host; --target slcan or vcan has one apart")
    with power_on(target) as drive, Rig(drive) as rig:
        knots_nm = rig.circle(LAPS)
        slow_down(rig)
        if not drive.listeners:
            rig.bus.shutdown()
        else:
            rig.fall_silent()
        rig.link.record_telemetry()
        with host(drive, knots_nm, tmp_path, rig.rate) as process:
            process.send_signal(signal.SIGKILL)
            process.wait()
        if not drive.listeners:
            rig.connect(heartbeat=False)
        heard = rig.link.emergencies
        assert rig.link.wait(lambda: HEARTBEAT_LOST in [e[0] for e in heard], _END_S), "no EMCY 8130h"
        assert_stopped_and_off(rig)


def test_bus_that_is_unplugged_stops_the_drive_on_the_path(target: Target) -> None:
    with power_on(target) as drive, Rig(drive) as rig:
        if drive.unplug is None:
            pytest.skip("nobody here who could pull the plug; the fault injector's bus-off stands for it")
        knots_nm = rig.circle(LAPS)
        stream_until(rig, knots_nm, 0.5)
        with drive.unplug(rig.bus):
            pass
        rig.connect(heartbeat=False)
        assert_stopped_and_off(rig)


def test_bus_off_stops_the_drive_on_the_path(target: Target) -> None:
    needs_clock(target)
    # A drive whose time passes with SYNC would wait for the host for ever.
    with (
        target.power_on("clock" if target.outlives_host else "sync") as drive,
        Rig(drive, bus := BadBus(inner=drive.open())) as rig,
    ):
        stream_until(rig, rig.circle(LAPS), 0.5)
        bus.go_bus_off(60.0)
        with pytest.raises(KonturError):
            rig.device.wait(lambda: False, 1.2, "is not heard any more")
        wait_for_fault(bus.inner, drive.node_id)
        bus.go_bus_off(0.0)
        rig.link.emergencies.clear()
        assert_stopped_and_off(rig)
