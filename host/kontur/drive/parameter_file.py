# SPDX-License-Identifier: Apache-2.0
"""Parameters in a file: TOML, a table a record, values in the unit that the comment says."""

from __future__ import annotations

import reprlib
import sys
from collections.abc import Mapping
from pathlib import Path

from kontur.drive.objects import Parameter
from kontur.errors import FileError
from kontur.files import read_toml


def text(values: Mapping[str, float], parameters: Mapping[str, Parameter]) -> str:
    """`values` by name as TOML."""
    lines: list[str] = ["# Parameters of a Kontur drive: kontur param load FILE"]
    table = ""
    for name in sorted(values, key=lambda name: ("." in name, name.partition(".")[0])):
        record, dot, key = name.rpartition(".")
        if dot and record != table:
            table = record
            lines.append(f"\n[{record}]")
        unit = parameters[name].unit
        lines.append(f"{key} = {values[name]!r}" + (f"  # {unit}" if unit else ""))
    return "\n".join(lines) + "\n"


def read(file: Path) -> dict[str, float]:
    """Values by name. Raises FileError: cannot be read, not TOML, or a value that is no number."""
    table = read_toml(file)
    if isinstance(table.get("name"), str) and {"x", "y"} <= table.keys():
        raise FileError(
            file,
            "is the file of a machine, not of parameters. A simulation takes it as --machine FILE; for a real drive "
            "set its masses, frictions and limits by name, such as plant_x.mass=88.08 (kontur param list)",
        )
    values: dict[str, float] = {}
    for key, value in table.items():
        entries = {f"{key}.{k}": v for k, v in value.items()} if isinstance(value, dict) else {key: value}
        for name, number in entries.items():
            if (
                isinstance(number, bool)
                or not isinstance(number, (int, float))
                or not abs(number) <= sys.float_info.max
            ):
                raise FileError(file, f"must be a number, is {reprlib.repr(number)}", word=name)
            values[name] = number
    return values
