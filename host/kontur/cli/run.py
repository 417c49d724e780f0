# SPDX-License-Identifier: Apache-2.0
"""`kontur run`: a file or a shape, under one or more controllers."""

from __future__ import annotations

import dataclasses
import importlib
import itertools
import shlex
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from kontur.cli.holds import Release
from kontur.cli.live_page import live_page, panel, view
from kontur.cli.motion_options import accel_option, approach_option, jerk_option, params_option, tolerance_option
from kontur.cli.options import (
    CONTROLLER,
    SIGNALS,
    NumberRange,
    StopRequest,
    check_output,
    grouped,
    held_by_signals,
    interruptible,
    parameter_option,
    parameter_values,
    parameters_of,
    target_options,
)
from kontur.cli.output import print_json, print_table, print_warnings, warnings_json
from kontur.cli.path_options import full_s_option, laser_option
from kontur.cli.planned import planned
from kontur.cli.program_options import Source, program_options
from kontur.cli.run_progress import run_progress
from kontur.drive.controllers import CONTROLLERS, described
from kontur.errors import KonturError
from kontur.runs import RETURN_MAX_M

if TYPE_CHECKING:
    from kontur.drive.scope import Setup
    from kontur.drive.target import Target
    from kontur.path.geometry import Program
    from kontur.planning.ahead import Planned
    from kontur.planning.planner import Trajectory
    from kontur.runs.runner import RunOptions, RunResult

_NOT_IN_COMMAND = ("log", "report", "as_json", "live", "controller", "scope_out")


@dataclass(frozen=True)
class Motion:
    """How the path is run: limits in place of the machine's, tolerance in mm, parameters, feed override in %, and from
    where."""

    accel: float | None
    jerk: float | None
    tolerance: float | None
    parameters: tuple[tuple[str, str], ...]
    params: Path | None
    override: float
    approach: bool
    resume: bool
    laser: bool
    full_s: float
    yes: bool


@dataclass(frozen=True)
class Output:
    """Where the result goes."""

    log: Path | None
    report: Path | None
    as_json: bool
    live: bool


@dataclass(frozen=True)
class Recording:
    """What the drive's scope records, and where that goes."""

    setup: Setup | None
    out: Path | None


def _output(log: Path | None, report: Path | None, as_json: bool, live: bool) -> Output:
    check_output(log, ".csv", ".mf4")
    check_output(report, ".html")
    return Output(log, report, as_json, live)


def _recording(
    scope_signals: str | None, scope_trigger: str | None, scope_pre: float, scope_divider: int, scope_out: Path | None
) -> Recording:
    """Raises ParameterError; UsageError when only one of --scope and --scope-out is there."""
    from kontur.drive import scope
    from kontur.report import capture_file

    check_output(scope_out, *capture_file.SUFFIXES)
    if (scope_signals is None) != (scope_out is None):
        raise click.UsageError("--scope says what to record and --scope-out where it goes: give both")
    if scope_signals is None:
        if scope_trigger is not None:
            raise click.UsageError("--scope-trigger is for what --scope records: give it, too")
        return Recording(None, None)
    trigger = scope.trigger(scope_trigger or "now")
    return Recording(scope.Setup(scope.names(scope_signals), trigger, scope_pre, scope_divider), scope_out)


