# SPDX-License-Identifier: Apache-2.0
"""Frames on the bus that no CANopen node sends, with the numbers of the drive: neither end takes them for its own."""

from __future__ import annotations

import random
import socket
from collections import deque
from collections.abc import Iterator

import can
import numpy as np
import pytest
from hooked_bus import HookedBus
from numpy.typing import NDArray

from kontur import machine
from kontur.can import wire
from kontur.can.bus import open_bus
from kontur.can.link import Link
from kontur.drive import pdos
from kontur.drive.device import Device, connected
from kontur.drive.knot_sender import AllKnots, KnotSender
from kontur.drive.stream import Operator, stream
from kontur.path import shapes
from kontur.planning import planner
from kontur.planning.bounds import limits
from kontur.sim import process as sim_process

STATUS, EMCY = wire.TPDO1 + 1, 0x81
MACHINE = machine.load().starting_at((0.02, 0.0))
KINDS = [{"is_extended_id": True}, {"is_extended_id": False, "is_fd": True}, {"is_remote_frame": True}]


def foreign(cob_id: int, data: bytes, **kind: bool) -> can.Message:
    whole = {"is_extended_id": False} | kind
    if kind.get("is_remote_frame"):
        return can.Message(arbitration_id=cob_id, dlc=len(data), **whole)  # type: ignore[arg-type]
    return can.Message(arbitration_id=cob_id, data=data, **whole)  # type: ignore[arg-type]


class Neighbour(HookedBus):
    """A drive on a bus on which others answer each of its frames with foreign ones that have the same number."""

    def __init__(self, **options: object) -> None:
        super().__init__(**options)
        self._random = random.Random(1)
        self._waiting: deque[can.Message] = deque()
        self.sent = 0

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self._waiting:
            self.sent += 1
            return self._waiting.popleft()
        message = super().recv(timeout)
        if message is not None:
            data = self._random.randbytes(len(message.data))
            self._waiting += [foreign(message.arbitration_id, data, **kind) for kind in KINDS]
            self._waiting.append(can.Message(arbitration_id=message.arbitration_id, data=data, is_error_frame=True))
        return message


@pytest.fixture(scope="module")
def knots_nm() -> NDArray[np.int32]:
    knots: NDArray[np.int32] = planner.plan(shapes.circle(0.02, 0.1, duration_s=1.5), limits(MACHINE)).knots_nm
    return knots


def start_nm(knots_nm: NDArray[np.int32]) -> tuple[int, int]:
    return int(knots_nm[0, 0]), int(knots_nm[0, 1])


def test_run_beside_foreign_frames_with_every_number_of_the_drive_is_that_without(knots_nm: NDArray[np.int32]) -> None:
    telemetry = []
    for kind in (HookedBus, Neighbour):
        with connected(bus := kind(machine=MACHINE), 1) as device, device.axes.enabled(also=pdos.TELEMETRY):
            result = stream(device, knots_nm, before_start=device.link.record_telemetry)
            assert (result.executed, result.retransmitted) == (len(knots_nm), 0)
            telemetry.append(device.link.recorded_telemetry(start_nm(knots_nm)))
            assert device.faults.warnings() == ()
            assert device.link.emergencies == []
            if isinstance(bus, Neighbour):
                assert bus.sent > 10_000
                assert device.link.dropped["foreign"] == pytest.approx(0.75 * bus.sent, abs=4)
            else:
                assert set(device.link.dropped.values()) == {0}
    clean, beside = telemetry
    assert beside.frames_lost == clean.frames_lost == 0
    np.testing.assert_array_equal(beside.tick, clean.tick)
    np.testing.assert_array_equal(beside.position_m, clean.position_m)


@pytest.fixture
def device() -> Iterator[Device]:
    with connected(HookedBus(machine=MACHINE), 1) as device:
        yield device


@pytest.mark.parametrize("kind", KINDS)
def test_foreign_frames_do_nothing_to_the_drive_in_process(device: Device, kind: dict[str, bool]) -> None:
    device.axes.enable()
    bus, before = device.link.bus, device.read("smc.lambda")
    for cob_id in range(0x800):
        bus.send(foreign(cob_id, bytes([0x2F, 0x10, 0x21, 1, 0, 0, 0, 0]), **kind))
    for reset_or_stop in (129, 130, 2, 128):
        bus.send(foreign(wire.NMT, bytes([reset_or_stop, 1]), **kind))
    bus.send(foreign(wire.RPDO1 + 1, bytes(4), **kind))
    device.link.wait(lambda: False, 0.1)
    assert device.axes.states() == ("operation enabled", "operation enabled")
    assert device.read("smc.lambda") == before
    assert device.faults.warnings() == ()


