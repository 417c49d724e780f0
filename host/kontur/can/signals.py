# SPDX-License-Identifier: Apache-2.0
"""The servo's signals as firmware/scope/signals.toml describes them: names, units, and places in scope and TPDOs.

The table is generated (host/kontur/signals.json, docs/signals.md). The scope, the telemetry and the columns of a log
are made from it, so a signal has one name everywhere.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

TABLE = Path(__file__).parents[1] / "signals.json"


@dataclass(frozen=True)
class Place:
    """Where a TPDO carries a signal: `bits` from `bit` on, little-endian. One count is `factor` `unit`s (SI)."""

    cob_id: int
    period_ms: int
    bit: int
    bits: int
    signed: bool
    factor: float
    unit: str


@dataclass(frozen=True)
class LogColumn:
    """The column of a log: its name, its unit, and the digits after the point in CSV."""

    name: str
    unit: str
    digits: int


@dataclass(frozen=True)
class Signal:
    """A signal. In the scope it has `number` (None: it has none), and one count is `factor` `unit`s.

    `telemetry` and `column` are None for signals that no TPDO carries.
    """

    number: int | None
    name: str
    unit: str
    factor: float
    description: str
    telemetry: Place | None = None
    column: LogColumn | None = None

    @property
    def column_name(self) -> str:
        """The name of its column in a capture's file: name and unit."""
        unit = self.unit.replace("/", "_per_")
        return f"{self.name}_{unit}" if unit else self.name


def _read() -> tuple[Signal, ...]:
    rows = json.loads(TABLE.read_text("ascii"))
    return tuple(
        Signal(
            row.get("number"),
            row["name"],
            row["unit"],
            row["factor"],
            row["description"],
            Place(**row["telemetry"]) if "telemetry" in row else None,
            LogColumn(**row["column"]) if "column" in row else None,
        )
        for row in rows
    )


SIGNALS = _read()
"""All signals, those of the scope first, by number."""

RECORDED = {s.name: s for s in SIGNALS if s.number is not None}
"""The signals that the scope in the drive can record, by name."""

CHANNELS = 8
"""So many of them at a time."""

DEFAULT_SIGNALS = ("contour_error", "force_x", "force_y")

TELEMETRY = {s.name: s.telemetry for s in SIGNALS if s.telemetry is not None}
"""Name to place of the signals that TPDOs carry."""
