# SPDX-License-Identifier: Apache-2.0
"""`kontur experiment`: experiments that are defined here, so that everyone runs the same."""

from __future__ import annotations

import click

from kontur import machine as machines
from kontur.cli.options import progress_bar, simulation_options
from kontur.cli.output import print_json, print_table
from kontur.device import CONTROLLERS
from kontur.experiment import CASES, paper
from kontur.run import Target


@click.group(name="experiment")
def command() -> None:
    """Run a defined experiment on the simulated drive."""


@command.command(name="paper")
@click.option("--case", "cases", type=click.Choice(list(CASES)), multiple=True, help="Only this circle (default: all).")
@click.option(
    "--controller", "controllers", type=click.Choice(CONTROLLERS), multiple=True, help="Only this (default: all)."
)
@click.option(
    "--seeds", type=click.IntRange(1, 1000), default=1, show_default=True, help="How many seeds, from --seed on."
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@simulation_options
def paper_command(
    *,
    cases: tuple[str, ...],
    controllers: tuple[str, ...],
    seeds: int,
    as_json: bool,
    machine: str,
    seed: int,
    num: str,
) -> None:
    """The three circles of docs: 4.488 mm/s r 4 mm (low), 100 mm/s r 20 mm (high), 100 mm/s r 4 mm (high-tight)."""
    target = Target(machine=machines.load(machine), num=num)
    cases, controllers = cases or tuple(CASES), controllers or CONTROLLERS
    done = 0
    with progress_bar("experiment paper") as progress:

        def one_more() -> None:
            nonlocal done
            done += 1
            progress(done / (len(cases) * len(controllers) * seeds))

        rows = list(paper(target, cases, controllers, range(seed, seed + seeds), one_more))
    if as_json:
        print_json({"cases": rows})
    else:
        print_table(rows, "True contour error")
