# SPDX-License-Identifier: Apache-2.0
"""The cycles of a servo tick, which the image counts by DWT CYCCNT (2162h)."""

import pytest
from board import Board
from chip import SYSTICK

LAST, WORST = 1, 2
ENTRY_AND_EXIT = 40  # cycles of an exception, which the tick itself cannot see, and of its first and last lines


@pytest.fixture
def ticks(board: Board, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Cycles from the entry of each servo tick to its exit, as the emulator sees them."""
    begun: list[float] = []
    cycles: list[float] = []
    stack, unstack = board._stack, board._unstack

    def entered(number: int) -> None:
        if number == SYSTICK:
            begun.append(board.now_ns)
        stack(number)

    def left() -> None:
        if board.active[-1] == SYSTICK:
            cycles.append((board.now_ns - begun.pop()) / board.cycle_ns)
        unstack()

    monkeypatch.setattr(board, "_stack", entered)
    monkeypatch.setattr(board, "_unstack", left)
    return cycles


def test_the_cycles_of_a_tick_are_objects_last_and_worst(board: Board, ticks: list[float]) -> None:
    board.start()
    board.enable()
    board.run(20)
    last, worst = board.read(0x2162, LAST), board.read(0x2162, WORST)
    assert abs(worst - max(ticks)) < ENTRY_AND_EXIT
    assert min(ticks) - ENTRY_AND_EXIT < last <= worst < 168e6 / board.wiring.control_hz


def test_the_worst_is_that_since_the_reset(board: Board, ticks: list[float]) -> None:
    board.start()
    board.enable()
    board.run(20)
    board.request_reset("software")
    ticks.clear()
    board.run(30)
    assert abs(board.read(0x2162, WORST) - max(ticks)) < ENTRY_AND_EXIT
