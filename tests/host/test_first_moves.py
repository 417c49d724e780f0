# SPDX-License-Identifier: Apache-2.0
"""The first moves of an axis: what is wrong with it is said in the right words, early, and nothing is damaged."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from kontur.can.simulated import simulated
from kontur.commissioning import first_moves
from kontur.commissioning.first_moves import Agreed, Diagnosis
from kontur.commissioning.identify import identify
from kontur.drive.device import Device
from kontur.drive.target import Target, open_drive
from kontur.errors import EmcyError
from kontur.experiments.machines import draw
from kontur.machine import LENGTHS, MACHINES, NOTHING, Machine, load

BALL_SCREW = load(MACHINES / "ball_screw.toml")
HELD = {"cascade.position_gain": 20.0, "cascade.velocity_gain": 30.0, "cascade.integral_gain": 5.0}


STIFF_SCALE, LEAD_SCREW = (load(MACHINES / f"{name}.toml") for name in ("stiff_scale", "lead_screw"))


def with_x(machine: Machine = BALL_SCREW, **changes: object) -> Machine:
    return replace(machine, x=replace(machine.x, **changes))  # type: ignore[arg-type]


@contextmanager
def drive(machine: Machine, told: str = LENGTHS) -> Iterator[Device]:
    with open_drive(Target(machine=machine, told=told)) as device:
        sim = simulated(device.link.bus)
        assert sim is not None
        sim.start_recording()
        yield device


def moved_m(device: Device) -> tuple[float, float]:
    """How far both axes have moved, in truth."""
    sim = simulated(device.link.bus)
    assert sim is not None
    x, y = np.ptp(sim.take_truth().pos_m, axis=0)
    return float(x), float(y)


class Swapped:
    """Two masses with friction; the motor of x moves y, and that of y moves x."""

    def __init__(self, start_m: tuple[float, float], period_s: float) -> None:
        self.at_m, self.speed, self.period_s = list(start_m), [0.0, 0.0], period_s

    def step(self, force_N: tuple[float, float]) -> list[float]:
        for axis, push_N in enumerate((force_N[1], force_N[0])):
            speed = self.speed[axis]
            if speed == 0.0 and abs(push_N) <= 60.0:
                continue
            against_N = np.copysign(60.0, speed or push_N)
            faster = speed + (push_N - against_N - 600.0 * speed) / 100.0 * self.period_s
            self.speed[axis] = 0.0 if faster * speed < 0.0 else faster
            self.at_m[axis] += self.speed[axis] * self.period_s
        return self.at_m


def test_swapped_motors_are_found_within_a_millimetre() -> None:
    with open_drive(Target(machine=BALL_SCREW, told=LENGTHS, plant=Swapped)) as device:
        sim = simulated(device.link.bus)
        assert sim is not None
        sim.start_recording()
        with pytest.raises(Diagnosis, match="motors or encoders are swapped") as caught:
            identify(device, "x", Agreed(300.0))
        assert max(moved_m(device)) < 1e-3
    assert caught.value.kind == "swapped"


@pytest.mark.parametrize(
    ("machine", "kind", "words"),
    [
        (with_x(backlash_m=1e-3), "coupling", r"moves \d\.\d mm before it takes the table along"),
        (with_x(backlash_m=1e-2, encoder_at="table"), "mass", "is a coupling loose"),
        (with_x(STIFF_SCALE, backlash_m=1e-3), "coupling", r"moves 1\.\d mm before it takes the table along"),
        (with_x(LEAD_SCREW, backlash_m=1e-3, encoder_at="table"), "coupling", "before it takes the table along"),
    ],
    ids=["motor", "table", "scale", "thrown"],
)
def test_loose_coupling_is_found_within_some_millimetres(machine: Machine, kind: str, words: str) -> None:
    with drive(machine) as device:
        with pytest.raises(Diagnosis, match=words) as caught:
            identify(device, "x", Agreed(min(300.0, machine.x.force_limit_N)))
        assert moved_m(device)[0] < 0.01
    assert caught.value.kind == kind


@pytest.mark.parametrize(
    "machine", [load(MACHINES / "long_axis.toml"), replace(draw(801), x=draw(801).y)], ids=["soft", "cogging"]
)
def test_soft_transmission_and_strong_cogging_are_not_called_loose(machine: Machine) -> None:
    """The second one has 9 N of cogging and 19 N of friction."""
    said: list[str] = []
    with drive(machine) as device:
        device.parameters.set({"plant_x.force_limit": machine.x.force_limit_N})
        agreed = Agreed(0.5 * machine.x.force_limit_N)
        with pytest.raises(KeyboardInterrupt):
            identify(device, "x", agreed, said.append, lambda: "constant speeds" in said[-1])


def test_free_travel_ends_before_the_limit_switches() -> None:
    with drive(with_x(travel_m=(-0.03, 0.02), soft_limit_m=(-0.025, 0.015)), NOTHING) as device:
        device.parameters.set(HELD | {"observer.bandwidth": 2000.0})
        limit_N = device.read("plant_x.force_limit")
        device.select_controller("cascade")
        first_moves.find_travel(device, "x", Agreed(300.0), 80.0, lambda: False)
        found_m = [device.read(f"position_limit_x.{end}") * 1e-9 for end in ("min", "max")]
        assert device.read("plant_x.force_limit") == limit_N
    assert -0.027 < found_m[0] < -0.024  # a switch closes 2 mm before the end stop
    assert 0.014 < found_m[1] < 0.017


def test_reversed_axis_stops_at_the_switch_that_it_should_not_meet() -> None:
    reversed_ = {"force_inverted": True, "encoder_inverted": True}
    with drive(with_x(travel_m=(-0.02, 0.03), soft_limit_m=(-0.015, 0.025), **reversed_), NOTHING) as device:
        device.parameters.set(HELD | {"observer.bandwidth": 2000.0})
        device.select_controller("cascade")
        with pytest.raises(Diagnosis, match="its lower limit switch on its way to the upper one") as caught:
            first_moves.find_travel(device, "x", Agreed(300.0), 80.0, lambda: False)
        assert "wiring_x.invert_force and wiring_x.invert_encoder" in str(caught.value)
        sim = simulated(device.link.bus)
        assert sim is not None
        assert np.min(sim.take_truth().pos_m) > -0.0199  # the end stop is at -20 mm
    assert caught.value.kind == "direction"


def test_switch_that_never_closes_is_named_and_the_end_stop_met_gently() -> None:
    machine = with_x(travel_m=(-0.03, 0.02), soft_limit_m=(-0.025, 0.015), limit_switch_m=0.0)
    with drive(machine, NOTHING) as device:
        device.parameters.set(HELD | {"observer.bandwidth": 2000.0})
        device.select_controller("cascade")
        with pytest.raises(Diagnosis, match=r"at 20\.\d mm on its way to the upper limit switch") as caught:
            first_moves.find_travel(device, "x", Agreed(300.0), 80.0, lambda: False)
        sim = simulated(device.link.bus)
        assert sim is not None
        assert np.max(np.abs(sim.take_truth().force_N)) <= 3.0 * 80.0 + 1.0
    assert caught.value.kind == "switch"


class Gauge:
    """Shows `factor` times what the drive has counted."""

    def __init__(self, factor: float) -> None:
        self.factor, self.counted_m = factor, 0.0
        self.said: list[str] = []

    def ready(self, axis: str) -> None:
        self.said.append(f"{axis} is ready")

    def distance_m(self, axis: str, counted_m: float) -> float:
        self.said.append(f"{axis} has moved")
        self.counted_m = counted_m
        return counted_m * self.factor


@pytest.mark.parametrize(("factor", "kind"), [(1.0, ""), (1.005, ""), (2.0, "encoder"), (1.0 / 6.5, "encoder")])
def test_length_of_a_count_is_checked_by_a_move_that_the_user_measures(factor: float, kind: str) -> None:
    gauge = Gauge(factor)
    with drive(BALL_SCREW) as device:
        device.parameters.set(HELD | {"observer.bandwidth": 2000.0})
        device.select_controller("cascade")
        found, text = _diagnosis(lambda: first_moves.check_by_gauge(device, "x", gauge, lambda: False))
        moved = moved_m(device)[0]
    assert found == kind
    assert not kind or f"Set plant_x.encoder={76.29e-3 * factor:.6g}"[:-1] in text
    assert gauge.said[:2] == ["x is ready", "x has moved"]
    assert gauge.counted_m == pytest.approx(moved, abs=1e-3)
    assert 0.01 < moved < 0.03


def _diagnosis(call: Callable[[], object]) -> tuple[str, str]:
    """Kind and text of the diagnosis of a call, empty where there is none."""
    try:
        call()
    except Diagnosis as error:
        return error.kind, str(error)
    return "", ""


def test_fault_on_the_way_says_at_which_step_and_what_to_look_at() -> None:
    said: list[str] = []
    fault = EmcyError(0x8611, 1, b"", "the drive reports 8611h")
    with (
        pytest.raises(Diagnosis, match=r"constant speeds.*end stop whose switch does not close.*8611h") as caught,
        first_moves.explained("x", "constant speeds", said.append),
    ):
        raise fault
    assert said == ["x: constant speeds"]
    assert caught.value.kind == "blocked"


@pytest.mark.parametrize("code", [0x8130, 0xFF10])
def test_host_that_was_too_slow_is_no_blocked_axis(code: int) -> None:
    words = r"axis x was stopped at this step: constant speeds\. no heartbeat"
    with (
        pytest.raises(Diagnosis, match=words) as caught,
        first_moves.explained("x", "constant speeds", lambda text: None),
    ):
        raise EmcyError(code, 1, b"", "no heartbeat")
    assert caught.value.kind == "host"


@pytest.mark.parametrize("swings", [0, 1], ids=["fast", "slow"])
def test_fault_that_says_nothing_of_the_direction_is_not_taken_for_a_runaway(
    swings: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A host that was too slow while the force swings fast, or slowly, is told as that."""
    done: list[int] = []

    def swing(*_: object) -> bool:
        if len(done) == swings:
            raise EmcyError(0x8130, 1, b"", "no heartbeat")
        done.append(1)
        return True

    monkeypatch.setattr(first_moves, "_swing", swing)
    with drive(BALL_SCREW) as device, pytest.raises(Diagnosis, match="no heartbeat") as caught:
        identify(device, "x", Agreed(300.0))
    assert caught.value.kind == "host"