_motion_options = grouped(
    "motion",
    Motion,
    accel_option,
    jerk_option,
    tolerance_option,
    parameter_option,
    params_option,
    click.option(
        "--override",
        type=NumberRange(0.1, 120.0),
        default=100.0,
        show_default=True,
        metavar="PERCENT",
        help="Feed override, at most 120. Above 100 the accelerations grow with its square, beyond the planned ones.",
    ),
    approach_option,
    click.option(
        "--resume",
        is_flag=True,
        help="Go on with this path where a fault, or Ctrl-C, stopped the drive on it. Axes that have crept go back, at "
        f"most {RETURN_MAX_M * 1e3:g} mm.",
    ),
    laser_option,
    full_s_option,
    click.option("--yes", is_flag=True, help="Do not wait where the program holds the path (M0, M1, M6)."),
)
_scope_options = grouped(
    "recording",
    _recording,
    click.option(
        "--scope",
        "scope_signals",
        type=SIGNALS,
        metavar="NAME,...",
        help="Record these signals in the drive; `kontur scope --list` lists all.",
    ),
    click.option(
        "--scope-trigger",
        metavar="now|fault|NAME>LEVEL|NAME<LEVEL",
        help="What the recording is around (default: now, the start of the path).",
    ),
    click.option(
        "--scope-pre", type=float, default=0.5, show_default=True, help="Share of the recording before the trigger."
    ),
    click.option(
        "--scope-divider",
        type=click.IntRange(1, 10_000),
        default=1,
        show_default=True,
        help="Control periods from one recorded frame to the next.",
    ),
    click.option(
        "--scope-out",
        type=click.Path(dir_okay=False, path_type=Path),
        help="Save the recording to this .png, .svg, .csv or .mf4 file.",
    ),
)
_output_options = grouped(
    "output",
    _output,
    click.option("--log", type=click.Path(dir_okay=False, path_type=Path), help="Log to this .csv or .mf4 file."),
    click.option("--report", type=click.Path(dir_okay=False, path_type=Path), help="Write an HTML report here."),
    click.option("--json", "as_json", is_flag=True, help="Print the result as JSON."),
    click.option(
        "--live",
        is_flag=True,
        help="Serve a page for this machine's browser, which shows the run and can hold and stop it. Its address is "
        "printed first. A drive that is simulated in this process runs no faster than the clock then.",
    ),
)


@click.command(name="run")
@program_options
@click.option(
    "--controller",
    type=CONTROLLER,
    multiple=True,
    default=["ccu"],
    show_default=True,
    help=f"Controller, by the paper's name or by the longer one: {described()}. Repeat the option for several runs.",
)
@_motion_options
@_output_options
@_scope_options
@target_options
@click.pass_context
def command(
    ctx: click.Context,
    /,
    *,
    source: Source,
    controller: tuple[str, ...],
    motion: Motion,
    output: Output,
    recording: Recording,
    target: Target,
) -> None:
    """Run FILE (G-code, or CSV with t,x,y or x,y) or a shape, and show the contour error.

    On a drive that is simulated in this process it is the true error of the tool. On a bus nobody knows the true
    position: it is the drive's own estimate.

    SIGUSR1 holds the drive on the path, SIGUSR2 lets it go on. Ctrl-C stops it on the path. So do the faults whose
    reaction is "path stop" (docs/faults.md), and the end of this program. As long as the drive has power, the
    same command with --resume goes on from there; axes that have crept meanwhile go back to the path first.

    SIGTERM and SIGHUP (the terminal is closed) stop it like Ctrl-C; a second Ctrl-C ends the command at once. So does
    a disk that is full stop it.

    The log is written while the drive moves, to NAME-running.csv beside it, which becomes the log at the end. If this
    program is killed, that file stays, and `kontur log` reads it. The drive records the 500 ms before a fault; that is
    saved beside the log as LOG-fault.csv and .png. Warnings of the drive are printed at the end, with their remedies.
    Where a warning is recorded too (contour tunnel), that is saved as LOG-warning.csv and .png.
    """
    from kontur.planning.bounds import clipped, limits

    names = CONTROLLERS if "all" in controller else tuple(dict.fromkeys(controller))
    if motion.resume and (target.in_process or len(names) > 1):
        raise click.UsageError(
            "--resume goes on with the one path on which a drive stopped: name its bus (-i, -c), and one controller"
        )
    if output.live:
        ctx.with_resource(live_page())
    program = source.load()
    path, options = _plan(program, motion, recording, target)
    if motion.resume:
        output = dataclasses.replace(output, log=_of_this_part(output.log), report=_of_this_part(output.report))
        recording = dataclasses.replace(recording, out=_of_this_part(recording.out))
    if output.report is not None:  # now, since modules in C that a second Ctrl-C breaks off while loading may crash
        importlib.import_module("kontur.report.page")
    notes = [*program.notes, *clipped(limits(target.machine, motion.accel, motion.jerk))]
    notes = [*source.notes(), *notes]
    results: list[RunResult] = []
    try:
        with interruptible() as stop_requested:
            for name in names:
                log = log_path(output.log, name, len(names) > 1) if output.log is not None else None
                options_of = dataclasses.replace(options, command=_command(ctx, name), log=log)
                results.append(_run(path, name, target, options_of, motion, stop_requested))
                if not results[-1].completed:
                    break
    except KeyboardInterrupt:
        click.echo("Interrupted.", err=True)
        sys.exit(stop_requested.exit_code)
    finally:
        several = len(names) > 1
        errors = _report(path, results, several, motion, output, recording, notes) if results else []
    if len(results) < len(names):
        click.echo(f"Not run after that: {', '.join(names[len(results) :])}.", err=True)
    last = results[-1]
    told = [error for error in (last.error, last.fault, last.log_problem, *errors) if error is not None]
    for error in told[1:]:
        click.echo(f"Error: {error}", err=True)
    if told:
        raise told[0]
    if not last.completed:
        more = "" if target.in_process else " The same command with --resume goes on from there."
        click.echo(f"Interrupted: the drive stopped on the path.{more}", err=True)
        sys.exit(stop_requested.exit_code)


