# SPDX-License-Identifier: Apache-2.0
"""The image starts on a chip: clock, bus, and ST's loader before it."""

import pytest
from board import Board
from conftest import general


def test_it_starts_by_the_rules_and_answers_an_sdo_over_can(board: Board) -> None:
    board.start()
    assert board.rcc.system_hz() == 168e6
    assert (board.rcc.bus_hz("APB1"), board.rcc.bus_hz("APB2")) == (42e6, 84e6)
    assert abs(board.can.bit_ns() - 1000) < 0.1
    assert abs(board.can.sample_point() - 0.857) < 0.001
    assert board.read(0x1001) == 0
    assert board.read(0x2031) == 1  # power
    assert not board.powered()
    assert board.dac.codes() == (2048, 2048)
    assert board.flash.read(0) >> 8 & 1  # prefetch
    board.enable()
    board.run(20)
    assert board.powered()
    assert board.read(0x1001) == 0
    assert [cause for _, cause in board.resets] == ["power"]


def test_each_request_is_answered_once(board: Board) -> None:
    board.start()
    before = len(board.can.sent)
    for _ in range(5):
        board.read(0x1001)
    board.run(5)
    answers = [f for f in board.can.sent[before:] if f[1] == 0x581]
    assert len(answers) == 5


def test_it_starts_when_the_loader_of_the_chip_has_started_it(board: Board) -> None:
    board.start(after_loader=True)
    assert board.rcc.system_hz() == 168e6
    assert board.read(0x1001) == 0


@general
def test_revision_a_of_the_chip_has_no_prefetch(board: Board) -> None:
    board.dbgmcu.revision = 0x1000
    board.start()
    assert not board.flash.read(0) >> 8 & 1


@general
def test_without_a_crystal_it_runs_on_its_own_oscillator_and_says_so(board: Board) -> None:
    board.rcc.crystal_hz = None
    board.start()
    assert board.rcc.system_hz() == 168e6
    assert board.read(0x603F) == 0x5200


@general
def test_a_crystal_that_stops_cuts_the_power_within_a_microsecond(board: Board) -> None:
    board.start()
    board.enable()
    board.rcc.fail_crystal()
    at_ns = board.now_ns
    board.run(1)
    ends_ns = [e[0] for e in board.gpio("B").edges if e[1] == 12 and not e[2]]
    assert ends_ns[-1] - at_ns < 10e3
    board.run(20)
    assert not board.powered()
    assert board.read(0x603F) == 0x5200
    assert board.rcc.system_hz() == 168e6


@general
@pytest.mark.parametrize(
    ("cause", "tells", "fault"),
    [("power", 1, 0), ("pin", 2, 0), ("software", 3, 0), ("IWDG", 4, 0x6010), ("WWDG", 4, 0x6010)],
)
def test_after_each_reset_it_is_off_and_says_why_it_has_started(
    board: Board, cause: str, tells: int, fault: int
) -> None:
    board.start()
    board.enable()
    since_ns = board.now_ns
    board.request_reset(cause)
    board.run(0.001)
    assert not board.powered()
    assert board.run_until(lambda: any(f[1] == 0x701 for f in board.can.sent), 300)
    board.run(3)
    assert (board.read(0x2031), board.read(0x603F)) == (tells, fault)
    assert not board.rises(since_ns)
