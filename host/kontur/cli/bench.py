# SPDX-License-Identifier: Apache-2.0
"""`kontur bench`: speed of simulation, streaming and planning on this machine, and load of the bus."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from kontur.can import bus_load
from kontur.cli.options import bus_options, interruptible, progress_bar, simulated_target_options
from kontur.cli.output import print_json, print_table, print_warnings, warnings_json
from kontur.errors import StreamError
from kontur.machine import told_text

if TYPE_CHECKING:
    from kontur.drive.target import Target


_NAMES = {"contour_mean_um": "estimated_mean_um", "contour_max_um": "estimated_max_um"}


@click.group(name="bench")
def command() -> None:
    """Measure the speed of simulation, streaming and planning on this machine."""


@command.command(name="sim")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@simulated_target_options
def sim_command(*, as_json: bool, target: Target) -> None:
    """Measure control periods a second of the simulated drive: NumPy model, library, and library over CAN frames."""
    from kontur.experiments.bench_sim import bench

    result = bench(target) | {"told": target.told}
    if as_json:
        print_json(result)
        return
    oracle = result["oracle_periods_per_s"]
    for name, what in (("oracle", "NumPy stepping"), ("direct", "in process, direct"), ("can", "in process, over CAN")):
        rate = result[f"{name}_periods_per_s"]
        click.echo(f"{what:<22}{rate:>12,.0f} control periods/s  {rate / oracle:>8.1f} x")
    click.echo(f"The drive is {told_text(target.told, target.compensation)}.")


@command.command(name="stream")
@click.option(
    "--knots",
    type=click.IntRange(1000, 3_000_000),
    default=100_000,
    show_default=True,
    help="Knots (control points of the path) to stream, one a millisecond of path time.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@bus_options
def stream_command(*, knots: int, as_json: bool, target: Target) -> None:
    """Stream knots, and measure how many were lost and sent again, and the time that the host needs for it.

    The axes move: circles of 4 mm diameter at 20 mm/s, to the left of where they stand. Without bus options the drive
    is a process of its own on slcan, whose time passes with SYNC; with -i kontur -c sim it is in this process. Either
    is told all of its machine.
    """
    from kontur.experiments import bench_stream

    with progress_bar("streaming") as progress, interruptible() as stop_requested:
        result = bench_stream.bench(target, knots, progress, stop_requested)
    warnings = result.pop("warnings")
    if as_json:
        print_json(result | {"warnings": warnings_json(warnings)})
    else:
        for name, value in result.items():
            if value is not None and not isinstance(value, dict):
                click.echo(f"{_NAMES.get(name, name):<24}{f'{value:,.4g}' if isinstance(value, float) else value}")
    print_warnings(warnings)
    if result["error"] is not None:
        raise StreamError(result["error"])


@command.command(name="bus")
@click.option(
    "-b",
    "--bitrate",
    type=click.IntRange(min=10_000),
    default=bus_load.BITRATE,
    show_default=True,
    help="Bit rate of the bus, bit/s.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def bus_command(*, bitrate: int, as_json: bool) -> None:
    """Compute from the EDS the worst-case share of the bus that the default PDOs take while knots are streamed."""
    loads = bus_load.loads(bitrate)
    total = sum(load.share for load in loads)
    if as_json:
        print_json({"bitrate": bitrate, "frames": [vars(load) for load in loads], "share": total})
        return
    rows = [
        {
            "frame": load.name,
            "per s": round(load.rate_hz),
            "bytes": load.data_bytes,
            "bits": load.bits,
            "share %": load.share * 100.0,
        }
        for load in loads
    ]
    rows.append(
        {
            "frame": "all",
            "per s": round(sum(load.rate_hz for load in loads)),
            "bytes": None,
            "bits": None,
            "share %": total * 100.0,
        }
    )
    print_table(rows, title=f"{bitrate:,} bit/s, worst case of stuffing")


@command.command(name="plan")
@click.option(
    "--lines",
    type=click.IntRange(1000, 3_000_000),
    default=100_000,
    show_default=True,
    help="Lines of the file that is read and planned; its first knots are timed from when it is opened.",
)
@click.option(
    "--kind",
    type=click.Choice(("lines", "arcs", "raster", "spiral")),
    default="lines",
    show_default=True,
    help="What the file has: lines in rows of waves; two arcs after each such line; a laser's raster with an S in each "
    "line; a spiral of lines without any stop on its way.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def plan_command(*, lines: int, kind: str, as_json: bool) -> None:
    """Plan paths of short lines, and compare their times with the least ones; read and plan a long file.

    The limits are those of Table 1 at 100 mm/s, the tolerance is 10 µm. The least times are those of the smooth curves
    that the lines stand for. Where corners are true they are those with exact stops ("stops"), and of any motion within
    the tolerance, which need not stop.
    """
    from kontur.experiments.bench_plan import bench

    with progress_bar("planning") as progress:
        result = bench(lines, progress, kind)
    if as_json:
        print_json(result)
        return
    headings = {"duration_s": "s", "least_s": "least s", "deviation_um": "off µm"}
    print_table(result["paths"], title="Times of paths", headings=headings)
    click.echo(
        f"{result['lines']} lines ({kind}): read in {result['read_s']:.1f} s, planned in {result['plan_s']:.1f} s, "
        f"the first knots after {result['first_knots_s']:.2f} s, {result['us_per_line']:.0f} µs a line; "
        f"the motion takes {result['motion_s']:.1f} s; "
        f"{result['peak_MiB']:.0f} MiB at most"
    )
