# SPDX-License-Identifier: Apache-2.0
"""`kontur demo`: one part under every controller, in any folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from kontur.cli.options import progress_bars, simulated_target_options
from kontur.cli.output import print_table

if TYPE_CHECKING:
    from kontur.drive.target import Target


@click.command(name="demo")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path), required=False)
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), default=Path("kontur-demo"), show_default=True,
              help="Folder of report, figures and logs.")  # fmt: skip
@simulated_target_options
def command(*, file: Path | None, out: Path, target: Target) -> None:
    """Cut FILE on the simulated drive under every controller, with report and logs: on the paper's machine, and on a
    real one with a spring between motor and table, for which `kontur design` found the gains.

    Without FILE it is the demo part, which comes with this program.
    """
    from kontur.experiments.demo import demo, part
    from kontur.runs.summary import heading, summary

    file = part() if file is None else file
    with progress_bars() as progress:
        shown = demo(file, out, target, progress)
    for runs in (shown.paper, shown.real):
        rows = [{"controller": run.meta["controller"], **summary(run)} for run in runs]
        what = f"{runs[0].meta['machine']}: {heading(runs[0].meta, truth=True)}"
        print_table(rows, f"{file}, {runs[0].columns['time_s'][-1]:.1f} s, {what}")
    click.echo(
        f"{out / 'report.html'} and {out / 'real' / 'report.html'} show the runs; {out / 'summary.json'} has the "
        "figures, and the logs are beside them."
    )
