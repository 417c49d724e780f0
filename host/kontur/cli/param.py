# SPDX-License-Identifier: Apache-2.0
"""`kontur param`: the drive's parameters by name, in their units."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from kontur.cli.options import PARAMETER, PARAMETER_VALUE, drive_of, parameter_values, parameters_of, target_options
from kontur.cli.output import print_json, print_table
from kontur.files import write_atomically

if TYPE_CHECKING:
    from kontur.drive.target import Target


@click.group(name="param")
def command() -> None:
    """List, read, set and store parameters (docs/objects.md has all of them).

    A simulated drive starts with its defaults in every command; set parameters with `kontur run --set NAME=VALUE`.
    """


@command.command(name="list")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@target_options
def list_command(*, target: Target, as_json: bool) -> None:
    """List all parameters with value, range and unit."""
    with drive_of(target) as device:
        rows = [
            {
                "name": p.name,
                "value": device.read(p.name),
                "unit": p.unit,
                "least": p.least,
                "greatest": p.greatest,
                "default": p.default,
                "description": p.description,
            }
            for p in device.parameters.values()
        ]
    if as_json:
        print_json(rows)
    else:
        print_table(rows)


@command.command(name="get")
@click.argument("names", nargs=-1, required=True, type=PARAMETER, metavar="NAME...")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@target_options
def get_command(*, target: Target, names: tuple[str, ...], as_json: bool) -> None:
    """Read parameters, or any other object, by name."""
    with drive_of(target) as device:
        rows = [{"name": name, "value": device.read(name), "unit": device.unit(name)} for name in names]
    if as_json:
        print_json(rows)
        return
    for row in rows:
        click.echo("{name} = {value} {unit}".format(**row).rstrip())


@command.command(name="set")
@click.argument("pairs", nargs=-1, required=True, type=PARAMETER_VALUE, metavar="NAME=VALUE...")
@target_options
def set_command(*, target: Target, pairs: tuple[tuple[str, str], ...]) -> None:
    """Set parameters; none is set when one of them cannot be."""
    with drive_of(target) as device, device.master.held():
        device.parameters.set(parameter_values(pairs))


@command.command(name="dump")
@click.argument("file", required=False, type=click.Path(dir_okay=False, path_type=Path))
@target_options
def dump_command(*, target: Target, file: Path | None) -> None:
    """Write all parameters to FILE (TOML), or to the terminal."""
    from kontur.drive import parameter_file

    with drive_of(target) as device:
        text = parameter_file.text(device.parameters.dump(), device.parameters)
    if file is None:
        click.echo(text, nl=False)
    else:
        write_atomically(file, text.encode())


@command.command(name="load")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@target_options
def load_command(*, target: Target, file: Path) -> None:
    """Set all parameters of FILE, as `dump` writes it; none is set when one of them cannot be."""
    values = parameters_of(file)
    with drive_of(target) as device, device.master.held():
        device.parameters.set(values)


_ALL_OBJECTS = click.option(
    "--all", "all_objects", is_flag=True, help="Include the communication objects (1000h to 1FFFh)."
)


@command.command(name="save")
@_ALL_OBJECTS
@target_options
def save_command(*, target: Target, all_objects: bool) -> None:
    """Store the parameters in the drive as they are now. No axis may have power."""
    with drive_of(target) as device, device.master.held():
        device.parameters.save(all_objects)
    click.echo("saved: the drive starts with what is set now")


@command.command(name="restore")
@_ALL_OBJECTS
@target_options
def restore_command(*, target: Target, all_objects: bool) -> None:
    """Let the drive start with the defaults again; node id and bit rate stay. No axis may have power."""
    with drive_of(target) as device, device.master.held():
        device.parameters.restore(all_objects)
    click.echo("restored: the defaults are in effect after the drive's next power-on or reset")
