# SPDX-License-Identifier: Apache-2.0
"""Streaming to the simulated drive over buses that lose, corrupt and delay frames: no knot is lost, or it is said."""

import random
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

import can
import numpy as np
import pytest
from hooked_bus import HookedBus
from numpy.typing import NDArray

from kontur import machine
from kontur.can import wire
from kontur.can.link import Link
from kontur.drive import pdos
from kontur.drive.device import Device
from kontur.drive.knot_sender import WINDOW
from kontur.drive.stream import Operator, stream
from kontur.errors import DeviceError, EmcyError, StreamError
from kontur.path import shapes
from kontur.planning import planner
from kontur.planning.bounds import limits

KNOT = wire.RPDO2 + 1
TELEMETRY = {cob + 1 for cob in wire.TELEMETRY}


class SlowBus(HookedBus):
    """A line that takes a knot each `KNOT_S`; what is sent meanwhile waits before it. It stands still at `stalls_s`."""

    KNOT_S, STALL_S = 1.5e-3, 0.1

    def __init__(self, **options: object) -> None:
        super().__init__(**options)
        self.waiting: deque[can.Message] = deque()
        self.next_s = 0.0
        self.stalls_s: list[float] = []

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if msg.arbitration_id == KNOT:
            self.waiting.append(msg)
        else:
            super().send(msg, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        end_s = self.time_s + (timeout or 0.0)
        while (message := super().recv(max(0.0, min(end_s, self.next_s) - self.time_s))) is None:
            if self.time_s >= end_s:
                break
            if self.waiting:
                super().send(self.waiting.popleft())
            self.next_s = self.time_s + self.KNOT_S
            if self.stalls_s and self.time_s > self.stalls_s[0]:
                self.next_s = self.stalls_s.pop(0) + self.STALL_S
        return message


@contextmanager
def enabled(knots_nm: NDArray[np.int32], kind: type[HookedBus] = HookedBus) -> Iterator[tuple[Device, HookedBus]]:
    x, y = (float(v) * 1e-9 for v in knots_nm[0])
    with kind(machine=machine.load().starting_at((x, y))) as bus:
        device = Device(Link(bus, 1))
        with device.axes.enabled():
            yield device, bus


@pytest.fixture(scope="module")
def knots_nm() -> NDArray[np.int32]:
    """About 1.3 s of motion, more than what a path starts with."""
    program = shapes.circle(0.02, 0.1)
    knots: NDArray[np.int32] = planner.plan(program, limits(machine.load())).knots_nm
    return knots


def test_drive_goes_the_whole_way_and_stands_at_the_last_knot(knots_nm: NDArray[np.int32]) -> None:
    shares: list[float] = []
    with enabled(knots_nm) as (device, _):
        result = stream(device, knots_nm, Operator(progress=shares.append))
        position_nm = np.array(device.position_nm())
    assert result.completed
    assert result.executed == len(knots_nm)
    assert result.retransmitted == 0
    assert result.rejected == {"sequence": 0, "crc": 0, "full": 0}
    assert np.abs(position_nm - knots_nm[-1]).max() < 20_000
    assert shares == sorted(shares)
    assert shares[0] < 0.1
    assert shares[-1] == 1.0


@pytest.mark.parametrize("loss", [0.002, 0.02])
def test_lost_knot_frames_are_sent_again(knots_nm: NDArray[np.int32], loss: float) -> None:
    draw = random.Random(1)
    with enabled(knots_nm) as (device, bus):
        bus.on_send = lambda m: None if m.arbitration_id == KNOT and draw.random() < loss else m
        result = stream(device, knots_nm)  # compares the drive's checksum with that of the knots
    assert result.completed
    assert result.retransmitted > 0
    assert result.rejected["sequence"] > 0


def test_corrupt_knot_frames_are_refused_and_sent_again(knots_nm: NDArray[np.int32]) -> None:
    draw = random.Random(2)

    def corrupt(message: can.Message) -> can.Message:
        if message.arbitration_id == KNOT and draw.random() < 0.005:
            data = bytearray(message.data)
            data[draw.randrange(8)] ^= 1 << draw.randrange(8)
            return can.Message(arbitration_id=KNOT, data=data, is_extended_id=False)
        return message

    with enabled(knots_nm) as (device, bus):
        bus.on_send = corrupt
        result = stream(device, knots_nm)
    assert result.completed
    assert result.rejected["crc"] > 0


def test_lost_status_frames_do_no_harm(knots_nm: NDArray[np.int32]) -> None:
    draw = random.Random(3)
    with enabled(knots_nm) as (device, bus):
        bus.on_recv = lambda m: None if m.arbitration_id == wire.TPDO1 + 1 and draw.random() < 0.3 else m
        assert stream(device, knots_nm).completed


def test_line_slower_than_the_host_gets_no_knot_twice(knots_nm: NDArray[np.int32]) -> None:
    with enabled(knots_nm, SlowBus) as (device, bus):
        result = stream(device, knots_nm)
        assert not bus.waiting
    assert result.completed
    assert result.retransmitted == 0


def test_slow_line_that_stalls_gets_no_more_than_it_can_take(knots_nm: NDArray[np.int32]) -> None:
    with enabled(knots_nm, SlowBus) as (device, bus):
        bus.stalls_s = [bus.time_s + wait_s for wait_s in (0.1, 0.4, 0.7)]
        most = 0

        def watch(_share: float) -> None:
            nonlocal most
            most = max(most, len(bus.waiting))

        result = stream(device, knots_nm, Operator(progress=watch))
    assert result.completed
    assert result.retransmitted <= 3 * WINDOW
    assert most <= 2 * WINDOW


def test_lost_telemetry_is_counted_exactly(knots_nm: NDArray[np.int32]) -> None:
    draw = random.Random(4)
    lost = 0

    def lose(message: can.Message) -> can.Message | None:
        nonlocal lost
        if message.arbitration_id in TELEMETRY and device.axes.statuswords()[0] & 1 << 12 and draw.random() < 0.01:
            lost += 1
            return None
        return message

    with enabled(knots_nm) as (device, bus):
        device.pdos.require(*pdos.TELEMETRY)
        bus.on_recv = lose
        stream(device, knots_nm, before_start=device.link.record_telemetry)
        bus.on_recv = lambda m: m
        device.link.wait(lambda: False, 0.05)
        start_nm = (int(knots_nm[0, 0]), int(knots_nm[0, 1]))
        telemetry = device.link.recorded_telemetry(start_nm)
    assert lost > 20
    assert telemetry.frames_lost == lost


def test_stop_request_ends_on_the_path_within_the_stop_time(knots_nm: NDArray[np.int32]) -> None:
    with enabled(knots_nm) as (device, bus):
        begin = bus.time_s
        result = stream(device, knots_nm, Operator(stop_requested=lambda: bus.time_s > begin + 0.6))
        stopped_s = bus.time_s
        stop_time_s = device.read("limits.path_stop_time") * 1e-3
        radius_m = np.hypot(*device.position_m())
        assert not result.completed
        assert result.stop_s is not None
        assert stopped_s - result.stop_s < stop_time_s + 0.011  # a status comes every 10 ms
        assert abs(radius_m - 0.02) < 50e-6
        assert 400 < result.executed < 700


def test_silent_stretch_of_the_host_shorter_than_the_queue_is_not_seen(knots_nm: NDArray[np.int32]) -> None:
    paused = False

    with enabled(knots_nm) as (device, bus):

        def pause(share: float) -> None:
            nonlocal paused
            if share > 0.5 and not paused:
                paused = True
                bus.sim.run(2000)  # 200 ms

        assert stream(device, knots_nm, Operator(progress=pause)).completed
    assert paused


def test_host_slower_than_the_path_is_a_stop_on_the_path_and_said(knots_nm: NDArray[np.int32]) -> None:
    sent = 0

    def stop_sending(message: can.Message) -> can.Message | None:
        nonlocal sent
        sent += message.arbitration_id == KNOT
        return None if message.arbitration_id == KNOT and sent > 1100 else message

    with enabled(knots_nm) as (device, bus):
        bus.on_send = stop_sending
        with pytest.raises(EmcyError, match="ran out of knots"):
            stream(device, knots_nm)
        assert abs(np.hypot(*device.position_m()) - 0.02) < 50e-6


def test_bus_that_loses_every_knot_is_noticed(knots_nm: NDArray[np.int32]) -> None:
    with enabled(knots_nm) as (device, bus):
        bus.on_send = lambda m: None if m.arbitration_id == KNOT else m
        with pytest.raises(StreamError, match="accepted no knot for 2 s"):
            stream(device, knots_nm)


def test_status_that_ceases_is_noticed(knots_nm: NDArray[np.int32]) -> None:
    with enabled(knots_nm) as (device, bus):
        bus.on_recv = lambda m: None if m.arbitration_id == wire.TPDO1 + 1 and bus.time_s > 0.5 else m
        with pytest.raises(StreamError, match="sent no status for 2 s"):
            stream(device, knots_nm)
        bus.on_recv = lambda m: m


def test_path_that_starts_elsewhere_is_refused_without_motion(knots_nm: NDArray[np.int32]) -> None:
    with enabled(knots_nm) as (device, _):
        before = device.position_nm()
        with pytest.raises(DeviceError, match=r"stream\.command: the drive refuses"):
            stream(device, knots_nm + np.int32(1_000_000))
        device.link.wait(lambda: False, 0.1)
        assert np.abs(np.subtract(device.position_nm(), before)).max() < 1000
