# SPDX-License-Identifier: Apache-2.0
"""python-canopen alone, with the EDS, as the master of another make: reads, changes and uses PDOs, SYNC and EMCY."""

from collections.abc import Iterator
from pathlib import Path

import canopen
import pytest
from canopen import SdoAbortedError

EDS = Path(__file__).resolve().parents[2] / "host" / "kontur" / "kontur.eds"
PATIENCE_S = 10.0
NODE = 3


@pytest.fixture
def network() -> Iterator[canopen.Network]:
    net = canopen.Network()
    net.connect(interface="kontur", channel="sim", pace="clock", node_id=NODE)
    yield net
    net.disconnect()


@pytest.fixture
def node(network: canopen.Network) -> canopen.RemoteNode:
    remote = network.add_node(NODE, str(EDS))
    remote.sdo.RESPONSE_TIMEOUT = PATIENCE_S
    return remote


def start(node: canopen.RemoteNode) -> None:
    node.nmt.state = "OPERATIONAL"
    state = None
    while state != "OPERATIONAL":  # a heartbeat from before may be on its way
        state = node.nmt.wait_for_heartbeat(PATIENCE_S)


def names(pdos: canopen.pdo.base.PdoMaps) -> list[list[str]]:
    return [[variable.name for variable in pdo] for pdo in pdos.values()]


def test_mapping_read_from_the_drive_is_the_one_of_the_eds(node: canopen.RemoteNode) -> None:
    for pdos in (node.tpdo, node.rpdo):
        pdos.read()
        from_drive = names(pdos)
        pdos.read(from_od=True)
        assert from_drive == names(pdos)
        assert all(pdo.trans_type == 254 for pdo in pdos.values())
    assert [number for number, pdo in node.rpdo.items() if pdo.enabled] == [1, 2, 3]
    assert [number for number, pdo in node.tpdo.items() if pdo.enabled] == [1]
    assert [v.name for v in node.rpdo[2]] == ["knot.sequence", "knot.crc", "knot.dx", "knot.dy"]
    assert node.tpdo[1].cob_id == 0x180 + NODE


def test_changed_mapping_is_sent_at_every_second_sync(network: canopen.Network, node: canopen.RemoteNode) -> None:
    node.tpdo.read()
    pdo = node.tpdo[5]
    pdo.clear()
    pdo.add_variable("error_register")
    pdo.add_variable("telemetry", "position_x")
    pdo.add_variable("statusword_y")
    pdo.trans_type = 2
    pdo.enabled = True
    pdo.save()
    start(node)
    received: list[bytes] = []
    pdo.add_callback(lambda mapped: received.append(bytes(mapped.data)))
    for _ in range(4):
        network.sync.transmit()
    node.sdo["error_register"].raw  # noqa: B018  its answer comes after what the SYNCs have sent
    assert [len(data) for data in received] == [6, 6]
    assert pdo["statusword_y"].raw & 0x6F == 0x40  # switch on disabled
    assert pdo["error_register"].raw == 0


def test_rpdo_with_a_gap_commands_the_axis_behind_it(network: canopen.Network, node: canopen.RemoteNode) -> None:
    node.rpdo.read()
    node.tpdo.read()
    pdo = node.rpdo[1]
    pdo.clear()
    pdo.add_variable("Dummy0006")
    pdo.add_variable("controlword_y")
    pdo.save()
    start(node)
    pdo["Dummy0006"].raw = 0xFFFF
    pdo["controlword_y"].raw = 0x06
    pdo.transmit()
    assert node.sdo["controlword_y"].raw == 0x06
    assert node.sdo["controlword_x"].raw == 0x00
    assert node.sdo["statusword_y"].raw & 0x6F == 0x21  # ready to switch on


def test_mapping_of_a_running_drive_is_refused(node: canopen.RemoteNode) -> None:
    node.tpdo.read()
    start(node)
    with pytest.raises(SdoAbortedError) as refused:
        node.tpdo[5].save()
    assert refused.value.code == 0x08000022


def test_object_that_cannot_be_mapped_is_refused(node: canopen.RemoteNode) -> None:
    node.tpdo.read()
    node.tpdo[5].clear()
    node.tpdo[5].add_variable("heartbeat_producer")
    with pytest.raises(SdoAbortedError) as refused:
        node.tpdo[5].save()
    assert refused.value.code == 0x06040041


def test_saved_pdo_goes_back_to_its_default_by_reset_communication(node: canopen.RemoteNode) -> None:
    node.tpdo.read()
    before = names(node.tpdo)
    node.tpdo[4].clear()
    node.tpdo[4].add_variable("error_register")
    node.tpdo[4].save()
    node.nmt.state = "RESET COMMUNICATION"
    node.tpdo.read()
    assert names(node.tpdo) == before


def test_frame_of_a_wrong_length_raises_an_emcy_and_is_counted(
    network: canopen.Network, node: canopen.RemoteNode
) -> None:
    start(node)
    network.send_message(0x200 + NODE, b"\x06\x00\x06")
    assert node.sdo["stream"]["rejected_length"].raw == 1
    assert [(e.code, e.register) for e in node.emcy.log] == [(0x8210, 0x11)]
    assert node.sdo["error_history"][1].raw & 0xFFFF == 0x8210
    network.send_message(0x200 + NODE, b"\x00\x00\x00\x00")
    assert node.sdo["error_register"].raw == 0
    assert [e.code for e in node.emcy.log] == [0x8210, 0]
    assert node.emcy.active == []
