# SPDX-License-Identifier: Apache-2.0
"""`kontur doctor`: what is wrong between this computer and a drive, and what to do about it."""

from __future__ import annotations

import dataclasses
import sys
from typing import TYPE_CHECKING

import click

from kontur.cli.options import target_options
from kontur.cli.output import print_json
from kontur.errors import visible

if TYPE_CHECKING:
    from kontur.drive.target import Target

_MARKS = {"ok": "ok     ", "warning": "WARNING", "error": "ERROR  "}


@click.command(name="doctor")
@click.option("--json", "as_json", is_flag=True, help="Print the findings as JSON.")
@target_options
def command(*, target: Target, as_json: bool) -> None:
    """Look at bus, interface, drive, inputs, wiring, encoders and load; each finding has a remedy.

    Nothing moves: no axis gets power, and no parameter changes. Warnings are worth a look; the exit code is 1 where
    something is wrong.
    """
    from kontur.commissioning.doctor import ERROR, OK, WARNING
    from kontur.commissioning.doctor_bus import examine

    found = examine(target)
    errors, warnings = (sum(one.level == level for one in found) for level in (ERROR, WARNING))
    if as_json:
        print_json({"ok": errors == 0, "findings": [dataclasses.asdict(one) for one in found]})
    else:
        for one in found:
            click.echo(visible(f"{_MARKS[one.level]}  {one.check}: {one.text}"))
            if one.level != OK:
                click.echo(visible(f"         -> {one.remedy}"))
        click.echo(f"\n{errors} wrong, {warnings} worth a look, {len(found) - errors - warnings} good.")
    if errors:
        sys.exit(1)
