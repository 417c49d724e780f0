# SPDX-License-Identifier: Apache-2.0
"""The supply of the chip falls below the threshold of its voltage detector."""

import pytest
from board import Board
from conftest import general

BROWN_OUT = 0x5110


def _acknowledge(board: Board) -> None:
    """Fault reset, as a rising edge, and at once all that enables the axes."""
    for word in (0, 0x80, 6, 7, 15):
        board.send(0x201, word.to_bytes(2, "little") * 2)
        board.run(0.2)
    board.run(3)


@general
def test_a_supply_that_stays_low_cannot_be_acknowledged_away(board: Board) -> None:
    board.start()
    board.enable()
    board.pwr.set_supply(2.8)
    fell_ns = board.now_ns
    assert board.run_until(lambda: len(board.resets) == 2, 1, 0.001)
    assert board.now_ns - fell_ns < 20e3
    assert not board.powered()
    assert board.run_until(lambda: any(f[1] == 0x701 for f in board.can.sent), 300, 1)
    board.run(3)
    assert board.read(0x2031) == 6  # brown-out
    board.send(0, b"\x01\x01")
    for _ in range(2):
        assert board.read(0x603F) == BROWN_OUT
        _acknowledge(board)
        assert not board.powered()
        assert board.statusword() & 0x4F == 0x08  # fault
    assert not [e for e in board.gpio("B").edges if e[1] == 12 and e[2] and e[0] > fell_ns]
    board.pwr.set_supply(3.3)
    board.run(1)
    board.command(0)
    board.command(0x80)
    assert board.read(0x603F) == 0
    board.enable()


@pytest.mark.parametrize("volts", [3.0, 2.93])
@general
def test_a_supply_above_the_threshold_is_no_fault(board: Board, volts: float) -> None:
    board.start()
    board.enable()
    board.pwr.set_supply(volts)
    board.run(3)
    assert board.powered()
    assert len(board.resets) == 1
