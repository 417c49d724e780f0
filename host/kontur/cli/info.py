# SPDX-License-Identifier: Apache-2.0
"""`kontur info`: identity and state of a drive."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import click

from kontur.can.emcy import describe_emcy
from kontur.cli.options import target_options
from kontur.cli.output import print_json, print_warnings, warnings_json

if TYPE_CHECKING:
    from kontur.drive.target import Target


@click.command(name="info")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@target_options
def command(*, target: Target, as_json: bool) -> None:
    """Show which drive answers, its firmware, state, position and warnings."""
    from kontur.drive.target import open_drive

    with open_drive(target) as device:
        info = device.info()
        bus = str(device.link.bus.channel_info)
    if as_json:
        print_json({"bus": bus, **dataclasses.asdict(info), "warnings": warnings_json(info.warnings)})
        return
    click.echo(f"bus         {bus}, CAN {info.can}")
    click.echo(f"drive       {info.name}, node {info.node_id}")
    click.echo(f"firmware    {info.build}, numbers {info.num}, control {info.control_hz} Hz")
    sent = ", ".join(f"{name.upper()} {cob_id:X}h" for name, cob_id in info.tpdos.items())
    click.echo(f"sends       {sent or 'no TPDO'}")
    click.echo(f"controller  {info.controller}")
    for axis, state, position_m, code in zip("xy", info.state, info.position_m, info.error_code, strict=True):
        fault = f", error {describe_emcy(code)}" if code else ""
        click.echo(f"axis {axis}      {state}, at {position_m * 1e3:.6f} mm{fault}")
    print_warnings(info.warnings)
