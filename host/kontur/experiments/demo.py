# SPDX-License-Identifier: Apache-2.0
"""The demonstration: one part, all controllers, on the paper's machine and on a real one, with logs and reports."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from kontur import machine
from kontur.drive import parameter_file
from kontur.drive.controllers import CONTROLLERS
from kontur.drive.stream import Operator
from kontur.drive.target import Target
from kontur.files import make_folder, write_atomically
from kontur.path import programs
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.report.page import write_report
from kontur.runs import log
from kontur.runs.log import RunLog
from kontur.runs.runner import RunOptions, run
from kontur.runs.summary import summary

_PACKAGE = Path(__file__).parents[1]
EXAMPLES = inside if (inside := _PACKAGE / "examples").is_dir() else _PACKAGE.parents[1] / "examples"
"""The example files: inside an installed package, in the root folder of a checkout."""

REAL = machine.MACHINES / "ball_screw.toml"
"""The real machine: a ball screw, with encoders at the motors."""


def part() -> Path:
    """The demo part, as a path from the current folder where it lies below that."""
    file, here = EXAMPLES / "part.ngc", Path.cwd()
    return file.relative_to(here) if file.is_relative_to(here) else file


def designed(controller: str) -> Path:
    """The parameters that `kontur design` gives `controller` for the machine REAL."""
    return REAL.parent / "designs" / f"{REAL.stem}-{controller}.toml"


@dataclass(frozen=True)
class Demonstration:
    """The runs of all controllers: on the machine of the target, and, designed for it, on the machine REAL."""

    paper: list[RunLog]
    real: list[RunLog]


def demo(file: Path, out: Path, target: Target, progress: Callable[[str, float], None]) -> Demonstration:
    """Run `file` under every controller on both machines; writes report.html and the logs as CSV and MF4 to `out` and
    to `out`/real, and summary.json to `out`.

    `progress` is called with the name of a step and its share done, 0 to 1. Raises what plan(), run() and the writers
    raise.
    """
    real = replace(target, machine=machine.load(REAL), told=machine.ALL, compensation=machine.FULL)
    gains = {name: parameter_file.read(designed(name)) for name in CONTROLLERS}
    both: tuple[tuple[Target, Path, dict[str, dict[str, float]], str], ...] = (
        (target, out, {name: {} for name in CONTROLLERS}, ""),
        (real, out / "real", gains, "real machine, "),
    )
    planned = [
        plan(
            programs.load(file),
            limits(one.machine),
            partial(progress, f"{what}planning"),
            travel_m=one.machine.soft_limits_m,
        )
        for one, _, _, what in both
    ]
    found = []
    for trajectory, (one, folder, parameters, what) in zip(planned, both, strict=True):
        make_folder(folder)
        runs = []
        for name in CONTROLLERS:
            options = RunOptions(command=_command(file, name, one, what != ""), parameters=parameters[name])
            runs.append(run(trajectory, name, one, options, Operator(progress=partial(progress, f"{what}{name}"))).log)
        _write(runs, folder, partial(progress, f"{what}logs and report"))
        found.append(runs)
    figures = [{str(one.meta["controller"]): summary(one) for one in runs} for runs in found]
    text = json.dumps(figures[0] | {"real": figures[1]}, indent=2)
    write_atomically(out / "summary.json", (text + "\n").encode())
    return Demonstration(*found)


def _command(file: Path, controller: str, target: Target, real: bool) -> str:
    words = ["kontur", "run", str(file), "--controller", controller, "--seed", str(target.seed)]
    if real:
        words += ["--machine", str(REAL), "--params", str(designed(controller))]
    return shlex.join(words)


def _write(runs: list[RunLog], folder: Path, progress: Callable[[float], None]) -> None:
    for i, one in enumerate(runs):
        progress(i / (len(runs) + 1))
        for suffix in ("csv", "mf4"):
            log.write(one, folder / f"{one.meta['controller']}.{suffix}")
    progress(len(runs) / (len(runs) + 1))
    write_report(folder / "report.html", runs, command="kontur demo")
    progress(1.0)
