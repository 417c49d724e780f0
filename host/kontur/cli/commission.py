# SPDX-License-Identifier: Apache-2.0
"""`kontur commission`: identify both axes, design, prove, and store, one after the other."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from kontur.cli.identify import agreed_of, encoder_known, require_length, show
from kontur.cli.live_page import view
from kontur.cli.options import NumberRange, StopRequest, drive_of, interruptible, target_options
from kontur.cli.output import print_json, print_table
from kontur.drive.axes import AXES
from kontur.errors import BusError, FileError, InputError, KonturError, NoAnswerError
from kontur.files import write_atomically

if TYPE_CHECKING:
    from kontur.commissioning.folder import Progress
    from kontur.commissioning.identify import Identified
    from kontur.commissioning.session import Session
    from kontur.design.search import Design
    from kontur.drive.device import Device
    from kontur.drive.target import Target
    from kontur.machine import Machine

AIMS = {"finish": (2.0, 2.0), "speed": (2.0, 4.0), "quiet": (1.7, 0.7)}
"""Ms and force step in N that a design may have."""
_CONTROLLERS = ("ccu", "cascade")
_STEPS = {
    "identify": "Each axis moves within its soft limits: a slow ramp of the force first, then a slow sine, constant "
    "speeds and a small multisine. This measures mass, friction, first mode, lag, cogging and ripple, and with a scale "
    "backlash and errors of the screw.",
    "tune": "Gains for the machine as it was measured are computed, which takes about a minute. Nothing moves.",
    "prove": "The sensitivity of each axis is measured with the new gains, and circles are run in both senses at two "
    "speeds, before and after.",
}
_LOST = (
    "A drive that hears nothing of its host stops its axes. Once it answers again, the same command goes on after the "
    "last step that was finished."
)
_HEADINGS = {
    "case": "circle",
    "controller": "controller",
    "before_um": "before µm",
    "after_um": "after µm",
    "ms_predicted": "Ms predicted",
    "ms_measured": "Ms measured",
    "iso_before_um": "G(b) before µm",
    "iso_after_um": "G(b) after µm",
}


@click.command(name="commission")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), required=True, metavar="DIR",
              help="Folder for the machine file, parameters, pictures, report and result. A commissioning that was "
              "broken off goes on from there.")  # fmt: skip
@click.option("--for", "aim", type=click.Choice(list(AIMS)), default="finish", show_default=True,
              help="The least error, the same with more force noise, or a quiet machine.")  # fmt: skip
@click.option("--force", "force_N", type=NumberRange(1.0, 3000.0), metavar="N",
              help="Largest force of the identification.  [default: half of the force limit]")  # fmt: skip
@click.option("--speed", type=NumberRange(5.0, 1000.0), default=200.0, show_default=True, metavar="MM_PER_S",
              help="Largest speed of the identification.")  # fmt: skip
@click.option("--yes", is_flag=True, help="Do not ask before each step.")
@click.option("--index-distance", "index_mm", type=NumberRange(0.1, 1000.0), metavar="MM",
              help="Distance of the index pulses: the length of an encoder count is checked by it.  [default on a bus: "
              "index_m of the machine file]")  # fmt: skip
@click.option("--length-checked", is_flag=True,
              help="The length of an encoder count was checked with a gauge (docs/hardware.md).")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@target_options
def command(
    *,
    target: Target,
    out: Path,
    aim: str,
    force_N: float | None,
    speed: float,
    yes: bool,
    index_mm: float | None,
    length_checked: bool,
    as_json: bool,
) -> None:
    """Bring an axis pair from unknown to proven: identify, tune, prove, store.

    The travel is that of the soft limits; force limit and motion limits are those of --machine. The new parameters are
    stored in the drive only if the proof holds, and the exit code is 1 where it does not. Ctrl-C stops on the spot and
    leaves the drive as it was. The same command goes on after the last step that was finished.
    """
    require_length(target, index_mm)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(out, f"cannot be made: {error.strerror}") from error
    asked = _Asked(out, aim, force_N, speed * 1e-3, index_mm, length_checked, yes, as_json)
    result: dict[str, Any] = {"axes": {}, "design": {}, "proof": [], "saved": False, "time": {}}
    begun, worth_keeping = None, True
    try:
        with interruptible() as stop_requested:
            begun = _begin(target, asked)
            _commission(begun, asked, stop_requested, result)
            if not as_json:
                _show_time(result["time"])
    except KeyboardInterrupt:
        click.echo("Interrupted: the axes have slowed down, and the parameters are as they were.", err=True)
        sys.exit(stop_requested.exit_code)
    except KonturError as error:
        if begun is not None and isinstance(error, (BusError, NoAnswerError)):
            error.args = (f"{error}\n{asked.where()}{_LOST}",)
        result["diagnosis"] = {"kind": getattr(error, "kind", "error"), "text": str(error)}
        worth_keeping = bool(result["axes"]) or not isinstance(error, InputError)
        raise
    finally:
        if begun is not None and worth_keeping and (result["axes"] or "diagnosis" in result):
            _write(out, result)
        if as_json:
            print_json(result)
    if not result["saved"]:
        sys.exit(1)


@dataclass(frozen=True)
class _Asked:
    """The options of the command."""

    out: Path
    aim: str
    force_N: float | None
    speed_mps: float
    index_mm: float | None
    length_checked: bool
    yes: bool
    as_json: bool
    said: list[str] = field(default_factory=list)

    def say(self, text: str) -> None:
        self.said.append(text)
        if not self.as_json:
            click.echo(f"{text}.", err=True)

    def where(self) -> str:
        return f"It came at this step: {self.said[-1]}. " if self.said else ""

    def explain(self, step: str) -> None:
        """Say what a step does, and ask for it."""
        if not self.as_json or not self.yes:
            click.echo(f"\n{step}: {_STEPS[step]}", err=True)
        if not self.yes:
            _go_on("Go on?")


class _Gauge:
    """A gauge that the user reads."""

    def ready(self, axis: str) -> None:
        _go_on(f"Axis {axis} will move slowly by some 20 mm. Set a gauge or a rule at it to zero. Ready?")

    def distance_m(self, axis: str, counted_m: float) -> float:
        text = f"How far has axis {axis} moved, in mm"
        return float(_ask(lambda: click.prompt(text, type=NumberRange(0.001, 2000.0), err=True))) * 1e-3


def _go_on(question: str) -> None:
    """Raises InputError where the answer is no."""
    if not _ask(lambda: click.confirm(question, err=True)):
        raise InputError("Not gone on. Nothing was stored; the same command goes on after the last step that was done.")


def _ask(question: Callable[[], Any]) -> Any:
    """The answer; Ctrl-C meanwhile is one at once. Raises InputError: there is nobody to answer."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        if sys.stdin is None:
            raise EOFError
        return question()
    except (click.Abort, EOFError) as error:
        if isinstance(error.__context__, KeyboardInterrupt):
            raise KeyboardInterrupt from error
        raise InputError(
            "nobody can answer this question, since the standard input has ended: answer in a terminal, or give --yes, "
            "and where a gauge is asked for also --index-distance or --length-checked"
        ) from error
    finally:
        signal.signal(signal.SIGINT, before)


