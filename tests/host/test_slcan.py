# SPDX-License-Identifier: Apache-2.0
"""The slcan bus that reads all that waits, against a socket that says what an adapter would."""

import os
import select
import socket
import struct
import sys
from collections.abc import Iterator

import can
import pytest

from kontur.can.bad_bus import BadBus
from kontur.can.bus import open_bus
from kontur.can.link import Link
from kontur.errors import BusError


@pytest.fixture
def wire() -> Iterator[tuple[can.BusABC, socket.socket]]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        bus = open_bus({"interface": "slcan", "channel": f"socket://127.0.0.1:{server.getsockname()[1]}"})
        peer, _ = server.accept()
        with peer, bus:
            yield bus, peer


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
