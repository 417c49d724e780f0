# SPDX-License-Identifier: Apache-2.0
"""The fault injector by itself: what goes in, what comes out, what it says it did."""

import contextlib
import itertools
from collections.abc import Iterator

import can
import pytest

from kontur.can.bad_bus import BadBus, BusFaults


class Wire(can.BusABC):
    """A bus with a clock of its own, on which the test is the other end."""

    channel_info = "wire"

    def __init__(self) -> None:
        self.time_s = 0.0
        self.sent: list[can.Message] = []
        self.incoming: list[can.Message] = []
        super().__init__(channel=None)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self.sent.append(msg)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self.incoming:
            return self.incoming.pop(0)
        self.time_s += timeout or 0.0
        return None


@contextlib.contextmanager
def around(wire: Wire, **faults: float) -> Iterator[BadBus]:
    with BadBus(inner=wire, faults=BusFaults(**faults)) as bus:  # type: ignore[arg-type]
        yield bus


def frame(number: int) -> can.Message:
    return can.Message(arbitration_id=0x301, data=number.to_bytes(8, "little"), is_extended_id=False)


def number(message: can.Message) -> int:
    return int.from_bytes(message.data, "little")


def sent_through(count: int, **faults: float) -> tuple[list[can.Message], BadBus]:
    wire = Wire()
    with around(wire, **faults) as bus:
        for i in range(count):
            bus.send(frame(i))
    return wire.sent, bus


def received_through(count: int, **faults: float) -> list[can.Message]:
    wire = Wire()
    wire.incoming = [frame(i) for i in range(count)]
    with around(wire, **faults) as bus:
        got = []
        while (message := bus.recv(1.0)) is not None:
            got.append(message)
        return got


def test_without_faults_frames_pass_as_they_are() -> None:
    assert [number(m) for m in sent_through(100)[0]] == list(range(100))
    assert [number(m) for m in received_through(100)] == list(range(100))


def test_shares_are_those_requested_and_counted() -> None:
    sent, bus = sent_through(20_000, drop=0.02, duplicate=0.01, seed=7)
    assert bus.to_drive.frames == 20_000
    assert 300 < bus.to_drive.lost < 500
    assert 140 < bus.to_drive.duplicated < 260
    assert len(sent) == 20_000 - bus.to_drive.lost + bus.to_drive.duplicated
    assert bus.to_host.frames == 0


def test_same_seed_gives_the_same_faults_and_another_one_others() -> None:
    def run(seed: int) -> list[int]:
        return [number(m) for m in sent_through(500, drop=0.1, duplicate=0.1, reorder=0.1, seed=seed)[0]]

    assert run(1) == run(1)
    assert run(1) != run(2)


def test_directions_do_not_influence_each_other() -> None:
    wire = Wire()
    with around(wire, drop=0.3) as bus:
        for i in range(200):
            bus.send(frame(i))
            wire.incoming.append(frame(i))
            bus.recv(0.0)
    assert [number(m) for m in wire.sent] == [number(m) for m in sent_through(200, drop=0.3)[0]]
    assert bus.to_host.lost != bus.to_drive.lost


def test_one_fault_more_leaves_the_others_where_they_were() -> None:
    alone = {number(m) for m in sent_through(1000, drop=0.05)[0]}
    with_others = {number(m) for m in sent_through(1000, drop=0.05, duplicate=0.1, reorder=0.1)[0]}
    assert alone - with_others <= {999}  # the last may wait for a frame to change places with


def test_duplicates_follow_one_another() -> None:
    assert [number(m) for m in sent_through(3, duplicate=1.0)[0]] == [0, 0, 1, 1, 2, 2]


def test_reordered_frame_changes_places_with_the_next_one_only() -> None:
    got = [number(m) for m in received_through(1000, reorder=0.1)]
    assert sorted(got) == list(range(1000))
    assert got != sorted(got)
    assert max(abs(place - i) for place, i in enumerate(got)) == 1


def test_last_frame_is_not_kept_for_ever_by_reordering() -> None:
    assert [number(m) for m in received_through(1, reorder=1.0)] == [0]


def test_delayed_frames_come_late_by_the_clock_of_the_target() -> None:
    wire = Wire()
    with around(wire, delay=1.0, delay_s=0.5) as bus:
        bus.send(frame(1))
        assert wire.sent == []
        while bus.recv(0.01) is None and not wire.sent:
            assert wire.time_s <= 0.51
        assert [number(m) for m in wire.sent] == [1]
        assert wire.time_s > 0.0


