# SPDX-License-Identifier: Apache-2.0
"""The move on the simulated machine, which decides between gains that keep the margins."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from kontur.design import search
from kontur.design.search import design
from kontur.design.trial import STOPPED, Trial
from kontur.drive import parameter_file
from kontur.errors import MachineError
from kontur.experiments import demo, machines
from kontur.machine import MACHINES, load

BALL_SCREW = load(MACHINES / "ball_screw.toml")


def test_the_trial_sees_what_the_linear_loop_does_not() -> None:
    """The loop is the same, whatever the drive is told of friction and gap, and however fast it learns."""
    trial, designed = Trial(BALL_SCREW, "ccu"), parameter_file.read(demo.designed("ccu"))
    error = trial(designed)
    assert 0.02e-6 < math.exp(error) < 0.5e-6
    assert trial({**designed, "friction_x.presliding": 0.0, "friction_y.presliding": 0.0}) > error + 0.3
    assert trial({**designed, "feedforward.friction_rate": 40.0, "feedforward.mass_rate": 20.0}) > error
    wider = replace(BALL_SCREW, x=replace(BALL_SCREW.x, backlash_m=2e-5), y=replace(BALL_SCREW.y, backlash_m=2e-5))
    assert Trial(wider, "ccu")(designed) > error + 0.5


def test_the_trial_is_in_the_middle_of_a_short_travel() -> None:
    short = replace(
        BALL_SCREW,
        x=replace(BALL_SCREW.x, travel_m=(0.1, 0.104), soft_limit_m=(0.1005, 0.1035), start_m=0.102,
                  lead_error=0.0, limit_switch_m=0.0),
        y=replace(BALL_SCREW.y, squareness_rad=0.0),
    )  # fmt: skip
    values = {**parameter_file.read(demo.designed("ccu")), **short.parameters(), "lead_map_x.points": 0}
    assert math.exp(Trial(short, "ccu")(values)) < 1e-6


def test_gains_that_stop_the_drive_lose() -> None:
    values = {**BALL_SCREW.parameters(), "smc.lambda": 1500.0, "smc.k_0": 1500.0, "smc.k_max": 1500.0}
    assert Trial(BALL_SCREW, "ccu")(values) == STOPPED


SHAKING = {
    "smc.lambda": 1340.3, "smc.k_0": 391.72, "smc.k_max": 391.72, "smc.zeta": 391.72, "compensator.alpha": 1185.6,
    "compensator.mu_0": 6.0, "compensator.mu_max": 6.0, "compensator.phi": 0.0041381,
    "compensator.dead_zone": 0.0041381, "compensator.in_axes": 1.0,
    "feedforward.friction_rate": 2.0, "feedforward.mass_rate": 2.0,
    "observer.bandwidth": 257.93, "force_filter_x.zero_1": 246.27, "force_filter_x.zero_damping_1": 1.3231,
    "force_filter_x.pole_1": 166.31, "force_filter_x.pole_damping_1": 0.28392, "force_filter_y.zero_1": 291.41,
    "force_filter_y.zero_damping_1": 1.3231, "force_filter_y.pole_1": 196.8, "force_filter_y.pole_damping_1": 0.28392,
}  # fmt: skip
"""Gains for draw 701 within all margins, with the least error of the trial. They stop circles of 4 mm at 100 mm/s."""


def test_gains_that_a_longer_path_stops_are_not_quiet() -> None:
    machine = machines.draw(701)
    problem, trial = search.Problem(machine, "ccu", "full", 2.0, 2.0), Trial(machine, "ccu")
    values = {**machine.parameters(), **SHAKING}
    assert max(axis.largest for axis in search.predicted(problem, SHAKING)) <= 2.0
    case = machines.cases()["r4@100"]
    assert machines._drive(machine, case, "ccu", values, "f32")["ended"] == "oscillating"
    assert trial(values) < STOPPED
    assert trial.quiet({**values, "oscillation.limit": problem.oscillation_N})
    assert not trial.quiet({**values, "oscillation.limit": search._WATCHED * problem.oscillation_N})


def test_a_line_between_stops_may_be_what_is_not_quiet() -> None:
    """So weak an axis goes round the circle, and not with the greatest acceleration of the machine."""
    trial, values = Trial(BALL_SCREW, "ccu"), parameter_file.read(demo.designed("ccu"))
    assert trial.quiet(values)
    weak = {**values, "plant_x.force_limit": 330.0}
    assert trial(weak) < STOPPED
    assert not trial.quiet(weak)


@pytest.mark.parametrize("fast", [False, True])
def test_the_error_on_the_machine_decides_between_gains_within_the_limits(
    fast: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last candidate has less error still, and a loop that no limit allows; the first stops the drive."""
    observers = (800.0, 1500.0, 3000.0)
    candidates = [np.log([10.0, 40.0, 5.0, observer]) for observer in observers]
    candidates.append(np.log([150.0, 900.0, 100.0, 3200.0]))
    errors = dict(zip(observers, (STOPPED, 1.0, 0.0 if fast else 2.0), strict=True))

    def error(self: Trial, values: Mapping[str, float]) -> float:
        return errors.get(values["observer.bandwidth"], -1.0)

    monkeypatch.setattr(search, "_candidates", lambda *_: iter(candidates))
    monkeypatch.setattr(Trial, "__call__", error)
    monkeypatch.setattr(Trial, "quiet", lambda *_: True)
    assert design(BALL_SCREW, "cascade").gains["observer.bandwidth"] == (3000.0 if fast else 1500.0)


