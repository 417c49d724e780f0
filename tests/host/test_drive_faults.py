# SPDX-License-Identifier: Apache-2.0
"""The drive behind the wire: parameters that must fit, faults as the host sees them, stops measured by the truth.

All on the simulated drive, through python-can frames.
"""

import dataclasses
from collections.abc import Callable, Iterator

import can
import numpy as np
import pytest
from stepped_stream import SteppedStream

from kontur import machine
from kontur.can.link import Link
from kontur.drive.device import Device
from kontur.drive.state_machine import BIT_PATH_RUNS, ENABLE
from kontur.drive.stream import stream
from kontur.errors import EmcyError, ParameterError
from kontur.path import shapes
from kontur.planning import planner
from kontur.planning.bounds import limits
from kontur.sim.bus import KonturBus

RADIUS_M = 0.004
FEED_MPS = 0.1
COUNT_UM = 0.07629
MACHINE = machine.load().starting_at((RADIUS_M, 0.0))
CIRCLE = planner.plan(shapes.circle(RADIUS_M, FEED_MPS, duration_s=1.2), limits(MACHINE))


@pytest.fixture
def device() -> Iterator[Device]:
    with can.Bus(interface="kontur", channel="sim", machine=MACHINE, seed=1) as bus:
        device = Device(Link(bus, 1))
        device.parameters.set(MACHINE.parameters())
        yield device


# --- parameters ---


@pytest.mark.parametrize("order", [1, -1])
def test_parameters_that_must_fit_together_may_be_set_in_any_order(device: Device, order: int) -> None:
    for values in (
        {"smc.k_0": 600.0, "smc.k_max": 800.0},
        {"smc.k_0": 50.0, "smc.k_max": 60.0},
        {"smc.k_bar": 4000.0, "smc.e_max": 1000.0},
        {"smc.k_bar": 40.0, "smc.e_max": 100000.0},
        {"compensator.mu_0": 9.0, "compensator.mu_max": 10.0},
    ):
        device.parameters.set(dict(list(values.items())[::order]))
        assert {name: device.read(name) for name in values} == values


def test_parameter_that_fits_no_other_is_refused_with_its_name(device: Device) -> None:
    with pytest.raises(ParameterError, match=r"smc\.k_0: the value does not fit another parameter"):
        device.parameters.set({"smc.gamma": 2.0, "smc.k_0": 401.0})
    assert device.read("smc.k_0") == 100.0
    device.axes.enable()


@pytest.mark.parametrize("axis", "xy")
@pytest.mark.parametrize(("name", "value"), [("pole_3", 4900.001), ("pole_1", 5000.0), ("pole_4", 0.5)])
def test_force_filter_above_half_the_control_rate_is_refused_with_its_name(
    device: Device, axis: str, name: str, value: float
) -> None:
    name = f"force_filter_{axis}.{name}"
    with pytest.raises(ParameterError, match=f"{name}: the value does not fit another parameter or the control rate"):
        device.parameters.set({name: value})
    assert device.read(name) == 0.0
    device.parameters.set({name: 4900.0})


@pytest.mark.parametrize("order", [1, -1])
def test_parameters_are_as_before_when_one_of_them_fits_no_other(device: Device, order: int) -> None:
    values = {"smc.gamma": 2.0, "smc.k_0": 600.0, "smc.k_max": 800.0, "compensator.mu_0": 90.0}
    before = device.parameters.dump()
    assert values["compensator.mu_0"] > before["compensator.mu_max"]
    with pytest.raises(ParameterError, match=r"compensator\.mu_0: the value does not fit another parameter"):
        device.parameters.set(dict(list(values.items())[::order]))
    assert device.parameters.dump() == before
    device.axes.enable()
    device.axes.disable()
    assert device.parameters.dump() == before


# --- stops, measured by where the machine really was ---


def contour_um(bus: KonturBus) -> np.ndarray:
    """Distance of the true position to the circle, one a control period."""
    return np.abs(np.hypot(*bus.sim.truth().pos_m.T) - RADIUS_M) * 1e6


def start(device: Device) -> SteppedStream:
    device.axes.enable()
    stepped = SteppedStream(device, CIRCLE.knots_nm)
    bus = device.link.bus
    assert isinstance(bus, KonturBus)
    bus.sim.start_schedule()
    bus.sim.record(True)
    stepped.start()
    return stepped


def fall_silent(stepped: SteppedStream) -> None:
    """No heartbeat any more; knots go on."""
    stepped.device.link.stop_heartbeat()
    with pytest.raises(EmcyError, match="8130h"):
        stepped.advance(1.0)


