# SPDX-License-Identifier: Apache-2.0
"""The core hangs, or is halted, at the worst places: in an interrupt, and in each state of an axis with power."""

from collections.abc import Callable

import pytest
from board import Board
from chip import NMI, SYSTICK
from conftest import general
from test_brake import ENGAGE_MS, LIVE_MS, RELEASE_MS, enable
from test_watchdogs import MOST_MS, expect_reset, hang

USART1, PVD, CAN_RX = 16 + 37, 16 + 1, 16 + 20
# RM0090 22.4: 32 counts of 4096 clocks of APB1. Without its crystal the chip runs at 16 MHz, and APB1 at 4.
MOST_WITHOUT_CRYSTAL_MS = 33.0


def _hang_in(board: Board, monkeypatch: pytest.MonkeyPatch, exception: int, cause: Callable[[], None]) -> None:
    """Both axes have power, `cause` calls the exception, and its first instruction never comes."""
    board.start()
    board.enable()
    stack = board._stack
    entered = []

    def enter(number: int) -> None:
        stack(number)
        if number == exception and not entered:
            entered.append(number)
            hang(board)

    monkeypatch.setattr(board, "_stack", enter)
    cause()
    assert board.run_until(lambda: bool(entered), 1, 0.01)


@general
@pytest.mark.parametrize("exception", [USART1, PVD, SYSTICK], ids=["serial", "supply", "servo tick"])
def test_an_interrupt_at_or_above_the_servo_tick_that_hangs_loses_its_power_in_three_milliseconds(
    board: Board, monkeypatch: pytest.MonkeyPatch, exception: int
) -> None:
    def cause() -> None:
        if exception == USART1:
            board.usart1.receive(b"x")
        if exception == PVD:
            board.pwr.set_supply(2.8)

    _hang_in(board, monkeypatch, exception, cause)
    board.run(MOST_MS)
    expect_reset(board, "WWDG")


@general
def test_an_nmi_that_hangs_without_a_crystal_loses_its_power_as_the_slow_clock_allows(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    _hang_in(board, monkeypatch, NMI, board.rcc.fail_crystal)
    board.run(MOST_WITHOUT_CRYSTAL_MS)
    expect_reset(board, "WWDG")


@general
def test_an_interrupt_below_the_servo_tick_that_hangs_is_a_background_that_hangs(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    _hang_in(board, monkeypatch, CAN_RX, lambda: board.send(0x601, bytes(8)))
    board.run(50.1)
    expect_reset(board, "IWDG")


@general
def test_a_lockup_loses_its_power_in_three_milliseconds(board: Board) -> None:
    board.start()
    board.enable()
    board.stuck = True
    board.run(MOST_MS)
    expect_reset(board, "WWDG")


def _be(board: Board, state: str) -> None:
    """Both axes have power, and are in this state."""
    enable(board)
    if state != "starting":
        board.run(LIVE_MS + 5)
    if state in ("engaging", "quick stop"):
        board.run(RELEASE_MS)
        board.command(7 if state == "engaging" else 2, 5)
    released = state == "releasing"
    assert board.released() == (released, released)
    assert board.powered()


@general
@pytest.mark.parametrize("state", ["starting", "releasing", "engaging", "quick stop"])
def test_a_halt_in_each_state_with_power_ends_and_nothing_comes_on_afterwards(board: Board, state: str) -> None:
    assert ENGAGE_MS > 5
    _be(board, state)
    since_ns = board.now_ns
    board.halted = True
    board.run(MOST_MS)
    assert [cause for _, cause in board.resets[1:]] == ["WWDG"]
    board.halted = False
    board.run(50)
    assert not board.powered()
    assert not board.rises(since_ns)
    assert board.read(0x603F) == 0x6010
