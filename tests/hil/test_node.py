# SPDX-License-Identifier: Apache-2.0
"""The drive as a CANopen node (CiA 301): nothing here gives the axes power."""

import struct

import pytest
from canopen.objectdictionary import ODVariable
from canopen.objectdictionary.datatypes import DOMAIN
from canopen.sdo import SdoAbortedError
from rig import PATIENCE_S, PRE_OPERATIONAL, RESET_COMMUNICATION, RESET_NODE, START, STATE_OF, STOP, Rig

from kontur.can import wire
from kontur.errors import DeviceError, ParameterError


def variables(rig: Rig) -> list[ODVariable]:
    entries = rig.link.node.object_dictionary.values()
    found = [v for e in entries for v in ([e] if isinstance(e, ODVariable) else e.values())]
    return [v for v in found if v.index >= 0x1000]  # those below are for gaps in a PDO


def upload(rig: Rig, index: int, sub: int = 0) -> bytes:
    return bytes(rig.link.node.sdo.upload(index, sub))


def abort_code(rig: Rig, index: int, sub: int, data: bytes | None = None) -> int:
    sdo = rig.link.node.sdo
    with pytest.raises(SdoAbortedError) as caught:
        _ = sdo.upload(index, sub) if data is None else sdo.download(index, sub, data)
    return int(caught.value.code)


@pytest.mark.parametrize("command", [RESET_NODE, RESET_COMMUNICATION])
def test_reset_ends_with_the_boot_up_message_and_pre_operational(rig: Rig, command: int) -> None:
    rig.nmt(START)
    states = rig.heartbeats()
    rig.reset(command)
    assert rig.link.wait(lambda: len(states) > states.index(0) + 1, 1.0)
    assert states[states.index(0) + 1] == STATE_OF[PRE_OPERATIONAL]


def test_heartbeats_come_in_the_time_that_was_set(rig: Rig) -> None:
    rig.device.write("heartbeat_producer", 20)
    states = rig.heartbeats()
    begin_ms = rig.device.read("clock.tick")
    assert rig.link.wait(lambda: len(states) > 20, 5.0)
    assert 380 <= rig.device.read("clock.tick") - begin_ms <= 440  # by the drive's own clock: 20 periods


# A stopped node does not answer, so the clock_rig: its time must not hang on that.


@pytest.mark.parametrize("command", [START, STOP, PRE_OPERATIONAL])
def test_nmt_state_follows_its_command(clock_rig: Rig, command: int) -> None:
    clock_rig.nmt(STOP if command == PRE_OPERATIONAL else PRE_OPERATIONAL)
    states = clock_rig.heartbeats()
    clock_rig.nmt(command)
    assert clock_rig.link.wait(lambda: states[-1:] == [STATE_OF[command]], PATIENCE_S)
    clock_rig.nmt(PRE_OPERATIONAL)


def test_nmt_command_for_another_node_is_none_of_its_business(rig: Rig) -> None:
    states = rig.heartbeats()
    rig.link.send(0, bytes([START, rig.drive.node_id + 1]))
    assert rig.link.wait(lambda: len(states) >= 2, 1.0)
    assert set(states) == {STATE_OF[PRE_OPERATIONAL]}


def test_nothing_but_heartbeats_comes_in_nmt_state_stopped(clock_rig: Rig) -> None:
    clock_rig.nmt(STOP)
    states = clock_rig.heartbeats()
    assert clock_rig.link.wait(lambda: STATE_OF[STOP] in states, PATIENCE_S)
    clock_rig.link.node.sdo.RESPONSE_TIMEOUT = 0.2
    with pytest.raises(Exception, match="No SDO response"):
        upload(clock_rig, 0x1000)
    clock_rig.nmt(PRE_OPERATIONAL)
    assert clock_rig.link.wait(lambda: states[-1] == STATE_OF[PRE_OPERATIONAL], PATIENCE_S)
    assert upload(clock_rig, 0x1000) == bytes.fromhex("92 01 ff ff")


def test_status_flows_in_nmt_state_operational_only(rig: Rig) -> None:
    seen = rig.link.status_count
    states = rig.heartbeats()
    assert rig.link.wait(lambda: len(states) >= 2, 1.0)
    assert rig.link.status_count == seen
    rig.nmt(START)
    assert rig.link.wait(lambda: rig.link.status_count > seen + 2, 1.0)


