# SPDX-License-Identifier: Apache-2.0
"""Tickets (2140h:3) of a simulated drive: the same in runs that are the same, others where time is the clock's."""

from __future__ import annotations

from pathlib import Path

import pytest

from kontur.can.bus import open_bus
from kontur.drive.device import connected
from kontur.sim.process import start


def in_process(**options: str) -> int:
    with connected(open_bus({"interface": "kontur", **options}), 1) as device:
        return int(device.read("master.ticket"))


def test_tickets_of_lockstep_runs_are_the_same_and_those_by_the_clock_are_not() -> None:
    assert in_process() == in_process()
    assert in_process(pace="clock") != in_process(pace="clock")


@pytest.mark.parametrize("pace", ["sync", "clock"])
def test_process_by_the_clock_has_tickets_of_its_own(tmp_path: Path, pace: str) -> None:
    tickets = set()
    for _ in range(2):
        with start(slcan_tcp="0", pace=pace) as sim, connected(open_bus(sim.options()), 1) as device:
            tickets.add(int(device.read("master.ticket")))
    assert len(tickets) == (1 if pace == "sync" else 2)
