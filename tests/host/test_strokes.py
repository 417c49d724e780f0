# SPDX-License-Identifier: Apache-2.0
"""The frequency response is measured in movements to and fro, without ways back between them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from kontur.commissioning import first_moves, response
from kontur.commissioning.response import Setup
from kontur.drive.target import Target, open_drive
from kontur.errors import ParameterError
from kontur.machine import MACHINES, load

SETUP = Setup(response.lines(24.0, 900.0, 24, 0.5), 20.0, 0.08, 0.5, 3, 0.2)


class Table:
    """Device and Mover at once: an axis at `at_m` that may be within 0 and `travel_m`."""

    axis = "x"
    held_back = False

    def __init__(self, travel_m: float, at_m: float) -> None:
        self.low_m, self.high_m, self.at_m = 0.0, travel_m, at_m
        self.velocity_mps = 0.0
        self.windows: list[tuple[float, int]] = []
        self.ways_back = 0

    def read(self, name: str) -> float:
        return {"clock.control_hz": 10_000, "plant_x.encoder": 0.1, "plant_x.force_limit": 500.0}.get(name, 0.0)

    def longest_s(self, speed_mps: float, sign: float) -> float:
        return (self.high_m - self.at_m if sign > 0.0 else self.at_m) / speed_mps

    def way_m(self, speed_mps: float, duration_s: float) -> float:
        return speed_mps * duration_s

    def go(self, position_m: float, speed_mps: float) -> None:
        self.at_m, self.ways_back = min(max(position_m, 0.0), self.high_m), self.ways_back + 1

    @contextmanager
    def moving(self, velocity_mps: float) -> Iterator[None]:
        self.velocity_mps = velocity_mps
        yield

    def excite(self, hz: Any, setup: Setup, windows: int) -> Any:
        self.at_m += self.velocity_mps * (setup.settle_s + windows * setup.window_s)
        assert self.low_m <= self.at_m <= self.high_m
        self.windows.append((self.velocity_mps, windows))
        return np.ones((windows, 3, len(hz)), complex)


def measured(monkeypatch: pytest.MonkeyPatch, travel_m: float, at_m: float) -> Table:
    table = Table(travel_m, at_m)
    monkeypatch.setattr(response, "Mover", lambda *_: table)
    monkeypatch.setattr(
        response, "excite", lambda mover, hz, amplitude, setup, windows, second: mover.excite(hz, setup, windows)
    )
    response.measure(table, "x", SETUP)  # type: ignore[arg-type]
    for sign in (1.0, -1.0):  # three sets of lines with three windows each
        assert sum(windows for velocity, windows in table.windows if velocity == sign * 0.08) == 9
    return table


@pytest.mark.parametrize("at_m", [0.0, 0.1, 0.2, 0.39])
def test_each_movement_goes_back_over_the_way_of_the_one_before(monkeypatch: pytest.MonkeyPatch, at_m: float) -> None:
    table = measured(monkeypatch, 0.39, at_m)
    assert table.ways_back <= 1  # from the end of the travel
    assert len(table.windows) <= 8


def test_short_travel_takes_more_movements(monkeypatch: pytest.MonkeyPatch) -> None:
    table = measured(monkeypatch, 0.13, 0.06)
    assert table.ways_back <= 2
    assert max(windows for _, windows in table.windows) == 2


def test_travel_that_is_too_short_for_a_window_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ParameterError, match=r"axis x has 60\.0 mm to move, too little for a window"):
        measured(monkeypatch, 0.06, 0.03)


@pytest.mark.parametrize("way_m", [0.004, -0.012, 0.06])
def test_axis_comes_near_a_place_however_short_the_way_is(way_m: float) -> None:
    """A window may need some mm more than there are from where the axis is."""
    with open_drive(Target(machine=load(MACHINES / "ball_screw.toml"))) as device:
        device.select_controller("cascade")
        with first_moves.moving(device, "x", lambda: False) as mover:
            to_m = mover.position_m() + way_m
            mover.go(to_m, 0.2)
            assert mover.position_m() == pytest.approx(to_m, abs=0.003)
