# SPDX-License-Identifier: Apache-2.0
"""Records (60C1h) of a master whose clock is not the drive's, over the bus. The axes stand: each is their place."""

from __future__ import annotations

import struct

import pytest
from rig import Rig
from test_any_master import Master

QUEUE_FULL, STOPPED, RUNNING = 0xFF34, 5, 2


def _started(rig: Rig) -> tuple[Master, bytes]:
    master = Master(rig)
    master.enable()
    rig.link.send(0x200 + master.node_id, b"\x1f\0\x1f\0")
    x, y = (rig.link.node.sdo.upload(index, 0) for index in (0x6064, 0x6864))
    return master, bytes(x + y)


def _send(rig: Rig, record: bytes, count: int) -> None:
    for _ in range(count):
        rig.link.send(0x400 + rig.drive.node_id, record)


@pytest.mark.motion
def test_lag_stays_with_a_master_whose_clock_is_faster(rig: Rig) -> None:
    if not rig.drive.stepped:
        pytest.skip("needs a drive whose time is the test's: use --target inproc or slcan")
    master, record = _started(rig)
    lag: list[int] = []
    begin_s = rig.link.time_s
    for ms in range(8000):
        _send(rig, record, 2 if ms % 250 == 0 else 1)  # 0.4 %
        end_s = begin_s + (ms + 0.95) * 1e-3  # of this millisecond, less half a control period
        rig.link.wait(lambda end_s=end_s: rig.link.time_s > end_s, 1.0)  # type: ignore[misc]
        if ms in (500, 7999):
            lag.append(master.read(0x60C4, 4))
    assert struct.unpack("<B", rig.link.node.sdo.upload(0x2200, 5))[0] == RUNNING
    assert abs(lag[1] - lag[0]) <= 8  # by itself it would be 30
    assert 1000 < master.read(0x2200, 13) <= 1005
    assert master.codes() == []


@pytest.mark.motion
def test_record_that_is_lost_is_told_and_stops_the_path(rig: Rig) -> None:
    master, record = _started(rig)
    for _ in range(1200):  # six times as many as path time takes
        _send(rig, record, 6)
        rig.link.wait(lambda: False, 1e-3)
    assert QUEUE_FULL in master.codes()
    assert rig.link.wait(lambda: master.read(0x2200, 5) == STOPPED, 1.0)
    assert master.write(0x60C4, 6, 1, 0) == 0
    assert rig.link.wait(lambda: master.codes() == [QUEUE_FULL, 0], 1.0)