@dataclass(frozen=True)
class _Begun:
    """A commissioning whose drive has answered, and whose folder is its own. `before`: parameters of the drive."""

    target: Target
    progress: Progress
    about: Mapping[str, str]
    before: Mapping[str, float]


def _begin(target: Target, asked: _Asked) -> _Begun:
    from kontur.commissioning import filed
    from kontur.commissioning.folder import Progress, identity

    with drive_of(target) as device:
        about = filed.facts(target, device)
        progress = Progress(asked.out, identity(target, device))
        if not target.in_process:
            target = dataclasses.replace(target, machine=_within_limits(target.machine, device))
        now = device.parameters.dump()
    before = progress.done("before", {}) or now
    progress.keep("before", {}, before)
    return _Begun(target, progress, about, before)


def _commission(begun: _Begun, asked: _Asked, stop_requested: StopRequest, result: dict[str, Any]) -> None:
    from kontur.commissioning.session import commissioned

    target, progress = begun.target, begun.progress
    with commissioned(target, begun.before, lambda text: click.echo(text, err=True)) as session:
        phases = _identify(target, asked, progress, stop_requested, result)
        after = _tune(target, asked, progress, phases, stop_requested, result)
        with _timed(target) as taken:
            _prove(target, asked, after, begun.before, session, begun.about, stop_requested, result)
        _add_time("prove", taken, result)
    if result["saved"]:
        progress.end()