@pytest.mark.parametrize(("quiet", "chosen"), [((1500.0, 3000.0), 1500.0), ((3000.0,), 3000.0), ((), 1500.0)])
def test_of_gains_that_are_quiet_the_least_error_decides_and_of_all_if_none_is(
    quiet: tuple[float, ...], chosen: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    candidates = [np.log([10.0, 40.0, 5.0, observer]) for observer in (3000.0, 1500.0)]
    monkeypatch.setattr(search, "_candidates", lambda *_: iter(candidates))
    monkeypatch.setattr(Trial, "__call__", lambda _, values: values["observer.bandwidth"] * 1e-4)
    watched: set[float] = set()

    def is_quiet(self: Trial, values: Mapping[str, float]) -> bool:
        watched.add(values["oscillation.limit"])
        return values["observer.bandwidth"] in quiet

    monkeypatch.setattr(Trial, "quiet", is_quiet)
    assert design(BALL_SCREW, "cascade").gains["observer.bandwidth"] == chosen
    assert watched == {15.0}  # half of the default


def test_a_machine_that_no_candidate_is_within_the_limits_of_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "_candidates", lambda *_: iter([np.log([150.0, 900.0, 100.0, 3200.0])]))
    with pytest.raises(MachineError, match=r"no gains of cascade keep Ms <= 2 .* the nearest have 10\."):
        design(BALL_SCREW, "cascade")


def test_a_machine_on_which_all_candidates_stop_the_drive_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "_candidates", lambda *_: iter([np.log([10.0, 40.0, 5.0, 3000.0])]))
    monkeypatch.setattr(Trial, "__call__", lambda *_: STOPPED)
    with pytest.raises(MachineError, match="all gains of cascade that keep the limits stop the drive"):
        design(BALL_SCREW, "cascade")


def test_a_candidate_with_too_large_a_force_step_is_brought_within_the_limit() -> None:
    problem = search.Problem(BALL_SCREW, "cascade", "full", 2.0, 0.5)
    start = np.log([30.0, 100.0, 20.0, 3000.0])
    assert search._used(problem, start)[1] > 0.55
    assert search._used(problem, search._within(problem, start))[1] <= 0.5


JUST_BEYOND = np.log([122.13, 314.29, 139.27, 3119.9])
"""A cascade that the search found when Ms might be a little above its limit: 2.0018."""


def test_a_candidate_just_beyond_the_limit_of_ms_is_brought_within_it() -> None:
    problem = search.Problem(BALL_SCREW, "cascade", "full", 2.0, 2.0)
    assert 2.0 < search._used(problem, JUST_BEYOND)[0] < 2.004
    assert search._used(problem, search._within(problem, JUST_BEYOND))[0] <= 2.0


def test_gains_just_beyond_a_limit_are_no_design(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "_candidates", lambda *_: iter([JUST_BEYOND]))
    monkeypatch.setattr(Trial, "__call__", lambda *_: 0.0)
    with pytest.raises(MachineError, match=r"no gains of cascade keep Ms <= 2 .* the nearest have 2\.00[1-4]"):
        design(BALL_SCREW, "cascade")
