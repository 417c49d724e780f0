# SPDX-License-Identifier: Apache-2.0
"""What objects answer to a master that knows only CiA 301, CiA 306's EDS and docs/objects.md."""

from __future__ import annotations

import can
import pytest
from rig import PRE_OPERATIONAL, RESET_NODE, START, Rig
from test_any_master import FAULT, NOT_IN_THIS_STATE, Master, Y

SAVE, LOAD = int.from_bytes(b"save", "little"), int.from_bytes(b"load", "little")
BAD_VALUE, TOO_HIGH, TOO_LOW = 0x0609_0030, 0x0609_0031, 0x0609_0032
EMCY_OF_SAVES = 0xFF32
AT_ONCE = 8  # sets


@pytest.mark.parametrize(
    ("index", "sub", "size", "value", "code"),
    [
        (0x2001, 1, 1, 0, TOO_LOW),
        (0x2001, 1, 1, 32, TOO_HIGH),
        (0x2001, 2, 2, 9, TOO_LOW),
        (0x2001, 2, 2, 11, BAD_VALUE),  # no port has it
        (0x2001, 2, 2, 1001, TOO_HIGH),
        (0x1003, 0, 1, 1, BAD_VALUE),
        (0x1400, 2, 1, 241, BAD_VALUE),
        (0x1800, 2, 1, 253, BAD_VALUE),
        (0x1800, 1, 4, 0x101, BAD_VALUE),
        (0x1029, 1, 1, 3, TOO_HIGH),
        (0x2000, 1, 1, 0x63, TOO_HIGH),
        (0x2140, 2, 4, 128, BAD_VALUE),
        (0x2200, 1, 1, 0, TOO_LOW),
        (0x2200, 1, 1, 5, TOO_HIGH),
        (0x2300, 5, 1, 255, BAD_VALUE),
        (0x6007, 0, 2, 0, TOO_LOW),
        (0x605A, 0, 2, -1, TOO_LOW),
        (0x605A, 0, 2, 3, BAD_VALUE),
        (0x605A, 0, 2, 7, TOO_HIGH),
        (0x605E, 0, 2, 2, TOO_HIGH),
        (0x6060, 0, 1, 99, BAD_VALUE),
        (0x6098, 0, 1, 0, TOO_LOW),
        (0x6098, 0, 1, 36, BAD_VALUE),
        (0x6098, 0, 1, 38, TOO_HIGH),
        (0x60C2, 1, 1, 0, TOO_LOW),
        (0x60C2, 1, 1, 21, TOO_HIGH),
    ],
)
def test_value_beyond_the_range_and_one_within_that_is_not_offered_have_codes_of_their_own(
    rig: Rig, index: int, sub: int, size: int, value: int, code: int
) -> None:
    master = Master(rig)
    if 0x1400 <= index < 0x1C00:
        rig.nmt(128)
    assert master.write(index, sub, size, value) == code


def _master(rig: Rig) -> Master:
    if not rig.drive.simulated:
        pytest.skip("saves and wears the flash: use a simulated target")
    return Master(rig)


def test_thousand_identical_saves_write_once(rig: Rig) -> None:
    master = _master(rig)
    assert master.write(0x2110, 1, 4, master.read(0x2110, 1) + 1) == 0
    assert master.write(0x1010, 1, 4, SAVE) == 0
    sets, erases = master.read(0x2035), master.read(0x2170, 1)
    for _ in range(1000):
        assert master.write(0x1010, 1, 4, SAVE) == 0
    assert (master.read(0x2035), master.read(0x2170, 1)) == (sets, erases)
    assert master.codes() == []


def test_storm_of_saves_is_refused_and_told_and_let_through_once_a_minute(rig: Rig) -> None:
    master = _master(rig)
    lambda_, sets = master.read(0x2110, 1), master.read(0x2035)
    codes = []
    for i in range(3 * AT_ONCE):
        assert master.write(0x2110, 1, 4, lambda_ + 1 + i) == 0
        codes.append(master.write(0x1010, 1, 4, SAVE))
    assert set(codes[AT_ONCE:]) == {NOT_IN_THIS_STATE}
    assert master.read(0x2035) <= sets + AT_ONCE
    assert master.read(0x2170, 3) == 0
    assert master.write(0x1011, 1, 4, LOAD) == NOT_IN_THIS_STATE
    assert rig.link.wait(lambda: master.codes() == [EMCY_OF_SAVES], 0.1)
    rig.reset(RESET_NODE)
    assert master.read(0x2110, 1) == lambda_ + codes.index(NOT_IN_THIS_STATE)  # of the last one that was let through


GUARD_ERROR, PDO_LATE, ONE_AXIS = 0x8130, 0x8250, 0xFF33
GUARD_MS = 50