def test_drive_tells_who_it_is(rig: Rig) -> None:
    info = rig.device.info()
    assert info.name == "Kontur"
    assert info.control_hz > 0
    assert info.state == ("switch on disabled", "switch on disabled")
    dictionary = rig.link.node.object_dictionary
    for sub in (1, 2, 3):  # vendor, product, revision as the EDS has them
        assert struct.unpack("<I", upload(rig, 0x1018, sub)) == (dictionary[0x1018][sub].default,)


def test_every_object_of_the_eds_is_there_with_its_size(rig: Rig) -> None:
    for variable in variables(rig):
        if not variable.readable:
            assert abort_code(rig, variable.index, variable.subindex) == 0x06010001
            continue
        if variable.index == 0x1003 and variable.subindex > upload(rig, 0x1003)[0]:
            assert abort_code(rig, 0x1003, variable.subindex) == 0x08000024
            continue
        if variable.data_type == DOMAIN:
            assert abort_code(rig, variable.index, variable.subindex) == 0x08000024  # nothing is captured
            continue
        data = upload(rig, variable.index, variable.subindex)
        if variable.data_type in variable.STRUCT_TYPES:
            assert len(data) == len(variable) // 8, f"{variable.qualname}: {data.hex()}"


def test_request_that_cannot_be_met_gets_its_abort_code(rig: Rig) -> None:
    assert abort_code(rig, 0x5FFF, 0) == 0x06020000  # no such object
    assert abort_code(rig, 0x1018, 9) == 0x06090011  # no such sub-index
    assert abort_code(rig, 0x1018, 1, bytes(4)) == 0x06010002  # read only
    assert abort_code(rig, 0x1017, 0, bytes(4)) in (0x06070010, 0x06070012)  # too long
    assert abort_code(rig, 0x1017, 0, bytes(1)) in (0x06070010, 0x06070013)  # too short
    assert abort_code(rig, 0x2000, 1, b"\x63") in (0x06090030, 0x06090031)  # too large


def test_parameter_keeps_what_was_written_until_reset_node(rig: Rig) -> None:
    rig.reset()  # a simulated drive was told its machine, which it has not stored
    before = rig.device.read("smc.lambda")
    other = 150.5 if before != 150.5 else 151.0
    rig.device.write("smc.lambda", other)
    assert rig.device.read("smc.lambda") == other
    rig.reset()
    assert rig.device.read("smc.lambda") == before


def test_parameter_out_of_range_or_unfit_changes_nothing(rig: Rig) -> None:
    before = rig.device.parameters.dump()
    with pytest.raises(ParameterError, match="out of range"):
        rig.device.parameters.set({"smc.gamma": 2.0, "smc.lambda": 1e6})
    with pytest.raises(ParameterError, match="does not fit another"):
        rig.device.write("smc.k_0", before["smc.k_max"] + 1.0)
    assert rig.device.parameters.dump() == before


def test_command_that_needs_another_state_is_refused(rig: Rig) -> None:
    with pytest.raises(DeviceError, match=r"stream\.command: the drive refuses"):
        rig.device.write("stream.command", 1)  # no axis is enabled


def test_axes_come_to_switched_on_and_back_one_after_the_other(rig: Rig) -> None:
    """As far as the axes go without power."""
    rig.nmt(START)
    for controlword, state in ((0x06, "ready to switch on"), (0x07, "switched on"), (0x06, "ready to switch on")):
        rig.device.axes.controlwords(controlword, 0x00)
        rig.device.wait(
            lambda state=state: rig.device.axes.states() == (state, "switch on disabled"),  # type: ignore[misc]
            1.0,
            f"x does not come to {state!r}",
        )
    rig.device.axes.controlwords(0x00, 0x06)
    rig.device.wait(
        lambda: rig.device.axes.states() == ("switch on disabled", "ready to switch on"), 1.0, "does not change axes"
    )


def test_corrupt_frames_do_not_disturb_the_node(rig: Rig) -> None:
    rig.nmt(START)
    for cob_id in (0x000, 0x080, wire.RPDO1, wire.RPDO2, 0x400, 0x500, 0x600, 0x77F):
        for length in range(9):
            if cob_id in (0x000, 0x080) and length == 2:
                continue  # a valid command
            node = 0 if cob_id in (0x000, 0x080, 0x77F) else rig.drive.node_id
            rig.link.send(cob_id + node, bytes([0xA5] * length))
    rig.reset()
    assert upload(rig, 0x1000) == bytes.fromhex("92 01 ff ff")
