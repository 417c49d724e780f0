# SPDX-License-Identifier: Apache-2.0
"""`kontur sweep`: many runs on simulated machines, over a grid and a sample of inputs."""

from __future__ import annotations

from pathlib import Path

import click

from kontur.cli.options import check_output, progress_bar


@click.command(name="sweep")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path), metavar="SWEEP.toml")
@click.option("-o", "--output", required=True, type=click.Path(dir_okay=False, path_type=Path),
              help="The table, .csv. Beside it: .rows, the rows as they come; .parquet, with pyarrow.")  # fmt: skip
@click.option("--workers", type=click.IntRange(1, 1024), help="Processes that run at a time (default: all cores).")
def command(*, file: Path, output: Path, workers: int | None) -> None:
    """Run all that SWEEP.toml asks for, on simulated machines, into one table.

    Each key of the file is an input of every run: a value or a list of values, whose product is the grid. A table
    { low, high, log } is a range to draw from, as often as `draws` says (docs/sweep.md).

    What was broken off, by Ctrl-C or a crash, goes on with the same command. The table is the same with any number of
    workers.
    """
    check_output(output, ".csv")
    from kontur.experiments import sweep
    from kontur.files import write_atomically

    asked = sweep.load(file)
    with progress_bar(f"sweep of {len(asked.runs)}") as progress:
        rows = sweep.carry_out(asked, output.with_suffix(".rows"), workers, progress)
    write_atomically(output, sweep.csv_bytes(rows))
    written = str(output)
    if sweep.has_parquet():
        parquet = output.with_suffix(".parquet")
        write_atomically(parquet, sweep.parquet_bytes(rows))
        written += f" and {parquet}"
    click.echo(f"{len(rows)} runs are in {written}.")
    problems = [row["problem"] for row in rows if row["problem"] is not None]
    if problems:
        click.echo(f"{len(problems)} of them have a problem (column `problem`). The first: {problems[0]}", err=True)
