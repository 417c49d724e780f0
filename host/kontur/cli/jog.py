# SPDX-License-Identifier: Apache-2.0
"""`kontur jog`: move axes at a constant speed."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import click

from kontur.cli.options import NumberRange, drive_of, interruptible, target_options
from kontur.cli.output import print_json
from kontur.drive.axes import AXES

if TYPE_CHECKING:
    from kontur.drive.target import Target

DURATION_MAX_S = 60.0
_SPEED = NumberRange(-10_000, 10_000)  # the most that limits.velocity can be


@click.command(name="jog")
@click.option("--x", type=_SPEED, metavar="MM_PER_S", help="Speed of x.")
@click.option("--y", type=_SPEED, metavar="MM_PER_S", help="Speed of y.")
@click.option(
    "--duration",
    "duration_s",
    type=NumberRange(0.0, DURATION_MAX_S, min_open=True),
    default=1.0,
    show_default=True,
    metavar="SECONDS",
    help=f"How long they move, at most {DURATION_MAX_S:g} s.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@target_options
def command(*, target: Target, x: float | None, y: float | None, duration_s: float, as_json: bool) -> None:
    """Move the axes with constant speed for a time; they stop before a soft limit and at a limit switch.

    Ctrl-C stops them.
    """
    from kontur.drive import single_axis

    velocity_mps = {axis: value * 1e-3 for axis, value in (("x", x), ("y", y)) if value is not None}
    if not velocity_mps:
        raise click.UsageError("which axis? Give a speed with --x or --y")
    interrupted = False
    with drive_of(target) as device, interruptible() as stop_requested, device.axes.enabled():
        before_m = device.position_m()
        completed = single_axis.jog(device, velocity_mps, duration_s, stop_requested)
        interrupted = stop_requested()
        after_m = device.position_m()
    if as_json:
        print_json({"from_m": before_m, "to_m": after_m, "completed": completed})
    else:
        for axis, a, b in zip(AXES, before_m, after_m, strict=True):
            click.echo(f"{axis}  {a * 1e3:.6f} mm -> {b * 1e3:.6f} mm")
        if not completed and not interrupted:
            click.echo("Stopped by a soft limit or a limit switch.", err=True)
    if interrupted:
        click.echo("Interrupted: the axes have slowed down.", err=True)
        sys.exit(stop_requested.exit_code)
