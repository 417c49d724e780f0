# SPDX-License-Identifier: Apache-2.0
"""`kontur demo`: one part under every controller, in any folder."""

from __future__ import annotations

from pathlib import Path

import click

from kontur import machine as machines
from kontur.cli.options import progress_bars, simulation_options
from kontur.cli.output import print_table


@click.command(name="demo")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path), required=False)
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), default=Path("kontur-demo"), show_default=True,
              help="Folder of report, figures and logs.")  # fmt: skip
@simulation_options
def command(*, file: Path | None, out: Path, machine: str, seed: int, num: str) -> None:
    """Cut FILE on the simulated drive under every controller, with report and logs.

    Without FILE it is the demo part, which comes with this program.
    """
    from kontur.drive.target import Target
    from kontur.experiments.demo import demo, part
    from kontur.runs.summary import summary

    target = Target(machine=machines.load(machine), seed=seed, num=num)
    file = part() if file is None else file
    with progress_bars() as progress:
        runs = demo(file, out, target, progress)
    rows = [{"controller": run.meta["controller"], **summary(run)} for run in runs]
    print_table(rows, f"{file}, {runs[0].columns['time_s'][-1]:.1f} s: true contour error")
    click.echo(
        f"{out / 'report.html'} shows the runs; {out / 'summary.json'} has the figures, and the logs are beside it."
    )
