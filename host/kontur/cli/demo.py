# SPDX-License-Identifier: Apache-2.0
"""`kontur demo`: what `make demo` runs."""

from __future__ import annotations

from pathlib import Path

import click

from kontur import machine as machines
from kontur.cli.options import progress_bars, simulation_options
from kontur.cli.output import print_table
from kontur.drive.target import Target
from kontur.experiments.demo import demo
from kontur.runs.summary import summary


@click.command(name="demo", short_help="Cut the demo part under every controller.")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path), default=Path("examples/part.ngc"))
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), default=Path("build/demo"), show_default=True)
@simulation_options
def command(*, file: Path, out: Path, machine: str, seed: int, num: str) -> None:
    """Cut FILE (default: examples/part.ngc) on the simulated drive under every controller, with report and logs."""
    target = Target(machine=machines.load(machine), seed=seed, num=num)
    with progress_bars() as progress:
        runs = demo(file, out, target, progress)
    rows = [{"controller": run.meta["controller"], **summary(run)} for run in runs]
    print_table(rows, f"{file}, {runs[0].columns['time_s'][-1]:.1f} s: true contour error")
    click.echo(
        f"{out / 'report.html'} shows the runs; {out / 'summary.json'} has the figures, and the logs are beside it."
    )
