# SPDX-License-Identifier: Apache-2.0
"""Cyclic synchronous torque (mode 10) by a master of python-canopen's primitives alone."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import can
import numpy as np
import pytest
from foreign_master import ENABLED, STATE, ForeignMaster
from targets import InProcess, Target
from test_cyclic_modes import DISABLE, DISABLE_VOLTAGE, HALT, QUICK_STOP, SHUTDOWN, STANDS_MPS

pytestmark = pytest.mark.motion

CYCLIC_TORQUE = 10
CYCLE_S = 0.002
FORCE_LIMIT_N = 600.0
FOLLOWS = 1 << 12
UNDERRUN, FAULT = 0xFF10, 0x08


@pytest.fixture
def bus(target: Target) -> Iterator[can.BusABC]:
    if not isinstance(target, InProcess):
        pytest.skip("the true force and speed are those of a drive in this process: use --target inproc")
    with target.power_on() as drive:
        assert drive.bus is not None
        yield drive.bus


def cycles(master: ForeignMaster, count: int, x: int, y: int) -> None:
    for _ in range(count):
        master.network.send_message(0x400 + master.node_id, struct.pack("<hh", x, y))
        master.network.send_message(0x80, b"")
        master.wait(CYCLE_S)


@pytest.fixture
def master(bus: can.BusABC) -> ForeignMaster:
    """A master whose axes follow a force of 0."""
    master = ForeignMaster(bus)
    assert master.read(0x6502) & 1 << 9
    master.set_up(round(CYCLE_S * 1e3), CYCLIC_TORQUE, 0x60710010, 0x68710010)
    master.enable()
    cycles(master, 20, 0, 0)
    assert all(word & FOLLOWS for word in master.statuswords())
    bus.start_recording()  # type: ignore[attr-defined]
    return master


def test_force_is_that_part_of_6076h_which_the_master_sends(bus: can.BusABC, master: ForeignMaster) -> None:
    assert master.read(0x6076) == FORCE_LIMIT_N * 1e3
    cycles(master, 30, 200, -300)
    truth = bus.take_truth()  # type: ignore[attr-defined]
    assert truth.force_N[-10:] == pytest.approx(np.tile([0.2 * FORCE_LIMIT_N, -0.3 * FORCE_LIMIT_N], (10, 1)))
    assert [master.read(0x6077), master.read(0x6877)] == [200, -300]
    assert truth.vel_mps[-1, 0] > 0.03
    assert truth.vel_mps[-1, 1] < -0.03
    assert master.codes == []


@pytest.mark.parametrize("word", [QUICK_STOP, SHUTDOWN, DISABLE_VOLTAGE, DISABLE, HALT])
def test_stop_is_obeyed_whatever_forces_go_on_to_come(bus: can.BusABC, master: ForeignMaster, word: int) -> None:
    cycles(master, 60, 200, 200)
    bus.take_truth()  # type: ignore[attr-defined]
    master.controlwords(word, word)
    cycles(master, 200, 200, 200)
    truth = bus.take_truth()  # type: ignore[attr-defined]
    assert np.abs(truth.vel_mps[-1]).max() < STANDS_MPS
    assert (master.statuswords()[0] & STATE == ENABLED) == (word == HALT)
    assert master.codes == []


def test_forces_that_are_lost_end_in_a_stop(bus: can.BusABC, master: ForeignMaster) -> None:
    cycles(master, 60, 200, 0)
    master.wait(0.5)
    assert master.codes == [UNDERRUN]
    assert [word & STATE for word in master.statuswords()] == [FAULT, FAULT]
    assert np.abs(bus.take_truth().vel_mps[-1]).max() < STANDS_MPS  # type: ignore[attr-defined]
