# SPDX-License-Identifier: Apache-2.0
"""Gains of several controllers for a machine, searched for at the same time, each in a process of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing

from kontur.design.search import Design, design
from kontur.experiments import engine
from kontur.machine import Machine


def designs(
    machine: Machine, controllers: Sequence[str], ms: float, force_step_N: float, stop_requested: Callable[[], bool]
) -> list[Design]:
    """What design() finds for each controller. Raises KeyboardInterrupt at a requested stop, and what design() does."""

    def poll() -> None:
        if stop_requested():
            raise KeyboardInterrupt

    jobs = [(number, (machine, name, ms, force_step_N)) for number, name in enumerate(controllers)]
    with closing(engine.results(_design, jobs, poll=poll)) as coming:
        found = dict(coming)
    return [found[number] for number, _ in jobs]


def _design(job: tuple[Machine, str, float, float]) -> Design:
    machine, controller, ms, force_step_N = job
    return design(machine, controller, ms=ms, force_step_N=force_step_N)
