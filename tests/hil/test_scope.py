# SPDX-License-Identifier: Apache-2.0
"""The scope: a capture comes whole over whatever bus there is, and what led to a fault waits for who asks."""

import numpy as np
import pytest
from rig import Rig

from kontur.can.link import Link
from kontur.drive import scope
from kontur.drive.device import Device
from kontur.drive.scope import Setup, Trigger
from kontur.drive.stream import stream
from kontur.errors import EmcyError


def test_capture_at_once_is_read_whole(rig: Rig) -> None:
    scope.arm(rig.device, Setup(("encoder_count_x", "encoder_count_y"), Trigger("now"), divider=2))
    assert scope.wait(rig.device, 5.0)
    shares: list[float] = []
    capture = scope.read(rig.device, shares.append)
    assert capture.values.shape == (3072, 2)
    assert np.all(np.abs(np.diff(capture.values, axis=0)) < 100)
    assert np.allclose(np.diff(capture.time_s), 2.0 / capture.control_hz)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


@pytest.mark.motion
def test_fault_leaves_its_capture_to_another_master_until_it_is_reset(rig: Rig) -> None:
    knots_nm = rig.circle(1.0)
    rig.device.parameters.set({"limits.velocity": 0.8 * rig.feed_mps})
    rig.device.axes.enable()
    rig.link.wait(lambda: False, 0.6)  # since the reset: there is something to keep
    with pytest.raises(EmcyError, match="8400h"):
        stream(rig.device, knots_nm)
    other = Device(Link(rig.bus, rig.drive.node_id))
    capture = scope.held(other)
    assert capture is not None
    assert capture.fault == 0x8400
    assert capture.time_s[0] <= -0.5
    assert np.abs(capture["force_x"][: capture.trigger_frame]).max() > 1.0
    assert capture["force_x"][-1] == capture["force_y"][-1] == 0.0
    rig.device.parameters.set({"limits.velocity": 5.0 * rig.feed_mps})
    rig.device.axes.enable()
    assert scope.held(rig.device) is None
    rig.device.axes.disable()
