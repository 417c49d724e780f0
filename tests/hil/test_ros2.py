# SPDX-License-Identifier: Apache-2.0
"""What a ros2_canopen master sends to a drive by examples/ros2/bus.yml, frame by frame: the configuration that dcfgen
makes of it, NMT start, and the commands of two CiA 402 channels with a SYNC each 10 ms. No part of ROS runs here."""

from __future__ import annotations

import shutil
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from canopen.sdo import SdoAbortedError
from rig import PRE_OPERATIONAL, START, Rig

ROOT = Path(__file__).resolve().parents[2]
SYNC_S, SPEED_UMPS = 0.01, 50_000
PROFILE_POSITION, PROFILE_VELOCITY = 1, 3
NEW_SET_POINT, AT_ONCE = 0x10, 0x20
ACKNOWLEDGED, REACHED = 1 << 12, 1 << 10
FAULT_RESET, DISABLE_VOLTAGE, SHUTDOWN, SWITCH_ON, ENABLE, HALT = 0x80, 0x00, 0x06, 0x07, 0x0F, 0x10F
STATE, SWITCH_ON_DISABLED, READY, SWITCHED_ON, ENABLED = 0x6F, 0x40, 0x21, 0x23, 0x27
STATUS, MOTION = (0x180, 0x380), (0x280, 0x480)  # TPDOs of x, y
COMMAND, TARGET = (0x200, 0x400), (0x300, 0x500)  # RPDOs of x, y


@pytest.fixture(scope="module")
def configuration(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[int, int, bytes]]:
    """What the master writes to the drive when it has booted: a concise DCF (CiA 302-3)."""
    folder = tmp_path_factory.mktemp("ros2")
    program = Path(sys.executable).with_name("dcfgen")
    if not program.exists():
        pytest.skip("dcfgen is not there: pip install dcf-tools 'setuptools<81'")
    for file in (ROOT / "examples" / "ros2" / "bus.yml", ROOT / "host" / "kontur" / "kontur.eds"):
        shutil.copy(file, folder)
    subprocess.run([program, "-r", "bus.yml"], cwd=folder, check=True, capture_output=True, timeout=120)
    return list(_writes((folder / "kontur.bin").read_bytes()))


def _writes(concise: bytes) -> Iterator[tuple[int, int, bytes]]:
    at = 4
    for _ in range(int.from_bytes(concise[:4], "little")):
        index, sub, size = struct.unpack_from("<HBI", concise, at)
        yield index, sub, concise[at + 7 : at + 7 + size]
        at += 7 + size


class Ros:
    """The master: values of the latest TPDOs, and RPDOs that go out before each SYNC."""

    def __init__(self, rig: Rig) -> None:
        self.rig, self.id = rig, rig.drive.node_id
        self.status, self.motion = [b"", b""], [b"", b""]
        self.controlword, self.position, self.velocity = [0, 0], [0, 0], [0, 0]
        self.mode = PROFILE_VELOCITY
        for axis in (0, 1):
            self._keep(STATUS[axis], self.status, axis)
            self._keep(MOTION[axis], self.motion, axis)

    def _keep(self, cob_id: int, into: list[bytes], axis: int) -> None:
        def keep(_id: int, data: bytearray, _time: float) -> None:
            into[axis] = bytes(data)

        self.rig.link._network.subscribers.pop(cob_id + self.id, None)  # kontur's own reading of it
        self.rig.link._network.subscribe(cob_id + self.id, keep)
        self.rig.link._lengths.pop(cob_id + self.id, None)  # not as long as in the EDS
        self.rig.link._telemetry_ids = frozenset()

    def cycle(self) -> None:
        link = self.rig.link
        for axis in (0, 1):
            link.send(TARGET[axis] + self.id, struct.pack("<ii", self.position[axis], self.velocity[axis]))
            link.send(COMMAND[axis] + self.id, struct.pack("<HB", self.controlword[axis], self.mode))
        link.send(0x77F, b"\x05")
        link.send(0x80, b"")
        link.wait(lambda: False, SYNC_S)

    def until(self, state: int, cycles: int = 50) -> None:
        """Cycles go by until both channels are in this state."""
        for _ in range(cycles):
            self.cycle()
            if all(data and data[0] & STATE == state for data in self.status):
                return
        raise AssertionError(f"{[data.hex() for data in self.status]}, not {state:02X}h")

    def speeds_umps(self) -> list[int]:
        return [struct.unpack("<ii", data)[1] for data in self.motion]

    def statuswords(self) -> list[int]:
        return [int.from_bytes(data[:2], "little") for data in self.status]

    def positions_nm(self) -> list[int]:
        return [struct.unpack("<ii", data)[0] for data in self.motion]

    def go_to(self, *target_nm: int) -> None:
        """Profile position as ros2_canopen's mode does it: change at once, bit 4 until the drive acknowledges."""
        self.position = list(target_nm)
        self.controlword = [ENABLE | AT_ONCE | NEW_SET_POINT] * 2
        self._until_acknowledged(True)
        self.controlword = [ENABLE | AT_ONCE] * 2
        self._until_acknowledged(False)

    def _until_acknowledged(self, wanted: bool) -> None:
        for _ in range(5):
            self.cycle()
            if all((word & ACKNOWLEDGED != 0) == wanted for word in self.statuswords()):
                return
        raise AssertionError(f"bit 12 is not {wanted}: {[hex(word) for word in self.statuswords()]}")


