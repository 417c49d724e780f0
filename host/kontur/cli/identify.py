# SPDX-License-Identifier: Apache-2.0
"""`kontur identify`: mass, friction, first mode, lag and screw of both axes, measured by their drive."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from kontur import machine as machines
from kontur.cli.options import NumberRange, check_output, drive_of, interruptible, target_options
from kontur.cli.output import print_json, print_table
from kontur.drive.axes import AXES
from kontur.files import write_atomically

if TYPE_CHECKING:
    from kontur.commissioning.first_moves import Agreed, Gauge
    from kontur.commissioning.fit import Value
    from kontur.commissioning.identify import Identified
    from kontur.drive.device import Device
    from kontur.drive.target import Target

FORCE_SHARE = 0.5  # of the force limit, where no force is given


@click.command(name="identify")
@click.option("--axis", "only", type=click.Choice(AXES), help="One axis alone.  [default: x, then y]")
@click.option("--force", "force_N", type=NumberRange(1.0, 3000.0), metavar="N",
              help="Largest force.  [default: half of the force limit]")  # fmt: skip
@click.option("--speed", type=NumberRange(5.0, 1000.0), default=200.0, show_default=True, metavar="MM_PER_S",
              help="Largest speed.")  # fmt: skip
@click.option("-o", "--output", type=click.Path(dir_okay=False, path_type=Path), metavar="MACHINE.toml",
              help="Write the machine file of what was found here, of both axes.")  # fmt: skip
@click.option("--params", type=click.Path(dir_okay=False, path_type=Path), metavar="PARAMS.toml",
              help="Write the parameters of the drive for it here.")  # fmt: skip
@click.option("--index-distance", "index_mm", type=NumberRange(0.1, 1000.0), metavar="MM",
              help="Distance of the index pulses: the length of an encoder count is checked by it.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@target_options
def command(
    *,
    target: Target,
    only: str | None,
    force_N: float | None,
    speed: float,
    index_mm: float | None,
    output: Path | None,
    params: Path | None,
    as_json: bool,
) -> None:
    """Measure both axes with their own drive, one after the other, within their soft limits.

    A slow ramp of the force finds the direction first, and stops the axis within a millimetre where it is wrong. The
    drive keeps its parameters. Ctrl-C stops.
    """
    check_output(output, ".toml")
    check_output(params, ".toml")
    if only is not None and (output or params):
        raise click.UsageError("--axis: a machine file has both axes; leave out --axis, or -o and --params")
    require_length(target, index_mm)
    from kontur.commissioning import machine_file
    from kontur.commissioning.session import identify_axes
    from kontur.drive import parameter_file

    with drive_of(target) as device, interruptible() as stop_requested:
        try:
            agreed = agreed_of(target, device, (only,) if only else AXES, {}, force_N, speed * 1e-3, index_mm)
            scales = (
                machine_file.scales(target.machine) if target.in_process and target.told == machines.LENGTHS else {}
            )
            found = identify_axes(device, agreed, scales, _say(as_json), stop_requested)
        except KeyboardInterrupt:
            click.echo("Interrupted: the axes have slowed down, and the parameters are as they were.", err=True)
            sys.exit(stop_requested.exit_code)
        declared = device.declared
    if output is not None or params is not None:
        machine = machine_file.machine(target.machine, found)
        if output is not None:
            write_atomically(output, machine_file.text(machine).encode())
        if params is not None:
            values = machine.parameters() | machine_file.parameters(found)
            write_atomically(params, parameter_file.text(values, declared).encode())
    if as_json:
        print_json({"axes": {name: machine_file.as_json(one) for name, one in found.items()}})
    else:
        show(found)
    if not target.in_process and not all(one.index_m > 0.0 for one in agreed.values()):
        click.echo("The length of an encoder count was not checked; a wrong one makes all figures wrong.", err=True)


def agreed_of(
    target: Target,
    device: Device,
    axes: Sequence[str],
    ratings: Mapping[str, float],
    force_N: float | None,
    speed_mps: float,
    index_mm: float | None,
    gauge: Gauge | None = None,
) -> dict[str, Agreed]:
    """What was agreed for each axis. A drive on a bus has index pulses where its machine file says so."""
    from kontur.commissioning.first_moves import Agreed
    from kontur.commissioning.session import force_limits

    found = {}
    for axis, limit_N in force_limits(device, axes, ratings).items():
        index_m = index_mm * 1e-3 if index_mm else 0.0 if target.in_process else getattr(target.machine, axis).index_m
        largest_N = min(force_N or FORCE_SHARE * limit_N, limit_N)
        found[axis] = Agreed(largest_N, speed_mps, index_m, encoder_known(target), gauge)
    return found


def encoder_known(target: Target) -> bool:
    """Whether the drive is told the lengths of its encoders, or has them."""
    return not target.in_process or target.told != machines.NOTHING


def require_length(target: Target, index_mm: float | None) -> None:
    """Raise UsageError where nothing says how long a count of the encoder is."""
    if index_mm is None and not encoder_known(target):
        raise click.UsageError(
            "--untold all: nothing says how long a count of the encoder is; give the distance of its index pulses with "
            "--index-distance MM"
        )


def _say(as_json: bool) -> Callable[[str], None]:
    return (lambda text: None) if as_json else (lambda text: click.echo(f"{text}.", err=True))


def show(found: dict[str, Identified]) -> None:
    """A table with a row a quantity, and a column an axis."""
    from kontur.commissioning import machine_file

    of = {name: machine_file.quantities(one) for name, one in found.items()}
    names = next(iter(of.values()))
    print_table(
        [{"what": key, **{name: _text(one[key]) for name, one in of.items()}} for key in names],
        "Identified",
        {"what": ""},
    )
    for name, one in found.items():
        click.echo(f"{name}: not seen: {', '.join(machine_file.as_json(one)['not_seen'])}")


def _text(value: Value | None) -> str:
    return "-" if value is None else f"{value.value:.4g} ± {value.uncertainty:.2g}"
