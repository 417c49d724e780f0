# SPDX-License-Identifier: Apache-2.0
"""A transmit queue that is full: the host waits and goes on; one that stays full is an error that names it."""

from __future__ import annotations

import errno
from collections.abc import Iterator

import can
import numpy as np
import pytest
from hooked_bus import HookedBus
from numpy.typing import NDArray

from kontur import machine
from kontur.can import wire
from kontur.can.bad_bus import BadBus, BusFaults
from kontur.can.bus import open_bus
from kontur.can.link import Link
from kontur.drive.device import Device, connected
from kontur.drive.stream import Operator, stream
from kontur.errors import BusError, EmcyError
from kontur.path import shapes
from kontur.planning import planner
from kontur.planning.bounds import limits
from kontur.sim import process as sim_process

SHORT = BusFaults(txqueuelen=10, frames_per_s=2500.0)  # SocketCAN's default length, and a bus that others use, too
MACHINE = machine.load().starting_at((0.02, 0.0))


@pytest.fixture(scope="module")
def knots_nm() -> NDArray[np.int32]:
    knots: NDArray[np.int32] = planner.plan(shapes.circle(0.02, 0.1, duration_s=2.0), limits(MACHINE)).knots_nm
    return knots


class FullBus(HookedBus):
    """A drive on a bus whose transmit queue is full for `full_s` from the frame on that a test says."""

    def __init__(self, **options: object) -> None:
        super().__init__(**options)
        self.full_until_s = 0.0
        self.refused: list[int] = []
        self.error: can.CanError = can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.time_s < self.full_until_s:
            self.refused.append(msg.arbitration_id)
            raise self.error
        super().send(msg, timeout)


@pytest.fixture
def bus() -> Iterator[FullBus]:
    with FullBus(machine=MACHINE) as bus:
        yield bus


def test_stream_through_a_short_queue_waits_for_room_and_sends_every_knot_once(knots_nm: NDArray[np.int32]) -> None:
    with connected(BadBus(machine=MACHINE, faults=SHORT), 1) as device, device.axes.enabled():
        result = stream(device, knots_nm)
        assert result.completed
        assert (result.executed, result.retransmitted) == (len(knots_nm), 0)
        assert device.read("stream.underruns") == 0
        assert device.link.bus.to_drive.refused > 100  # type: ignore[attr-defined]


@pytest.mark.parametrize("pace", ["clock", "sync"])
def test_drive_in_a_process_answers_through_a_queue_that_others_fill(pace: str) -> None:
    with (
        sim_process.start(slcan_tcp="0", pace=pace, machine=MACHINE) as process,
        connected(BadBus(inner=open_bus(process.options()), faults=SHORT), 1) as device,
    ):
        for i in range(100):
            device.link.send(0x7FF, bytes([i]))
        assert device.link.bus.to_drive.refused > 0  # type: ignore[attr-defined]
        assert device.read("stream.free") == device.read("ip_buffer_x.size")


@pytest.mark.parametrize(
    "error",
    [
        can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS),
        can.CanOperationError("Transmit buffer full"),  # SocketCAN, when the socket's own buffer is
        can.CanOperationError("The transmit queue is full"),  # PCAN
        can.CanOperationError("Transmit buffer overflow", -13),  # Kvaser
    ],
)
def test_every_service_waits_while_the_queue_is_full(bus: FullBus, error: can.CanError) -> None:
    bus.error = error
    device = Device(Link(bus, 1))
    services = {
        0x601: lambda: device.write("smc.lambda", 150.0),
        wire.NMT: lambda: device.link.send(wire.NMT, bytes([wire.NMT_START, 1])),
        wire.HEARTBEAT + wire.HOST_NODE_ID: device.link.send_heartbeat,
    }
    for cob_id, service in services.items():
        bus.refused.clear()
        bus.full_until_s = bus.time_s + 0.2
        service()
        assert set(bus.refused) == {cob_id}
    assert device.read("smc.lambda") == 150.0


def test_frames_that_come_while_the_queue_is_full_are_handled(bus: FullBus) -> None:
    device = Device(Link(bus, 1))
    device.axes.enable()
    before = device.link.status_count
    bus.full_until_s = bus.time_s + 0.3
    device.link.send(wire.SYNC, b"")
    assert device.link.status_count > before + 10


