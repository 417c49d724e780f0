# SPDX-License-Identifier: Apache-2.0
"""A stream that a test drives step by step: it decides when the path starts, and how far it goes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kontur.drive.device import Device
from kontur.drive.knot_sender import AllKnots, KnotSender
from kontur.drive.state_machine import RUN_PATH


class SteppedStream:
    """The queue of an enabled `device` is filled with `knots_nm` (n, 2); nothing moves before start()."""

    def __init__(self, device: Device, knots_nm: NDArray[np.int32]) -> None:
        self.device = device
        self.sender = KnotSender(device, AllKnots(knots_nm))
        self.sender.fill()

    def start(self) -> None:
        """Let path time run."""
        self.device.axes.controlwords(RUN_PATH, RUN_PATH)

    def advance(self, duration_s: float) -> None:
        """Send knots, and handle frames when all are sent, for `duration_s`. Raises EmcyError at a fault."""
        link = self.device.link
        end_s = link.time_s + duration_s
        while (left_s := end_s - link.time_s) > 1e-9:
            self.step(left_s)

    def step(self, timeout_s: float = 0.02) -> None:
        """One step of advance()."""
        if self.sender.accepted < self.sender.total:
            self.sender.advance()
        else:
            self.device.link.poll(timeout_s)
            self.device.faults.check()

    def advance_to(self, share: float) -> None:
        """Send knots until the drive has executed this share of them."""
        while self.sender.share < share:
            self.sender.advance()
