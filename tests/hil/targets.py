# SPDX-License-Identifier: Apache-2.0
"""The drives that the suite runs on, and what each of them can do."""

from __future__ import annotations

import dataclasses
import os
import shutil
import subprocess
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
from numpy.typing import NDArray

from kontur import machine
from kontur.can.bus import open_bus
from kontur.drive.target import Target as KonturTarget
from kontur.drive.target import tell_emulated
from kontur.machine import Machine
from kontur.sim import emulator
from kontur.sim import process as sim_process

# Without the friction that vanishes at times, in which an axis without power would float away.
MACHINE = dataclasses.replace(machine.load(), friction_schedule=(), friction_repeat_s=0.0)
IMAGE = Path(__file__).parents[2] / "build/firmware/kontur.elf"
Metres = NDArray[np.float64]


@dataclass
class Drive:
    """A drive that is on; `bus_options` are python-can's, to reach it.

    `stepped`: its time passes with the host's frames. `bus`: the host's bus, where there can be but one.
    `listeners`: others may listen on the same bus. `truth_m`: switches the drive off and gives the true positions
    (n, 2) since power-on, one a control period; None where nobody knows them. `unplug`: cuts the bus until the `with`
    ends.
    """

    bus_options: dict[str, Any]
    simulated: bool = True
    node_id: int = 1
    stepped: bool = False
    listeners: bool = False
    bus: can.BusABC | None = None
    truth_m: Callable[[], Metres] | None = None
    unplug: Callable[[can.BusABC], AbstractContextManager[None]] | None = None
    parameters: dict[str, float] = field(default_factory=dict)

    def open(self) -> can.BusABC:
        """The host's bus."""
        return self.bus if self.bus is not None else open_bus(self.bus_options)


class Target(ABC):
    """`outlives_host`: the drive is no part of the host's process, which may be killed.

    `watched`: its motion is known for when no host listens, too. `holds_clock`: it keeps up with the wall clock,
    whatever machine it runs on.
    """

    outlives_host = True
    watched = True
    holds_clock = True
    simulated = True

    @abstractmethod
    def power_on(self, pace: str = "sync", plant: Machine = MACHINE) -> AbstractContextManager[Drive]:
        """A drive; where simulated, a new one that moves `plant`. Its time passes with the host's frames where the
        target can do that, and by the wall clock with `pace` clock."""


def needs_clock(target: Target) -> None:
    """Skip a test that measures by the wall clock where the target may be too slow for it."""
    if not target.holds_clock:
        pytest.skip(
            "an emulator does not keep up with the wall clock on every machine: run this with --target slcan or vcan"
        )


class InProcess(Target):
    """Firmware and plant as a library in this process."""

    outlives_host = False

    @contextmanager
    def power_on(self, pace: str = "sync", plant: Machine = MACHINE) -> Iterator[Drive]:
        options = {"interface": "kontur", "channel": "sim", "machine": plant, "seed": 1}
        options["pace"] = "clock" if pace == "clock" else "lockstep"
        with can.Bus(**options) as bus:
            sim = bus.sim  # type: ignore[attr-defined]
            sim.record(True)
            yield Drive(
                options,
                stepped=pace != "clock",
                bus=bus,
                truth_m=lambda: sim.truth().pos_m,
                parameters=plant.parameters(),
            )


class Process(Target):
    """Firmware and plant as the process kontur-sim, on slcan over TCP or on vcan."""

    def __init__(self, **bus: str) -> None:
        self.bus = bus
        self.is_vcan = "can" in bus

    @contextmanager
    def power_on(self, pace: str = "sync", plant: Machine = MACHINE) -> Iterator[Drive]:
        with tempfile.TemporaryDirectory() as folder, ExitStack() as running:
            record = Path(folder) / "truth"
            sim = running.enter_context(sim_process.start(**self.bus, pace=pace, machine=plant, record=record))

            def truth_m() -> Metres:
                running.close()
                return sim_process.read_record(record).pos_m

            yield Drive(
                sim.options(),
                stepped=pace != "clock",
                listeners=self.is_vcan,
                truth_m=truth_m,
                unplug=self._link_down if self.is_vcan else _hung_up,
                parameters=plant.parameters(),
            )

    @contextmanager
    def _link_down(self, _bus: can.BusABC) -> Iterator[None]:
        channel = self.bus["can"]
        if os.geteuid() != 0:
            pytest.skip(f"taking {channel} down needs root")
        subprocess.run(["ip", "link", "set", channel, "down"], check=True)
        try:
            yield
        finally:
            subprocess.run(["ip", "link", "set", channel, "up"], check=True)


class Image(Target):
    """The STM32F405 image in QEMU, slcan on its serial line. It moves the machine that it simulates by itself."""

    watched = False
    holds_clock = False  # an emulator is as fast as the machine that it runs on

    @contextmanager
    def power_on(self, pace: str = "sync", plant: Machine = MACHINE) -> Iterator[Drive]:
        if shutil.which(emulator.PROGRAM) is None:
            pytest.skip(f"{emulator.PROGRAM} is missing: apt-get install qemu-system-arm")
        on_chip = dataclasses.replace(plant, model=machine.ON_CHIP)
        with emulator.start(IMAGE) as running:
            target = KonturTarget(on_chip, running.options())
            tell_emulated(target, pace)
            yield Drive(running.options(), stepped=pace != "clock", unplug=_hung_up, parameters=target.parameters())


@contextmanager
def _hung_up(bus: can.BusABC) -> Iterator[None]:
    """The client's TCP connection breaks, without a word of slcan."""
    bus.serialPortOrig.close()  # type: ignore[attr-defined]
    yield


class RealDrive(Target):
    """A drive on the bench; what keeps its table safe is in rig.py."""

    simulated = False

    def __init__(self, options: dict[str, Any], node_id: int) -> None:
        self.options, self.node_id = options, node_id

    @contextmanager
    def power_on(self, pace: str = "sync", plant: Machine = MACHINE) -> Iterator[Drive]:
        if plant is not MACHINE:
            pytest.skip("needs a machine of its own, which simulated drives have")
        yield Drive(
            self.options, simulated=False, node_id=self.node_id, listeners=self.options["interface"] == "socketcan"
        )


def named(name: str, node_id: int) -> Target:
    """The target of --target NAME."""
    if name == "inproc":
        return InProcess()
    if name == "slcan":
        return Process(slcan_tcp="0")
    if name.startswith("vcan"):
        return Process(can="vcan0" if name == "vcan" else name)
    if name == "qemu":
        return Image()
    interface, colon, rest = name.partition(":")
    if not colon:
        return RealDrive({"interface": "socketcan", "channel": name}, node_id)
    channel, _, bitrate = rest.partition("@")
    return RealDrive({"interface": interface, "channel": channel, "bitrate": int(bitrate or 1_000_000)}, node_id)
