# SPDX-License-Identifier: Apache-2.0
"""The simulated drive as a python-can bus: `can.Bus(interface="kontur", channel="sim", seed=1)`.

With `pace="lockstep"`, the default, the drive's time passes inside recv() only, by as much as its timeout allows. So a
run needs no thread and is the same each time. Clients that receive in a thread of their own (can.Notifier) need
`pace="clock"`: the drive's time passes in recv() too, but never faster than the wall clock. With `pace="sync"` it
passes with SYNC alone, like that of `kontur sim --pace sync` and of the image in QEMU (docs/protocol.md, Time).
"""

from __future__ import annotations

import math
import secrets
import threading
import time
from pathlib import Path
from typing import Any

import can

from kontur import machine as machines
from kontur.can.simulated import MakePlant, SimulatedBus, Truth
from kontur.errors import KonturError
from kontur.machine import Machine
from kontur.sim.library import Sim

PATIENCE_S = 3600.0
"""Time of the drive after which a recv() without timeout returns None."""

PACES = ("lockstep", "clock", "sync")

_CLOCK_SLICE_S = 1e-3
_WIRE_S = 2e-4  # that a frame and its answer take at 1 Mbit/s


class KonturBus(SimulatedBus):
    """A bus to a simulated drive. `machine` is a Machine or the name of a file; `sim` is the simulated drive itself.

    `plant` makes the machine that is moved, in place of the simulator's (docs/own-plant.md).

    The drive has been on for `on_for_ms` when the bus is opened.

    Raises can.CanInitializationError when the simulator cannot be started.
    """

    def __init__(
        self,
        channel: Any = "sim",
        can_filters: Any = None,
        *,
        machine: Machine | str | Path = machines.DEFAULT,
        seed: int = 1,
        node_id: int = 1,
        num: str = "f32",
        pace: str = "lockstep",
        on_for_ms: int = 0,
        plant: MakePlant | None = None,
        **_: object,
    ) -> None:
        if pace not in PACES:
            raise can.CanInitializationError(f"pace must be one of {', '.join(PACES)}, is {pace!r}")
        try:
            simulated = machine if isinstance(machine, Machine) else machines.load(machine)
            self.sim = Sim(simulated, int(seed), int(node_id), num)
            if plant is not None:
                start_m = (simulated.x.start_m, simulated.y.start_m)
                self.sim.set_plant(plant(start_m, 1.0 / self.sim.control_hz))
        except (KonturError, ValueError, OverflowError) as error:
            raise can.CanInitializationError(str(error)) from error
        self.channel_info = f"kontur simulated drive, machine {simulated.name!r}, seed {seed}, node {node_id}"
        self._lock = threading.Lock()
        self._clock_start_s = time.monotonic() if pace == "clock" else None
        self._wire_free_s = 0.0
        self._by_sync = pace == "sync"
        self.sim.run(on_for_ms * self.sim.control_hz // 1000)
        while on_for_ms and self.sim.recv() is not None:  # frames of the time before the bus was opened
            pass
        self.sim.set_paced(self._by_sync)
        if self.by_clock:  # other runs are the same each time
            self.sim.set_entropy(secrets.randbits(32))
        super().__init__(channel=channel, can_filters=can_filters)

    @property
    def time_s(self) -> float:
        """Time of the drive since power-on."""
        return self.sim.tick / self.sim.control_hz

    @property
    def by_clock(self) -> bool:
        """Whether the drive's time follows the wall clock, whatever the host does."""
        return self._clock_start_s is not None

    def start_recording(self) -> int:
        """Record the truth from now on, and start the machine's friction schedule; returns the control period."""
        first = self.sim.tick
        self.sim.start_schedule()
        self.sim.record(True)
        return first

    def take_truth(self) -> Truth:
        """What was recorded since the last call, one row a control period; it is not kept."""
        found = self.sim.truth()
        self.sim.record(True)
        return found

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame, which the drive handles in this call; with pace "clock", after its time on a wire.

        A frame that classic CANopen does not have does nothing, as on a real bus.
        """
        with self._lock:
            if self.by_clock:
                self._wait_for_wire()
            if msg.is_extended_id or msg.is_fd or msg.is_error_frame:
                return
            self.sim.send(msg.arbitration_id, msg.data, msg.is_remote_frame)
            if self._by_sync and not msg.is_remote_frame:
                self.sim.run(self.sim.periods_of(msg.arbitration_id))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The oldest frame; without one, the drive's time passes until a frame comes or `timeout` is over.

        With pace "sync" no frame can come in this call, so it returns None without waiting.
        """
        patience_s = 0.0 if self._by_sync else PATIENCE_S if timeout is None else max(0.0, timeout)
        end_tick = self.sim.tick + math.ceil(patience_s * self.sim.control_hz)
        while True:
            with self._lock:
                frame = self.sim.recv()
                if frame is None and self.sim.tick < end_tick and self.sim.step(self._periods_to(end_tick)):
                    continue
            if frame is not None:
                self._note_frame(frame.tick)
                message = can.Message(
                    timestamp=frame.tick / self.sim.control_hz,
                    arbitration_id=frame.id,
                    is_extended_id=False,
                    is_remote_frame=frame.rtr,
                    data=frame.data,
                )
                if self._matches_filters(message):
                    return message
            elif self.sim.tick >= end_tick:
                return None
            else:
                time.sleep(_CLOCK_SLICE_S)

    def shutdown(self) -> None:
        """Power the drive off."""
        super().shutdown()
        self.sim.close()

    def _wait_for_wire(self) -> None:
        """Wait until a wire would be free after the last frame, and let the drive's time pass until now."""
        time.sleep(max(0.0, self._wire_free_s - time.monotonic()))
        self.sim.run(self._periods_to(self.sim.tick + self.sim.control_hz))
        self._note_frame(self.sim.tick)

    def _note_frame(self, tick: int) -> None:
        if self._clock_start_s is not None:
            free_s = self._clock_start_s + tick / self.sim.control_hz + _WIRE_S
            self._wire_free_s = max(self._wire_free_s, free_s)

    def _periods_to(self, end_tick: int) -> int:
        if self._clock_start_s is not None:
            end_tick = min(end_tick, int((time.monotonic() - self._clock_start_s) * self.sim.control_hz))
        return max(0, end_tick - self.sim.tick)
