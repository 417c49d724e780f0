# SPDX-License-Identifier: Apache-2.0
"""What objects answer to a master that knows only CiA 301, CiA 306's EDS and docs/objects.md."""

from __future__ import annotations

import pytest
from rig import RESET_NODE, Rig
from test_any_master import NOT_IN_THIS_STATE, Master

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
        (0x2200, 1, 1, 4, TOO_HIGH),
        (0x2300, 5, 1, 255, BAD_VALUE),
        (0x605A, 0, 2, -1, TOO_LOW),
        (0x605A, 0, 2, 3, BAD_VALUE),
        (0x605A, 0, 2, 7, TOO_HIGH),
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
