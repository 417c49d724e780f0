# SPDX-License-Identifier: Apache-2.0
"""What happens when the core stops doing its work without a fault of its own."""

import itertools
import struct

from board import Board
from conftest import general
from unicorn import arm_const as arm

NOWHERE = 0x2001F000  # RAM that the image does not use
NOPS = 1000
MOST_MS = 3.3


def expect_reset(board: Board, watchdog: str) -> None:
    """That watchdog alone has reset the chip, and no axis has power."""
    assert [cause for _, cause in board.resets[1:]] == [watchdog]
    assert not board.powered()


def hang(board: Board) -> None:
    """The core runs in a loop for ever, a long one of NOP, because the emulator is slow at each branch."""
    board.uc.mem_write(NOWHERE, struct.pack(f"<{NOPS + 1}H", *[0xBF00] * NOPS, 0xE000 | (-NOPS - 2 & 0x7FF)))
    board.uc.reg_write(arm.UC_ARM_REG_PC, NOWHERE)
    board.asleep = False


def _hang(board: Board, *, masked: bool) -> None:
    """The same outside of interrupts, where it would keep all others out."""
    assert board.run_until(lambda: not board.active, 1, 0.001)
    hang(board)
    board.uc.reg_write(arm.UC_ARM_REG_PRIMASK, int(masked))


def _gaps_ms(feeds: list[float]) -> list[float]:
    return [(b - a) / 1e6 for a, b in itertools.pairwise(feeds)]


def test_a_core_that_hangs_loses_its_power_within_three_milliseconds(board: Board) -> None:
    board.start()
    board.enable()
    _hang(board, masked=True)
    board.run(MOST_MS)
    expect_reset(board, "WWDG")
    assert board.run_until(lambda: any(f[1] == 0x701 for f in board.can.sent), 300)
    board.run(3)
    assert board.read(0x603F) == 0x6010
    assert board.read(0x2031) == 4  # watchdog


@general
def test_a_servo_tick_that_stands_still_loses_its_power_as_fast(board: Board) -> None:
    board.start()
    board.enable()
    board.core.write(0x010, 0)  # SysTick off
    board.run(MOST_MS)
    expect_reset(board, "WWDG")


@general
def test_a_background_that_hangs_loses_its_power_within_the_period_of_the_other_watchdog(board: Board) -> None:
    board.start()
    board.enable()
    _hang(board, masked=False)
    board.run(94.1)  # LSI at its slowest: 17 kHz (DS8626)
    expect_reset(board, "IWDG")


def test_both_watchdogs_are_fed_with_a_margin_of_ten(board: Board) -> None:
    board.start()
    board.enable()
    for dog in (board.iwdg, board.wwdg):
        dog.feeds.clear()
    board.run(20)
    assert max(_gaps_ms(board.wwdg.feeds)) < 3.1 / 10
    assert max(_gaps_ms(board.iwdg.feeds)) < 34 / 10


def test_the_alive_pin_is_a_square_wave_of_the_servo_tick(board: Board) -> None:
    board.start()
    port, pin = board.wiring.alive
    board.gpio(port).edges.clear()
    board.run(10)
    edges = [e for e in board.gpio(port).edges if e[1] == pin]
    assert abs(len(edges) - 10 * board.wiring.control_hz / 1e3) <= 1
    assert all(a[2] != b[2] for a, b in itertools.pairwise(edges))
    _hang(board, masked=True)
    board.gpio(port).edges.clear()
    board.run(2)
    assert not [e for e in board.gpio(port).edges if e[1] == pin]
