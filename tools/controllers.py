# SPDX-License-Identifier: Apache-2.0
"""Reads the list of control laws, firmware/core/controllers.h, for the object dictionary and the host."""

from __future__ import annotations

import json
import re
from pathlib import Path

from source import ROOT, SourceError

SOURCE = "firmware/core/controllers.h"
KEYS = ("name", "alias", "description")


def load(path: Path = ROOT / SOURCE) -> list[dict[str, str]]:
    """The laws in their order: `name`, `alias`, `description`. Raises SourceError with what is wrong."""
    text = path.read_text("ascii")
    rows = re.findall(r'ROW\(([A-Z0-9_]+), "([a-z0-9_]+)", "([a-z0-9-]+)", "([^"]+)"\)', text)
    if not rows or len(rows) != len(re.findall(r"\bROW\([A-Z]", text)):
        raise SourceError(f'{path}: a row is ROW(ID, "name", "name-in-words", "description")')
    words = [word for _, name, alias, _ in rows for word in {name, alias}]
    if len(set(words)) != len(words):
        raise SourceError(f"{path}: two laws have the same name")
    return [dict(zip(KEYS, row[1:], strict=True)) for row in rows]


def table(laws: list[dict[str, str]]) -> str:
    """The host's list."""
    return json.dumps(laws, indent=1) + "\n"
