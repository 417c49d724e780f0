# SPDX-License-Identifier: Apache-2.0
"""The slcan bus that reads all that waits, against a socket that says what an adapter would."""

import errno
import itertools
import os
import select
import socket
import struct
import sys
import threading
from collections.abc import Iterator

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kontur import machine
from kontur.can.bad_bus import BadBus
from kontur.can.bus import open_bus
from kontur.can.link import Link
from kontur.drive.device import connected
from kontur.drive.stream import stream
from kontur.errors import BusError
from kontur.path import shapes
from kontur.planning import planner
from kontur.planning.bounds import limits
from kontur.sim import process as sim_process


def wires() -> Iterator[tuple[can.BusABC, socket.socket]]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        bus = open_bus({"interface": "slcan", "channel": f"socket://127.0.0.1:{server.getsockname()[1]}"})
        peer, _ = server.accept()
        with peer, bus:
            yield bus, peer


wire = pytest.fixture(wires)


def test_frames_cut_anywhere_come_whole_and_in_order(wire: tuple[can.BusABC, socket.socket]) -> None:
    bus, peer = wire
    text = b"".join(b"t%03X8%016X\r" % (i, i) for i in range(300))
    for cut in range(0, len(text), 37):
        peer.sendall(text[cut : cut + 37])
    messages = [bus.recv(5.0) for _ in range(300)]
    assert [m.arbitration_id for m in messages if m] == list(range(300))
    assert [bytes(m.data) for m in messages if m] == [i.to_bytes(8, "big") for i in range(300)]


def test_acknowledgements_and_refusals_between_frames_are_no_frames(wire: tuple[can.BusABC, socket.socket]) -> None:
    bus, peer = wire
    peer.sendall(b"\rz\r\at1232ABCD\r\a\a\rr0014\r")
    frames: list[can.Message] = []
    for _ in range(20):
        if len(frames) < 2 and (message := bus.recv(1.0)) is not None:
            frames.append(message)
    assert [(m.arbitration_id, m.is_remote_frame, m.dlc) for m in frames] == [(0x123, False, 2), (0x001, True, 4)]


def test_what_has_come_is_received_without_waiting(wire: tuple[can.BusABC, socket.socket]) -> None:
    bus, peer = wire
    assert bus.recv(0) is None
    peer.sendall(b"t1230\rt1240\r")
    assert bus.recv(5.0).arbitration_id == 0x123  # type: ignore[union-attr]
    assert bus.recv(0).arbitration_id == 0x124  # type: ignore[union-attr]


def test_connection_closed_by_the_other_end_is_an_error(wire: tuple[can.BusABC, socket.socket]) -> None:
    bus, peer = wire
    peer.shutdown(socket.SHUT_RDWR)
    with pytest.raises(can.CanOperationError, match="closed the connection"):
        bus.recv(5.0)


def test_bus_is_called_by_interface_and_channel(wire: tuple[can.BusABC, socket.socket]) -> None:
    bus, peer = wire
    assert bus.channel_info == f"slcan socket://127.0.0.1:{peer.getsockname()[1]}"
    assert BadBus(inner=bus).channel_info == f"{bus.channel_info}, with faults"


def test_a_message_about_the_bus_names_it(wire: tuple[can.BusABC, socket.socket]) -> None:
    bus, peer = wire
    peer.shutdown(socket.SHUT_RDWR)
    with pytest.raises(BusError, match=rf"slcan socket://127.0.0.1:{peer.getsockname()[1]}: receiving failed"):
        Link(bus, 1).wait(lambda: False, 5.0)


def test_sending_to_a_connection_that_was_closed_says_so_and_why(wire: tuple[can.BusABC, socket.socket]) -> None:
    bus, peer = wire
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    peer.close()
    assert select.select([bus.fileno()], [], [], 5.0)[0]
    with pytest.raises(can.CanOperationError, match="closed the connection; it has ended, or serves another program"):
        bus.send(can.Message(arbitration_id=1, is_extended_id=False))


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals there")
def test_serial_port_of_another_program_is_left_alone_and_the_message_says_what_to_do() -> None:
    adapter, terminal = os.openpty()
    port = os.ttyname(terminal)
    with os.fdopen(adapter, "rb", buffering=0) as said, open_bus({"interface": "slcan", "channel": port}):
        assert said.read(100) == b"O\r"
        with pytest.raises(BusError, match=rf"bus slcan {port} cannot be opened: .*Another program uses it.*fuser -v"):
            open_bus({"interface": "slcan", "channel": port, "bitrate": 1_000_000})
        assert not select.select([said], [], [], 0.1)[0], "it was sent to an adapter in use"
    os.close(terminal)


