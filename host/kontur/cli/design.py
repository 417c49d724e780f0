# SPDX-License-Identifier: Apache-2.0
"""`kontur design`: parameters of a drive from the file of its machine, under margins."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from kontur import machine as machines
from kontur.cli.options import CONTROLLER, MACHINE, POSITIVE, NumberRange, check_output, progress_bar
from kontur.cli.output import print_json, print_table
from kontur.drive.controllers import CONTROLLERS, described
from kontur.files import write_atomically

if TYPE_CHECKING:
    from kontur.design.search import Design

_HEADINGS = {
    "axis": "axis",
    "ms": "Ms",
    "ms_at_Hz": "at Hz",
    "gain": "gain margin",
    "phase_deg": "phase margin °",
    "delay_ms": "delay margin ms",
    "crossover_Hz": "crossover Hz",
    "bandwidth_Hz": "|S| < 1/2 up to Hz",
    "reversal_um": "reversal µm",
}


@click.command(name="design")
@click.argument("machine", type=MACHINE, metavar="MACHINE.toml")
@click.option(
    "--controller", type=CONTROLLER, default="ccu", show_default=True, help=f"Controller, or all: {described()}."
)
@click.option(
    "--compensation",
    type=click.Choice(machines.COMPENSATIONS),
    default=machines.FULL,
    show_default=True,
    help="What the drive is told besides the gains: all that it can compensate, or what a rigid axis has.",
)
@click.option(
    "--ms",
    type=NumberRange(1.1, 10.0),
    default=2.0,
    show_default=True,
    help="Largest sensitivity: the inverse of the modulus margin.",
)
@click.option(
    "--force-step",
    type=POSITIVE,
    default=2.0,
    show_default=True,
    metavar="N",
    help="Largest mean change of the force from one control period to the next, which the encoder's counts make.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    required=True,
    metavar="PARAMS.toml",
    help="Where the parameters go, and beside them the picture of the margins (.svg). For several controllers the name "
    "of each is put before the suffix.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def command(
    *, machine: str, controller: str, compensation: str, ms: float, force_step: float, output: Path, as_json: bool
) -> None:
    """Find gains for the machine of a file: the least true error of a short move within margins.

    The margins hold for each resonance ±10 % and for masses ±20 %. The law is the firmware's own: its servo tick is
    asked for its response, and the best gains drive the simulated machine. `kontur run --params PARAMS.toml` uses the
    result, `kontur param load` gives it to a drive.
    """
    from kontur.cli.run import log_path
    from kontur.design import figure
    from kontur.design.search import design

    check_output(output, ".toml")
    plan = machines.load(machine)
    names = CONTROLLERS if controller == "all" else (controller,)
    results: list[dict[str, Any]] = []
    for name in names:
        with progress_bar(name) as progress:
            found = design(plan, name, compensation, ms, force_step, progress)
        file = log_path(output, name, len(names) > 1)
        write_atomically(file, found.text.encode())
        write_atomically(file.with_suffix(".svg"), figure.picture(found, ms, "svg"))
        results.append(_as_json(found, file))
        if not as_json:
            rows = [{"axis": axis, **results[-1]["axes"][axis]} for axis in "xy"]
            print_table([{key: row[key] for key in _HEADINGS} for row in rows], f"{plan.name}: {name}", _HEADINGS)
            click.echo(f"The force step is {found.force_step_N:.2f} N. {found.limit}")
            click.echo(f"{file}: {', '.join(f'{key} {value:g}' for key, value in found.gains.items())}\n")
    if as_json:
        print_json({"machine": plan.name, "compensation": compensation, "designs": results})


def _as_json(design: Design, file: Path) -> dict[str, Any]:
    axes = {}
    for name, axis in zip("xy", design.axes, strict=True):
        m = axis.margins
        axes[name] = {
            "ms": m.ms,
            "ms_at_Hz": m.ms_at_Hz,
            "ms_at_resonance": m.resonance,
            "ms_at_mass": m.mass,
            "gain": m.gain,
            "phase_deg": m.phase_deg,
            "delay_ms": m.delay_s * 1e3,
            "crossover_Hz": m.crossover_Hz,
            "bandwidth_Hz": m.bandwidth_Hz,
            "force_change_N": axis.force_change_N,
            "reversal_um": axis.reversal_m * 1e6,
        }
    return {
        "controller": design.controller,
        "file": str(file),
        "gains": design.gains,
        "axes": axes,
        "force_step_N": design.force_step_N,
        "limit": design.limit,
    }
