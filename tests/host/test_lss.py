# SPDX-License-Identifier: Apache-2.0
"""LSS (CiA 305) by python-canopen's master, against the simulated drive."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import can
import canopen
import pytest
from canopen.lss import CS_INQUIRE_PRODUCT_CODE, CS_INQUIRE_REVISION_NUMBER, CS_INQUIRE_SERIAL_NUMBER, LssError

VENDOR, PRODUCT, REVISION, SERIAL = 0, 1, 0x00010000, 0


class Network(canopen.Network):  # type: ignore[misc]
    """The drive answers at once, so what it says is taken before a send returns: no thread, no waiting."""

    def __init__(self, bus: can.BusABC) -> None:
        super().__init__(bus)
        self.sent: list[tuple[int, bytes]] = []
        self.lss.RESPONSE_TIMEOUT = 0.001  # of what will not be answered

    def send_message(self, can_id: int, data: Any, remote: bool = False) -> None:
        super().send_message(can_id, data, remote)
        self.take()

    def take(self, device_s: float = 0.0) -> None:
        """Let at most so much of the device's time pass."""
        end_s = self.bus.time_s + device_s
        while (message := self.bus.recv(max(0.0, end_s - self.bus.time_s))) is not None:
            self.sent.append((message.arbitration_id, bytes(message.data)))
            self.notify(message.arbitration_id, message.data, message.timestamp)


@pytest.fixture
def network(monkeypatch: pytest.MonkeyPatch) -> Iterator[Network]:
    monkeypatch.setattr("canopen.lss.time.sleep", lambda seconds: None)
    with can.Bus(interface="kontur", channel="sim") as bus:
        made = Network(bus)
        made.take()
        yield made


def configuration(network: Network, on: bool) -> None:
    lss = network.lss
    lss.send_switch_state_global(lss.CONFIGURATION_STATE if on else lss.WAITING_STATE)


def reset_communication(network: Network) -> None:
    network.sent.clear()
    network.nmt.send_command(0x82)


def test_address_and_node_id_are_inquired(network: Network) -> None:
    configuration(network, True)
    assert network.lss.inquire_node_id() == 1
    assert network.lss.inquire_lss_address(CS_INQUIRE_PRODUCT_CODE) == PRODUCT
    assert network.lss.inquire_lss_address(CS_INQUIRE_REVISION_NUMBER) == REVISION
    assert network.lss.inquire_lss_address(CS_INQUIRE_SERIAL_NUMBER) == SERIAL
    configuration(network, False)
    with pytest.raises(LssError):
        network.lss.inquire_node_id()


def test_drive_is_selected_by_its_whole_address(network: Network) -> None:
    with pytest.raises(LssError):
        network.lss.send_switch_state_selective(VENDOR, PRODUCT, REVISION, SERIAL + 1)
    assert network.lss.send_switch_state_selective(VENDOR, PRODUCT, REVISION, SERIAL)
    assert network.lss.inquire_node_id() == 1


def test_node_id_is_changed_and_stored(network: Network) -> None:
    configuration(network, True)
    network.lss.configure_node_id(17)
    network.lss.store_configuration()
    assert network.lss.inquire_node_id() == 1  # until it is reset
    reset_communication(network)
    assert (0x700 + 17, b"\0") in network.sent
    network.nmt.send_command(0x81)
    node = network.add_node(canopen.RemoteNode(17, canopen.ObjectDictionary()))
    assert node.sdo.upload(0x2001, 1) == bytes([17])
    assert node.sdo.upload(0x1014, 0) == (0x80 + 17).to_bytes(4, "little")


@pytest.mark.parametrize("node_id", [0, 32, 127, 128, 254])
def test_node_id_that_kontur_does_not_take_is_an_error(network: Network, node_id: int) -> None:
    configuration(network, True)
    with pytest.raises(LssError, match="1"):
        network.lss.configure_node_id(node_id)
    reset_communication(network)
    assert (0x701, b"\0") in network.sent


def test_drive_without_node_id_is_found_by_fastscan_and_given_one(network: Network) -> None:
    configuration(network, True)
    network.lss.configure_node_id(255)
    network.lss.store_configuration()
    reset_communication(network)
    network.take(0.5)
    assert network.sent == []  # no boot-up, no heartbeat
    network.lss.send_identify_non_configured_remote_slave()
    assert network.sent.pop() == (0x7E4, bytes([0x50]) + bytes(7))
    assert network.lss.fast_scan() == (True, [VENDOR, PRODUCT, REVISION, SERIAL])
    network.lss.configure_node_id(5)
    network.lss.store_configuration()
    configuration(network, False)
    assert (0x705, b"\0") in network.sent
    network.lss.send_identify_non_configured_remote_slave()
    assert network.sent[-1][0] != 0x7E4
    assert network.lss.fast_scan() == (False, None)


def test_bit_timing_is_configured_and_activated_with_silence(network: Network) -> None:
    configuration(network, True)
    for entry in (5, 9):
        with pytest.raises(LssError, match="1"):
            network.lss.configure_bit_timing(entry)
    network.lss.configure_bit_timing(2)
    network.lss.activate_bit_timing(400)
    network.sent.clear()
    network.take(0.79)
    assert network.sent == []
    network.take(0.3)
    assert network.sent
    node = network.add_node(canopen.RemoteNode(1, canopen.ObjectDictionary()))
    assert node.sdo.upload(0x2001, 2) == (500).to_bytes(2, "little")
