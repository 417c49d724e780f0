# SPDX-License-Identifier: Apache-2.0
"""Jogging and homing over CAN, against the true position of the simulated machine, which no encoder sees."""

import json
from collections.abc import Callable, Iterator

import can
import numpy as np
import pytest
from click.testing import CliRunner
from hooked_bus import HookedBus

from kontur import machine
from kontur.can import wire
from kontur.can.link import Link
from kontur.cli import main
from kontur.drive import single_axis
from kontur.drive.axes import AXES, METHODS
from kontur.drive.device import Device
from kontur.drive.state_machine import FAULT_RESET
from kontur.errors import DeviceError, EmcyError, ParameterError
from kontur.sim.library import Sim

MACHINE = machine.load()
SWITCH_M = 0.148
COUNT_M = 76.29e-9


@pytest.fixture
def start_m() -> tuple[float, float]:
    return (0.0, 0.0)


@pytest.fixture
def device(start_m: tuple[float, float]) -> Iterator[Device]:
    with can.Bus(interface="kontur", channel="sim", machine=MACHINE.starting_at(start_m), seed=1) as bus:
        drive = Device(Link(bus, 1))
        drive.parameters.set(MACHINE.parameters())
        yield drive


def sim(device: Device) -> Sim:
    simulator: Sim = device.link.bus.sim  # type: ignore[attr-defined]
    return simulator


def true_m(device: Device) -> np.ndarray:
    """Where the axes truly are, now."""
    sim(device).record(True)
    sim(device).run(1)
    return sim(device).truth().pos_m[-1]


def test_jog_moves_its_axis_with_the_speed_requested_and_holds_the_other(device: Device) -> None:
    with device.axes.enabled():
        sim(device).record(True)
        assert single_axis.jog(device, {"x": 0.05}, 0.5)
        truth = sim(device).truth()
    speed = truth.vel_mps[:, 0]
    assert np.median(speed[speed > 0.025]) == pytest.approx(0.05, rel=1e-3)
    assert speed.max() < 0.0503
    assert np.abs(truth.pos_m[:, 1]).max() < 1e-6
    # as long as told, at 50 mm/s, and what it takes to ask for it over the bus
    assert truth.pos_m[-1, 0] == pytest.approx(0.025, abs=0.001)
    acceleration = np.abs(truth.force_N[:, 0]).max() / MACHINE.x.mass_kg
    assert acceleration < 1.0 + (MACHINE.x.coulomb_N + 0.05 * MACHINE.x.viscous_Nspm) / MACHINE.x.mass_kg + 0.3


def test_jog_ends_before_a_soft_limit_without_a_fault(device: Device) -> None:
    device.write("position_limit_x.max", 3_000_000)
    with device.axes.enabled():
        sim(device).record(True)
        assert not single_axis.jog(device, {"x": 0.1}, 5.0)
        truth = sim(device).truth()
        assert device.axes.states() == ("operation enabled", "operation enabled")
    assert truth.pos_m[-1, 0] == pytest.approx(0.003, abs=1e-6)
    assert truth.pos_m[:, 0].max() < 0.003 + 2e-6


@pytest.mark.parametrize("start_m", [(0.14, 0.0)])
def test_jog_ends_on_a_limit_switch_that_comes_before_the_soft_limit(device: Device) -> None:
    device.write("position_limit_x.max", 150_000_000)
    with device.axes.enabled():
        assert not single_axis.jog(device, {"x": 0.02}, 5.0)
        assert device.read("digital_inputs_x") == 2
        assert SWITCH_M < true_m(device)[0] < SWITCH_M + 0.001


def test_stop_request_ends_the_jog(device: Device) -> None:
    asked = iter([False] * 20 + [True] * 1000)
    with device.axes.enabled():
        assert not single_axis.jog(device, {"x": 0.02, "y": -0.02}, 30.0, lambda: next(asked))
        at_m = true_m(device)
    assert at_m[0] == pytest.approx(-at_m[1], abs=0.002)
    assert 0.0 < at_m[0] < 0.02


