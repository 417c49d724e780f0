# SPDX-License-Identifier: Apache-2.0
"""The serial 16-bit DAC (DAC8563) as output of the axes (2104h:1 = 2)."""

import pytest
from analog import MID_SCALE
from board import Board
from conftest import general
from test_watchdogs import hang
from unicorn import arm_const as arm

ZERO = (MID_SCALE, MID_SCALE)


def _enable(board: Board) -> None:
    board.start()
    for axis in (0, 0x800):
        board.write(0x2104 + axis, 1, 2, 1)
    board.run(2)
    board.enable()
    board.serial_dac.history.clear()


def _push(board: Board) -> None:
    for encoder, counts in zip(board.wiring.encoders, (20, -20), strict=True):
        getattr(board, encoder).move(counts)


def test_from_power_on_it_puts_out_no_force_and_then_has_its_range(board: Board) -> None:
    board.start()
    dac = board.serial_dac
    assert dac.reference
    assert dac.ldac_inactive
    assert dac.volts() == (2.5, 2.5)
    assert {(x, y) for _, x, y in dac.history} == {ZERO}


def test_both_channels_change_at_one_time_once_a_tick(board: Board) -> None:
    _enable(board)
    _push(board)
    board.run(5)
    history = board.serial_dac.history
    assert abs(len(history) - 5e-3 * board.wiring.control_hz) <= 2
    _, x, y = history[-1]
    assert x < MID_SCALE < y
    assert board.dac.codes() == (2048, 2048)


def test_its_steps_are_of_16_bits(board: Board) -> None:
    _enable(board)
    getattr(board, board.wiring.encoders[0]).move(1)
    board.run(10)
    codes = {x - MID_SCALE for _, x, _ in board.serial_dac.history}
    assert any(code % 16 for code in codes)
    assert len(codes) > 3


@pytest.mark.parametrize("word", [0, 6])
def test_without_power_it_puts_out_no_force_but_its_offset(board: Board, word: int) -> None:
    _enable(board)
    _push(board)
    board.run(5)
    board.command(word)
    assert not board.powered()
    assert tuple(board.serial_dac.codes) == ZERO
    board.write(0x2104, 8, 100, 2)  # 10 mV of 10 V: 32.8 of 32768 codes
    board.run(2)
    assert tuple(board.serial_dac.codes) == (MID_SCALE + 33, MID_SCALE)


@general
def test_safe_outputs_set_it_to_no_force_at_once(board: Board) -> None:
    _enable(board)
    _push(board)
    board.run(5)
    assert tuple(board.serial_dac.codes) != ZERO
    board.rcc.fail_crystal()
    board.run(0.05)
    assert tuple(board.serial_dac.codes) == ZERO
    board.broken.clear()  # a frame may have been broken off, which has no effect


@general
@pytest.mark.parametrize("shift_us", [0.1, 0.5, 1.3, 2.2])
def test_safe_outputs_break_off_what_the_servo_tick_is_sending(board: Board, shift_us: float) -> None:
    """In the first frame, between the frames, in the second one; what the tick still sends afterwards has no effect."""
    _enable(board)
    _push(board)
    board.run(5)
    assert board.run_until(lambda: board.spi3.shifting, 0.2, 1e-4)
    board.run(shift_us * 1e-3)
    assert tuple(board.serial_dac.codes) != ZERO
    board.rcc.fail_crystal()
    since_ns = board.now_ns
    board.run(0.05)
    for _ in range(50):
        assert tuple(board.serial_dac.codes) == ZERO
        assert not board.powered()
        board.run(0.02)
    assert not board.rises(since_ns)
    board.broken.clear()  # a frame was broken off


def test_a_reset_of_the_chip_sets_it_to_no_force(board: Board) -> None:
    _enable(board)
    _push(board)
    board.run(5)
    hang(board)
    board.uc.reg_write(arm.UC_ARM_REG_PRIMASK, 1)
    board.run(3.3)
    assert [cause for _, cause in board.resets[1:]] == ["WWDG"]
    assert not board.powered()
    board.run(5)
    assert tuple(board.serial_dac.codes) == ZERO
    board.broken.clear()  # the reset may have broken a frame off