def bit_4(device: Device, stepped: SteppedStream) -> None:
    device.axes.controlwords(ENABLE, ENABLE)
    device.link.wait(lambda: False, 0.2)
    assert device.axes.states() == ("operation enabled", "operation enabled")
    assert device.read("stream.state") == 5


def silence(device: Device, stepped: SteppedStream) -> None:
    fall_silent(stepped)
    device.link.wait(lambda: False, 0.2)
    assert device.axes.states() == ("fault", "fault")
    assert device.axes.both(BIT_PATH_RUNS, False)


@pytest.fixture(scope="module")
def undisturbed_max_um() -> float:
    with can.Bus(interface="kontur", channel="sim", machine=MACHINE, seed=1) as bus:
        device = Device(Link(bus, 1))
        device.parameters.set(MACHINE.parameters())
        stepped = start(device)
        stepped.advance(CIRCLE.duration_s + 0.2)
        assert device.read("stream.state") == 4
        return float(contour_um(bus).max())


@pytest.mark.parametrize("way", [bit_4, silence])
@pytest.mark.parametrize("number", range(20))
def test_stop_leaves_the_circle_no_further_than_the_run_without_it(
    device: Device, undisturbed_max_um: float, way: Callable[[Device, SteppedStream], None], number: int
) -> None:
    moment_s = np.random.default_rng(number).uniform(0.1, 0.7 if way is silence else 1.2)
    stepped = start(device)
    stepped.advance(moment_s)
    way(device, stepped)
    bus = device.link.bus
    assert isinstance(bus, KonturBus)
    truth = bus.sim.truth()
    assert contour_um(bus).max() <= undisturbed_max_um + COUNT_UM
    stopped = np.flatnonzero(np.hypot(*truth.vel_mps.T) > 1e-3)[-1]
    turned_m = RADIUS_M * np.abs(np.diff(np.unwrap(np.arctan2(*truth.pos_m.T[::-1])))).sum()
    assert turned_m < FEED_MPS * (stopped * 1e-4) - 1e-3, "it did not stop on the way"


# --- faults, as exceptions of the host ---


@pytest.mark.parametrize(
    ("frozen_ms", "message"),
    [
        (20, r"7320h: an encoder stood still while .* Remedy: check .* moves freely"),
        (0, r"8611h: an axis was further from its reference .* Remedy: set plant_x and plant_y as the machine is"),
    ],
)
def test_blocked_axis_is_reported_with_its_remedy(frozen_ms: int, message: str) -> None:
    stuck = dataclasses.replace(MACHINE, x=dataclasses.replace(MACHINE.x, coulomb_N=3000.0))
    with can.Bus(interface="kontur", channel="sim", machine=stuck, seed=1) as bus:
        device = Device(Link(bus, 1))
        device.parameters.set({**MACHINE.parameters(), "fault_delay.frozen": frozen_ms})
        device.axes.enable()
        with pytest.raises(EmcyError, match=message):
            stream(device, CIRCLE.knots_nm)
        device.axes.enable()
        assert device.axes.states() == ("operation enabled", "operation enabled")


def test_axis_that_is_too_fast_is_reported(device: Device) -> None:
    device.write("limits.velocity", 0.05)
    device.axes.enable()
    with pytest.raises(EmcyError, match=r"8400h"):
        stream(device, CIRCLE.knots_nm)


def test_knot_outside_the_limits_is_reported_and_the_drive_can_be_enabled_again(device: Device) -> None:
    device.write("position_limit_x.min", -3_000_000)
    device.axes.enable()
    with pytest.raises(EmcyError, match=r"FF11h: a knot lies outside position_limit"):
        stream(device, CIRCLE.knots_nm)
    device.axes.enable()
    assert device.axes.states() == ("operation enabled", "operation enabled")


def test_drive_is_enabled_again_after_the_host_was_silent(device: Device) -> None:
    stepped = start(device)
    stepped.advance(0.3)
    fall_silent(stepped)
    device.link.wait(lambda: False, 0.2)
    assert device.info().error_code == (0x8130, 0x8130)
    device.axes.enable()
    assert device.info().error_code == (0, 0)


def test_reset_node_during_motion_leaves_a_drive_that_works(device: Device) -> None:
    stepped = start(device)
    stepped.advance(0.3)
    device.link.send(0x000, bytes([129, 1]))
    bus = device.link.bus
    assert isinstance(bus, KonturBus)
    bus.sim.run(2000)
    assert np.abs(bus.sim.truth().force_N[-1999:]).max() == 0.0
    device.axes.enable()
    assert device.read("stream.state") == 0
    assert device.axes.states() == ("operation enabled", "operation enabled")