@pytest.mark.parametrize("inverted", ["invert_force", "invert_encoder"])
def test_wrong_polarity_is_rehearsed_by_an_axis_that_runs_away(device: Device, inverted: str) -> None:
    device.parameters.set({f"wiring_x.{inverted}": 1})
    with pytest.raises(EmcyError, match="8611h"), device.axes.enabled():
        single_axis.jog(device, {"x": 0.02}, 1.0)
    assert abs(true_m(device)[0]) > 5e-5


def test_force_and_encoder_inverted_together_are_the_other_direction(device: Device) -> None:
    device.parameters.set({"wiring_x.invert_force": 1, "wiring_x.invert_encoder": 1})
    with device.axes.enabled():
        assert single_axis.jog(device, {"x": 0.02}, 1.0)
        assert device.position_m()[0] == pytest.approx(-true_m(device)[0], abs=5 * COUNT_M)
        assert true_m(device)[0] < -0.015


@pytest.mark.parametrize("speed_mps", [float("nan"), float("inf"), 1e9])
def test_jog_at_no_speed_that_a_drive_can_be_given_is_refused(device: Device, speed_mps: float) -> None:
    with device.axes.enabled(), pytest.raises(ParameterError, match="target_velocity_x"):
        single_axis.jog(device, {"x": speed_mps}, 1.0)


def test_jog_of_a_silent_host_stops(device: Device) -> None:
    with device.axes.enabled():
        device.write("mode_x", 3)
        device.link.wait(lambda: False, 0.01)
        device.write("target_velocity_x", 50_000)
        device.link.wait(lambda: False, 0.3)
        sim(device).record(True)
        sim(device).run(15_000)
        truth = sim(device).truth()
        assert np.abs(truth.force_N[-5000:]).max() == 0.0
        assert (
            np.abs(truth.vel_mps[-5000:]).max() < 1e-3
        )  # where friction is nothing, noise moves a table without power
        with pytest.raises(EmcyError, match="8130h"):
            device.wait(lambda: False, 0.5, "waits")


@pytest.mark.parametrize("start_m", [(-0.14, 0.135)])
@pytest.mark.parametrize(
    ("axis", "method", "home_m"),
    [("x", "switch-", -SWITCH_M), ("y", "switch+", SWITCH_M), ("x", "switch-index-", -0.14), ("y", "index-", 0.13)],
)
def test_home_point_is_the_true_edge_of_the_switch_or_the_index(
    device: Device, axis: str, method: str, home_m: float
) -> None:
    device.parameters.set({f"homing_method_{axis}": METHODS[method], f"home_offset_{axis}": 7_000_000})
    with device.axes.enabled():
        assert single_axis.home(device, axis)
        i = AXES.index(axis)
        reported_m = device.position_m()[i]
        assert reported_m - 0.007 == pytest.approx(true_m(device)[i] - home_m, abs=5 * COUNT_M)
        assert device.axes.states() == ("operation enabled", "operation enabled")
    assert device.position_m()[i] == pytest.approx(reported_m, abs=2e-6)  # it stays when the power goes


@pytest.fixture
def lossy() -> Iterator[tuple[Device, Callable[[float], None]]]:
    """A drive near its lower limit switch, and what loses all TPDO1 for a time, from now on."""
    with HookedBus(channel="sim", machine=MACHINE.starting_at((-0.14, 0.0)), seed=1) as bus:
        drive = Device(Link(bus, 1))
        drive.parameters.set(MACHINE.parameters())

        def lose_status(duration_s: float) -> None:
            end_s = bus.time_s + duration_s
            bus.on_recv = lambda message: (
                None if message.arbitration_id == wire.TPDO1 + 1 and bus.time_s < end_s else message
            )

        yield drive, lose_status


@pytest.mark.parametrize("silent_s", [0.0, 0.02, 0.3])
def test_homing_again_ends_at_the_home_point_of_the_second_method(
    lossy: tuple[Device, Callable[[float], None]], silent_s: float
) -> None:
    device, lose_status = lossy
    for method, offset_nm in (("here", 20_000_000), ("switch-", -148_000_000), ("here", 5_000_000)):
        device.parameters.set({"homing_method_x": METHODS[method], "home_offset_x": offset_nm})
        with device.axes.enabled():
            device.write("mode_x", 6)  # as a master before may have left it
            device.axes.refresh()
            lose_status(silent_s)
            assert single_axis.home(device, "x")
            at_m = device.position_m()[0]
            truly_m = true_m(device)[0]
        expected_m = truly_m if method == "switch-" else offset_nm * 1e-9
        assert at_m == pytest.approx(expected_m, abs=5 * COUNT_M), method


