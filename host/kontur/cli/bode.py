# SPDX-License-Identifier: Apache-2.0
"""`kontur bode`: the frequency response of an axis, measured by its drive."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from kontur.cli.motion_options import params_option
from kontur.cli.options import (
    CONTROLLER,
    POSITIVE,
    NumberRange,
    check_output,
    drive_of,
    interruptible,
    parameter_option,
    parameter_values,
    parameters_of,
    progress_bar,
    target_options,
)
from kontur.cli.output import print_json, print_table
from kontur.drive.axes import AXES
from kontur.drive.controllers import CONTROLLERS, described
from kontur.files import write_atomically

if TYPE_CHECKING:
    from kontur.commissioning.response import Response, Setup
    from kontur.drive.target import Target

_FORCE_SHARE = 0.15  # of the force limit, where no force is given
_HEADINGS = {
    "hz": "Hz",
    "plant_um_per_N": "|P| µm/N",
    "plant_deg": "phase °",
    "plant_error": "± %",
    "sensitivity": "|S|",
    "sensitivity_error": "±",
    "loop": "|L|",
    "coherence": "coherence",
}


@click.command(name="bode")
@click.argument("axis", type=click.Choice(AXES))
@click.option("--from", "low_hz", type=NumberRange(1.0, 5000.0), default=5.0, show_default=True, metavar="HZ",
              help="Lower end of the band.")  # fmt: skip
@click.option("--to", "high_hz", type=NumberRange(1.0, 20_000.0), default=1000.0, show_default=True, metavar="HZ",
              help="Upper end of the band, below half the control rate.")  # fmt: skip
@click.option("--points", type=click.IntRange(1, 400), default=48, show_default=True, help="Frequencies in the band.")
@click.option("--force", "force_N", type=POSITIVE, metavar="N",
              help="All amplitudes that act together.  [default: 15 % of the force limit]")  # fmt: skip
@click.option("--speed", type=NumberRange(0.0, 1000.0), default=30.0, show_default=True, metavar="MM_PER_S",
              help="Speed to and fro meanwhile, so that friction is constant; 0: at rest.")  # fmt: skip
@click.option("--window", "window_s", type=NumberRange(0.02, 5.0), default=1.0, show_default=True, metavar="SECONDS",
              help="Time over which a frequency is correlated; its inverse is the resolution.")  # fmt: skip
@click.option("--windows", type=click.IntRange(2, 50), default=2, show_default=True,
              help="Windows of each frequency in each direction; their scatter is the uncertainty.")  # fmt: skip
@click.option("--controller", type=CONTROLLER, help=f"Controller: {described()}.  [default: as it is]")
@parameter_option
@params_option
@click.option("-o", "--output", "outputs", multiple=True, type=click.Path(dir_okay=False, path_type=Path),
              help="Save as table (.csv), as picture (.png), or as one for a column of a paper (.svg, .pdf). "
              "Can be repeated.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@target_options
def command(
    *,
    axis: str,
    target: Target,
    low_hz: float,
    high_hz: float,
    points: int,
    force_N: float | None,
    speed: float,
    window_s: float,
    windows: int,
    controller: str | None,
    parameters: tuple[tuple[str, str], ...],
    params: Path | None,
    outputs: tuple[Path, ...],
    as_json: bool,
) -> None:
    """Measure machine, loop and sensitivity of AXIS (x or y), with its loop closed.

    The drive adds a small force to that of its controller, and the axis moves to and fro within its soft limits. Ctrl-C
    stops it.
    """
    for file in outputs:
        check_output(file, ".svg", ".pdf", ".png", ".csv")
    if low_hz >= high_hz:
        raise click.UsageError(f"--from {low_hz:g} must be below --to {high_hz:g}")
    if controller == "all":
        raise click.UsageError("--controller: one of them; a response is of one controller")
    from kontur.commissioning import response

    values = (parameters_of(params) if params is not None else {}) | parameter_values(parameters)
    hz = response.lines(low_hz, high_hz, points, window_s)
    with drive_of(target) as device, interruptible() as stop_requested, progress_bar(f"axis {axis}") as progress:
        device.parameters.set(values)
        if controller is not None:
            device.select_controller(controller)
        name = CONTROLLERS[int(device.read("controller.select"))]
        limit_N = float(device.read(f"plant_{axis}.force_limit"))
        setup = response.Setup(hz, force_N or _FORCE_SHARE * limit_N, speed * 1e-3, window_s, windows)
        try:
            with device.axes.enabled():
                found = response.measure(device, axis, setup, progress, stop_requested)
        except KeyboardInterrupt:
            click.echo("Interrupted: the excitation has ended, and the axes have slowed down.", err=True)
            sys.exit(stop_requested.exit_code)
    _show(found, setup, axis, name, as_json, outputs)


def _show(found: Response, setup: Setup, axis: str, controller: str, as_json: bool, outputs: tuple[Path, ...]) -> None:
    from kontur.commissioning import bode

    rows, margins = bode.rows(found), bode.margins(found)
    for file in outputs:
        if file.suffix.lower() == ".csv":
            write_atomically(file, bode.table(found).encode())
        else:
            from kontur.commissioning import figure

            form = file.suffix.lower().removeprefix(".")
            draw = figure.picture if form == "png" else figure.for_column
            write_atomically(file, draw(found, f"axis {axis}, {controller}", form))
    if as_json:
        result: dict[str, Any] = {
            "axis": axis,
            "controller": controller,
            "force_N": setup.force_N,
            "speed_mps": setup.speed_mps,
            "window_s": setup.window_s,
            "margins": margins,
            "points": bode.points(found),
        }
        print_json(result)
        return
    print_table(rows, f"axis {axis}, {controller}", _HEADINGS)
    known = {key: value for key, value in margins.items() if value is not None}
    click.echo(
        f"Ms {known['ms']:.2f} at {known['ms_at_Hz']:.0f} Hz; "
        + "; ".join(f"{bode.MARGINS[key]} {value:.3g}" for key, value in known.items() if key in bode.MARGINS)
    )
