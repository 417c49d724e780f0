# SPDX-License-Identifier: Apache-2.0
"""What all code generators have in common: they read one TOML file and write text files that depend on it alone."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[1]


class SourceError(Exception):
    """A source is not usable; the message says where and what is wrong."""


def load_toml(path: Path) -> dict[str, Any]:
    """The tables of a source, in ASCII, with fractions as Decimal. Raises SourceError."""
    try:
        toml: dict[str, Any] = tomllib.loads(path.read_text("ascii"), parse_float=Decimal)
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise SourceError(f"{path}: {error}") from error
    return toml


def note(source: str, generator: str) -> str:
    """What generated text says of itself; source and generator are paths from the root of the repository."""
    return f"Generated from {source} by {generator}: do not edit"


def c_head(source: str, generator: str) -> str:
    """The first lines of generated C."""
    return f"/* SPDX-License-Identifier: Apache-2.0 */\n/* {note(source, generator)}. */\n"


def run(parser: argparse.ArgumentParser, make: Callable[[argparse.Namespace], Mapping[Path, str]]) -> int:
    """A generator's main(): write the files that `make` gives for the arguments.

    Returns the exit status, 1 after a SourceError, whose message goes to stderr; nothing is written then.
    """
    try:
        outputs = make(parser.parse_args())
    except SourceError as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 1
    for path, text in outputs.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8", newline="\n")
    return 0
