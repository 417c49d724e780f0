# SPDX-License-Identifier: Apache-2.0
"""Whether head (`meta`) and values of a log are what a log may have: it may come from anywhere."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

_NUMBERS = ("seed", "control_hz", "frames_lost", "accepted", "resumed_at_s", "force_max_N", "force_step_N")
_TEXTS = (
    *("program", "controller", "status", "fault", "trajectory", "machine", "told", "compensation"),
    *("firmware", "num", "command"),
)
_TABLES = ("plant", "parameters", "rejected", "score", "path")
_TABLES_OF_NUMBERS = ("rejected", "score", "path")
_PATH = {"length_mm", "from_mm", "to_mm", "known_mm"}  # kontur.runs.coverage
_LISTS = ("warnings",)
_LEVELS = 8  # of tables and lists in one another
_LARGEST = 2.0**64
_MEASURED_MAX = 1e12


def problem_of_values(columns: Mapping[str, NDArray[np.float64]]) -> tuple[int, str] | None:
    """The first column with a value that nothing measures, and the row of that; None: there is none. Not known (NaN) is
    no problem."""
    for name, values in columns.items():
        beyond = np.abs(values) > _MEASURED_MAX
        if np.any(beyond):
            return int(np.argmax(beyond)), f"column {name} has a value beyond {_MEASURED_MAX:g}"
    return None


def problem_of_kinds(meta: Mapping[str, Any]) -> str | None:
    """The first entry that is of another kind than the table `META` of kontur.runs.log says; None: there is none."""
    for key, value in meta.items():
        wanted = _wanted(key, value)
        if wanted:
            return f"{key} is no {wanted}"
        if _is_deeper(value, _LEVELS):
            return f"{key} is nested more than {_LEVELS} levels deep"
    return None


def _wanted(key: str, value: Any) -> str | None:
    """What the entry had to be, where it is not."""
    if key in _NUMBERS and not _is_number(value):
        return "number"
    if key in _TEXTS and not isinstance(value, str):
        return "text"
    if key in _LISTS and not isinstance(value, list):
        return "list"
    if key in _TABLES and not isinstance(value, Mapping):
        return "table"
    if key in _TABLES_OF_NUMBERS and not all(map(_is_measured, value.values())):
        return "table of numbers"
    if key == "path" and value and not (value.keys() >= _PATH and value["length_mm"] > 1e-6):
        return f"table with {', '.join(sorted(_PATH))}"
    return None


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and -_LARGEST <= value <= _LARGEST


def _is_measured(value: Any) -> bool:
    return _is_number(value) and abs(value) <= _MEASURED_MAX


def _is_deeper(value: Any, levels: int) -> bool:
    if not isinstance(value, (Mapping, list)):
        return False
    inner = value.values() if isinstance(value, Mapping) else value
    return levels == 0 or any(_is_deeper(one, levels - 1) for one in inner)
