# SPDX-License-Identifier: Apache-2.0
"""Run all that docs/paper.md shows, some minutes, and write it: `python tools/paper_page.py docs/paper.md`."""

from __future__ import annotations

from pathlib import Path

import click
from paper import page

from kontur import machine as machines
from kontur.cli.options import progress_bar, simulation_options
from kontur.drive.target import Target
from kontur.experiments import paper


@click.command()
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@simulation_options
def main(*, file: Path, machine: str, seed: int, num: str) -> None:
    """Run all that docs/paper.md shows, some minutes, and write it as FILE, with pictures in img/paper beside it."""
    with progress_bar("paper page") as progress:
        results = paper.measure(Target(machine=machines.load(machine), seed=seed, num=num), progress=progress)
    page.write(results, file)
    click.echo(f"{file}: {len(results.outcomes)} runs, firmware {results.build}")


if __name__ == "__main__":
    main()