def _report(
    path: Planned,
    results: list[RunResult],
    several: bool,
    motion: Motion,
    output: Output,
    recording: Recording,
    notes: list[str],
) -> list[KonturError]:
    """Print the figures of the runs, and save what belongs to them; the logs are written already.

    Returns what could not be saved.
    """
    from kontur.planning.ahead import Ahead
    from kontur.planning.outputs import passed_over

    errors: list[KonturError] = []
    try:
        trajectory = path.trajectory() if isinstance(path, Ahead) else path
        _print(trajectory, results, output.as_json, motion.override, [*notes, *passed_over(trajectory)])
    finally:  # also where nobody reads what is printed
        for result in results:
            if result.error is not None:
                continue
            try:
                _save_capture(result, several, output, recording)
            except KonturError as error:
                errors.append(error)
        if output.report is not None:
            from kontur.report.page import write_report

            try:
                write_report(output.report, [result.log for result in results])
                if results[-1].error is not None:
                    click.echo(f"The report up to then is in {output.report}.", err=True)
            except KonturError as error:
                errors.append(error)
    return errors


def _plan(program: Program, motion: Motion, recording: Recording, target: Target) -> tuple[Planned, RunOptions]:
    """The trajectory, or so much of it that it can be driven while the rest is planned; and the options that all runs
    of it have in common. A drive in this process, whose time is not that of the clock, gets all of it."""
    from kontur.drive.target import open_drive
    from kontur.planning.bounds import limits
    from kontur.planning.outputs import Tool
    from kontur.runs.resume import passed_by
    from kontur.runs.runner import RunOptions

    values = parameters_of(motion.params) if motion.params is not None else {}
    values |= parameter_values(motion.parameters)
    bounds = limits(target.machine, motion.accel, motion.jerk)
    passed = 0
    if motion.resume:
        with open_drive(target) as device:
            passed = passed_by(device)
    path = planned(program, bounds, target.machine.soft_limits_m, motion.tolerance, target.in_process, passed)
    return path, RunOptions(
        parameters=values,
        tool=Tool(motion.full_s, motion.laser),
        approach=bounds if motion.approach else None,
        raise_fault=False,
        scope=recording.setup,
        resume=motion.resume,
        whole=False,
    )


def _run(
    trajectory: Planned,
    name: str,
    target: Target,
    options: RunOptions,
    motion: Motion,
    stop_requested: StopRequest,
) -> RunResult:
    """One run with a progress bar, which Ctrl-C stops and signals hold. A live page does both, too."""
    from kontur.drive.stream import Operator
    from kontur.runs.runner import run

    asked = panel()
    asked.offers, asked.percent = ("hold", "resume", "stop", "override"), motion.override
    page = view()
    with run_progress(name, trajectory, asked, page) as (progress, watch), held_by_signals(asked):
        release = Release(trajectory.program, asked, motion.yes)
        operator = Operator(progress, stop_requested, asked.rate, release, _notice)
        result = run(trajectory, name, target, dataclasses.replace(options, watch=watch), operator)
    if page is not None:
        page.end(_ending(result))
    return result


