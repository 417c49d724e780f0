# SPDX-License-Identifier: Apache-2.0
"""The drive's faults by EMCY code: what happened, why, and what to do. The text is the firmware's (docs/faults.md)."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

TABLE = Path(__file__).parents[1] / "fault_table.json"


@dataclass(frozen=True)
class Fault:
    """A row of firmware/supervision/faults.toml. `reaction`: warn, refuse, path stop, quick stop or disable; the scope
    in the drive keeps what led to it; `bit`: its number there, None where the CANopen node raises it."""

    name: str
    fault: str
    cause: str
    remedy: str
    reaction: str
    captured: bool
    bit: int | None

    @property
    def warns(self) -> bool:
        """Whether it only warns, whatever the options."""
        return self.reaction in ("warn", "refuse")


@lru_cache(maxsize=1)
def faults() -> dict[int, Fault]:
    """All faults that a drive can report, by EMCY code."""
    rows = json.loads(TABLE.read_text("utf-8"))
    return {int(code, 16): Fault(**row) for code, row in rows.items()}


def describe_emcy(code: int) -> str:
    """The fault of an EMCY code, with cause and remedy."""
    fault = faults().get(code)
    if fault is None:
        return f"{code:04X}h: unknown to this version of kontur; see docs/faults.md of the firmware's version"
    return f"{code:04X}h: {fault.fault}. Cause: {fault.cause}. Remedy: {fault.remedy}"