def test_queue_that_is_full_for_a_while_in_motion_does_not_stop_the_stream(
    bus: FullBus, knots_nm: NDArray[np.int32]
) -> None:
    device = Device(Link(bus, 1))
    count = 0

    def full_now_and_then(message: can.Message) -> can.Message:
        nonlocal count
        if message.arbitration_id == wire.RPDO2 + 1 and (count := count + 1) % 700 == 0:
            bus.full_until_s = bus.time_s + 0.3
        return message

    bus.on_send = full_now_and_then
    with device.axes.enabled():
        result = stream(device, knots_nm)
        assert result.executed == len(knots_nm)
        assert result.retransmitted == 0
        assert device.read("stream.underruns") == 0
    assert bus.refused


def test_queue_that_stays_full_is_one_error_that_names_it(bus: FullBus) -> None:
    device = Device(Link(bus, 1))
    bus.channel_info = "socketcan channel 'can0'"
    begin_s = bus.time_s
    bus.full_until_s = begin_s + 60.0
    with pytest.raises(BusError) as raised:
        device.read("stream.free")
    text = str(raised.value)
    assert "\n" not in text
    assert "its transmit queue has been full for 2 s" in text
    assert "`ip -details link show can0`" in text
    assert "`ip link set can0 txqueuelen 1000`" in text
    assert 2.0 < bus.time_s - begin_s < 2.1


def test_queue_that_stays_full_in_motion_ends_with_the_drive_stopped_on_its_path(
    bus: FullBus, knots_nm: NDArray[np.int32]
) -> None:
    device = Device(Link(bus, 1))

    def stuck(share: float) -> None:
        if share > 0.6 and not bus.refused:
            bus.full_until_s = bus.time_s + 3600.0

    with pytest.raises((BusError, EmcyError)), device.axes.enabled():
        stream(device, knots_nm, Operator(progress=stuck))
    bus.full_until_s = 0.0
    assert device.read("error_code_x") == 0x8130


def test_other_errors_of_sending_are_reported_at_once(bus: FullBus) -> None:
    device = Device(Link(bus, 1))
    bus.error = can.CanOperationError("Failed to transmit: Network is down", errno.ENETDOWN)
    begin_s = bus.time_s
    bus.full_until_s = begin_s + 60.0
    with pytest.raises(BusError, match="sending failed: Failed to transmit: Network is down"):
        device.read("stream.free")
    assert bus.time_s == begin_s


# --- the model of such a queue ---


def test_model_takes_as_many_frames_as_it_has_places_and_sends_them_in_order_at_its_rate() -> None:
    with HookedBus(machine=MACHINE) as inner:
        sent: list[tuple[int, float]] = []
        inner.on_send = lambda message: sent.append((message.arbitration_id, inner.time_s))  # type: ignore[func-returns-value]
        bus = BadBus(inner=inner, faults=BusFaults(txqueuelen=3, frames_per_s=100.0))
        for i in range(3):
            bus.send(can.Message(arbitration_id=0x700 + i, is_extended_id=False))
        with pytest.raises(can.CanOperationError) as raised:
            bus.send(can.Message(arbitration_id=0x703, is_extended_id=False))
        assert raised.value.error_code == errno.ENOBUFS
        assert sent == []
        begin_s = inner.time_s
        while inner.time_s < begin_s + 0.05:
            bus.recv(0.05)
        assert [cob_id for cob_id, _ in sent] == [0x700, 0x701, 0x702]
        assert [time_s - begin_s for _, time_s in sent] == pytest.approx([0.01, 0.02, 0.03], abs=1e-3)
        bus.send(can.Message(arbitration_id=0x704, is_extended_id=False))
        assert bus.to_drive.refused == 1


@pytest.mark.parametrize("faults", [{"txqueuelen": -1}, {"txqueuelen": 10, "frames_per_s": 0.0}])
def test_queue_that_cannot_be_is_refused(faults: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="txqueuelen must be"):
        BusFaults(**faults)  # type: ignore[arg-type]
