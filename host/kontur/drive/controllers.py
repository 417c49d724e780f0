# SPDX-License-Identifier: Apache-2.0
"""The drive's controllers: the paper's names, and names that explain themselves. Both are accepted everywhere."""

from __future__ import annotations

from dataclasses import dataclass

from kontur.errors import ParameterError


@dataclass(frozen=True)
class Controller:
    """`name` is the paper's, and what logs and reports use; `alias` says what the controller does."""

    name: str
    alias: str
    description: str


_ALL = (
    Controller("track", "axis-smc", "sliding mode on each axis"),
    Controller("cc", "contour-smc", "contouring control"),
    Controller("ccu", "contour-smc-compensated", "contouring control with uncertainty compensation"),
    Controller("cascade", "cascade", "P-PI cascade with feedforward"),
    Controller("ccc", "cross-coupled-cascade", "cascade with cross-coupled control"),
)

CONTROLLERS = tuple(controller.name for controller in _ALL)
"""The paper's names, in the order in which `controller.select` counts them."""

DESCRIPTIONS = {controller.name: controller.description for controller in _ALL}

NAMES = {word: controller.name for controller in _ALL for word in (controller.name, controller.alias)}
"""The paper's name by each accepted name."""


def named(name: str) -> str:
    """The paper's name of a controller. Raises ParameterError when there is no controller `name`."""
    if name not in NAMES:
        raise ParameterError(f"controller {name!r} is unknown; there are {described()}")
    return NAMES[name]


def described() -> str:
    """All controllers with their two names, for messages and --help."""
    return ", ".join(c.name if c.name == c.alias else f"{c.name} ({c.alias})" for c in _ALL)
