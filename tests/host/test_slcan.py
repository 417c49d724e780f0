# SPDX-License-Identifier: Apache-2.0
"""The slcan bus that reads all that waits, against a socket that says what an adapter would."""

import socket
from collections.abc import Iterator

import can
import pytest

from kontur.can.bus import open_bus


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
