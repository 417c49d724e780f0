# SPDX-License-Identifier: Apache-2.0
"""Gains of several controllers are searched for at the same time, and Ctrl-C ends that."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest

from kontur.commissioning import gains
from kontur.errors import MachineError
from kontur.experiments import engine
from kontur.machine import MACHINES, load

BALL_SCREW = load(MACHINES / "ball_screw.toml")


def test_each_controller_has_its_own_whichever_is_found_first(monkeypatch: pytest.MonkeyPatch) -> None:
    def results(
        function: Any, jobs: Sequence[tuple[int, Any]], poll: Callable[[], None]
    ) -> Iterator[tuple[int, tuple[Any, ...]]]:
        for number, job in reversed(jobs):
            yield number, function(job)

    monkeypatch.setattr(engine, "results", results)
    monkeypatch.setattr(gains, "design", lambda machine, controller, **limits: (controller, limits))
    found = gains.designs(BALL_SCREW, ("ccu", "cascade"), 1.7, 0.7, lambda: False)
    limits = {"ms": 1.7, "force_step_N": 0.7}
    assert found == [("ccu", limits), ("cascade", limits)]


def test_stop_ends_a_search_that_would_take_minutes() -> None:
    asked = []

    def stop_requested() -> bool:
        asked.append(True)
        return len(asked) > 2

    with pytest.raises(KeyboardInterrupt):
        gains.designs(BALL_SCREW, ("ccu", "cascade"), 2.0, 2.0, stop_requested)


def test_machine_for_which_there_are_no_gains_is_told_as_without_processes() -> None:
    with pytest.raises(MachineError, match="a design needs a machine with the model 'full'"):
        gains.designs(load(MACHINES / "table1_on_chip.toml"), ("ccu", "cascade"), 2.0, 2.0, lambda: False)
