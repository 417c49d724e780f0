# SPDX-License-Identifier: Apache-2.0
"""`kontur home`: find the home point of an axis."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import click

from kontur.cli.options import NumberRange, drive_of, interruptible, target_options
from kontur.cli.output import print_json
from kontur.drive.axes import AXES, METHODS

if TYPE_CHECKING:
    from kontur.drive.target import Target


@click.command(name="home")
@click.argument("axis", type=click.Choice(AXES))
@click.option(
    "--method",
    type=click.Choice(list(METHODS)),
    help="What defines the home point: limit switch at the negative or positive end, an index pulse, or the position. "
    "Default: the drive's homing_method.",
)
@click.option("--offset", type=NumberRange(-2000, 2000), metavar="MM",
              help="Position of the home point. Default: the drive's home_offset.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@target_options
def command(*, target: Target, axis: str, method: str | None, offset: float | None, as_json: bool) -> None:
    """Home AXIS, so that positions count from its home point. The other axis is held.

    Speeds and acceleration are the parameters homing_speed and homing_acceleration. Ctrl-C stops the axis.
    """
    from kontur.drive import single_axis

    parameters: dict[str, float] = {}
    if method is not None:
        parameters[f"homing_method_{axis}"] = METHODS[method]
    if offset is not None:
        parameters[f"home_offset_{axis}"] = offset * 1e6
    with drive_of(target) as device, device.master.held():
        device.parameters.set(parameters)
        with interruptible() as stop_requested, device.axes.enabled():
            homed = single_axis.home(device, axis, stop_requested)
            position_m = device.position_m()[AXES.index(axis)]
    if as_json:
        print_json({"axis": axis, "homed": homed, "position_m": position_m})
    elif homed:
        click.echo(f"{axis}  homed, stands at {position_m * 1e3:.6f} mm")
    if not homed:
        click.echo("Interrupted: the axis has slowed down and is not homed.", err=True)
        sys.exit(stop_requested.exit_code)
