# SPDX-License-Identifier: Apache-2.0
"""A random walk of each board, which walk.py can do for hours: `python tests/board/walk.py --seeds 1..1000`."""

import pytest
from board import Board
from walk import Walk


@pytest.mark.parametrize("ready", [False, True], ids=["live", "ready"])
def test_no_walk_of_controlwords_contacts_supply_halts_and_noise_finds_force_without_power(
    board: Board, ready: bool
) -> None:
    walk = Walk(board, seed=7, ready=ready)
    walk.run(ms=100)
    assert walk.with_power > 50
    assert ready or walk.with_force > 10  # some amplifiers never become ready
