# SPDX-License-Identifier: Apache-2.0
"""`kontur report`: one HTML file, or one picture, from logs."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from kontur.cli.options import check_output


@click.command()
@click.argument("logs", nargs=-1, required=True, type=click.Path(), metavar="LOG...")
@click.option("-o", "--output", required=True, type=click.Path(dir_okay=False, path_type=Path),
              help="The report, .html; a picture of it, .png; or one for a paper, .svg or .pdf.")  # fmt: skip
@click.option("--title", help="Title of the report; default: the name of the program.")
def command(logs: tuple[str, ...], output: Path, title: str | None) -> None:
    """Compare the runs in LOG... (CSV or MF4), which followed the same path.

    A report needs no network and no other file. With -o NAME.png a picture of the answer is written instead, with
    NAME.svg or NAME.pdf one as wide as a column of a paper (88 mm), with its fonts in it.
    """
    check_output(output, ".html", ".png", ".svg", ".pdf")
    from kontur.report import page
    from kontur.runs import log

    runs = [log.read(name, thinned=True) for name in logs]
    if output.suffix.lower() != ".html":
        page.picture(output, runs)
    else:
        again = [*page.commands_of(runs), shlex.join(["kontur", "report", *logs, "-o", str(output)])]
        page.write_report(output, runs, title, "\n".join(again))
    click.echo(output)
