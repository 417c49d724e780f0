# SPDX-License-Identifier: Apache-2.0
"""`kontur check`: what a file holds, and what it is refused for."""

from __future__ import annotations

import dataclasses
import sys
from typing import TYPE_CHECKING, Any

import click

from kontur import machine as machines
from kontur.cli.motion_options import accel_option, jerk_option, tolerance_option
from kontur.cli.options import MACHINE, progress_bar
from kontur.cli.output import print_json, print_table
from kontur.cli.path_options import full_s_option, laser_option
from kontur.cli.program_options import Source, program_options
from kontur.errors import FileError, KonturError, visible

if TYPE_CHECKING:
    from kontur.path.geometry import Program
    from kontur.planning.bounds import Limits
    from kontur.planning.planner import Trajectory

EXIT_REFUSED = 1
_SLOWEST = {"place": "slowest", "asked": "feed mm/s", "reached": "reached", "lost": "lost s", "by": "limited by"}
_EVENTS = {"word": "event", "count": "times", "line": "first in line", "time_s": "at s"}


@click.command(name="check")
@program_options
@click.option(
    "--machine",
    type=MACHINE,
    default=str(machines.DEFAULT),
    show_default="Table 1 of the paper",
    metavar="MACHINE.toml",
    help="The machine whose limits and travel are meant.",
)
@accel_option
@jerk_option
@tolerance_option
@laser_option
@full_s_option
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def command(
    *,
    source: Source,
    machine: str,
    accel: float | None,
    jerk: float | None,
    tolerance: float | None,
    laser: bool,
    full_s: float,
    as_json: bool,
) -> None:
    """Check FILE (G-code, or CSV) or a shape as `kontur run` would take it, without a drive: nothing moves.

    All that the file is refused for is printed at once, each kind with its first line; the exit code is 1 then.
    Otherwise extent, time, feeds that are not reached, the slowest places, and what the program switches.
    """
    from kontur.path.smoothing import toleranced
    from kontur.planning.bounds import clipped, limits
    from kontur.planning.outputs import Tool, of_words, words

    plan = machines.load(machine)
    bounds = limits(plan, accel, jerk)
    result: dict[str, Any] = {"file": source.name, "machine": plan.name, "refusals": []}
    trajectory = None
    try:
        program, refusals = source.check()
        result["refusals"] = [_refusal(error, count) for error, count in refusals]
        result["notes"] = [*source.notes(), *program.notes, *clipped(bounds)]
        if not refusals:
            trajectory = _planned(
                toleranced(program, None if tolerance is None else tolerance * 1e-3), bounds, plan.soft_limits_m, result
            )
            result["output_changes"] = len(of_words(words(trajectory, Tool(full_s, laser))))
    except KonturError as error:  # of the whole file, or of its path
        result["refusals"].append(_refusal(error, 1))
    if as_json:
        print_json(result)
    else:
        _print(result, trajectory)
    if result["refusals"]:
        sys.exit(EXIT_REFUSED)


def _refusal(error: KonturError, count: int) -> dict[str, Any]:
    """One kind of refusal, in the form of print_json()."""
    if isinstance(error, FileError):
        return {"line": error.line, "word": error.word, "problem": error.problem, "count": count}
    return {"line": None, "word": None, "problem": str(error), "count": count}


def _planned(
    program: Program, bounds: Limits, travel_m: tuple[tuple[float, float], tuple[float, float]], result: dict[str, Any]
) -> Trajectory:
    """Plan the program; put what is known of it into `result` as soon as it is. Raises PathError."""
    from kontur.path.smoothing import TOLERANCE_M
    from kontur.planning.checks import extent_m
    from kontur.planning.outputs import passed_over
    from kontur.planning.planner import plan

    least, greatest = extent_m(program) * 1e3
    result |= {
        "moves": len(program.moves),
        "length_mm": program.length_m * 1e3,
        "extent_mm": {axis: [float(least[i]), float(greatest[i])] for i, axis in enumerate("xy")},
        "travel_mm": {axis: [1e3 * end for end in travel_m[i]] for i, axis in enumerate("xy")},
    }
    with progress_bar("planning") as progress:
        trajectory = plan(program, bounds, progress, travel_m, TOLERANCE_M)
    feed = trajectory.feed
    result |= {
        "duration_s": trajectory.duration_s,
        "path_deviation_um": trajectory.deviation_m * 1e6,
        "rapid_deviation_um": trajectory.rapid_deviation_m * 1e6,
        "feed": None if feed is None else dataclasses.asdict(feed),
        "events": _events(trajectory),
    }
    result["notes"] += passed_over(trajectory)
    return trajectory


def _events(trajectory: Trajectory) -> list[dict[str, Any]]:
    """Each kind of word that switches something, how often it stands there, and where first: line and time."""
    from kontur.path.geometry import KNOT_S
    from kontur.planning.outputs import boundaries

    arrives, _ = boundaries(trajectory)
    return [
        {"word": kind, "count": count, "line": first.line, "time_s": float(arrives[first.before]) * KNOT_S}
        for kind, (count, first) in trajectory.program.events.kinds().items()
    ]


def _print(result: dict[str, Any], trajectory: Trajectory | None) -> None:
    for refusal in result["refusals"]:
        word = "" if refusal["word"] is None else refusal["word"]
        times = f"{' ' if word else ''}×{refusal['count']}, " if refusal["count"] > 1 else " " if word else ""
        first = "first in" if refusal["count"] > 1 else "in"
        line = "" if refusal["line"] is None else f"{first} line {refusal['line']}: "
        click.echo(visible(f"refused: {word}{times}{line}{refusal['problem']}"))
    if "extent_mm" in result:
        x, y = (result["extent_mm"][axis] for axis in "xy")
        click.echo(
            f"{result['moves']} moves of {result['length_mm']:.1f} mm together, "
            f"in x from {x[0]:.3f} to {x[1]:.3f} mm, in y from {y[0]:.3f} to {y[1]:.3f} mm"
        )
    if trajectory is not None:
        click.echo(f"takes {trajectory.duration_s:.2f} s on {result['machine']}")
        if trajectory.smoothed:
            click.echo(trajectory.smoothed)
        if trajectory.feed is not None:
            click.echo(str(trajectory.feed))
            rows = [
                {"place": slow.place, "asked": slow.asked_mps * 1e3, "reached": slow.reached_mps * 1e3,
                 "lost": slow.lost_s, "by": slow.by}
                for slow in trajectory.feed.slowest
            ]  # fmt: skip
            if rows:
                print_table(rows, headings=_SLOWEST)
        if result["events"]:
            print_table(result["events"], headings=_EVENTS)
            click.echo(f"outputs change {result['output_changes']} times")
    for note in result.get("notes", []):
        click.echo(note)
    if not result["refusals"]:
        click.echo("`kontur run` takes it.")
