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


PWM, FREQUENCY, MODE, LEAST, MOST = 0x2163, 1, 2, 3, 4


def _with_pwm(board: Board, **parameters: int) -> None:
    """Both axes are enabled, with PWM of these parameters."""
    board.start()
    for axis in AXES:
        board.write(0x2104 + axis, 1, 1, 1)
    for name, (sub, size) in {"hz": (FREQUENCY, 4), "mode": (MODE, 1), "least": (LEAST, 2), "most": (MOST, 2)}.items():
        if name in parameters:
            board.write(PWM, sub, parameters[name], size)
    board.run(2)
    board.enable()


def _duties(board: Board, ms: float = 5) -> list[tuple[float, float]]:
    """What the pins have in each half millisecond from now on."""
    found = []
    for _ in range(int(2 * ms)):
        board.run(0.5)
        found.append((board.tim8.duty(1), board.tim8.duty(2)))
    return found


@general
@pytest.mark.parametrize("hz", [3000, 20000, 100000])
def test_the_frequency_of_pwm_is_a_parameter(board: Board, hz: int) -> None:
    _with_pwm(board, hz=hz)
    assert abs(168e6 / (board.tim8.words[0x2C] + 1) - hz) < hz / 1000
    _push(board)


@general
def test_in_locked_antiphase_no_force_is_half_the_time_and_there_is_no_direction(board: Board) -> None:
    _with_pwm(board, mode=1)
    assert all(abs(d - 0.5) < 0.01 for duties in _duties(board) for d in duties)
    board.gpio("B").edges.clear()
    for _ in range(5):
        board.tim2.move(100)  # the force is against it
        board.tim5.move(-100)
        ((x, y), _) = _duties(board, 1)
        assert x < 0.49 < 0.51 < y
    assert not [e for e in board.gpio("B").edges if e[1] in (14, 15)]
    board.command(0)
    assert (board.tim8.duty(1), board.tim8.duty(2)) == (0.5, 0.5)


@general
@pytest.mark.parametrize("mode", [0, 1])
def test_the_duty_stays_between_the_least_and_the_greatest(board: Board, mode: int) -> None:
    _with_pwm(board, mode=mode, least=100, most=900)
    least = 0.1 if mode == 0 else 0.5
    assert all(abs(d - least) < 0.02 for duties in _duties(board) for d in duties)
    board.tim2.move(2000)  # 150 um: more than the amplifier can do
    board.tim5.move(-2000)
    reached = [d for duties in _duties(board, 10) for d in duties]
    assert all(0.0999 <= d <= 0.9001 for d in reached)
    assert max(reached) > 0.89


@general
def test_a_halt_in_locked_antiphase_does_not_hold_the_pins_at_full_force(board: Board) -> None:
    _with_pwm(board, mode=1)
    board.halted = True
    board.run(0.001)
    assert abs(board.tim8.duty(1) - 0.5) < 0.02


@general
@pytest.mark.parametrize("mode", [0, 1], ids=["sign-magnitude", "antiphase"])
def test_an_axis_that_is_switched_off_has_no_force_by_its_next_edge_and_the_other_one_goes_on(
    board: Board, mode: int
) -> None:
    _with_pwm(board, mode=mode)
    board.tim2.move(20)
    board.tim5.move(20)
    board.run(5)
    none = 0.5 if mode else 0.0
    assert none not in (board.tim8.duty(1), board.tim8.duty(2))
    board.send(0x201, b"\x00\x00\x0f\x00")  # disable voltage of x alone
    assert board.run_until(lambda: not board.enabled(0), 5, 1e-3)
    board.run(2e-3)
    assert board.tim8.duty(1) == none
    assert board.gpio("B").level(14) is False  # direction
    assert board.enabled(1)
    board.tim5.move(20)
    board.run(2)
    assert board.tim8.duty(1) == none != board.tim8.duty(2)


@general
def test_a_break_while_the_amplifiers_start_is_a_fault_though_they_become_ready(board: Board) -> None:
    board.start()
    ready = (board.gpio("C").outside, 5), (board.gpio("B").outside, 1)
    for (inputs, pin), axis in zip(ready, AXES, strict=True):
        for sub, value, size in ((1, 1, 1), (6, 30, 2), (7, 1, 1)):
            board.write(0x2104 + axis, sub, value, size)
        inputs[pin] = True
    board.run(3)
    board.send(0, b"\x01\x01")
    for word in (6, 7, 15):
        board.command(word)
    assert board.powered()
    board.gpio("A").outside[BREAK] = True
    board.run(1)
    board.gpio("A").outside[BREAK] = False
    for inputs, pin in ready:
        inputs[pin] = False
    board.run(35)
    assert board.read(0x603F) == 0x5400
    assert not board.powered()
    assert not [e for e in board.gpio("D").edges if e[1] == 2 and e[2]]  # the brake stays engaged
    for inputs, pin in ready:
        inputs[pin] = True
    board.command(0)
    board.command(0x80)
    board.enable()
    for inputs, pin in ready:
        inputs[pin] = False
    board.run(10)
    _push(board)
