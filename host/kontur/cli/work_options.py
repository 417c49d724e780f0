# SPDX-License-Identifier: Apache-2.0
"""Options of the commands that make many runs: who works, and where the table is kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from kontur.files import make_folder

F = TypeVar("F", bound=Callable[..., Any])
_PROCESSES_MAX = 1024


class _Workers(click.ParamType["int | str"]):
    name = "workers"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int | str:
        if "://" in str(value):
            return str(value)
        try:
            number = int(value)
        except ValueError:
            number = 0
        if not 1 <= number <= _PROCESSES_MAX:
            self.fail(f"{value!r} is neither a number of processes from 1 to {_PROCESSES_MAX} nor an address such as "
                      "tcp://localhost:8786", param, ctx)  # fmt: skip
        return number


workers_option = click.option(
    "--workers",
    type=_Workers(),
    metavar="NUMBER|tcp://HOST:PORT",
    help="Processes that run at a time (default: all cores), or the scheduler of a dask cluster.",
)
_OUT = click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Keep the runs there as they come, and the table in the end. What was broken off goes on with the same "
    "command.",
)


def work_options(function: F) -> F:
    """--out, --workers."""
    return _OUT(workers_option(function))


def rows_file(out: Path | None, name: str) -> Path | None:
    """The file of rows in the folder `out`, which is made. Raises FileError."""
    if out is None:
        return None
    make_folder(out)
    return out / f"{name}.rows"


def write_table(rows: Sequence[dict[str, Any]], file: Path) -> str:
    """Write the table beside the file of rows; returns where it is, in words."""
    from kontur.experiments import table

    return " and ".join(map(str, table.write(rows, file.with_suffix(".csv"))))