@contextmanager
def _timed(target: Target) -> Iterator[dict[str, float]]:
    """What a step takes of the drive's time, and of the processors' time; known at the end."""
    drive_s, computing_s = target.stopwatch.drive_s, _computing_s()
    taken: dict[str, float] = {}
    yield taken
    taken["drive_s"] = round(target.stopwatch.drive_s - drive_s, 3)
    taken["computing_s"] = round(_computing_s() - computing_s, 3)


def _computing_s() -> float:
    """Processor time of this program and of the processes that it had, s."""
    return sum(os.times()[:4])


def _add_time(step: str, taken: Mapping[str, float], result: dict[str, Any]) -> None:
    """Add what a step took to the sum."""
    steps = result["time"].get("steps", {}) | {step: taken}
    result["time"] = {name: round(sum(one[name] for one in steps.values()), 3) for name in taken} | {"steps": steps}


def _show_time(taken: Mapping[str, Any]) -> None:
    click.echo(
        f"It took {taken['drive_s']:.0f} s of the drive's time and {taken['computing_s']:.0f} s of computing (with the "
        "simulation, where the drive is simulated in this process).",
        err=True,
    )


def show_proof(rows: Sequence[Mapping[str, Any]]) -> None:
    """A table of the circles."""
    print_table([{key: row[key] for key in _HEADINGS} for row in rows], "Proof", _HEADINGS)


def _within_limits(machine: Machine, device: Device) -> Machine:
    """The machine with the soft limits of a drive on a bus, where these are narrower."""
    axes = {}
    for name in AXES:
        axis = getattr(machine, name)
        low_m, high_m = (float(device.read(f"position_limit_{name}.{end}")) * 1e-9 for end in ("min", "max"))
        limits_m = (max(low_m, axis.soft_limit_m[0]), min(high_m, axis.soft_limit_m[1]))
        if limits_m[0] >= limits_m[1]:
            raise FileError(
                machine.name, f"the soft limits of {name} in the drive and in the machine file have nothing in common"
            )
        axes[name] = dataclasses.replace(axis, soft_limit_m=limits_m)
    return dataclasses.replace(machine, **axes)


def _identify(
    target: Target, asked: _Asked, progress: Progress, stop_requested: StopRequest, result: dict[str, Any]
) -> dict[str, float]:
    """Write the machine file; returns parameters that it cannot say."""
    from kontur.commissioning import machine_file
    from kontur.commissioning.first_moves import Diagnosis
    from kontur.commissioning.folder import MACHINE
    from kontur.commissioning.session import identify_axes

    options = {"force_N": asked.force_N, "speed_mps": asked.speed_mps, "index_mm": asked.index_mm}
    if (kept := progress.done("identify", options)) is not None:
        asked.say("identify: is done already")
    else:
        asked.explain("identify")
        ratings = {f"plant_{name}.force_limit": getattr(target.machine, name).force_limit_N for name in AXES}
        if encoder_known(target):
            ratings |= machine_file.scales(target.machine)
        gauge = None if asked.yes or target.in_process or asked.length_checked else _Gauge()
        with _timed(target) as taken, drive_of(target) as device:
            agreed = agreed_of(target, device, AXES, ratings, asked.force_N, asked.speed_mps, asked.index_mm, gauge)
            unproven = [name for name, one in agreed.items() if one.index_m == 0.0 and one.gauge is None]
            if unproven and not target.in_process and not asked.length_checked:
                raise Diagnosis(
                    "length",
                    f"nothing proves how long an encoder count of {' and '.join(unproven)} is, and a wrong length "
                    "makes travel and speed wrong: give the distance of index pulses (--index-distance), or leave out "
                    "--yes and type what a gauge shows, or say --length-checked where you have measured it before",
                )
            found = identify_axes(device, agreed, ratings, asked.say, stop_requested)
        machine = machine_file.machine(target.machine, found)
        kept = {
            "axes": {name: machine_file.as_json(one) for name, one in found.items()},
            "machine": machine_file.text(machine),
            "parameters": machine_file.parameters(found),
            "time": taken,
        }
        _pictures(asked.out, found)
        progress.keep("identify", options, kept)
        if not asked.as_json:
            show(found)
    result["axes"] = kept["axes"]
    _add_time("identify", kept["time"], result)
    write_atomically(asked.out / MACHINE, kept["machine"].encode())
    parameters: dict[str, float] = kept["parameters"]
    return parameters


