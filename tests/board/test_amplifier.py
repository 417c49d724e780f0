# SPDX-License-Identifier: Apache-2.0
"""Amplifiers that are live some time after they are enabled, and that say "ready" only then (2104h:6, 7)."""

from board import Board
from conftest import general

DELAY_MS = 30
FAULT_INPUT = 5  # of x, at port C of the general board; an open contact is a fault


def _command_enable(board: Board) -> None:
    board.send(0, b"\x01\x01")
    for word in (6, 7, 15):
        board.command(word)


def test_until_the_amplifiers_are_live_the_commands_are_zero(board: Board) -> None:
    board.start()
    for index in (0x2104, 0x2904):
        board.write(index, 6, DELAY_MS, 2)
    board.run(3)
    _command_enable(board)
    getattr(board, board.wiring.encoders[0]).move(50)
    board.dac.history.clear()
    board.run(DELAY_MS - 6)
    assert board.powered()
    assert {code for _, *codes in board.dac.history for code in codes} == {2048}
    assert board.statusword() & 0x6F == 0x23  # switched on
    board.run(6)
    assert board.statusword() & 0x6F == 0x27
    board.dac.history.clear()
    getattr(board, board.wiring.encoders[0]).move(50)
    board.run(3)
    assert {x for _, x, _ in board.dac.history} != {2048}


def _start_not_ready(board: Board) -> dict[int, bool]:
    """A board whose first amplifier has a "ready" output that says no. Returns the inputs, to change that."""
    board.start()
    board.write(0x2104, 6, DELAY_MS, 2)
    board.write(0x2104, 7, 1, 1)
    inputs: dict[int, bool] = board.gpio("C").outside
    inputs[FAULT_INPUT] = True
    board.run(5)
    return inputs


@general
def test_an_amplifier_that_says_fault_while_inhibited_can_be_enabled(board: Board) -> None:
    inputs = _start_not_ready(board)
    assert board.read(0x603F) == 0
    _command_enable(board)
    assert board.enabled(0)
    board.run(10)
    inputs[FAULT_INPUT] = False
    board.run(3)
    assert board.statusword() & 0x6F == 0x27
    inputs[FAULT_INPUT] = True
    board.run(1)
    assert not board.powered()
    assert board.read(0x603F) == 0x5400


@general
def test_an_amplifier_that_does_not_become_ready_is_a_fault_after_its_time(board: Board) -> None:
    board.start()
    board.write(0x2104, 6, DELAY_MS, 2)
    board.write(0x2104, 7, 1, 1)
    board.gpio("C").outside[FAULT_INPUT] = True
    _command_enable(board)
    board.run(DELAY_MS + 2)
    assert not board.powered()
    assert board.read(0x603F) == 0x5400
    assert {x for _, x, _ in board.dac.history} == {2048}


@general
def test_a_ready_contact_that_has_not_opened_since_the_last_time_does_not_end_the_wait(board: Board) -> None:
    inputs = _start_not_ready(board)
    _command_enable(board)
    inputs[FAULT_INPUT] = False
    board.run(3)
    assert board.statusword() & 0x6F == 0x27
    board.command(0)
    assert not board.powered()
    _command_enable(board)  # sooner than the amplifier opens its contact
    board.tim2.move(50)
    board.dac.history.clear()
    board.run(DELAY_MS - 6)
    assert board.powered()
    assert {x for _, x, _ in board.dac.history} == {2048}
    assert board.statusword() & 0x6F == 0x23
    board.run(6)
    assert board.statusword() & 0x6F == 0x27
