# SPDX-License-Identifier: Apache-2.0
"""`kontur circle-test`: circles in both senses, and the figures of ISO 230-4."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from kontur.cli.live_page import view
from kontur.cli.motion_options import accel_option, approach_option, jerk_option, params_option
from kontur.cli.options import (
    CONTROLLER,
    POSITIVE,
    StopRequest,
    check_output,
    interruptible,
    parameter_option,
    parameter_values,
    parameters_of,
    progress_bars,
    target_options,
)
from kontur.cli.output import print_json, print_table, print_warnings
from kontur.drive.controllers import described

if TYPE_CHECKING:
    from kontur.drive.target import Target
    from kontur.experiments.circle_test import Setup
    from kontur.planning.bounds import Limits
    from kontur.runs.circle_record import Circle, CircleTest
    from kontur.runs.runner import RunResult

DEFAULT_FEEDS = (20.0, 100.0)
_REACHED = 0.99  # of a feed


@click.command(name="circle-test")
@click.option("--radius", type=POSITIVE, default=20.0, show_default=True, metavar="MM", help="Radius of the circle.")
@click.option(
    "--centre", type=float, nargs=2, default=(0.0, 0.0), metavar="X Y", help="Its centre in mm (default: 0 0)."
)
@click.option("--feed", "feeds", type=POSITIVE, multiple=True, default=DEFAULT_FEEDS, show_default=True,
              metavar="MM_PER_S", help="Feed; give it several times for several.")  # fmt: skip
@click.option("--lead", type=POSITIVE, default=0.5, show_default=True, metavar="TURNS",
              help="Turns before and after the one that is measured.")  # fmt: skip
@click.option("--controller", type=CONTROLLER, default="ccu", show_default=True, help=f"Controller: {described()}.")
@accel_option
@jerk_option
@parameter_option
@params_option
@approach_option
@click.option("--report", type=click.Path(dir_okay=False, path_type=Path), help="Write an HTML report here.")
@click.option("--save", type=click.Path(dir_okay=False, path_type=Path),
              help="Keep the test in this .json file, for --compare.")  # fmt: skip
@click.option("--compare", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE",
              help="Show this earlier test, kept by --save, beside the new one.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON.")
@target_options
def command(
    *,
    radius: float,
    centre: tuple[float, float],
    feeds: tuple[float, ...],
    lead: float,
    controller: str,
    accel: float | None,
    jerk: float | None,
    parameters: tuple[tuple[str, str], ...],
    params: Path | None,
    approach: bool,
    report: Path | None,
    save: Path | None,
    compare: Path | None,
    as_json: bool,
    target: Target,
) -> None:
    """Run circles counter-clockwise and clockwise, and show the figures of ISO 230-4.

    These are the circular deviations G and G(b), the radial deviation F and the mean of both senses D. The squareness
    and the scales of the axes, their backlash and the spikes at their reversals are estimated from the same circles.

    A drive that is simulated in this process gives two sets of figures: by the true position, and by the position that
    the drive reports. On a bus there are the latter alone, which do not see what the encoders do not see.
    """
    check_output(report, ".html", ".svg", ".pdf")
    check_output(save, ".json")
    from kontur.experiments.circle_test import Setup
    from kontur.planning.bounds import limits
    from kontur.runs import circle_record

    if "all" in controller:
        raise click.UsageError("--controller: a test is of one controller; compare two tests with --compare")
    before = circle_record.load(compare) if compare is not None else None
    if before is not None and abs(before.radius_mm - radius) > 1e-6 * radius:
        raise click.UsageError(f"{compare} is of radius {before.radius_mm:g} mm, this test of {radius:g} mm")
    values = parameters_of(params) if params is not None else {}
    bounds = limits(target.machine, accel, jerk)
    setup = Setup(
        radius * 1e-3,
        (centre[0] * 1e-3, centre[1] * 1e-3),
        lead,
        controller,
        values | parameter_values(parameters),
        bounds if approach else None,
    )
    feeds = tuple(dict.fromkeys(feeds))
    done: list[tuple[Circle, tuple[RunResult, RunResult]]] = []
    try:
        with interruptible() as stop_requested:
            _run(setup, feeds, bounds, target, stop_requested, done)
    except KeyboardInterrupt:
        click.echo("Interrupted: the drive stopped on the circle.", err=True)
        sys.exit(stop_requested.exit_code)
    finally:
        if done:
            test = circle_record.CircleTest(radius, _conditions(setup, done[0][1][0]), tuple(one for one, _ in done))
            asked = zip(feeds, done, strict=False)
            notes = [str(runs[0].log.meta["feed"]) for feed, (one, runs) in asked if one.feed_mmps < _REACHED * feed]
            _show(test, before, as_json, notes)
            print_warnings(dict.fromkeys(code for _, both in done for run in both for code in run.warnings))
            if save is not None:
                circle_record.save(test, save)
            if report is not None:
                from kontur.report.circle_page import write_circle_report

                write_circle_report(report, test, before)


def _run(
    setup: Setup,
    feeds: tuple[float, ...],
    bounds: Limits,
    target: Target,
    stop_requested: StopRequest,
    done: list[tuple[Circle, tuple[RunResult, RunResult]]],
) -> None:
    """Each circle is in `done` when it is complete, also where a later one fails."""
    from kontur.experiments.circle_test import circle_test

    with progress_bars() as progress:
        feeds_mps = [feed * 1e-3 for feed in feeds]
        for one in circle_test(setup, feeds_mps, bounds, target, progress, stop_requested, view()):
            done.append(one)


def _conditions(setup: Setup, run: RunResult) -> dict[str, Any]:
    """What was measured on what, from the log of a run."""
    meta = run.log.meta
    known = {
        name: meta[name] for name in ("machine", "told", "compensation", "seed", "firmware", "num") if name in meta
    }
    x, y = (value * 1e3 for value in setup.centre_m)
    return {"controller": setup.controller, "centre, mm": f"{x:g}, {y:g}", "turns before and after": setup.lead} | known


def _show(test: CircleTest, before: CircleTest | None, as_json: bool, notes: list[str]) -> None:
    from kontur.runs import circle_record

    if as_json:
        print_json(circle_record.figures(test) | ({} if before is None else {"before": circle_record.figures(before)}))
        return
    headings = circle_record.HEADINGS
    what = f"Circle of radius {test.radius_mm:g} mm, {test.conditions['controller']}"
    print_table(circle_record.rows(test, before, circle_record.DEVIATIONS), f"{what}: deviations, µm", headings)
    print_table(circle_record.rows(test, before, circle_record.CAUSES), "Causes, estimated", headings)
    print_table(circle_record.spike_rows(test, before), "Spikes at the reversals: height µm, width", headings)
    for note in notes:
        click.echo(f"{note[:1].upper()}{note[1:]}.")
