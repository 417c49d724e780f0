# SPDX-License-Identifier: Apache-2.0
"""`kontur prove`: the sensitivity measured against the predicted, and circles before and after."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from kontur import machine as machines
from kontur.cli.commission import show_proof
from kontur.cli.live_page import view
from kontur.cli.options import (
    CONTROLLER,
    MACHINE,
    check_output,
    drive_of,
    interruptible,
    parameters_of,
    target_options,
)
from kontur.cli.output import print_json
from kontur.drive.controllers import described

if TYPE_CHECKING:
    from kontur.drive.target import Target


@click.command(name="prove")
@click.option("--model", type=MACHINE, metavar="MACHINE.toml",
              help="The machine as it was identified, for what is predicted.  [default: --machine]")  # fmt: skip
@click.option("--params", type=click.Path(dir_okay=False, path_type=Path), metavar="PARAMS.toml",
              help="What is proved, of `kontur tune`.  [default: the drive as it is]")  # fmt: skip
@click.option("--controller", type=CONTROLLER, default="ccu", show_default=True,
              help=f"Its controller: {described()}.")  # fmt: skip
@click.option("--cascade", "cascade", type=click.Path(dir_okay=False, path_type=Path), metavar="PARAMS.toml",
              help="The cascade that was tuned the same way, to compare with.")  # fmt: skip
@click.option("-o", "--report", "report", type=click.Path(dir_okay=False, path_type=Path), metavar="PROOF.html",
              help="Write a report to be filed here.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@target_options
def command(
    *,
    target: Target,
    model: str | None,
    params: Path | None,
    controller: str,
    cascade: Path | None,
    report: Path | None,
    as_json: bool,
) -> None:
    """Measure the sensitivity of each axis, and run circles in both senses at two speeds, before and after.

    The drive keeps the parameters that it has. The exit code is 1 where the proof does not hold: the measured Ms
    exceeds 2.2, the drive stops on a circle, or the circles are worse than before. Ctrl-C stops on the path.
    """
    check_output(report, ".html")
    if controller == "all":
        raise click.UsageError("--controller: one of them; --cascade is what it is compared with")
    from kontur.commissioning import filed, prove
    from kontur.commissioning.session import commissioned

    values = {controller: parameters_of(params) if params is not None else {}}
    values |= {"cascade": parameters_of(cascade)} if cascade is not None else {}
    known = machines.load(model) if model is not None else target.machine
    with drive_of(target) as device:
        about = filed.facts(target, device)
        before = device.parameters.dump()
    candidates = [prove.candidate(known, name, before | after) for name, after in values.items()]
    changed = {name: before[name] for after in values.values() for name in after if name in before}
    say = (lambda text: None) if as_json else (lambda text: click.echo(f"{text}.", err=True))
    try:
        with interruptible() as stop_requested, commissioned(target, before, lambda text: click.echo(text, err=True)):
            evidence = prove.prove(target, candidates, changed, say, stop_requested, drive_of, view())
    except KeyboardInterrupt:
        click.echo("Interrupted: the axes have stopped, and the parameters are as they were.", err=True)
        sys.exit(stop_requested.exit_code)
    problem = prove.problem_of(evidence.proof, controller)
    rows = [one.as_json() for one in evidence.proof]
    if report is not None:
        verdict = f"The proof does not hold: {problem}" if problem else "The proof holds."
        filed.write_report(report, verdict, about, evidence, candidates, before)
    if as_json:
        print_json({"proof": rows, "holds": not problem, "problem": problem})
    else:
        show_proof(rows)
    if problem:
        click.echo(f"The proof does not hold: {problem}", err=True)
        sys.exit(1)