def test_flips_hit_identifier_length_and_data_by_one_to_three_bits() -> None:
    sent, _ = sent_through(2000, flip=1.0)
    changed = {"identifier": 0, "length": 0, "data": 0}
    for i, message in enumerate(sent):
        whole = frame(i)
        assert 0 <= message.arbitration_id < 0x800
        assert len(message.data) == message.dlc <= 8
        changed["identifier"] += message.arbitration_id != whole.arbitration_id
        changed["length"] += message.dlc != whole.dlc
        data = bytes(message.data)
        changed["data"] += data != bytes(whole.data)[: len(data)]
        bits = (message.arbitration_id ^ 0x301).bit_count()
        bits += (int.from_bytes(data, "little") ^ int.from_bytes(whole.data[: len(data)], "little")).bit_count()
        assert bits <= 3
    assert min(changed.values()) > 50


def test_flipped_frame_leaves_that_of_the_sender_alone() -> None:
    message = frame(5)
    with around(Wire(), flip=1.0, duplicate=0.5, delay=0.3, reorder=0.3) as bus:
        for _ in range(100):
            bus.send(message)
    assert (message.arbitration_id, number(message)) == (0x301, 5)


def test_burst_is_a_run_of_lost_frames() -> None:
    sent, bus = sent_through(10_000, burst=0.001, burst_frames=25)
    got = [number(m) for m in sent]
    gaps = [b - a - 1 for a, b in itertools.pairwise(got) if b != a + 1]
    assert gaps
    assert all(gap % 25 == 0 for gap in gaps)
    assert bus.to_drive.lost_in_bursts >= sum(gaps)


def test_bus_off_lasts_its_time_in_both_directions() -> None:
    wire = Wire()
    with around(wire, bus_off_s=1.0) as bus:
        bus.go_bus_off()
        bus.send(frame(1))
        wire.incoming = [frame(2)]
        assert bus.recv(0.99) is None
        assert wire.sent == []
        assert wire.time_s == pytest.approx(0.99)
        bus.recv(0.02)
        bus.send(frame(3))
        wire.incoming = [frame(4)]
        got = bus.recv(0.0)
        assert got is not None
        assert ([number(m) for m in wire.sent], number(got)) == ([3], 4)
        assert (bus.to_drive.lost_bus_off, bus.to_host.lost_bus_off) == (1, 1)


def test_error_frames_pass_as_they_are() -> None:
    wire = Wire()
    wire.incoming = [can.Message(is_error_frame=True)]
    with around(wire, drop=1.0) as bus:
        got = bus.recv(0.0)
        assert got is not None
        assert got.is_error_frame


def test_recv_lasts_its_timeout_and_no_longer() -> None:
    wire = Wire()
    with around(wire, drop=1.0) as bus:
        wire.incoming = [frame(i) for i in range(10)]
        assert bus.recv(0.25) is None
        assert wire.time_s == pytest.approx(0.25)


def test_python_can_opens_it_by_name_around_any_bus() -> None:
    with (
        can.Bus(interface="virtual", channel="faults") as other,
        can.Bus(interface="kontur-bad-bus", inner="virtual", channel="faults", duplicate=1.0, seed=3) as bus,
    ):
        bus.send(frame(1))
        assert [number(m) for m in (other.recv(1.0), other.recv(1.0)) if m] == [1, 1]
        other.send(frame(2))
        assert [number(m) for m in (bus.recv(1.0), bus.recv(1.0)) if m] == [2, 2]


def test_filters_are_for_what_arrives_in_the_end() -> None:
    wire = Wire()
    wire.incoming = [frame(1), can.Message(arbitration_id=0x80, is_extended_id=False)]
    filters = [{"can_id": 0x80, "can_mask": 0x7FF, "extended": False}]
    with BadBus(inner=wire, can_filters=filters, faults=BusFaults()) as bus:
        got = bus.recv(0.1)
        assert got is not None
        assert got.arbitration_id == 0x80


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"drop": 1.5}, r"drop=1\.5 is no probability"),
        ({"bus_off_s": -1.0}, r"bus_off_s=-1 is out of range"),
        ({"drop": "often"}, "kontur-bad-bus: "),
    ],
)
def test_fault_that_cannot_be_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(can.CanInitializationError, match=message):
        can.Bus(interface="kontur-bad-bus", inner="virtual", channel="faults", **options)
