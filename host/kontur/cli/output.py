# SPDX-License-Identifier: Apache-2.0
"""Output of the commands: tables for people, JSON for programs."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click

from kontur.can.emcy import describe_emcy
from kontur.cli.terminal import styled
from kontur.errors import visible

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

PIPED_WIDTH = 200


def print_json(value: Any) -> None:
    """Print JSON on stdout. It has ASCII only, without control characters, so that each terminal shows it as it is."""
    click.echo(json.dumps(value, indent=2).replace("\x7f", "\\u007f"))


def console(stderr: bool = False, width: int | None = None) -> Console:
    """rich's console on stdout or stderr. Texts from outside are given to it as cell()."""
    from rich.console import Console

    return Console(file=styled(sys.stderr if stderr else sys.stdout), width=width)


def cell(text: str) -> Text:
    """A text from outside, in which rich reads no markup, and the terminal no escape sequences."""
    from rich.text import Text

    return Text(visible(text))


def print_table(rows: Sequence[Mapping[str, Any]], title: str = "", headings: Mapping[str, str] | None = None) -> None:
    """Print a table on stdout; keys of the rows are its columns, numbers have four digits.

    `headings` of columns: default those of the figures of a run.
    """
    from rich.table import Table
    from rich.text import Text

    from kontur.runs.summary import SUMMARY, TRACKING

    headings = SUMMARY | TRACKING if headings is None else headings
    table = Table(title=Text(visible(title), "bold") if title else None, title_justify="left")
    for key in rows[0]:
        number = any(isinstance(row[key], (int, float)) for row in rows)
        table.add_column(headings.get(key, key), justify="right" if number else "left", overflow="fold")
    for row in rows:
        table.add_row(*(cell(_text(value)) for value in row.values()))
    console(width=None if sys.stdout.isatty() else PIPED_WIDTH).print(table)


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def print_warnings(codes: Iterable[int]) -> None:
    """Print the warnings of a drive, EMCY codes, with cause and remedy, to stderr."""
    for code in codes:
        click.echo(f"Warning: the drive reports {describe_emcy(code)}.", err=True)


def warnings_json(codes: Iterable[int]) -> list[dict[str, str]]:
    """Warnings in the form of print_json()."""
    return [{"code": f"{code:04X}h", "text": describe_emcy(code)} for code in codes]
