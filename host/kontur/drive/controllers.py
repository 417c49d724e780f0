# SPDX-License-Identifier: Apache-2.0
"""The drive's controllers: the paper's names, and names that explain themselves. Both are accepted everywhere."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from kontur.errors import ParameterError


@dataclass(frozen=True)
class Controller:
    """`name` is the paper's, and what logs and reports use; `alias` says what the controller does."""

    name: str
    alias: str
    description: str


TABLE = Path(__file__).parents[1] / "controllers.json"
"""Generated from firmware/core/controllers.h, the list of the firmware."""

_ALL = tuple(Controller(**row) for row in json.loads(TABLE.read_text("utf-8")))

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