# --- lines that are damaged ---

GOOD = [
    b"t1232ABCD",
    b"t7FF0",
    b"t0818ffffFFFF00000000",
    b"t1811A51234",
    b"r0014",
    b"T1FFFFFFF1FF",
    b"d1239" + b"00" * 12,
]
DAMAGED = [
    b"t1232ABCDt1232ABCD",
    b"t1232AB",
    b"t1232ABCDE",
    b"t1232ABCG",
    b"t8001AA",
    b"t123",
    b"t",
    b"t1239000000000000000000",
    b"t123 2ABCD",
    b"T200000001AA",
    b"rFFFFF",
    b"\xff\xfe",
    b"hello",
    b"d123F00",
    b"t1232AB\a",
    b"t" * 100_000,
]


def received(bus: can.BusABC, until: int) -> list[can.Message]:
    messages = []
    while (message := bus.recv(30.0)) is not None and message.arbitration_id != until:
        messages.append(message)
    assert message is not None, "the last frame has not come"
    return messages


@pytest.mark.parametrize("line", DAMAGED, ids=lambda line: repr(line[:24]))
def test_damaged_line_is_dropped_and_counted_and_the_next_frame_comes(
    wire: tuple[can.BusABC, socket.socket], line: bytes
) -> None:
    bus, peer = wire
    peer.sendall(b"t1001AA\r" + line + b"\rt1011BB\r")
    assert [(m.arbitration_id, bytes(m.data)) for m in received(bus, 0x101)] == [(0x100, b"\xaa")]
    assert bus.garbled == 1  # type: ignore[attr-defined]


@pytest.mark.parametrize("end", [b"\r", b"\n", b"\r\n"])
def test_lines_end_in_cr_lf_or_both(wire: tuple[can.BusABC, socket.socket], end: bytes) -> None:
    bus, peer = wire
    peer.sendall(end.join([*GOOD, b"", b"z", b"Z", b"t1011BB", b""]))
    assert len(received(bus, 0x101)) == len(GOOD)
    assert bus.garbled == 0  # type: ignore[attr-defined]


def test_time_stamp_behind_the_data_is_no_damage(wire: tuple[can.BusABC, socket.socket]) -> None:
    bus, peer = wire
    peer.sendall(b"t1811A5EA5F\rr7011EA5F\rt1010\r")
    assert [(m.arbitration_id, bytes(m.data)) for m in received(bus, 0x101)] == [(0x181, b"\xa5"), (0x701, b"")]


def test_frame_behind_damage_is_received_without_waiting(wire: tuple[can.BusABC, socket.socket]) -> None:
    bus, peer = wire
    peer.sendall(b"t1230\r\r\a\rhello\rt1240\r")
    assert bus.recv(30.0).arbitration_id == 0x123  # type: ignore[union-attr]
    assert bus.recv(0).arbitration_id == 0x124  # type: ignore[union-attr]


@pytest.fixture(scope="module")
def one_wire() -> Iterator[tuple[can.BusABC, socket.socket]]:
    yield from wires()


