# SPDX-License-Identifier: Apache-2.0
"""Masters that know nothing of this drive, such as a PLC: raw frames and python-canopen's SDO client. Nobody claims."""

from __future__ import annotations

import pytest
from canopen.sdo import SdoAbortedError
from rig import PRE_OPERATIONAL, RESET_NODE, START, Rig

LSS_REQUEST, LSS_ANSWER = 0x7E5, 0x7E4
SHUTDOWN, SWITCH_ON, ENABLE = 0x06, 0x07, 0x0F
STATE, ENABLED, SWITCH_ON_DISABLED = 0x6F, 0x27, 0x40
Y = 0x800  # from an object of axis x to that of axis y
EMCY_OF_MEMORY, EMCY_OF_PARAMETER, EMCY_OF_VALUE = 0x5510, 0xFF18, 0x8200
HEARTBEAT_LOST, PLC_ID = 0x8130, 20
FAULT_RESET, FAULT_REACTION, FAULT = 0x80, 0x0F, 0x08
NOT_IN_THIS_STATE, TOO_LOW = 0x0800_0022, 0x0609_0032
PROFILE_VELOCITY, SPEED_UMPS = 3, 20_000


class Master:
    """A master that has not claimed the drive and sends no heartbeat."""

    def __init__(self, rig: Rig) -> None:
        self.rig, self.link = rig, rig.link
        self.node_id = rig.drive.node_id
        assert rig.device.read("master.holder") == 0
        rig.nmt(START)

    def write(self, index: int, sub: int, size: int, value: int) -> int:
        """Returns the abort code, 0 for success."""
        try:
            self.link.node.sdo.download(index, sub, value.to_bytes(size, "little", signed=value < 0))
        except SdoAbortedError as refused:
            return int(refused.code)
        return 0

    def read(self, index: int, sub: int = 0) -> int:
        return int.from_bytes(self.link.node.sdo.upload(index, sub), "little")

    def lss(self, *request: int) -> bytes:
        """The answer to a request of LSS, empty if there is none within 20 ms."""
        answers: list[bytes] = []
        self.link._network.subscribe(LSS_ANSWER, lambda _id, data, _t: answers.append(bytes(data)))
        self.link.send(LSS_REQUEST, bytes(request).ljust(8, b"\0"))
        self.link.wait(lambda: bool(answers), 0.02)
        self.link._network.unsubscribe(LSS_ANSWER)
        return answers[0] if answers else b""

    def map_rpdo(self, number: int, *entries: int) -> None:
        """Map entries (index << 16 | sub-index << 8 | bits) into an RPDO, in pre-operational; then operational."""
        communication, mapping = 0x1400 + number - 1, 0x1600 + number - 1
        cob_id = (number + 1) * 0x100 + self.node_id
        self.rig.nmt(PRE_OPERATIONAL)
        assert self.write(communication, 1, 4, 1 << 31 | cob_id) == 0
        assert self.write(mapping, 0, 1, 0) == 0
        for sub, entry in enumerate(entries, 1):
            assert self.write(mapping, sub, 4, entry) == 0
        assert self.write(mapping, 0, 1, len(entries)) == 0
        assert self.write(communication, 1, 4, cob_id) == 0
        self.rig.nmt(START)

    def jog(self) -> None:
        """Both axes at 20 mm/s"""
        self.enable(PROFILE_VELOCITY)
        for axis in (0, Y):
            assert self.write(0x60FF + axis, 0, 4, SPEED_UMPS) == 0
        assert self.link.wait(lambda: min(self.speeds()) > SPEED_UMPS // 2, 2.0)

    def speeds(self) -> tuple[int, int]:
        """In um/s"""
        x, y = (self.link.node.sdo.upload(0x606C + axis, 0) for axis in (0, Y))
        return int.from_bytes(x, "little", signed=True), int.from_bytes(y, "little", signed=True)

    def states(self) -> tuple[int, int]:
        return self.read(0x6041) & STATE, self.read(0x6041 + Y) & STATE

    def enable(self, mode: int = 7) -> None:
        """Both axes, by RPDO1 as it is at power-on."""
        for axis in (0, Y):
            assert self.write(0x6060 + axis, 0, 1, mode) == 0
        for controlword, state in ((SHUTDOWN, 0x21), (SWITCH_ON, 0x23), (ENABLE, ENABLED)):
            self.link.wait(lambda: False, 0.002)
            self.link.send(0x200 + self.node_id, controlword.to_bytes(2, "little") * 2)
            assert self.link.wait(lambda state=state: self.states() == (state, state), 2.0)  # type: ignore[misc]

    def codes(self) -> list[int]:
        """EMCY codes so far"""
        return [code for code, _, _ in self.link.emergencies]


def test_lss_configuration_without_power_is_no_memory_fault(rig: Rig) -> None:
    master = Master(rig)
    other_id = master.node_id % 31 + 1
    assert master.lss(0x04, 1) == b""
    assert master.lss(0x11, other_id)[:2] == b"\x11\x00"
    rig.link.wait(lambda: False, 0.1)
    assert master.lss(0x13, 0, 2)[:2] == b"\x13\x00"
    rig.link.wait(lambda: False, 0.1)
    assert EMCY_OF_MEMORY not in master.codes()
    assert (master.read(0x2001, 1), master.read(0x2001, 2)) == (other_id, 500)
    rig.reset(RESET_NODE)
    assert (master.read(0x2001, 1), master.read(0x2001, 2)) == (master.node_id, 1000)


@pytest.mark.motion
def test_lss_configuration_is_refused_while_an_axis_has_power(rig: Rig) -> None:
    master = Master(rig)
    master.enable()
    assert master.lss(0x04, 1) == b""
    assert master.lss(0x11, master.node_id % 31 + 1)[:3] == b"\x11\xff\x01"
    assert master.lss(0x13, 0, 2)[:3] == b"\x13\xff\x01"
    assert master.lss(0x15, 200) == b""
    told = rig.link.status_count
    rig.link.wait(lambda: False, 0.1)
    assert rig.link.status_count > told
    assert (master.read(0x2001, 1), master.read(0x2001, 2)) == (master.node_id, 1000)
    assert EMCY_OF_PARAMETER in master.codes()
    assert EMCY_OF_MEMORY not in master.codes()
    assert master.states() == (ENABLED, ENABLED)


_PLC = (0x60400010, 0x60600008, 0x68400010, 0x68600008)
"""Of each axis controlword and mode, in the third RPDO"""


def _needs_room(rig: Rig) -> None:
    if not rig.drive.simulated:
        pytest.skip("a jog needs more room than the 2 mm of this suite: use a simulated target")


def _jogging(rig: Rig) -> Master:
    """A master whose outputs, of a PLC, are mapped into RPDO 3, and whose axes jog."""
    _needs_room(rig)
    master = Master(rig)
    master.map_rpdo(3, *_PLC)
    master.jog()
    return master


@pytest.mark.motion
def test_zeroed_outputs_of_a_plc_stop_a_jog(rig: Rig) -> None:
    master = _jogging(rig)
    rig.link.send(0x400 + master.node_id, bytes(6))
    assert master.states() == (SWITCH_ON_DISABLED, SWITCH_ON_DISABLED)
    assert rig.link.wait(lambda: max(map(abs, master.speeds())) < SPEED_UMPS // 20, 2.0)
    assert master.codes() == []
    assert (master.read(0x6061), master.read(0x6061 + Y)) == (PROFILE_VELOCITY, PROFILE_VELOCITY)


@pytest.mark.motion
def test_value_that_is_refused_is_refused_alone_and_told_once(rig: Rig) -> None:
    master = _jogging(rig)
    rejected = master.read(0x2200, 20)
    for _ in range(5):  # x goes on and asks for a mode that there is not, y stops
        rig.link.send(0x400 + master.node_id, bytes([0x0F, 0, 5, 0, 0, 0]))
        rig.link.wait(lambda: False, 0.01)
    assert master.codes() == [EMCY_OF_VALUE]
    assert master.read(0x2200, 20) == rejected + 5
    assert master.states() == (ENABLED, SWITCH_ON_DISABLED)
    rig.link.send(0x400 + master.node_id, bytes(6))
    assert master.states() == (SWITCH_ON_DISABLED, SWITCH_ON_DISABLED)
    assert rig.link.wait(lambda: master.codes() == [EMCY_OF_VALUE, 0], 1.0)


@pytest.mark.motion
def test_heartbeat_lost_without_power_is_latched_and_nothing_is_enabled_until_it_is_back(rig: Rig) -> None:
    master = Master(rig)
    assert master.write(0x1016, 1, 4, PLC_ID << 16 | 50) == 0
    rig.link.send(0x700 + PLC_ID, b"\x05")
    assert rig.link.wait(lambda: master.states() == (FAULT, FAULT), 1.0)
    assert master.codes() == [HEARTBEAT_LOST]
    for controlword in (FAULT_RESET, SHUTDOWN, SWITCH_ON, ENABLE):
        rig.link.send(0x200 + master.node_id, controlword.to_bytes(2, "little") * 2)
        rig.link.wait(lambda: False, 0.005)
        assert master.states() == (FAULT, FAULT)
    assert master.write(0x1016, 1, 4, PLC_ID << 16 | 10_000) == 0
    rig.link.send(0x700 + PLC_ID, b"\x05")
    rig.link.send(0x200 + master.node_id, bytes(4))
    rig.link.send(0x200 + master.node_id, FAULT_RESET.to_bytes(2, "little") * 2)
    assert rig.link.wait(lambda: master.codes() == [HEARTBEAT_LOST, 0], 1.0)
    master.enable()


@pytest.mark.motion
def test_ramps_limits_and_homing_are_written_to_an_enabled_axis_as_function_blocks_do(rig: Rig) -> None:
    _needs_room(rig)
    master = Master(rig)
    master.enable(PROFILE_VELOCITY)
    taken = ((0x6083, 0, 4), (0x6084, 0, 4), (0x6085, 0, 4), (0x605A, 0, 2), (0x605D, 0, 2), (0x607C, 0, 4))
    taken += ((0x607D, 1, 4), (0x607D, 2, 4), (0x6065, 0, 4), (0x6098, 0, 1), (0x6099, 1, 4), (0x6099, 2, 4))
    for index, sub, size in (*taken, (0x609A, 0, 4)):
        for axis in (0, Y):
            now = rig.link.node.sdo.upload(index + axis, sub)
            rig.link.node.sdo.download(index + axis, sub, now[:size])  # raises where it is refused
    assert master.write(0x2110, 1, 4, master.read(0x2110, 1)) == NOT_IN_THIS_STATE  # the loop's
    here = int.from_bytes(rig.link.node.sdo.upload(0x6064, 0), "little", signed=True)
    assert master.write(0x607D, 2, 4, here - 1_000_000) == NOT_IN_THIS_STATE
    assert master.write(0x607D, 2, 4, here + 5_000_000) == 0
    assert master.write(0x6083, 0, 4, 200_000) == 0
    assert master.write(0x60FF, 0, 4, SPEED_UMPS) == 0
    rig.link.wait(lambda: False, 1.0)
    end = int.from_bytes(rig.link.node.sdo.upload(0x6064, 0), "little", signed=True)
    assert abs(end - here - 5_000_000) < 10_000
    assert master.states() == (ENABLED, ENABLED)
    assert EMCY_OF_MEMORY not in master.codes()


def test_motor_is_not_known_to_the_drive(rig: Rig) -> None:
    master = Master(rig)
    for axis in (0, Y):
        assert master.read(0x6402 + axis) == 0
        assert master.link.node.sdo.upload(0x6403 + axis, 0) == b"-"


@pytest.mark.motion
@pytest.mark.parametrize(("option", "first"), [(1, FAULT_REACTION), (2, FAULT)])
def test_lost_master_stops_on_the_path_or_cuts_the_power_but_never_does_nothing(
    rig: Rig, option: int, first: int
) -> None:
    assert Master(rig).write(0x1016, 1, 4, PLC_ID << 16 | 50) == 0
    master = _jogging(rig)
    assert master.write(0x6007, 0, 2, 0) == TOO_LOW
    assert master.write(0x6007, 0, 2, option) == 0
    rig.link.send(0x700 + PLC_ID, b"\x05")
    assert rig.link.wait(lambda: master.states()[0] != ENABLED, 1.0)
    assert master.states()[0] == first
    assert rig.link.wait(lambda: master.states() == (FAULT, FAULT), 1.0)
    assert master.codes() == [HEARTBEAT_LOST]
