# SPDX-License-Identifier: Apache-2.0
"""Which drive is meant: the options of its bus, or the machine to simulate; and the connection to it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from kontur.can.bad_bus import BusFaults
from kontur.can.bus import open_bus
from kontur.can.simulated import MakePlant, simulated
from kontur.drive.device import Device, connected
from kontur.machine import ALL, FULL, Machine, load

SIMULATED = "kontur"
BAD_BUS = "kontur-bad-bus"


@dataclass
class Stopwatch:
    """`drive_s`: for how long connections to a drive were open, by its own time."""

    drive_s: float = 0.0


@dataclass(frozen=True)
class Target:
    """Which drive. `bus` are python-can's options; None: a drive that is simulated in this process.

    `machine` is what is simulated, or what motion of a real drive is planned for; `seed` and `num`: noise and numeric
    back end of the simulation. `place_at_start`: the simulated axes stand where the path starts, instead of where the
    machine's file says. `faults`: what happens to frames on their way, see kontur.can.bad_bus.
    `set_pdos`: PDOs that another master has changed are set as kontur needs them, until the drive is reset.

    What a machine is and what its drive is told are two things. `told` and `compensation` say what a drive that is
    simulated in this process is told of `machine` (kontur.machine.TOLD, COMPENSATIONS). A drive on a bus is told
    nothing: it keeps its parameters.

    `plant` makes a machine in Python that a drive in this process moves, in place of the simulator's. `stopwatch` runs
    while open_drive() is open, of this target and of those that are made of it by replace().
    """

    machine: Machine = field(default_factory=load)
    bus: Mapping[str, Any] | None = None
    node_id: int = 1
    seed: int = 1
    num: str = "f32"
    place_at_start: bool = True
    faults: BusFaults | None = None
    set_pdos: bool = False
    told: str = ALL
    compensation: str = FULL
    plant: MakePlant | None = None
    stopwatch: Stopwatch = field(default_factory=Stopwatch, compare=False)

    @property
    def in_process(self) -> bool:
        """Whether the drive is simulated in this process, and gone when the bus is closed."""
        options = self.options()
        return bool(options.get("inner", options["interface"]) == SIMULATED)

    def parameters(self) -> dict[str, float]:
        """What the drive is told of the machine, by the names of its parameters. Raises ParameterError."""
        return self.machine.parameters(self.seed, self.told, self.compensation)

    def options(self) -> dict[str, Any]:
        """python-can's options to open the bus with."""
        options = dict(self.bus) if self.bus is not None else {"interface": SIMULATED, "channel": "sim"}
        if options.get("interface") == SIMULATED:
            options |= {"machine": self.machine, "seed": self.seed, "node_id": self.node_id, "num": self.num}
            options |= {"plant": self.plant} if self.plant is not None else {}
        if self.faults is not None:
            options |= {"interface": BAD_BUS, "inner": options["interface"], "faults": self.faults}
        return options


@contextmanager
def open_drive(target: Target) -> Iterator[Device]:
    """The drive of `target`, until the `with` ends. One in this process is told of its machine what `target` says.

    Raises BusError, NoAnswerError, ParameterError.
    """
    with connected(open_bus(target.options()), target.node_id) as device:
        device.pdos.may_set = target.set_pdos
        if simulated(device.link.bus):
            device.parameters.set(target.parameters())
        began_s = device.link.time_s
        try:
            yield device
        finally:
            target.stopwatch.drive_s += device.link.time_s - began_s


def tell(target: Target) -> None:
    """Tell a drive on a bus of its machine what `target` says; it keeps that until it is powered off.

    Raises BusError, NoAnswerError, ParameterError.
    """
    with connected(open_bus(target.options()), target.node_id) as device:
        device.parameters.set(target.parameters())


def tell_emulated(target: Target, pace: str) -> None:
    """The same for an image in QEMU, and how its time passes: "clock" or "sync". It stores both, as a board does, so
    that a reset keeps them."""
    with connected(open_bus(target.options()), target.node_id) as device:
        device.parameters.set(target.parameters() | {"pace_select": int(pace == "sync")})
        device.parameters.save()
