# SPDX-License-Identifier: Apache-2.0
"""`kontur tune`: gains for a machine as it was measured, for a purpose."""

from __future__ import annotations

from pathlib import Path

import click

from kontur import machine as machines
from kontur.cli import design
from kontur.cli.commission import AIMS
from kontur.cli.options import CONTROLLER, MACHINE
from kontur.drive.controllers import described


@click.command(name="tune")
@click.argument("machine", type=MACHINE, metavar="MACHINE.toml")
@click.option("--for", "aim", type=click.Choice(list(AIMS)), default="finish", show_default=True,
              help="The least error, the same with more force noise, or a quiet machine.")  # fmt: skip
@click.option("--controller", type=CONTROLLER, default="ccu", show_default=True,
              help=f"Controller, or all: {described()}.")  # fmt: skip
@click.option("-o", "--output", type=click.Path(dir_okay=False, path_type=Path), required=True, metavar="PARAMS.toml",
              help="Where the parameters go, and beside them the picture of the margins (.svg).")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.pass_context
def command(context: click.Context, *, machine: str, aim: str, controller: str, output: Path, as_json: bool) -> None:
    """Find gains for the machine file of `kontur identify`, and say what limits them.

    It is `kontur design` with the Ms and the force step of a purpose.
    """
    ms, force_step_N = AIMS[aim]
    context.invoke(
        design.command, machine=machine, controller=controller, compensation=machines.FULL, ms=ms,
        force_step=force_step_N, output=output, as_json=as_json,
    )  # fmt: skip
