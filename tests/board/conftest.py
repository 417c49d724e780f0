# SPDX-License-Identifier: Apache-2.0
"""The fixture `board`: each image on its board, and no broken rule at the end."""

from collections.abc import Iterator

import pytest
from board import IMAGES, WIRINGS, Board


@pytest.fixture(params=WIRINGS)
def board(request: pytest.FixtureRequest) -> Iterator[Board]:
    """A board without power yet."""
    image = IMAGES / f"{request.param}.elf"
    if not image.is_file():
        pytest.skip(f"{image} is not there: make firmware")
    board = Board(WIRINGS[request.param])
    yield board
    assert not board.broken, "rules broken:\n" + "\n".join(dict.fromkeys(board.broken))


general = pytest.mark.parametrize("board", ["kontur"], indirect=True)  # a test for one board only