@settings(deadline=None)
@given(
    lines=st.lists(st.tuples(st.sampled_from(GOOD) | st.binary(max_size=40), st.sampled_from([b"\r", b"\n", b"\r\n"]))),
    cut=st.integers(1, 50),
)
def test_whatever_comes_the_good_lines_are_received_in_order(
    one_wire: tuple[can.BusABC, socket.socket], lines: list[tuple[bytes, bytes]], cut: int
) -> None:
    bus, peer = one_wire
    text = b"".join(line + end for line, end in lines) + b"\rt7651BB\r"
    for at in range(0, len(text), cut):
        peer.sendall(text[at : at + cut])
    messages = received(bus, 0x765)
    good = [
        line
        for part in text.replace(b"\n", b"\r").replace(b"\a", b"\a\r").split(b"\r")
        for line in GOOD
        if line == part
    ]
    heads = [(m.arbitration_id, m.dlc) for m in messages]
    for line in good:  # random bytes may be a frame, too
        digits = 8 if line[:1].isupper() else 3
        head = int(line[1 : 1 + digits], 16), can.util.dlc2len(int(line[1 + digits : 2 + digits], 16))
        assert head in heads
        del heads[: heads.index(head) + 1]


def test_peer_that_does_not_read_fills_the_queue_and_then_gets_every_frame_whole() -> None:
    """As a serial port whose write times out: send() does not block, and what was taken is sent once."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        bus = open_bus({"interface": "slcan", "channel": f"socket://127.0.0.1:{server.getsockname()[1]}"})
        peer, _ = server.accept()
        peer.settimeout(30.0)
        with peer, bus:
            sent = 0

            def fill() -> None:
                nonlocal sent
                while True:
                    bus.send(can.Message(arbitration_id=0x301, data=sent.to_bytes(8, "big"), is_extended_id=False))
                    sent += 1

            with pytest.raises(can.CanOperationError, match="transmit buffer is full") as raised:
                fill()
            assert raised.value.error_code == errno.ENOBUFS
            text = bytearray()
            while len(text) < len(b"O\r") + sent * len(b"t3018%016X\r" % 0):
                bus.recv(0)
                text += peer.recv(65536)
            bus.send(can.Message(arbitration_id=0x302, is_extended_id=False))
            while not text.endswith(b"t3020\r"):
                text += peer.recv(65536)
    assert text == b"O\r" + b"".join(b"t3018%016X\r" % i for i in range(sent)) + b"t3020\r"


def test_thread_that_sends_beside_one_that_receives_sends_every_frame_once() -> None:
    """As can.Notifier does it."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        bus = open_bus({"interface": "slcan", "channel": f"socket://127.0.0.1:{server.getsockname()[1]}"})
        peer, _ = server.accept()
        peer.settimeout(30.0)
        ended = threading.Event()

        def receive() -> None:
            while not ended.is_set():
                bus.recv(0)

        with peer, bus:
            receiver = threading.Thread(target=receive)
            receiver.start()
            text, want = bytearray(), b"O\r" + b"".join(b"t3018%016X\r" % i for i in range(20_000))
            for i in range(20_000):
                message = can.Message(arbitration_id=0x301, data=i.to_bytes(8, "big"), is_extended_id=False)
                while True:
                    try:
                        bus.send(message)
                        break
                    except can.CanOperationError:
                        text += peer.recv(1000)
            while len(text) < len(want):
                text += peer.recv(65536)
            ended.set()
            receiver.join()
    assert text == want


def test_stream_over_a_line_that_is_damaged_both_ways_arrives_completely(monkeypatch: pytest.MonkeyPatch) -> None:
    plant = machine.load().starting_at((0.02, 0.0))
    knots_nm = planner.plan(shapes.circle(0.02, 0.1, duration_s=1.0), limits(plant)).knots_nm
    damage = itertools.cycle(DAMAGED[:-1])
    with (
        sim_process.start(slcan_tcp="0", pace="sync", machine=plant) as process,
        connected(bus := open_bus(process.options()), 1) as device,
    ):
        split, write, written = bus._split, bus._write, itertools.count()  # type: ignore[attr-defined]
        monkeypatch.setattr(
            bus, "_split", lambda data: split(next(damage) + b"\r" + data.replace(b"\rt181", b"t181", 1))
        )

        def write_damaged(line: str) -> None:
            if (number := next(written)) % 40 == 0:
                write(line + line)
            elif number % 40 == 20:
                write(line[:-1] + "\n\x00\xe4")
            write(line)

        monkeypatch.setattr(bus, "_write", write_damaged)
        with device.axes.enabled():
            assert stream(device, knots_nm).executed == len(knots_nm)
        assert device.link.dropped["line"] > 100