def _tune(
    target: Target,
    asked: _Asked,
    progress: Progress,
    phases: Mapping[str, float],
    stop_requested: StopRequest,
    result: dict[str, Any],
) -> dict[str, dict[str, float]]:
    """Parameters for the drive by controller."""
    from kontur.commissioning import gains
    from kontur.commissioning.folder import MACHINE
    from kontur.drive import parameter_file
    from kontur.drive.target import open_drive
    from kontur.machine import load

    ms, force_step_N = AIMS[asked.aim]
    options = {"aim": asked.aim, "machine": (asked.out / MACHINE).read_text()}
    if (kept := progress.done("tune", options)) is not None:
        asked.say("tune: is done already")
    else:
        asked.explain("tune")
        machine = load(asked.out / MACHINE)
        with _timed(target) as taken:
            designs = gains.designs(machine, _CONTROLLERS, ms, force_step_N, stop_requested)
        asked.say(designs[0].limit.removesuffix("."))
        kept = {
            "design": {one.controller: _as_json(one) for one in designs},
            "after": {one.controller: {**one.parameters, **phases} for one in designs},
            "time": taken,
        }
        progress.keep("tune", options, kept)
    result["design"] = kept["design"]
    _add_time("tune", kept["time"], result)
    with open_drive(target) as device:
        declared = device.declared
        # A design without a filter means none, also where the drive has one of before, or of the other controller.
        unfiltered = {name: one.default for name, one in device.parameters.items() if name.startswith("force_filter_")}
    after: dict[str, dict[str, float]] = {
        name: unfiltered
        | {
            key: value
            for key, value in values.items()
            if target.in_process or not key.startswith("position_limit_")  # the user's own
        }
        for name, values in kept["after"].items()
    }
    for name, values in after.items():
        write_atomically(asked.out / f"params-{name}.toml", parameter_file.text(values, declared).encode())
    return after


def _prove(
    target: Target,
    asked: _Asked,
    after: Mapping[str, dict[str, float]],
    before: Mapping[str, float],
    session: Session,
    about: Mapping[str, str],
    stop_requested: StopRequest,
    result: dict[str, Any],
) -> None:
    from kontur.commissioning import filed, prove
    from kontur.commissioning.folder import MACHINE
    from kontur.drive.target import open_drive
    from kontur.machine import LENGTHS, load

    asked.explain("prove")
    model = load(asked.out / MACHINE)
    candidates = [prove.candidate(model, name, values) for name, values in after.items()]
    changed = {name for values in after.values() for name in values}
    restored = {name: value for name, value in session.before.items() if name in changed}
    if target.in_process:  # a new drive; with a wrong length its circles would go beyond the travel
        restored = model.parameters(told=LENGTHS)
    evidence = prove.prove(target, candidates, restored, asked.say, stop_requested, drive_of, view())
    result["proof"] = [one.as_json() for one in evidence.proof]
    if not asked.as_json:
        show_proof(result["proof"])
    problem = prove.problem_of(evidence.proof, _CONTROLLERS[0])
    verdict = f"Not stored: {problem}" if problem else "The proof holds; the parameters are stored in the drive."
    filed.write_report(asked.out / "proof.html", verdict, about, evidence, candidates, before)
    if problem:
        result["diagnosis"] = {"kind": "proof", "text": problem}
    else:
        with open_drive(target) as device:
            device.parameters.set(after[_CONTROLLERS[0]])
            device.select_controller(_CONTROLLERS[0])
            device.parameters.save()
        result["saved"] = session.keep = True
    click.echo(verdict if problem else f"Stored in the drive; all files are in {asked.out}.", err=True)


def _as_json(design: Design) -> dict[str, Any]:
    return {
        "gains": design.gains,
        "force_step_N": design.force_step_N,
        "limit": design.limit,
        "axes": {name: dataclasses.asdict(axis.margins) for name, axis in zip("xy", design.axes, strict=True)},
    }


def _pictures(out: Path, found: dict[str, Identified]) -> None:
    from kontur.commissioning import bode, figure

    for name, one in found.items():
        write_atomically(out / f"response-{name}.svg", figure.picture(one.response, f"axis {name}", "svg"))
        write_atomically(out / f"response-{name}.csv", bode.table(one.response).encode())


def _write(out: Path, result: dict[str, Any]) -> None:
    from kontur.commissioning.folder import RESULT

    write_atomically(out / RESULT, (json.dumps(result, indent=2) + "\n").encode())
