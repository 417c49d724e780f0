# SPDX-License-Identifier: Apache-2.0
"""`kontur run`: a file or a shape, under one or more controllers."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click
from click.core import ParameterSource

from kontur.cli import EXIT_INTERRUPTED
from kontur.cli.options import (
    KEY_VALUE,
    POSITIVE,
    NumberRange,
    check_output,
    held_by_signals,
    interruptible,
    parameter_values,
    progress_bar,
    target_options,
)
from kontur.cli.output import print_json, print_table, print_warnings, warnings_json
from kontur.drive import scope as scopes
from kontur.drive.device import CONTROLLERS
from kontur.drive.scope import Setup
from kontur.drive.target import Target
from kontur.errors import FileError
from kontur.path import programs, shapes
from kontur.path.geometry import Program
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.report import capture_file
from kontur.runs import log as logs
from kontur.runs.log import RunLog
from kontur.runs.runner import RunResult, run
from kontur.runs.summary import summary

F = TypeVar("F", bound=Callable[..., Any])

# Options of each shape, in mm (laps: turns), and what they are when not given.
SHAPES: dict[str, dict[str, float]] = {
    "circle": {"radius": 20.0, "laps": 1.0},
    "ellipse": {"half_width": 30.0, "half_height": 15.0, "laps": 1.0},
    "eight": {"size": 40.0, "laps": 1.0},
    "square": {"side": 40.0, "corner_radius": 5.0},
    "spiral": {"inner": 0.0, "outer": 20.0, "pitch": 5.0},
}
_MAY_BE_0 = ("corner_radius", "inner")
_NOT_IN_COMMAND = ("log", "report", "as_json", "controller", "scope_out")


def _shape_option(name: str, text: str) -> Callable[[F], F]:
    shapes_with = [f"{shape} {defaults[name]:g}" for shape, defaults in SHAPES.items() if name in defaults]
    unit = "" if name == "laps" else ", mm"
    kind = NumberRange(min=0) if name in _MAY_BE_0 else POSITIVE
    return click.option(
        f"--{name.replace('_', '-')}", type=kind, help=f"{text}{unit} (default: {', '.join(shapes_with)})."
    )


def _program(source: str, feed_mm_s: float | None, sizes: dict[str, float | None]) -> Program:
    feed_mps = None if feed_mm_s is None else feed_mm_s * 1e-3
    given = {name: value for name, value in sizes.items() if value is not None}
    fitting = SHAPES.get(source, {})
    for name in given:
        if name not in fitting:
            raise click.UsageError(f"--{name.replace('_', '-')} does not belong to {source}")
    if source not in SHAPES:
        if not Path(source).exists():
            raise FileError(source, f"no such file, and no shape either; shapes are {', '.join(SHAPES)}")
        return programs.load(source, feed_mps)
    if feed_mps is None:
        raise click.UsageError(f"{source} needs a feed: --feed MM_PER_S")
    values = {
        (name if name == "laps" else f"{name}_m"): value * (1.0 if name == "laps" else 1e-3)
        for name, value in (fitting | given).items()
    }
    program: Program = getattr(shapes, source)(**values, feed_mps=feed_mps)
    return program


def _command(ctx: click.Context, controller: str) -> str:
    """The command that makes one run again: what was given, without where its output went."""
    words = ["kontur", "run", str(ctx.params["source"]), "--controller", controller]
    for param in ctx.command.params:
        name = param.name or ""
        if not isinstance(param, click.Option) or name in _NOT_IN_COMMAND:
            continue
        if ctx.get_parameter_source(name) in (ParameterSource.DEFAULT, None):
            continue
        value = ctx.params[name]
        if param.is_flag:
            words.append(param.opts[-1])
            continue
        for one in value if param.multiple else [value]:
            words += [param.opts[-1], "=".join(one) if isinstance(one, tuple) else str(one)]
    return shlex.join(words)


def log_path(path: Path, controller: str, several: bool) -> Path:
    """Where the log of one of several controllers goes: its name is put before the suffix."""
    return path.with_name(f"{path.stem}-{controller}{path.suffix}") if several else path


def _scope_setup(signals: str | None, trigger: str | None, pre: float, divider: int, out: Path | None) -> Setup | None:
    """Raises ParameterError; UsageError when only one of --scope and --scope-out is there."""
    if (signals is None) != (out is None):
        raise click.UsageError("--scope says what to record and --scope-out where it goes: give both")
    if signals is None:
        if trigger is not None:
            raise click.UsageError("--scope-trigger is for what --scope records: give it, too")
        return None
    return Setup(scopes.names(signals), scopes.trigger(trigger or "now"), pre, divider)


def _save_capture(result: RunResult, controller: str, several: bool, log: Path | None, out: Path | None) -> None:
    """To where it was asked for, or beside the log where a fault or a warning left it."""
    if result.capture is None:
        if out is not None:
            click.echo("The scope has not been triggered in the run.", err=True)
        return
    if out is not None:
        capture_file.save(result.capture, log_path(out, controller, several))
    elif log is not None:
        beside = log_path(log, controller, several)
        what = "fault" if result.fault is not None else "warning"
        for suffix in (".csv", ".png"):
            capture_file.save(result.capture, beside.with_name(f"{beside.stem}-{what}{suffix}"))


@click.command(name="run")
@click.argument("source", metavar=f"FILE|{'|'.join(SHAPES)}")
@click.option("--feed", type=POSITIVE, metavar="MM_PER_S", help="Speed along a shape or a CSV path of x,y.")
@_shape_option("radius", "Radius")
@_shape_option("half_width", "Half axis along x")
@_shape_option("half_height", "Half axis along y")
@_shape_option("size", "Width")
@_shape_option("side", "Side")
@_shape_option("corner_radius", "Radius of the corners")
@_shape_option("inner", "Inner radius")
@_shape_option("outer", "Outer radius")
@_shape_option("pitch", "Distance from turn to turn")
@_shape_option("laps", "Laps")
@click.option(
    "--controller",
    type=click.Choice([*CONTROLLERS, "all"]),
    multiple=True,
    default=["ccu"],
    show_default=True,
    help="Controller; several options, several runs.",
)
@click.option(
    "--accel", type=POSITIVE, metavar="M_PER_S2", help="Acceleration limit of both axes instead of the machine's."
)
@click.option("--jerk", type=POSITIVE, metavar="M_PER_S3", help="Jerk limit of both axes instead of the machine's.")
@click.option(
    "--set", "parameters", type=KEY_VALUE, multiple=True, metavar="NAME=VALUE", help="Set a parameter before."
)
@click.option(
    "--override",
    type=NumberRange(0.1, 120.0),
    default=100.0,
    show_default=True,
    metavar="PERCENT",
    help="Feed override, to 120; above 100 accelerations grow with its square, beyond what was planned.",
)
@click.option(
    "--approach", is_flag=True, help="Let a real drive go to the start of the path first, in a straight line."
)
@click.option("--resume", is_flag=True, help="Go on with this path where a fault, or Ctrl-C, stopped the drive on it.")
@click.option("--log", type=click.Path(dir_okay=False, path_type=Path), help="Log to this .csv or .mf4 file.")
@click.option("--report", type=click.Path(dir_okay=False, path_type=Path), help="Write an HTML report to this file.")
@click.option(
    "--scope", "scope_signals", metavar="NAME,...", help="Record these signals of the servo (see kontur scope)."
)
@click.option("--scope-trigger", metavar="now|fault|NAME>LEVEL|NAME<LEVEL",
              help="Around what (default: now, the start of the path).")  # fmt: skip
@click.option("--scope-pre", type=float, default=0.5, show_default=True, help="Share of it before the trigger.")
@click.option("--scope-divider", type=click.IntRange(1, 10_000), default=1, show_default=True,
              help="Control periods from frame to frame.")  # fmt: skip
@click.option("--scope-out", type=click.Path(dir_okay=False, path_type=Path),
              help="Save what was recorded to this .png, .svg, .csv or .mf4 file.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@target_options
@click.pass_context
def command(
    ctx: click.Context,
    /,
    *,
    target: Target,
    source: str,
    feed: float | None,
    controller: tuple[str, ...],
    accel: float | None,
    jerk: float | None,
    parameters: tuple[tuple[str, str], ...],
    override: float,
    approach: bool,
    resume: bool,
    log: Path | None,
    report: Path | None,
    scope_signals: str | None,
    scope_trigger: str | None,
    scope_pre: float,
    scope_divider: int,
    scope_out: Path | None,
    as_json: bool,
    **sizes: float | None,
) -> None:
    """Run FILE (G-code, or CSV with t,x,y or x,y) or a shape, and tell the contour error.

    SIGUSR1 holds the drive on the path, SIGUSR2 lets it go on. Ctrl-C stops it there; so do the faults of the kind
    "path stop" (docs/faults.md), and the end of this program. As long as the drive has power and the axes are not
    moved, the same command with --resume goes on from there. The log is complete up to where it stopped,
    and so it is when a fault ends the run: what the drive recorded of the 500 ms before is put beside the log then
    (LOG-fault.csv, .png). What the drive warns of is told at the end, with its remedy; where it captures that
    (contour tunnel), too, it is put there as LOG-warning.
    """
    if resume and (target.in_process or len(controller) > 1 or "all" in controller):
        raise click.UsageError(
            "--resume goes on with the one path that a drive has left: name its bus (-i, -c), and one controller"
        )
    check_output(log, ".csv", ".mf4")
    check_output(report, ".html")
    check_output(scope_out, *capture_file.SUFFIXES)
    setup = _scope_setup(scope_signals, scope_trigger, scope_pre, scope_divider, scope_out)
    values = parameter_values(parameters)
    program = _program(source, feed, sizes)
    motion = limits(target.machine, accel, jerk)
    with progress_bar("planning") as progress:
        trajectory = plan(program, motion, progress, travel_m=target.machine.soft_limits_m)

    controllers = CONTROLLERS if "all" in controller else tuple(dict.fromkeys(controller))
    runs: list[RunLog] = []
    completed, fault = True, None
    warnings: dict[int, None] = {}  # each once, whichever runs it came in
    for name in controllers:
        with progress_bar(name) as progress, interruptible() as stop_requested, held_by_signals() as held:
            result = run(
                trajectory,
                name,
                target,
                parameters=values,
                command=_command(ctx, name),
                approach=motion if approach else None,
                progress=progress,
                stop_requested=stop_requested,
                rate=lambda held=held: 0.0 if held() else override / 100.0,  # type: ignore[misc]
                raise_fault=False,
                scope=setup,
                resume=resume,
            )
        runs.append(result.log)
        if log is not None:
            logs.write(result.log, log_path(log, name, len(controllers) > 1))
        _save_capture(result, name, len(controllers) > 1, log, scope_out)
        warnings |= dict.fromkeys(result.warnings)
        completed, fault = result.completed, result.fault
        if not completed:
            break
    if report is not None:
        from kontur.report.page import write_report

        write_report(report, runs)

    rows = [{"controller": run_log.meta["controller"], **summary(run_log)} for run_log in runs]
    if as_json:
        print_json({"program": program.name, "duration_s": trajectory.duration_s, "runs": rows,
                    "warnings": warnings_json(warnings)})  # fmt: skip
    else:
        print_table(rows, f"{program.name}, {trajectory.duration_s:.2f} s: contour error")
    print_warnings(warnings)
    if fault is not None:
        raise fault
    if not completed:
        more = "" if target.in_process else " The same command with --resume goes on from there."
        click.echo(f"Interrupted: the drive stopped on the path.{more}", err=True)
        sys.exit(EXIT_INTERRUPTED)
