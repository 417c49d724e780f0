# SPDX-License-Identifier: Apache-2.0
"""PWM of the general board (TIM8): its break input switches it off without the core."""

import pytest
from board import Board
from conftest import general

BREAK = 6  # at port A; an open contact is a break
AXES = (0, 0x800)
each_rate = pytest.mark.parametrize("board", ["kontur", "kontur-20khz"], indirect=True)  # the Feather has no PWM


def _command_force(board: Board) -> None:
    """Both axes are enabled, with PWM and a force."""
    board.start()
    for axis in AXES:
        board.write(0x2104 + axis, 1, 1, 1)
    board.enable()
    _push(board)


def _push(board: Board) -> None:
    board.tim2.move(20)  # 1.5 um
    board.tim5.move(20)
    board.run(5)
    assert board.tim8.duty(1) > 0
    assert board.tim8.duty(2) > 0


@each_rate
def test_the_break_input_switches_pwm_off_without_the_core(board: Board) -> None:
    _command_force(board)
    board.gpio("A").outside[BREAK] = True  # and no time passes
    assert (board.tim8.duty(1), board.tim8.duty(2)) == (0, 0)


@each_rate
def test_a_break_is_a_fault_of_the_amplifiers_and_cuts_the_power_in_the_next_tick(board: Board) -> None:
    _command_force(board)
    board.gpio("A").outside[BREAK] = True
    board.run(2 * 1e3 / board.wiring.control_hz)
    assert not board.powered()
    board.run(3)
    assert board.read(0x603F) == 0x5400
    board.command(0)
    board.command(0x80)
    assert board.read(0x603F) == 0x5400  # as long as the input is active
    board.gpio("A").outside[BREAK] = False
    board.run(1)
    board.command(0)
    board.command(0x80)
    assert board.read(0x603F) == 0
    board.enable()
    _push(board)


@general
def test_an_axis_with_an_analog_command_needs_no_break_input(board: Board) -> None:
    board.start()
    board.gpio("A").outside[BREAK] = True
    board.run(1)
    board.enable()
    board.run(5)
    assert board.powered()
    assert board.read(0x603F) == 0
