# SPDX-License-Identifier: Apache-2.0
"""kontur report: one HTML file, or one picture, from logs."""

from __future__ import annotations

import shlex

import click

from kontur import log


@click.command()
@click.argument("logs", nargs=-1, required=True, type=click.Path(), metavar="LOG...")
@click.option("-o", "--output", required=True, type=click.Path(), help="The report, .html, or a picture of it, .png.")
@click.option("--title", help="Title of the report; default: the name of the program.")
def command(logs: tuple[str, ...], output: str, title: str | None) -> None:
    """Compare the runs in LOG... (CSV or MF4), which followed the same path.

    A report needs no network and no other file. With -o NAME.png a picture of the answer is written instead.
    """
    from kontur import report  # takes a second: only who draws pays

    runs = [log.read(name) for name in logs]
    if output.lower().endswith(".png"):
        report.picture(output, runs)
    else:
        again = [*report.commands_of(runs), shlex.join(["kontur", "report", *logs, "-o", output])]
        report.write_report(output, runs, title, "\n".join(again))
    click.echo(output)