@pytest.fixture
def ros(rig: Rig, configuration: list[tuple[int, int, bytes]]) -> Ros:
    """The master, whose drive is configured and enabled in the mode of bus.yml."""
    if not rig.drive.simulated or (rig.drive.stepped and rig.link._sync_ms):
        pytest.skip("needs SYNC that paces nothing, and room to move: use --target inproc")
    rig.nmt(PRE_OPERATIONAL)
    for index, sub, data in configuration:
        try:
            rig.link.node.sdo.download(index, sub, data)
        except SdoAbortedError as refused:
            raise AssertionError(f"{index:04X}h:{sub} = {data.hex()}: {refused}") from refused
    rig.nmt(START)
    ros = Ros(rig)
    ros.until(SWITCH_ON_DISABLED)
    for controlword, state in ((FAULT_RESET, SWITCH_ON_DISABLED), (SHUTDOWN, READY), (SWITCH_ON, SWITCHED_ON),
                               (ENABLE, ENABLED)):  # fmt: skip
        ros.controlword = [controlword] * 2
        ros.until(state)
    assert [data[2] for data in ros.status] == [PROFILE_VELOCITY] * 2
    return ros


@pytest.mark.motion
def test_command_sequence_of_two_channels_by_the_example_bus_configuration(ros: Ros) -> None:
    ros.velocity = [SPEED_UMPS, -SPEED_UMPS]
    for _ in range(50):
        ros.cycle()
    assert ros.speeds_umps() == pytest.approx([SPEED_UMPS, -SPEED_UMPS], abs=500)
    ros.controlword = [HALT, ENABLE]  # one channel alone
    for _ in range(50):
        ros.cycle()
    assert ros.speeds_umps() == pytest.approx([0, -SPEED_UMPS], abs=500)
    ros.velocity = [0, 0]
    for _ in range(50):
        ros.cycle()
    assert ros.speeds_umps() == pytest.approx([0, 0], abs=500)
    ros.controlword = [DISABLE_VOLTAGE] * 2
    ros.until(SWITCH_ON_DISABLED)
    assert ros.rig.link.emergencies == []


@pytest.mark.motion
def test_both_channels_go_to_targets_in_profile_position(ros: Ros) -> None:
    ros.mode = PROFILE_POSITION
    ros.cycle()
    ros.cycle()
    assert [data[2] for data in ros.status] == [PROFILE_POSITION] * 2
    begin = ros.positions_nm()
    ros.go_to(begin[0] + 3_000_000, begin[1] - 2_000_000)
    ros.cycle()
    ros.go_to(begin[0] + 1_000_000, begin[1] - 2_000_000)  # x on its way: back at once
    for _ in range(100):
        ros.cycle()
    assert np.subtract(ros.positions_nm(), begin) == pytest.approx([1_000_000, -2_000_000], abs=1000)
    assert all(word & REACHED for word in ros.statuswords())
    assert ros.rig.link.emergencies == []
