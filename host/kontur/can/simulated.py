# SPDX-License-Identifier: Apache-2.0
"""What a bus offers whose drive is simulated: the drive's own time, and where its axes really are.

The simulator derives its bus from `SimulatedBus` (kontur.sim.bus), so whoever talks to a drive can ask for these
without importing a simulator. A real drive's bus is no SimulatedBus, and then they are not known.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import can
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Truth:
    """What no encoder sees, one row a control period; each array (n, 2), x and y, but for the last two (n,).

    `pos_m`, `vel_mps` at the instant the encoders are read; `force_N` as asked for by the firmware in this period;
    `friction_N` as it acted. `digital` and `power`, 0 to 1, are the outputs beside the axes (2180h).
    """

    pos_m: NDArray[np.float64]
    vel_mps: NDArray[np.float64]
    force_N: NDArray[np.float64]
    friction_N: NDArray[np.float64]
    digital: NDArray[np.float64]
    power: NDArray[np.float64]


class Plant(Protocol):
    """A machine in Python that the simulated drive moves (docs/own-plant.md)."""

    def step(self, force_N: tuple[float, float]) -> Iterable[float]:
        """Let one control period pass under the drive's force demand; returns the positions (x, y) at its end, m."""


MakePlant: TypeAlias = Callable[[tuple[float, float], float], Plant]
"""Makes a plant at rest at a position in m, with a control period in s."""


class SimulatedBus(can.BusABC):
    """A bus to one simulated drive, whose time passes in recv()."""

    @property
    @abstractmethod
    def time_s(self) -> float:
        """Time of the drive since power-on."""

    @property
    @abstractmethod
    def by_clock(self) -> bool:
        """Whether the drive's time keeps up with the wall clock, whatever the host does."""

    @abstractmethod
    def start_recording(self) -> int:
        """Record the truth from now on, and start the machine's friction schedule; returns the control period."""

    @abstractmethod
    def take_truth(self) -> Truth:
        """What was recorded since the last call, one row a control period; it is not kept."""


def simulated(bus: can.BusABC) -> SimulatedBus | None:
    """The simulated drive at the end of `bus`, which may be around it (kontur.can.bad_bus); None for another one."""
    bus = getattr(bus, "inner", bus)
    return bus if isinstance(bus, SimulatedBus) else None
