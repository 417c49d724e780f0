# SPDX-License-Identifier: Apache-2.0
"""The paper's experiment: circles on the drive of its Table 1, under each controller, scored by the true contour error.

The radius of the slow circle and the two fast ones are ours: the paper gives 4.5 mm/s and a friction schedule that
repeats after 5.6 s, which a lap of r = 4 mm takes at 4.488 mm/s.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kontur.drive.target import Target
    from kontur.experiments.engine import Workers
    from kontur.machine import Machine
    from kontur.path.geometry import Program
    from kontur.planning.planner import Trajectory

LAP_S = 5.6


@dataclass(frozen=True)
class Case:
    """A circle; `score_from_s`: the time until then, in which it speeds up, is not scored."""

    radius_m: float
    feed_mps: float
    score_from_s: float

    def program(self) -> Program:
        """As many laps as take 5.6 s at the feed, the period of the friction schedule."""
        from kontur.path import shapes

        return shapes.circle(self.radius_m, self.feed_mps, duration_s=LAP_S)


CASES = {
    "low": Case(radius_m=0.004, feed_mps=0.004488, score_from_s=0.0),
    "high": Case(radius_m=0.020, feed_mps=0.100, score_from_s=0.3),
    "high-tight": Case(radius_m=0.004, feed_mps=0.100, score_from_s=0.3),
}


def paper(
    target: Target,
    cases: Iterable[str],
    controllers: Iterable[str],
    seeds: Iterable[int],
    parameters: Mapping[str, float] | None = None,
    rows_file: Path | None = None,
    workers: Workers = None,
    progress: Callable[[float], None] = lambda share: None,
) -> list[dict[str, Any]]:
    """One row a case, seed and controller: what `kontur experiment paper --json` prints.

    `parameters` are set before. `rows_file` and `workers` are those of engine.carry_out(); the rows do not depend on
    them. Raises what carry_out(), plan() and run() raise.
    """
    from kontur.experiments.engine import carry_out

    seeds, controllers = list(seeds), list(controllers)
    jobs = [
        (name, replace(target, seed=seed), controller, dict(parameters or {}))
        for name in cases
        for seed in seeds
        for controller in controllers
    ]
    return carry_out(_run, jobs, rows_file=rows_file, workers=workers, progress=progress)


def _run(job: tuple[str, Target, str, dict[str, float]]) -> dict[str, Any]:
    from kontur.runs.runner import RunOptions, run
    from kontur.runs.summary import summarise

    name, target, controller, parameters = job
    options = RunOptions(parameters=parameters, score_from_s=CASES[name].score_from_s)
    log = run(trajectory(name, target.machine), controller, target, options).log
    found = summarise(log)
    return {
        "case": name,
        "controller": controller,
        "seed": target.seed,
        "num": log.meta["num"],
        "path_percent": found.path_percent,
        "mean_um": found.mean_um,
        "rms_um": found.rms_um,
        "max_um": found.max_um,
        "energy_J": float(log.columns["energy_J"][-1]),
        "force_max_N": found.force_max_N,
        "force_step_N": found.force_step_N,
    }


@cache
def trajectory(case: str, machine: Machine) -> Trajectory:
    """The motion along a circle of CASES, planned for `machine`."""
    from kontur.planning.bounds import limits
    from kontur.planning.planner import plan

    return plan(CASES[case].program(), limits(machine))