def _guard(rig: Rig) -> list[int]:
    """Ask for the node's state by a remote frame; the bytes that answer within 20 ms."""
    answers: list[int] = []
    cob_id = 0x700 + rig.drive.node_id
    rig.link._network.subscribe(cob_id, lambda _id, data, _t: answers.append(data[0]))
    rig.bus.send(can.Message(arbitration_id=cob_id, is_remote_frame=True, dlc=1, is_extended_id=False))
    rig.link.wait(lambda: bool(answers), 0.02)
    rig.link._network.unsubscribe(cob_id)
    return answers


def test_counter_of_sync_is_set_first_since_its_period_is_0(rig: Rig) -> None:
    master = Master(rig)
    assert master.read(0x1006) == 0
    assert master.write(0x1019, 0, 1, 10) == 0
    assert master.write(0x1006, 0, 4, 1000) == 0
    assert master.write(0x1019, 0, 1, 20) == NOT_IN_THIS_STATE


def test_node_guarding_is_answered(rig: Rig) -> None:
    master = Master(rig)
    assert master.write(0x1017, 0, 2, 0) == 0
    states = [_guard(rig) for _ in range(3)]
    assert [[state & 0x7F for state in answer] for answer in states] == [[5]] * 3
    assert [answer[0] >> 7 for answer in states] in ([0, 1, 0], [1, 0, 1])


@pytest.mark.motion
def test_master_that_ceases_to_guard_is_a_fault(rig: Rig) -> None:
    master = Master(rig)
    assert master.write(0x1017, 0, 2, 0) == 0
    assert master.write(0x100C, 0, 2, GUARD_MS) == 0
    assert master.write(0x100D, 0, 1, 2) == 0
    assert _guard(rig)
    assert rig.link.wait(lambda: master.codes() == [GUARD_ERROR], 1.0)
    assert master.states() == (FAULT, FAULT)
    assert _guard(rig)
    assert master.write(0x100D, 0, 1, 0) == 0
    rig.link.send(0x200 + master.node_id, bytes(4))
    rig.link.send(0x200 + master.node_id, b"\x80\0\x80\0")
    assert rig.link.wait(lambda: master.codes() == [GUARD_ERROR, 0], 1.0)


def test_fourth_rpdo_is_mapped_and_watched(rig: Rig) -> None:
    master = Master(rig)
    rig.nmt(PRE_OPERATIONAL)
    assert master.write(0x1403, 5, 2, GUARD_MS) == 0
    master.map_rpdo(4, 0x60FF0020, 0x68FF0020)
    rig.link.send(0x500 + master.node_id, (123).to_bytes(4, "little") + (-45).to_bytes(4, "little", signed=True))
    assert (master.read(0x60FF), master.read(0x60FF + Y)) == (123, 2**32 - 45)
    assert rig.link.wait(lambda: master.codes() == [PDO_LATE], 1.0)
    rig.link.send(0x500 + master.node_id, bytes(8))
    assert rig.link.wait(lambda: master.codes() == [PDO_LATE, 0], GUARD_MS * 1e-3 / 2)


@pytest.mark.motion
def test_axes_stop_when_a_watched_rpdo_does_not_come(rig: Rig) -> None:
    master = Master(rig)
    rig.nmt(PRE_OPERATIONAL)
    assert master.write(0x1400, 5, 2, 500) == 0
    rig.nmt(START)
    master.enable()
    assert rig.link.wait(lambda: master.codes() == [PDO_LATE, GUARD_ERROR], 1.0)
    assert rig.link.wait(lambda: master.states() == (FAULT, FAULT), 1.0)


def test_error_code_of_an_axis_is_mapped(rig: Rig) -> None:
    master = Master(rig)
    rig.nmt(PRE_OPERATIONAL)
    cob_id = 0x6A0  # nobody's: there is no node 0
    assert master.write(0x1803, 1, 4, 1 << 31 | cob_id) == 0
    assert master.write(0x1A03, 0, 1, 0) == 0
    for sub, entry in enumerate((0x603F0010, 0x683F0010), 1):
        assert master.write(0x1A03, sub, 4, entry) == 0
    assert master.write(0x1A03, 0, 1, 2) == 0
    assert master.write(0x1803, 1, 4, cob_id) == 0
    seen: list[bytes] = []
    rig.link._network.subscribe(cob_id, lambda _id, data, _t: seen.append(bytes(data)))
    rig.nmt(START)
    assert rig.link.wait(lambda: bytes(4) in seen, 1.0)


@pytest.mark.motion
def test_jog_in_mode_7_with_one_axis_only_is_told(rig: Rig) -> None:
    master = Master(rig)
    master.enable()
    rig.link.send(0x200 + master.node_id, b"\x1f\0\x0f\0")
    assert rig.link.wait(lambda: master.codes() == [ONE_AXIS], 2.0)
    rig.link.send(0x200 + master.node_id, b"\x0f\0\x0f\0")
    assert rig.link.wait(lambda: master.codes() == [ONE_AXIS, 0], 1.0)
