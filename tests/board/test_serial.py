# SPDX-License-Identifier: Apache-2.0
"""slcan on the serial port of the board."""

import pytest
from board import Board
from wires import FRAMING, NOISE


def test_the_serial_port_answers_and_becomes_the_bus(board: Board) -> None:
    board.start()
    usart = getattr(board, board.wiring.usart)
    usart.receive(b"O\r")
    board.run(3)
    usart.receive(b"t60184001100000000000\r")
    assert board.run_until(lambda: b"t5818" in usart.sent, 10)


@pytest.mark.parametrize("error", [FRAMING, NOISE], ids=["framing", "noise"])
def test_a_byte_that_is_damaged_on_the_line_makes_no_frame(board: Board, error: int) -> None:
    board.start()
    usart = getattr(board, board.wiring.usart)
    usart.receive(b"O\r")
    board.run(3)
    usart.receive(b"t601840011000000000", 0)
    board.run(1)
    usart.receive(b"0", error)
    board.run(1)
    usart.receive(b"0\r")
    board.run(5)
    assert b"t581" not in usart.sent
