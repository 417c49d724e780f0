# SPDX-License-Identifier: Apache-2.0
"""The analog command of the chip's own DAC."""

import pytest
from board import Board


def test_the_offset_of_an_analog_command_is_a_parameter_of_each_axis(board: Board) -> None:
    board.start()
    board.write(0x2104, 8, 1000, 2)  # 0.1 V of 10 V: 20.48 of 2048 codes
    board.write(0x2904, 8, -1000 & 0xFFFF, 2)
    board.run(2)
    assert board.dac.codes() == (2048 + 20, 2048 - 20)
    board.enable()
    board.run(1)
    board.dac.history.clear()
    board.run(10)
    mean = [sum(h[axis] for h in board.dac.history) / len(board.dac.history) - 2048 for axis in (1, 2)]
    assert abs(mean[0] - 20.48) < 0.1
    assert abs(mean[1] + 20.48) < 0.1


def test_outputs_that_become_safe_while_a_tick_writes_them_do_not_come_back_for_an_instant(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    board.start()
    board.enable()
    board.run(2)
    write, failed_ns = board.dac.write, []

    def fail(offset: int, value: int) -> None:
        write(offset, value)
        if not failed_ns:
            failed_ns.append(board.now_ns)
            board.rcc.fail_crystal()

    monkeypatch.setattr(board.dac, "write", fail)
    board.run(2)
    assert not board.powered()
    assert not board.rises(failed_ns[0])
