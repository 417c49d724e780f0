# SPDX-License-Identifier: Apache-2.0
"""`kontur log`: show or convert a log of a run."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

import click

from kontur.cli.output import PIPED_WIDTH, cell, console, print_json

if TYPE_CHECKING:
    from kontur.runs.sample import Total

_LONG = ("plant", "parameters")  # shown by --json only


@click.group()
def command() -> None:
    """Show or convert a log of a run, also one that a killed run has left (NAME-running.csv)."""


@command.command()
@click.argument("file", type=click.Path())
@click.option("--json", "as_json", is_flag=True, help="Print all of it as JSON.")
def show(file: str, as_json: bool) -> None:
    """Show the run and the range of every column of the log FILE (CSV or MF4)."""
    from rich.table import Table

    from kontur.runs import log

    run = log.read(file, thinned=True)
    columns = {name: _range(run.total(name)) for name in run.columns}
    if as_json:
        print_json({"meta": run.meta, "rows": run.total("tick").count, "columns": columns})
        return
    out = console(width=None if sys.stdout.isatty() else PIPED_WIDTH)
    head = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    for key, value in run.meta.items():
        shown = f"{len(value)} values (--json shows them)" if key in _LONG else value
        head.add_row(cell(key), cell(shown if isinstance(shown, str) else json.dumps(shown)))
    out.print(head)
    table = Table("column", "unit", box=None, padding=(0, 2, 0, 0))
    for name in ("rows", "min", "mean", "max"):
        table.add_column(name, justify="right")
    table.add_column("what", overflow="fold")
    for column in log.COLUMNS:
        if column.name in columns:
            known = columns[column.name]
            numbers = (
                "" if known[key] is None else f"{known[key]:.{column.digits}f}" for key in ("min", "mean", "max")
            )
            table.add_row(column.name, column.unit, str(known["rows"]), *numbers, column.what)
    out.print(table)


@command.command()
@click.argument("source", type=click.Path())
@click.argument("target", type=click.Path())
def convert(source: str, target: str) -> None:
    """Write the log SOURCE as TARGET; both are .csv or .mf4, and TARGET also .mat for MATLAB."""
    from kontur.runs import log

    if target.lower().endswith(".mat"):
        from kontur.runs import mat

        mat.write(log.read(source), target)
    else:
        log.convert(source, target)


def _range(total: Total) -> dict[str, Any]:
    some = total.count > 0
    return {
        "rows": total.count,
        "min": total.least if some else None,
        "mean": total.mean if some else None,
        "max": total.greatest if some else None,
    }
