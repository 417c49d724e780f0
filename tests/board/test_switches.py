# SPDX-License-Identifier: Apache-2.0
"""The outputs beside the axes: pins and PWM of the general board, by the knots of a stream."""

import pytest
from board import Board
from conftest import general

from kontur.can import wire
from kontur.can.outputs import Outputs, chained

KNOTS = 40
ON, FLOOD, PEN = 1, 8, 256
PINS = {0: ("B", 11), 1: ("B", 13), 2: ("C", 14), 3: ("C", 9), 4: ("A", 7), 5: ("C", 15), 8: ("B", 2)}
HALF = 32768


def switched(board: Board) -> int:
    return sum(1 << bit for bit, (port, pin) in PINS.items() if board.gpio(port).level(pin) is True)


def run_stream(board: Board) -> None:
    """A path that stands still, with outputs from knot 3 on, until it is at knot 10 or so."""
    import numpy as np

    here = np.array([[board.read(index) for index in (0x6064, 0x6864)]]).astype(np.uint32).astype(np.int32)
    knots = np.repeat(here, KNOTS, axis=0)
    outputs = Outputs(np.array([3]), np.array([ON | FLOOD | PEN], dtype=np.uint16), np.array([HALF], dtype=np.uint16))
    start = int(here[0, 0]), int(here[0, 1])
    board.write(0x1404, 1, 0x501, 4)
    frames = bytearray(wire.pack_knots(knots, start))
    chained(frames, outputs)
    before = dict(zip(outputs.knot.tolist(), outputs.frames(), strict=True))
    for sub, value, size in ((4, KNOTS, 4), (2, start[0] & 0xFFFFFFFF, 4), (3, start[1] & 0xFFFFFFFF, 4), (1, 1, 1)):
        board.write(0x2200, sub, value, size)
    for n in range(KNOTS):
        if n in before:
            board.send(0x501, before[n].tobytes())
            board.run(0.2)
        board.send(0x301, bytes(frames[8 * n : 8 * n + 8]))
        board.run(0.2)
    assert board.read(0x2200, 7) == KNOTS
    assert switched(board) == 0
    board.command(0x1F, ms=0)
    assert board.run_until(lambda: switched(board) != 0, 20)


@general
def test_knots_switch_pins_and_power_and_a_halt_switches_them_off_in_a_tick(board: Board) -> None:
    board.start()
    assert switched(board) == 0
    assert board.tim1.duty(1) == 0.0
    board.enable()
    run_stream(board)
    assert switched(board) == ON | FLOOD | PEN
    assert board.tim1.duty(1) == pytest.approx(0.5, abs=1e-4)
    board.command(0x11F, ms=0.5)  # a pass of the background until it is read, and a tick
    assert switched(board) == 0
    assert board.tim1.duty(1) == 0.0
    board.command(0x1F, ms=0.5)
    assert switched(board) == ON | FLOOD | PEN


@general
def test_fault_of_an_amplifier_switches_them_off(board: Board) -> None:
    board.start()
    board.enable()
    run_stream(board)
    board.gpio("C").outside[5] = True
    board.run(0.5)  # three ticks until an input counts
    assert switched(board) == 0
    assert board.tim1.duty(1) == 0.0


@general
@pytest.mark.parametrize("switch", range(4))
def test_a_limit_switch_switches_them_off_in_a_tick(board: Board, switch: int) -> None:
    board.start()
    board.enable()
    run_stream(board)
    board.gpio("C").outside[switch] = True
    board.run(0.5)  # three ticks until an input counts
    assert switched(board) == 0
    assert board.tim1.duty(1) == 0.0
    board.run(3)
    assert board.read(0x603F) == 0xFF12
