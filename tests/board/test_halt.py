# SPDX-License-Identifier: Apache-2.0
"""A debugger halts the core: timers, DAC and pins of the chip go on by themselves."""

import pytest
from board import Board
from conftest import general

FREEZE_WATCHDOGS = 1 << 12 | 1 << 11  # what OpenOCD's stm32f4x.cfg sets in DBGMCU_APB1_FZ when it connects


def _halt(board: Board, ms: float) -> None:
    board.halted = True
    board.run(ms)


@pytest.mark.parametrize("debugger_sets", [0, FREEZE_WATCHDOGS], ids=["plain", "openocd"])
def test_a_halt_with_power_ends_by_the_watchdog(board: Board, debugger_sets: int) -> None:
    board.start()
    board.enable()
    board.dbgmcu.words[8] |= debugger_sets
    board.run(1)
    _halt(board, 3.3)
    assert [cause for _, cause in board.resets[1:]] == ["WWDG"]
    assert not board.powered()
    assert board.dac.codes() == (None, None)


@general
def test_a_halt_without_power_lasts(board: Board) -> None:
    board.start()
    _halt(board, 1000)
    assert len(board.resets) == 1
    board.halted = False
    board.run(5)
    assert board.read(0x1001) == 0


@general
def test_a_halt_stops_pwm_at_once(board: Board) -> None:
    board.start()
    board.write(0x2104, 1, 1, 1)  # output of x: PWM
    board.enable()
    board.tim2.move(20)  # 1.5 um
    board.run(5)
    assert board.tim8.duty(1) > 0
    _halt(board, 0.001)
    assert board.tim8.duty(1) == 0
