# SPDX-License-Identifier: Apache-2.0
"""The in-process drive on a bus that does to each frame what a test says."""

from collections.abc import Callable

import can

from kontur.sim.bus import KonturBus

Fault = Callable[[can.Message], can.Message | None]


class HookedBus(KonturBus):
    """Sends through `on_send`, which returns the frame to send, another one, or None: lost. Receives likewise."""

    def __init__(self, **options: object) -> None:
        super().__init__(**options)  # type: ignore[arg-type]
        self.on_send: Fault = lambda message: message
        self.on_recv: Fault = lambda message: message

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if (message := self.on_send(msg)) is not None:
            super().send(message, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        end_s = self.time_s + (timeout or 0.0)
        while (message := super().recv(max(0.0, end_s - self.time_s))) is not None:
            if (kept := self.on_recv(message)) is not None:
                return kept
        return None
