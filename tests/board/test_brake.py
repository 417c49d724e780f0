# SPDX-License-Identifier: Apache-2.0
"""The brake of an axis: released after the amplifier is live, engaged before it is switched off (2160h)."""

import pytest
from board import Board

LIVE_MS, RELEASE_MS, ENGAGE_MS = 20, 30, 40
with_brakes = pytest.mark.parametrize("board", ["kontur", "kontur-20khz"], indirect=True)  # the Feather has no pin left


def enable(board: Board) -> None:
    board.start()
    for axis in (0, 0x800):
        board.write(0x2104 + axis, 6, LIVE_MS, 2)
        board.write(0x2160 + axis, 1, RELEASE_MS, 2)
        board.write(0x2160 + axis, 2, ENGAGE_MS, 2)
    board.run(3)
    board.send(0, b"\x01\x01")
    for word in (6, 7, 15):
        board.command(word)


def _enabled(board: Board) -> None:
    enable(board)
    board.run(LIVE_MS + RELEASE_MS + 5)
    assert board.statusword() & 0x6F == 0x27
    assert board.released() == (True, True)


def _edge_ms(board: Board, pin: tuple[str, int], rising: bool = False) -> float:
    return [e[0] for e in board.gpio(pin[0]).edges if e[1] == pin[1] and e[2] == rising][-1] / 1e6


@with_brakes
def test_a_brake_is_released_when_the_amplifier_is_live_and_the_axis_may_move_later(board: Board) -> None:
    enable(board)
    assert board.powered()
    assert board.released() == (False, False)
    assert board.run_until(lambda: board.released() == (True, True), LIVE_MS)
    released_ms = board.now_ns / 1e6
    enabled_ms = _edge_ms(board, board.wiring.enable[0], True)
    assert abs(released_ms - enabled_ms - LIVE_MS) < 2
    assert board.statusword() & 0x6F == 0x23  # switched on
    board.dac.history.clear()
    getattr(board, board.wiring.encoders[0]).move(50)
    board.run(2)
    assert {x for _, x, _ in board.dac.history} != {2048}  # the law holds the axis already
    assert board.run_until(lambda: board.statusword() & 0x6F == 0x27, 2 * RELEASE_MS)
    assert abs(board.now_ns / 1e6 - released_ms - RELEASE_MS) < 3


@with_brakes
@pytest.mark.parametrize("word", [7, 6, 2], ids=["disable operation", "shutdown", "quick stop"])
def test_the_law_holds_the_axis_until_its_brake_is_engaged(board: Board, word: int) -> None:
    _enabled(board)
    getattr(board, board.wiring.encoders[0]).move(50)
    board.run(2)
    board.command(word, ENGAGE_MS / 2)
    assert board.released() == (False, False)
    assert board.powered()
    assert board.dac.codes()[0] != 2048
    board.run(ENGAGE_MS)
    assert not board.powered()
    (brake, _), (enable, _) = board.wiring.brake or (), board.wiring.enable
    assert 0 <= _edge_ms(board, enable) - _edge_ms(board, brake) - ENGAGE_MS < 2


@with_brakes
def test_a_fault_that_cuts_the_power_engages_the_brakes_in_the_same_tick(board: Board) -> None:
    _enabled(board)
    board.gpio("C").outside[5] = True  # amplifier x
    board.run(1)
    assert board.read(0x603F) == 0x5400
    for brake, enable in zip(board.wiring.brake or (), board.wiring.enable, strict=True):
        assert abs(_edge_ms(board, enable) - _edge_ms(board, brake)) < 0.005


@with_brakes
def test_a_fault_that_stops_the_axes_first_engages_the_brakes_before_the_power_ends(board: Board) -> None:
    board.start()
    board.write(0x1016, 1, 127 << 16 | 50, 4)
    board.send(0x77F, b"\x05")
    _enabled_again(board)
    board.run(60)  # no heartbeat any more
    assert board.statusword() & 0x4F == 0x0F  # fault reaction active
    assert board.released() == (False, False)
    assert board.powered()
    board.run(ENGAGE_MS)
    assert board.statusword() & 0x4F == 0x08
    assert not board.powered()


def _enabled_again(board: Board) -> None:
    for axis in (0, 0x800):
        board.write(0x2160 + axis, 2, ENGAGE_MS, 2)
        board.send(0x77F, b"\x05")
    board.run(3)
    board.enable()
    board.send(0x77F, b"\x05")
    assert board.released() == (True, True)


@with_brakes
def test_what_makes_the_outputs_safe_engages_the_brakes(board: Board) -> None:
    _enabled(board)
    board.rcc.fail_crystal()
    board.run(0.05)
    assert board.released() == (False, False)
    assert not board.powered()


@with_brakes
def test_60feh_shows_the_brake(board: Board) -> None:
    _enabled(board)
    assert (board.read(0x60FE, 1), board.read(0x68FE, 1)) == (0, 0)
    board.command(0)
    assert (board.read(0x60FE, 1), board.read(0x68FE, 1)) == (1, 1)
    assert board.released() == (False, False)
