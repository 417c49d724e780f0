# SPDX-License-Identifier: Apache-2.0
"""A machine, read from one TOML file in SI units.

It gives the simulator its model, the drive its parameters, and the planner its limits. `model` has the machine and what
its drive is told of it, `reader` reads the file.
"""

from kontur.machine.model import (
    ALL,
    COMPENSATIONS,
    FULL,
    LENGTHS,
    NOT_ON_CHIP,
    NOTHING,
    ON_CHIP,
    RIGID,
    TOLD,
    Axis,
    Machine,
    told_text,
)
from kontur.machine.reader import DEFAULT, GAINS, MACHINES, load

__all__ = [
    "ALL",
    "COMPENSATIONS",
    "DEFAULT",
    "FULL",
    "GAINS",
    "LENGTHS",
    "MACHINES",
    "NOTHING",
    "NOT_ON_CHIP",
    "ON_CHIP",
    "RIGID",
    "TOLD",
    "Axis",
    "Machine",
    "load",
    "told_text",
]
