# SPDX-License-Identifier: Apache-2.0
"""The demonstration: one part, all controllers, with logs, a report and a summary."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from functools import partial
from pathlib import Path

from kontur.drive.controllers import CONTROLLERS
from kontur.drive.stream import Operator
from kontur.drive.target import Target
from kontur.errors import FileError
from kontur.files import write_atomically
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


def part() -> Path:
    """The demo part, as a path from the current folder where it lies below that."""
    file, here = EXAMPLES / "part.ngc", Path.cwd()
    return file.relative_to(here) if file.is_relative_to(here) else file


def demo(file: Path, out: Path, target: Target, progress: Callable[[str, float], None]) -> list[RunLog]:
    """Run `file` under every controller; writes `out`/report.html, summary.json and the logs as CSV and MF4.

    `progress` is called with the name of a step and its share done, 0 to 1. Raises what plan(), run() and the writers
    raise.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(out, f"cannot be made ({error.strerror}); give another folder") from error
    trajectory = plan(
        programs.load(file),
        limits(target.machine),
        lambda share: progress("planning", share),
        travel_m=target.machine.soft_limits_m,
    )
    runs = []
    for name in CONTROLLERS:
        command = shlex.join(["kontur", "run", str(file), "--controller", name, "--seed", str(target.seed)])
        operator = Operator(progress=partial(progress, name))
        runs.append(run(trajectory, name, target, RunOptions(command=command), operator).log)
    for i, one in enumerate(runs):
        progress("logs", i / len(runs))
        for suffix in ("csv", "mf4"):
            log.write(one, out / f"{one.meta['controller']}.{suffix}")
    progress("report", 0.0)
    write_report(out / "report.html", runs, command="kontur demo")
    figures = {str(one.meta["controller"]): summary(one) for one in runs}
    write_atomically(out / "summary.json", (json.dumps(figures, indent=2) + "\n").encode())
    return runs
