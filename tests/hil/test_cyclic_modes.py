# SPDX-License-Identifier: Apache-2.0
"""Cyclic modes by a master of python-canopen's primitives alone (foreign_master.py), whose SYNC is not punctual.

Ten minutes of it: `.venv/bin/python tests/hil/foreign_master.py --minutes 10 --ppm 500`.
"""

from __future__ import annotations

from collections.abc import Iterator

import can
import numpy as np
import pytest
from foreign_master import CYCLIC_POSITION, ENABLED, RADIUS_M, SPEED_MPS, STATE, ForeignMaster, circles, off_circle_m
from targets import MACHINE, InProcess, Target

import kontur
from kontur.can.link import Link
from kontur.drive.device import Device

pytestmark = pytest.mark.motion

DURATION_S = 4.0
QUICK_STOP, SHUTDOWN, DISABLE_VOLTAGE, DISABLE, HALT = 0x0B, 0x06, 0x00, 0x07, 0x10F
STANDS_MPS = 1e-3


@pytest.fixture
def bus(target: Target) -> Iterator[can.BusABC]:
    if not isinstance(target, InProcess):
        pytest.skip("SYNC within 0.1 ms needs a drive whose time is the master's: use --target inproc")
    with target.power_on() as drive:
        assert drive.bus is not None
        Device(Link(drive.bus, drive.node_id)).parameters.set(drive.parameters)  # as `kontur param load` does
        yield drive.bus


def following(bus: can.BusABC, cycle_ms: int, **unpunctual: float) -> tuple[ForeignMaster, tuple[int, int]]:
    """A master that is about to drive circles, and where they begin."""
    master = ForeignMaster(bus)
    master.set_up(cycle_ms, CYCLIC_POSITION, 0x607A0020, 0x687A0020)
    master.enable()
    start_nm = master.positions_nm()
    master.begin(circles(start_nm, DURATION_S), cycle_ms, **unpunctual)
    bus.start_recording()  # type: ignore[attr-defined]
    return master, start_nm


@pytest.fixture(scope="module")
def lossless_m() -> float:
    """Mean distance from the same circle of Kontur's own stream, of which nothing is lost."""
    path = kontur.plan(kontur.shapes.circle(RADIUS_M, SPEED_MPS, 2.0), kontur.limits(MACHINE))
    truth = kontur.run(path, "ccu", kontur.Target(MACHINE)).truth
    assert truth is not None
    mean_m: float = np.abs(np.hypot(*(truth.pos_m - [-RADIUS_M, 0.0] - truth.pos_m[0]).T) - RADIUS_M).mean()
    return mean_m


@pytest.mark.parametrize("ppm", [0.0, 500.0, -500.0])
@pytest.mark.parametrize("cycle_ms", [1, 2, 4, 10])
def test_circle_by_set_points_is_as_good_as_by_a_stream(
    bus: can.BusABC, cycle_ms: int, ppm: float, lossless_m: float
) -> None:
    master, start_nm = following(bus, cycle_ms, jitter=0.2 if ppm else 0.0, ppm=ppm)
    master.follow(DURATION_S)
    position_m = bus.take_truth().pos_m  # type: ignore[attr-defined]
    assert np.ptp(position_m[:, 0]) == pytest.approx(2 * RADIUS_M, rel=1e-4)
    assert off_circle_m(position_m, start_nm).mean() < 1.5 * lossless_m
    assert off_circle_m(position_m, start_nm).max() < 5e-6
    assert master.codes == []
    assert [word & STATE for word in master.statuswords()] == [ENABLED, ENABLED]


@pytest.mark.parametrize("word", [QUICK_STOP, SHUTDOWN, DISABLE_VOLTAGE, DISABLE, HALT])
@pytest.mark.parametrize("cycle_ms", [1, 10])
def test_stop_is_obeyed_at_once_whatever_set_points_go_on_to_come(bus: can.BusABC, cycle_ms: int, word: int) -> None:
    master, _ = following(bus, cycle_ms, jitter=0.2)
    master.follow(1.0)
    bus.take_truth()  # type: ignore[attr-defined]
    master.controlwords(word, word)
    if word == DISABLE_VOLTAGE:
        master.wait(2e-4)
        assert np.all(bus.take_truth().force_N[-1] == 0.0)  # type: ignore[attr-defined]
    master.follow(0.4)
    truth = bus.take_truth()  # type: ignore[attr-defined]
    assert np.hypot(*truth.vel_mps[-1]) < STANDS_MPS
    assert np.hypot(*(truth.pos_m[-1] - truth.pos_m[0])) < 0.02
    assert (master.statuswords()[0] & STATE == ENABLED) == (word == HALT)
    assert master.codes == []


PROFILE_POSITION, NEW, RELATIVE = 1, 0x10, 0x40
TARGET_REACHED, ACKNOWLEDGED = 1 << 10, 1 << 12


def test_profile_position_moves_each_axis_to_its_target_and_says_so(bus: can.BusABC) -> None:
    master = ForeignMaster(bus)
    master.set_up(1, PROFILE_POSITION, 0x607A0020, 0x687A0020)
    master.write_both(0x6081, 0, 4, 50_000)
    master.enable()
    from_nm = master.positions_nm()
    for axis, target_nm in ((0, 10_000_000), (0x800, -4_000_000)):
        master.write(0x607A + axis, 0, 4, target_nm)
    for word, acknowledged in ((0x0F | NEW | RELATIVE, ACKNOWLEDGED), (0x0F | RELATIVE, 0)):
        master.controlwords(word, word)
        assert [status & (ACKNOWLEDGED | TARGET_REACHED) for status in master.statuswords()] == [acknowledged] * 2
    master.wait(0.6)
    assert [status & TARGET_REACHED for status in master.statuswords()] == [TARGET_REACHED] * 2
    assert np.subtract(master.positions_nm(), from_nm) == pytest.approx([10_000_000, -4_000_000], abs=1000)
    assert master.read(0x6062) == from_nm[0] + 10_000_000
    assert master.codes == []