def test_encoder_and_scale_that_disagree_are_no_blocked_axis() -> None:
    """The drive watches them, and says what to look at: a scale_m of another scale ends within some millimetres."""
    with drive(load(MACHINES / "stiff_scale.toml")) as device:
        device.parameters.set({"second_encoder_x.length": 0.02})
        with pytest.raises(Diagnosis, match=r"^axis x: .*7306h.*second_encoder length") as caught:
            identify(device, "x", Agreed(300.0))
        assert moved_m(device)[0] < 0.005
    assert caught.value.kind == "encoder"


@pytest.mark.parametrize(("behind_s", "calls"), [(0.0, 1), (0.4, 4), (1e9, 160)])
def test_frames_that_came_while_the_host_computed_are_handled_first(
    behind_s: float, calls: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the answer to the next request stands behind them, and the drive seems to be silent."""
    clock, called = [0.0], [0]

    def handle_pending() -> None:  # as of a Link: what has come, for about 0.1 s at most
        called[0] += 1
        clock[0] += min(0.125, max(0.0, behind_s - clock[0]))

    monkeypatch.setattr("time.monotonic", lambda: clock[0])
    first_moves.catch_up(SimpleNamespace(link=SimpleNamespace(handle_pending=handle_pending)))  # type: ignore[arg-type]
    assert called[0] == calls
