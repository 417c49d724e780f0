# SPDX-License-Identifier: Apache-2.0
"""`kontur bench`: how fast it is here."""

from __future__ import annotations

import click

from kontur import machine as machines
from kontur.bench import bench
from kontur.cli.options import simulation_options
from kontur.cli.output import print_json
from kontur.run import Target


@click.group(name="bench")
def command() -> None:
    """Measure speed on this machine."""


@command.command(name="sim")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@simulation_options
def sim_command(*, as_json: bool, machine: str, seed: int, num: str) -> None:
    """Control periods a second of the simulated drive: NumPy oracle, library directly, and over CAN frames."""
    result = bench(Target(machine=machines.load(machine), seed=seed, num=num))
    if as_json:
        print_json(result)
        return
    oracle = result["oracle_periods_per_s"]
    for name, what in (("oracle", "NumPy stepping"), ("direct", "in process, direct"), ("can", "in process, over CAN")):
        rate = result[f"{name}_periods_per_s"]
        click.echo(f"{what:<22}{rate:>12,.0f} control periods/s  {rate / oracle:>8.1f} x")
