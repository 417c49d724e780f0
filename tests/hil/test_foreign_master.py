# SPDX-License-Identifier: Apache-2.0
"""While a master holds the drive, another one may read and stop. Raw SDO frames at 600h + node id, beside kontur."""

from __future__ import annotations

import can
import pytest
from rig import Rig

LOCAL_CONTROL, READ_ONLY = 0x0800_0021, 0x0601_0002
SECOND_MASTER = 0xFF19
SAVE = int.from_bytes(b"save", "little")
Y = 0x800


class Foreign:
    """A master that knows nothing of the holder, on the same wire."""

    def __init__(self, rig: Rig) -> None:
        self.rig, self.id = rig, rig.drive.node_id

    def _request(self, command: int, index: int, sub: int, data: bytes = b"") -> bytes:
        answers: list[bytes] = []
        frame = bytes([command, index & 0xFF, index >> 8, sub]) + data.ljust(4, b"\0")

        def answered(_id: int, answer: bytearray, _time: float) -> None:
            if answer[1:4] == frame[1:4]:  # not to kontur, which reads the tick by the same channel
                answers.append(bytes(answer))

        self.rig.link._network.subscribe(0x580 + self.id, answered)
        self.rig.bus.send(can.Message(arbitration_id=0x600 + self.id, data=frame, is_extended_id=False))
        assert self.rig.link.wait(lambda: bool(answers), 1.0)
        return answers[-1]

    def write(self, index: int, sub: int, size: int, value: int) -> int:
        answer = self._request(0x23 | (4 - size) << 2, index, sub, value.to_bytes(size, "little", signed=value < 0))
        return int.from_bytes(answer[4:], "little") if answer[0] == 0x80 else 0

    def read(self, index: int, sub: int = 0) -> int:
        answer = self._request(0x40, index, sub)
        assert answer[0] != 0x80
        return int.from_bytes(answer[4:], "little")

    def lss(self, *request: int) -> list[bytes]:
        answers: list[bytes] = []
        self.rig.link._network.subscribe(0x7E4, lambda _id, data, _t: answers.append(bytes(data)))
        data = bytes(request).ljust(8, b"\0")
        self.rig.bus.send(can.Message(arbitration_id=0x7E5, data=data, is_extended_id=False))
        self.rig.link.wait(lambda: bool(answers), 0.02)
        return answers


@pytest.mark.motion
def test_what_is_the_holders_is_refused_to_others_and_the_holder_is_told(rig: Rig) -> None:
    foreign = Foreign(rig)
    writes = [
        (0x6060, 0, 1, 3), (0x60FF, 0, 4, 370_000), (0x68FF, 0, 4, 370_000), (0x2000, 1, 1, 0), (0x2131, 0, 2, 1200),
        (0x2100, 4, 4, 600_000), (0x607D, 2, 4, 10**9), (0x1016, 1, 4, 0), (0x1017, 0, 2, 0), (0x1014, 0, 4, 1 << 31),
        (0x2001, 1, 1, 9), (0x1010, 1, 4, SAVE), (0x2200, 1, 1, 2), (0x1201, 1, 4, 1 << 31), (0x6040, 0, 2, 0x0F),
        (0x6040, 0, 2, 0x80),
    ]  # fmt: skip
    with rig.device.axes.enabled():
        before = [foreign.read(index, sub) for index, sub, *_ in writes if index != 0x2200]
        refused = foreign.read(0x2140, 5)
        assert {foreign.write(*write) for write in writes} <= {LOCAL_CONTROL}
        assert [foreign.read(index, sub) for index, sub, *_ in writes if index != 0x2200] == before
        assert foreign.read(0x2140, 5) == refused + len(writes)
        assert rig.link.wait(lambda: SECOND_MASTER in [code for code, _, _ in rig.link.emergencies], 0.1)
        rig.link.wait(lambda: False, 0.2)
        assert max(map(abs, (rig.device.read("velocity_actual_x"), rig.device.read("velocity_actual_y")))) < 1000
        assert rig.device.axes.states() == ("operation enabled", "operation enabled")
        rig.device.write("controller.select", 1)  # the holder may
        rig.device.write("feed_override", 50.0)
    assert foreign.write(0x2000, 1, 1, 2) == 0  # nobody holds it any more


@pytest.mark.motion
def test_stop_of_any_master_is_obeyed(rig: Rig) -> None:
    foreign = Foreign(rig)
    with rig.device.axes.enabled():
        assert foreign.write(0x6040, 0, 2, 0x06) == 0
        assert foreign.write(0x6040 + Y, 0, 2, 0x00) == 0
        assert rig.link.wait(lambda: "operation enabled" not in rig.device.axes.states(), 1.0)


def test_lss_configures_nothing_while_a_master_holds_the_drive(rig: Rig) -> None:
    foreign = Foreign(rig)
    with rig.device.master.held():
        foreign.lss(0x04, 1)
        assert foreign.lss(0x11, 9)[0][:2] == b"\x11\xff"
        assert foreign.lss(0x17)[0][:2] == b"\x17\x02"
        foreign.lss(0x04, 0)
    assert rig.device.read("node.id") == rig.drive.node_id


def test_ticket_read_by_another_master_does_not_make_the_holders_void(rig: Rig) -> None:
    foreign = Foreign(rig)
    with rig.device.master.held():
        ticket = rig.device.read("master.ticket")
        foreign.read(0x2140, 3)
        rig.device.write("master.arm", ticket)


def test_master_that_comes_after_a_holder_has_the_first_channel(rig: Rig) -> None:
    foreign = Foreign(rig)
    with rig.device.master.held():
        pass
    assert foreign.write(0x2140, 2, 4, 5) == 0  # it claims, and has no channel of its own
    assert foreign.write(0x2140, 4, 4, foreign.read(0x2140, 3)) == 0
    assert foreign.write(0x2000, 1, 1, 1) == 0
    assert foreign.write(0x2140, 2, 4, 0) == 0


def test_holder_without_a_channel_is_told_from_others_by_its_ticket(rig: Rig) -> None:
    master = Foreign(rig)
    writes = [(0x6060, 0, 1, 3), (0x60FF, 0, 4, 370_000), (0x2000, 1, 1, 0), (0x2131, 0, 2, 1200), (0x2001, 1, 1, 9),
              (0x1010, 1, 4, SAVE)]  # fmt: skip
    assert master.write(0x2140, 2, 4, 127) == 0
    rig.link.send_heartbeat()
    assert {master.write(*write) for write in writes} == {LOCAL_CONTROL}
    assert master.read(0x2140, 5) == len(writes)
    assert master.write(0x2140, 4, 4, master.read(0x2140, 3)) == 0
    assert [master.write(*write) for write in writes[:4]] == [0] * 4
    rig.link.wait(lambda: False, 1.1)
    assert {master.write(*write) for write in writes} == {LOCAL_CONTROL}
    assert master.write(0x6040, 0, 2, 0) == 0
    assert master.write(0x2140, 2, 4, 0) == 0
