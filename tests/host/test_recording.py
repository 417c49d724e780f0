# SPDX-License-Identifier: Apache-2.0
"""Recordings of an axis while it is commissioned: a fault that comes meanwhile is what is reported."""

import pytest

from kontur.commissioning.recording import ScopeRecorder
from kontur.drive.target import Target, open_drive
from kontur.errors import EmcyError

HEARTBEAT_LOST = 0x8130


@pytest.mark.parametrize("begun", [True, False], ids=["during the recording", "before it"])
def test_fault_is_reported_and_not_that_the_scope_keeps_its_capture(begun: bool) -> None:
    with open_drive(Target()) as device:
        recorder = ScopeRecorder(device, "x", 0.1)
        with device.axes.enabled():
            if begun:
                recorder.start()
            device.link.stop_heartbeat()
            assert device.link.wait(lambda: HEARTBEAT_LOST in device.link.reported, 2.0)
            device.link.wait(lambda: False, 0.5)
            with pytest.raises(EmcyError, match="heartbeat"):
                recorder.read() if begun else recorder.start()