def _ending(result: RunResult) -> str:
    """How a run ended, for its live page."""
    problem = result.error or result.fault or result.log_problem
    status = "complete" if result.completed else "stopped by the operator"
    return f"{result.log.meta['controller']}: {problem or status}"


def _notice(text: str) -> None:
    click.echo(text, err=True)


def _save_capture(result: RunResult, several: bool, output: Output, recording: Recording) -> None:
    """The capture where it was asked for, or beside the log where a fault or a warning triggered."""
    from kontur.report import capture_file

    controller = str(result.log.meta["controller"])
    if result.capture is None:
        if recording.out is not None:
            click.echo("The scope has not been triggered in the run.", err=True)
    elif recording.out is not None:
        capture_file.save(result.capture, log_path(recording.out, controller, several))
    elif output.log is not None:
        beside = log_path(output.log, controller, several)
        what = "fault" if result.fault is not None else "warning"
        for suffix in (".csv", ".png"):
            capture_file.save(result.capture, beside.with_name(f"{beside.stem}-{what}{suffix}"))


def _of_this_part(path: Path | None) -> Path | None:
    """Where a file of a resumed run goes: NAME-part-2 and so on where the one of the part before exists."""
    if path is None or not path.is_file():
        return path
    names = (path.with_name(f"{path.stem}-part-{part}{path.suffix}") for part in itertools.count(2))
    free = next(name for name in names if not name.exists())
    click.echo(f"{path} has the part before; this one goes to {free}.", err=True)
    return free


def log_path(path: Path, controller: str, several: bool) -> Path:
    """Where the log of one of several controllers goes: its name is put before the suffix."""
    return path.with_name(f"{path.stem}-{controller}{path.suffix}") if several else path


def _print(trajectory: Trajectory, results: list[RunResult], as_json: bool, override: float, notes: list[str]) -> None:
    """The figures of all runs, what of the feed was planned, and each warning once, whichever runs it came in."""
    from kontur.runs.summary import heading, summary

    first = results[0].log
    name, feed = trajectory.program.name, trajectory.feed
    rows = [{"controller": result.log.meta["controller"], **summary(result.log)} for result in results]
    warnings = dict.fromkeys(code for result in results for code in result.warnings)
    oscillated = [result.log.meta for result in results if "oscillation" in result.log.meta]
    notes = [*notes, *(f"{meta['controller']} oscillated: {meta['oscillation']}." for meta in oscillated)]
    if as_json:
        print_json({"program": name, "duration_s": trajectory.duration_s, "feed": feed and asdict(feed),
                    "override_percent": override, "path_deviation_um": trajectory.deviation_m * 1e6,
                    "rapid_deviation_um": trajectory.rapid_deviation_m * 1e6, "notes": notes,
                    "contour_error": "true" if first.has_truth else "estimated",
                    "told": first.meta.get("told"), "compensation": first.meta.get("compensation"), "runs": rows,
                    "warnings": warnings_json(warnings)})  # fmt: skip
    else:
        print_table(rows, f"{name}, {trajectory.duration_s:.2f} s: {heading(first.meta, first.has_truth)}")
        if feed is not None:
            of_that = "" if override == 100.0 else f"; {override:g} % of that by --override"
            click.echo(f"{str(feed).capitalize() if not feed.limited else 'The ' + str(feed)}{of_that}.")
        if trajectory.smoothed:
            click.echo(f"The path is {trajectory.smoothed}.")
        for note in notes:
            click.echo(note)
    print_warnings(warnings)


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
        if param.is_flag or value == param.flag_value:
            words.append(param.opts[-1])
            continue
        for one in value if param.multiple else [value]:
            words += [param.opts[-1], "=".join(one) if isinstance(one, tuple) else str(one)]
    return shlex.join(words)
