# SPDX-License-Identifier: Apache-2.0
"""A drive whose answers come late, as of a simulation on a busy machine or through a slow gateway."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import can
import pytest

from kontur.can.link import Link
from kontur.drive.device import Device
from kontur.errors import NoAnswerError
from kontur.sim.bus import KonturBus

SDO_RESPONSE = 0x581


class LateBus(KonturBus):
    """Answers to SDO requests come `late_s` after the drive has sent them, by its time."""

    late_s = 0.0

    def __init__(self) -> None:
        super().__init__(channel="sim")
        self._held: deque[tuple[float, can.Message]] = deque()

    def recv(self, timeout: float | None = None) -> can.Message | None:
        end_s = self.time_s + (timeout or 0.0)
        while True:
            if self._held and self._held[0][0] <= self.time_s:
                return self._held.popleft()[1]
            until_s = min(end_s, self._held[0][0]) if self._held else end_s
            message = super().recv(max(0.0, until_s - self.time_s))
            if message is not None and message.arbitration_id == SDO_RESPONSE:
                self._held.append((self.time_s + self.late_s, message))
            elif message is not None:
                return message
            elif self.time_s >= end_s - 1e-9 and not (self._held and self._held[0][0] <= self.time_s):
                return None


@pytest.fixture
def bus() -> Iterator[LateBus]:
    with LateBus() as bus:
        yield bus


@pytest.mark.parametrize("late_s", [0.4, 1.0])
def test_objects_in_one_frame_and_in_segments_are_read_and_written(bus: LateBus, late_s: float) -> None:
    device = Device(Link(bus, 1))
    bus.late_s = late_s
    assert device.read("device_name") == "Kontur"
    device.write("smc.lambda", 123.0)
    assert device.read("smc.lambda") == 123.0


def test_drive_that_does_not_answer_is_told_within_three_seconds(bus: LateBus) -> None:
    device = Device(Link(bus, 1))
    bus.late_s = 100.0
    begin_s = bus.time_s
    with pytest.raises(NoAnswerError, match="does not answer"):
        device.read("error_register")
    assert bus.time_s - begin_s < 3.1
