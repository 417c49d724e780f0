# SPDX-License-Identifier: Apache-2.0
"""`kontur sweep`: many runs on simulated machines, over a grid and a sample of inputs."""

from __future__ import annotations

from pathlib import Path

import click

from kontur.cli.options import check_output, progress_bar
from kontur.cli.work_options import workers_option, write_table


@click.command(name="sweep")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path), metavar="SWEEP.toml")
@click.option("-o", "--output", required=True, type=click.Path(dir_okay=False, path_type=Path),
              help="The table, .csv. Beside it: .rows, the rows as they come; .parquet, with pyarrow.")  # fmt: skip
@workers_option
def command(*, file: Path, output: Path, workers: int | str | None) -> None:
    """Run all that SWEEP.toml asks for, on simulated machines, into one table.

    Each key of the file is an input of every run: a value or a list of values, whose product is the grid. A table
    { low, high, log } is a range to draw from, as often as `draws` says (docs/sweep.md).

    What was broken off, by Ctrl-C or a crash, goes on with the same command. The table is the same with any number of
    workers.
    """
    check_output(output, ".csv")
    from kontur.experiments import engine, sweep

    asked = sweep.load(file)
    with progress_bar(f"sweep of {len(asked.runs)}") as progress:
        figures = engine.carry_out(
            sweep.one_run, asked.runs, asked.files, output.with_suffix(".rows"), workers, progress
        )
    rows = [inputs | row for inputs, row in zip(asked.runs, figures, strict=True)]
    click.echo(f"{len(rows)} runs are in {write_table(rows, output)}.")
    problems = [row["problem"] for row in rows if row["problem"] is not None]
    if problems:
        click.echo(f"{len(problems)} of them have a problem (column `problem`). The first: {problems[0]}", err=True)
