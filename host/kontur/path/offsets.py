# SPDX-License-Identifier: Apache-2.0
"""Where the origin of a G-code program is, as LinuxCNC has it: the chosen coordinate system (G54 to G59.3), which may
be turned, and G92's offset inside it. Lengths in m, A, B and C in degrees.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

AXES = "XYZABC"
SYSTEMS = (540, 550, 560, 570, 580, 590, 591, 592, 593)
"""G codes of the coordinate systems, times ten."""


def zeros() -> dict[str, float]:
    return dict.fromkeys(AXES, 0.0)


@dataclass
class Offsets:
    """`systems`: the origin of each coordinate system in the machine; `turns`: how it is turned, a number of modulus 1.
    `g92`: in the coordinates of the system, which counts while `g92_holds`."""

    systems: list[dict[str, float]] = field(default_factory=lambda: [zeros() for _ in SYSTEMS])
    turns: list[complex] = field(default_factory=lambda: [1.0 + 0.0j for _ in SYSTEMS])
    chosen: int = 0
    g92: dict[str, float] = field(default_factory=zeros)
    g92_holds: bool = False

    @property
    def turned(self) -> bool:
        return self.turns[self.chosen] != 1.0

    def turn(self, system: int, degrees: float) -> None:
        self.turns[system] = cmath.rect(1.0, math.radians(degrees)) if degrees % 360.0 else 1.0 + 0.0j

    def of(self, axis: str) -> float:
        """The origin of the program, for an axis of a system that is not turned."""
        return self.systems[self.chosen][axis] + self.shift(axis)

    def shift(self, axis: str) -> float:
        """G92's part."""
        return self.g92[axis] if self.g92_holds else 0.0

    def local(self, at: Mapping[str, float], system: int | None = None) -> dict[str, float]:
        """A place of the machine in a coordinate system, the chosen one where none is named, without G92."""
        system = self.chosen if system is None else system
        origin = self.systems[system]
        local = {axis: at[axis] - origin[axis] for axis in AXES}
        if self.turns[system] != 1.0:
            xy = complex(local["X"], local["Y"]) / self.turns[system]
            local |= {"X": xy.real, "Y": xy.imag}
        return local

    def in_machine(self, x: float, y: float) -> complex:
        """A place of the program in the machine, as x + iy."""
        local = complex(x + self.shift("X"), y + self.shift("Y"))
        origin = self.systems[self.chosen]
        return local * self.turns[self.chosen] + complex(origin["X"], origin["Y"])

    def set_here(self, at: Mapping[str, float], values: Mapping[str, float]) -> None:
        """G92: let the machine, which is `at`, be at `values` of the program."""
        if not self.g92_holds:
            self.g92 = zeros()
        local = self.local(at)
        self.g92 |= {axis: local[axis] - value for axis, value in values.items()}
        self.g92_holds = True

    def set_origin(self, system: int, at: Mapping[str, float] | None, values: Mapping[str, float]) -> None:
        """G10: let the origin of a system be at `values`; or be so that the machine, which is `at`, is at `values`."""
        origin = self.systems[system]
        if at is None:
            origin |= values
            return
        local = self.local(at, system)
        moved = {axis: local[axis] - self.shift(axis) - value for axis, value in values.items()}
        if self.turns[system] != 1.0:
            xy = complex(moved.get("X", 0.0), moved.get("Y", 0.0)) * self.turns[system]
            moved |= {"X": xy.real, "Y": xy.imag}
        for axis, by in moved.items():
            origin[axis] += by
