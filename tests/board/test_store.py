# SPDX-License-Identifier: Apache-2.0
"""Parameters in the flash of the chip."""

import pytest
from board import Board
from conftest import general


@general
@pytest.mark.parametrize("after_loader", [False, True], ids=["reset", "loader"])
def test_parameters_are_saved_and_loaded_by_the_rules_of_the_flash(board: Board, after_loader: bool) -> None:
    board.start(after_loader=after_loader)  # the loader leaves the flash unlocked
    board.write(0x1017, 0, 70, 2)
    board.send(0x601, bytes.fromhex("2310100173617665"))  # 1010h:1 "save"
    assert board.run_until(lambda: board.can.sent[-1][1:] == (0x581, bytes.fromhex("6010100100000000")), 2000, 5)
    assert board.flash.words[board.flash.CR] == board.flash.LOCK
    assert board.store != b"\xff" * len(board.store)
    assert [cause for _, cause in board.resets] == ["power"]  # the watchdog was fed meanwhile
    board.start()
    assert board.read(0x1017) == 70


@general
@pytest.mark.parametrize(("ms", "heartbeat_ms"), [(3, 100), (251, 100), (300, 70)], ids=["erase", "words", "after"])
def test_a_supply_that_falls_during_a_save_leaves_the_old_parameters_or_the_new_ones(
    board: Board, ms: float, heartbeat_ms: int
) -> None:
    board.start()
    board.write(0x1017, 0, 70, 2)
    board.send(0x601, bytes.fromhex("2310100173617665"))
    board.run(ms)
    board.pwr.set_supply(2.8)
    assert board.run_until(lambda: len(board.resets) == 2, 1000, 1)  # when the flash is no longer busy
    board.pwr.set_supply(3.3)
    assert board.run_until(lambda: any(f[1] == 0x701 for f in board.can.sent), 300)
    board.run(3)
    assert board.read(0x1017) == heartbeat_ms
    assert board.read(0x603F) == 0x5110
