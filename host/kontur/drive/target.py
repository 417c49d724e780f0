# SPDX-License-Identifier: Apache-2.0
"""Which drive is meant: the options of its bus, or the machine to simulate; and the connection to it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from kontur.can.bad_bus import BusFaults
from kontur.can.bus import open_bus
from kontur.can.simulated import simulated
from kontur.drive.device import Device, connected
from kontur.machine import Machine

SIMULATED = "kontur"
BAD_BUS = "kontur-bad-bus"


@dataclass(frozen=True)
class Target:
    """Which drive: `bus` are python-can's options, None for a simulated one, which takes machine, seed and num.

    `faults`: what happens to frames on their way.

    `place_at_start`: a simulated machine stands where the path starts, instead of where its file says.
    """

    machine: Machine
    bus: Mapping[str, Any] | None = None
    node_id: int = 1
    seed: int = 1
    num: str = "f32"
    place_at_start: bool = True
    faults: BusFaults | None = None

    @property
    def in_process(self) -> bool:
        """The drive is simulated here, and gone when the bus is closed."""
        options = self.options()
        return bool(options.get("inner", options["interface"]) == SIMULATED)

    def options(self) -> dict[str, Any]:
        """python-can's options to open the bus with."""
        options = dict(self.bus) if self.bus is not None else {"interface": SIMULATED, "channel": "sim"}
        if options.get("interface") == SIMULATED:
            options |= {"machine": self.machine, "seed": self.seed, "node_id": self.node_id, "num": self.num}
        if self.faults is not None:
            options |= {"interface": BAD_BUS, "inner": options["interface"], "faults": self.faults}
        return options


@contextmanager
def connect(target: Target) -> Iterator[Device]:
    """The drive of `target`; a simulated one is told of the machine that it moves.

    Raises BusError, NoAnswerError, ParameterError.
    """
    with connected(open_bus(target.options()), target.node_id) as device:
        if simulated(device.link.bus):
            device.set_parameters(target.machine.parameters(target.seed))
        yield device
