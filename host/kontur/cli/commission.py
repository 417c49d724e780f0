# SPDX-License-Identifier: Apache-2.0
"""`kontur commission`: identify both axes, design, prove, and store, one after the other."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from kontur.cli.identify import FORCE_SHARE, encoder_known, require_length, show
from kontur.cli.live_page import view
from kontur.cli.options import NumberRange, drive_of, interruptible, progress_bar, target_options
from kontur.cli.output import print_json, print_table
from kontur.drive.axes import AXES
from kontur.errors import FileError, KonturError
from kontur.files import write_atomically

if TYPE_CHECKING:
    from kontur.commissioning.identify import Identified
    from kontur.commissioning.prove import Proof
    from kontur.design.search import Design
    from kontur.drive.target import Target
    from kontur.machine import Machine

AIMS = {"finish": (2.0, 2.0), "speed": (2.0, 4.0), "quiet": (1.7, 0.7)}
"""Ms and force step in N that a design may have."""
_CONTROLLERS = ("ccu", "cascade")
_STEPS = {
    "identify": "Each axis moves within its soft limits: a slow ramp of the force first, then a slow sine, constant "
    "speeds and a small multisine. This measures mass, friction, first mode, lag and cogging.",
    "tune": "Gains for the machine as it was measured are computed. Nothing moves.",
    "prove": "The sensitivity of each axis is measured with the new gains, and circles are run in both senses at two "
    "speeds, before and after.",
}
_HEADINGS = {
    "case": "circle",
    "controller": "controller",
    "before_um": "before µm",
    "after_um": "after µm",
    "ms_predicted": "Ms predicted",
    "ms_measured": "Ms measured",
}


@click.command(name="commission")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), required=True, metavar="DIR",
              help="Folder for the machine file, parameters, pictures and the result.")  # fmt: skip
@click.option("--for", "aim", type=click.Choice(list(AIMS)), default="finish", show_default=True,
              help="The least error, the same with more force noise, or a quiet machine.")  # fmt: skip
@click.option("--force", "force_N", type=NumberRange(1.0, 3000.0), metavar="N",
              help="Largest force of the identification.  [default: half of the force limit]")  # fmt: skip
@click.option("--speed", type=NumberRange(5.0, 1000.0), default=200.0, show_default=True, metavar="MM_PER_S",
              help="Largest speed of the identification.")  # fmt: skip
@click.option("--yes", is_flag=True, help="Do not ask before each step.")
@click.option("--index-distance", "index_mm", type=NumberRange(0.1, 1000.0), metavar="MM",
              help="Distance of the index pulses: the length of an encoder count is checked by it.")  # fmt: skip
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
    as_json: bool,
) -> None:
    """Bring an axis pair from unknown to proven: identify, tune, prove, store.

    The travel is that of the soft limits; force limit and motion limits are those of --machine. The new parameters are
    stored in the drive only if the proof holds. Ctrl-C stops on the spot and leaves the drive as it was.
    """
    require_length(target, index_mm)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(out, f"cannot be made: {error.strerror}") from error
    say = (lambda text: None) if as_json else (lambda text: click.echo(f"{text}.", err=True))
    result: dict[str, Any] = {"axes": {}, "design": {}, "proof": [], "saved": False}
    try:
        with interruptible() as stop_requested:
            _commission(
                target,
                out,
                aim,
                force_N,
                speed * 1e-3,
                (index_mm or 0.0) * 1e-3,
                yes,
                as_json,
                say,
                stop_requested,
                result,
            )
    except KeyboardInterrupt:
        click.echo("Interrupted: the axes have slowed down, and the parameters are as they were.", err=True)
        sys.exit(stop_requested.exit_code)
    except KonturError as error:
        result["diagnosis"] = {"kind": getattr(error, "kind", "error"), "text": str(error)}
        _write(out, result)
        if as_json:
            print_json(result)
        raise
    _write(out, result)
    if as_json:
        print_json(result)


def _commission(
    target: Target,
    out: Path,
    aim: str,
    force_N: float | None,
    speed_mps: float,
    index_m: float,
    yes: bool,
    as_json: bool,
    say: Callable[[str], None],
    stop_requested: Callable[[], bool],
    result: dict[str, Any],
) -> None:
    from kontur.commissioning import machine_file, prove
    from kontur.commissioning.session import identify_axes
    from kontur.drive import parameter_file
    from kontur.drive.target import open_drive

    _explain("identify", yes, as_json)
    with drive_of(target) as device:
        before = device.parameters.dump()
        declared = device.declared
        device.parameters.set(_ratings(target.machine))
        try:
            found = identify_axes(
                device, AXES, force_N, FORCE_SHARE, speed_mps, index_m, encoder_known(target), say, stop_requested
            )
        finally:
            device.parameters.set(before)
    result["axes"] = {name: machine_file.as_json(one) for name, one in found.items()}
    machine = machine_file.machine(target.machine, found)
    write_atomically(out / "machine.toml", machine_file.text(machine).encode())
    _pictures(out, found)
    if not as_json:
        show(found)

    _explain("tune", yes, as_json)
    ms, force_step_N = AIMS[aim]
    designs = [_design(machine, name, ms, force_step_N) for name in _CONTROLLERS]
    after = {one.controller: one.parameters | machine_file.parameters(found) for one in designs}
    result["design"] = {one.controller: _as_json(one) for one in designs}
    for one in designs:
        text = parameter_file.text(after[one.controller], declared)
        write_atomically(out / f"params-{one.controller}.toml", text.encode())
    say(designs[0].limit.removesuffix("."))

    _explain("prove", yes, as_json)
    restored = before if not target.in_process else {}
    proof = prove.prove(target, designs, restored, after, say, drive_of, view())
    result["proof"] = [one.as_json() for one in proof]
    if not as_json:
        print_table([one.as_json() for one in proof], "Proof", _HEADINGS)
    problem = _problem(proof)
    with open_drive(target) as device:
        device.parameters.set(before if problem else after[_CONTROLLERS[0]])
        if not problem:
            device.parameters.save()
            result["saved"] = True
    if problem:
        result["diagnosis"] = {"kind": "proof", "text": problem}
    click.echo(f"Not stored: {problem}" if problem else f"Stored in the drive; all files are in {out}.", err=True)


def _ratings(machine: Machine) -> dict[str, float]:
    """What is known of the amplifiers: their force limits."""
    return {f"plant_{name}.force_limit": getattr(machine, name).force_limit_N for name in AXES}


def _problem(proof: list[Proof]) -> str:
    """Why the design of the first controller is not kept; empty where it is."""
    from kontur.commissioning.prove import MS_MAX

    kept = [one for one in proof if one.controller == _CONTROLLERS[0]]
    for one in kept:
        if one.ms_measured > MS_MAX:
            return f"the measured Ms of {one.ms_measured:.2f} exceeds {MS_MAX:g}; ask for a quieter design: --for quiet"
        if one.after_um is None:
            return f"the drive stopped on {one.case} with the new gains"
    before = [one.before_um for one in kept if one.before_um is not None]
    after = [one.after_um for one in kept if one.after_um is not None]
    if len(before) == len(after) and sum(after) > sum(before):
        return (
            f"the circles are no better: {sum(after) / len(after):.2f} µm after, {sum(before) / len(before):.2f} before"
        )
    return ""


def _design(machine: Machine, controller: str, ms: float, force_step_N: float) -> Design:
    from kontur.design.search import design

    with progress_bar(f"gains of {controller}") as progress:
        return design(machine, controller, ms=ms, force_step_N=force_step_N, progress=progress)


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


def _explain(step: str, yes: bool, as_json: bool) -> None:
    if not as_json or not yes:
        click.echo(f"\n{step}: {_STEPS[step]}", err=True)
    if not yes:
        click.confirm("Go on?", abort=True, err=True)


def _write(out: Path, result: dict[str, Any]) -> None:
    write_atomically(out / "commission.json", (json.dumps(result, indent=2) + "\n").encode())