def test_homing_twice_with_power_on_homes_twice(lossy: tuple[Device, Callable[[float], None]]) -> None:
    device, lose_status = lossy
    device.parameters.set({"homing_method_x": METHODS["switch-"], "home_offset_x": -148_000_000})
    with device.axes.enabled():
        for _ in range(2):
            begin_s = device.link.time_s
            lose_status(0.1)
            assert single_axis.home(device, "x")
            assert device.link.time_s - begin_s > 0.2
            assert device.position_m()[0] == pytest.approx(true_m(device)[0], abs=5 * COUNT_M)


def test_jog_back_from_a_limit_is_not_taken_for_the_one_that_it_stopped(
    lossy: tuple[Device, Callable[[float], None]],
) -> None:
    device, lose_status = lossy
    device.write("position_limit_x.min", -141_000_000)
    with device.axes.enabled():
        assert not single_axis.jog(device, {"x": -0.05}, 5.0)
        lose_status(0.1)
        assert single_axis.jog(device, {"x": 0.05}, 0.3)


def test_short_jog_returns_when_the_axis_stands(lossy: tuple[Device, Callable[[float], None]]) -> None:
    device, lose_status = lossy
    with device.axes.enabled():
        device.write("mode_x", 3)
        device.link.wait(lambda: False, 0.05)
        lose_status(0.1)
        single_axis.jog(device, {"x": 0.05}, 0.08)
        at_m = true_m(device)[0]
        device.link.wait(lambda: False, 0.2)
        assert true_m(device)[0] == pytest.approx(at_m, abs=2e-6)


def test_fault_reset_bit_that_a_master_left_set_does_not_keep_the_next_one_out(device: Device) -> None:
    device.axes.enable()
    device.write("mode_x", 3)
    device.write("target_velocity_x", 50_000)
    device.link.wait(lambda: False, 0.3)
    device.link.stop_heartbeat()
    device.link.wait(lambda: "fault reaction active" in device.axes.states(), 2.0)
    for axis in "xy":
        device.write(f"controlword_{axis}", FAULT_RESET)  # too early: its edge is gone
    device.link.wait(lambda: device.axes.states() == ("fault", "fault"), 2.0)
    device.axes.enable()
    assert device.axes.states() == ("operation enabled", "operation enabled")


def test_homing_that_finds_nothing_is_an_error_that_says_what_to_look_at(device: Device) -> None:
    device.parameters.set({"homing_method_x": 17, "position_limit_x.min": -1e6, "position_limit_x.max": 1e6})
    with device.axes.enabled(), pytest.raises(DeviceError, match=r"axis x has found no home point .*digital_inputs_x"):
        single_axis.home(device, "x")
    assert abs(true_m(device)[0]) < 0.004


def test_homing_can_be_stopped(device: Device) -> None:
    device.parameters.set({"homing_method_x": 17})
    asked = iter([False] * 50 + [True] * 1000)
    with device.axes.enabled():
        assert not single_axis.home(device, "x", lambda: next(asked))
    assert -0.02 < true_m(device)[0] < -0.001


def test_home_and_jog_on_the_command_line() -> None:
    def kontur(*args: str) -> dict[str, object]:
        result = CliRunner().invoke(main, [*args, "--json"])
        assert result.exit_code == 0, result.output
        values: dict[str, object] = json.loads(result.stdout)
        return values

    assert kontur("home", "y", "--method", "here", "--offset", "12.5")["position_m"] == pytest.approx(0.0125, abs=1e-6)
    jogged = kontur("jog", "--x", "10", "--duration", "0.2")
    assert jogged["completed"] is True
    assert jogged["to_m"][0] == pytest.approx(0.002, abs=2e-4)  # type: ignore[index]
    assert CliRunner().invoke(main, ["jog"]).exit_code == 2