def test_error_frames_do_nothing_to_the_drive_in_process(device: Device) -> None:
    device.axes.enable()
    device.link.bus.send(can.Message(arbitration_id=wire.RPDO1 + 1, data=bytes(4), is_error_frame=True))
    device.link.wait(lambda: False, 0.1)
    assert device.axes.states() == ("operation enabled", "operation enabled")


def test_lines_of_foreign_frames_do_nothing_to_the_drive_and_are_not_refused() -> None:
    """As on a wire: who sends them may be talking to somebody else."""
    with sim_process.start(slcan_tcp="0", pace="sync", machine=MACHINE) as process:
        host, _, port = process.channel.removeprefix("socket://").rpartition(":")
        with socket.create_connection((host, int(port)), 30.0) as client:
            client.sendall(b"O\rt000" + b"2" + b"0101\r")
            client.sendall(b"T0000000028101\rT00000201400000000\rR000001812\rd0002" + b"8101\rb00028101\r")
            client.sendall(b"D0000000028101\rB0000000028101\rr0002\rt60184005100500000000\r")  # and 1005h is read
            text = b""
            while b"t5818" not in text:
                text += client.recv(4096)
    assert b"\a" not in text
    assert b"t7011" + b"00" not in text.partition(b"t701105")[2]  # operational, and no boot-up message after it


def test_count_that_cannot_be_is_dropped_and_counted_and_never_makes_accepted_negative(
    knots_nm: NDArray[np.int32],
) -> None:
    accepted: list[int] = []
    seen = corrupted = 0

    def corrupt(message: can.Message) -> can.Message:
        nonlocal seen, corrupted
        if message.arbitration_id != STATUS or (seen := seen + 1) % 2 == 0 or accepted[-1] > 60:
            return message
        corrupted += 1
        return can.Message(arbitration_id=STATUS, data=bytes(message.data[:6]) + b"\xfd\xff", is_extended_id=False)

    with connected(bus := HookedBus(machine=MACHINE), 1) as device, device.axes.enabled():
        sender = KnotSender(device, AllKnots(knots_nm))
        accepted.append(sender.accepted)
        bus.on_recv = corrupt
        while sender.accepted < 100:
            sender.advance()
            accepted.append(sender.accepted)
    assert corrupted > 0
    assert device.link.dropped["status"] == corrupted
    assert accepted == sorted(accepted)


def test_count_beyond_what_was_sent_is_dropped_and_counted(knots_nm: NDArray[np.int32]) -> None:
    count = 0

    def corrupt(message: can.Message) -> can.Message:
        nonlocal count
        if message.arbitration_id != STATUS or (count := count + 1) % 7:
            return message
        data = bytes(message.data[:6]) + (int.from_bytes(message.data[6:8], "little") + 5000 & 0xFFFF).to_bytes(
            2, "little"
        )
        return can.Message(arbitration_id=STATUS, data=data, is_extended_id=False)

    shares: list[float] = []
    with connected(bus := HookedBus(machine=MACHINE), 1) as device, device.axes.enabled():
        bus.on_recv = corrupt
        assert stream(device, knots_nm, Operator(progress=shares.append)).executed == len(knots_nm)
    assert device.link.dropped["status"] > 10
    assert shares == sorted(shares)


def test_frames_of_a_wrong_length_are_dropped_and_counted() -> None:
    with HookedBus(machine=MACHINE) as bus:
        link = Link(bus, 1)
        Device(link)
        bus.on_recv = lambda m: can.Message(arbitration_id=EMCY, data=b"\x10\x81", is_extended_id=False)
        link.poll(0.2)
    assert link.emergencies == []
    assert link.dropped["length"] == 1


def test_bus_of_python_can_that_has_can_fd_is_no_other_for_the_host() -> None:
    """python-can's virtual bus carries whatever is sent, as a SocketCAN interface with fd=True does."""
    with (
        can.Bus(interface="virtual", channel="fd") as other,
        open_bus({"interface": "virtual", "channel": "fd"}) as bus,
    ):
        link = Link(bus, 1)
        for kind in KINDS:
            other.send(foreign(STATUS, bytes(8), **kind))
        other.send(can.Message(arbitration_id=STATUS, data=bytes(64), is_fd=True, is_extended_id=False))
        other.send(can.Message(arbitration_id=STATUS, data=bytes(8), is_extended_id=False))
        assert link.wait(lambda: link.status_count > 0, 10.0)
    assert link.status_count == 1
    assert link.dropped["foreign"] == 4
