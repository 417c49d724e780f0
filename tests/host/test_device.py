# SPDX-License-Identifier: Apache-2.0
"""A drive by the names of its objects: against the simulated drive, and against a bus where nobody answers."""

from collections.abc import Iterator

import can
import pytest

from kontur import machine
from kontur.can.bus import open_bus
from kontur.can.link import Link
from kontur.drive.device import Device
from kontur.errors import BusError, DeviceError, EmcyError, NoAnswerError, ParameterError


@pytest.fixture
def device() -> Iterator[Device]:
    with can.Bus(interface="kontur", channel="sim") as bus:
        yield Device(Link(bus, 1))


def test_parameter_is_read_and_written_in_its_unit(device: Device) -> None:
    assert device.read("smc.lambda") == 22.0
    device.write("smc.lambda", 150.5)
    assert device.read("smc.lambda") == 150.5
    assert device.link.node.sdo.upload(0x2110, 1) == (150500).to_bytes(4, "little")


def test_negative_value_of_four_bytes_survives_the_wire(device: Device) -> None:
    device.write("position_limit_x.min", -123_456_789)
    assert device.read("position_limit_x.min") == -123_456_789


def test_machine_is_sent_to_the_drive_and_read_back(device: Device) -> None:
    values = machine.load().parameters()
    device.parameters.set(values)
    assert {name: device.read(name) for name in values} == pytest.approx(values, rel=1e-12)


def test_dump_has_every_parameter_and_sets_back_what_was_changed(device: Device) -> None:
    before = device.parameters.dump()
    assert set(before) == set(device.parameters) - {"node.id", "node.bitrate"}
    device.write("compensator.alpha", 33.0)
    device.parameters.set(before)
    assert device.parameters.dump() == before


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("smc.lambda", 1e6, r"smc\.lambda: 1e\+06 1/s is out of range; it must be 1\.\.2000 1/s"),
        ("smc.lambda", float("nan"), r"smc\.lambda: nan is not a number"),
        ("smc.lamda", 1.0, r"smc\.lamda: no such parameter; did you mean smc\.lambda"),
    ],
)
def test_bad_value_is_refused_before_anything_is_set(device: Device, name: str, value: float, message: str) -> None:
    before = device.parameters.dump()
    with pytest.raises(ParameterError, match=message):
        device.parameters.set({"smc.gamma": 2.0, name: value})
    assert device.parameters.dump() == before


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("stream.total", -1, r"stream\.total: -1 is out of range; it must be 0\.\.3e\+09"),
        ("target_velocity_x", 1e15, r"target_velocity_x: 1e\+15 um/s is out of range"),
        ("target_velocity_x", float("inf"), r"target_velocity_x: inf is not a number"),
    ],
)
def test_value_that_the_type_of_an_object_does_not_hold_is_refused(
    device: Device, name: str, value: float, message: str
) -> None:
    with pytest.raises(ParameterError, match=message):
        device.write(name, value)


def test_parameter_of_an_enabled_axis_is_refused_by_the_drive(device: Device) -> None:
    with device.axes.enabled(), pytest.raises(DeviceError, match=r"plant_x\.mass: the drive refuses"):
        device.write("plant_x.mass", 50.0)


def reset(device: Device) -> None:
    device.link.node.nmt.send_command(0x81)


def test_saved_parameters_are_there_after_a_reset(device: Device) -> None:
    device.write("smc.lambda", 150.0)
    reset(device)
    assert device.read("smc.lambda") == 22.0
    device.write("smc.lambda", 150.0)
    device.parameters.save()
    device.write("smc.lambda", 160.0)
    reset(device)
    assert device.read("smc.lambda") == 150.0


def test_restored_defaults_are_there_after_a_reset(device: Device) -> None:
    device.write("smc.lambda", 150.0)
    device.parameters.save()
    device.parameters.restore()
    assert device.read("smc.lambda") == 150.0
    reset(device)
    assert device.read("smc.lambda") == 22.0


def test_communication_objects_are_saved_when_requested(device: Device) -> None:
    for everything, kept in ((False, 100.0), (True, 70.0)):
        device.write("heartbeat_producer", 70)
        device.parameters.save(everything)
        reset(device)
        assert device.read("heartbeat_producer") == kept
    device.parameters.restore(all_objects=True)
    reset(device)
    assert device.read("heartbeat_producer") == 100.0


def test_parameters_are_not_saved_while_an_axis_has_power(device: Device) -> None:
    with device.axes.enabled():
        for keep in (device.parameters.save, device.parameters.restore):
            with pytest.raises(DeviceError, match=r"node 1\) stores nothing: an axis has power.* switch the axes off"):
                keep()


def test_both_axes_are_enabled_inside_and_off_afterwards(device: Device) -> None:
    with device.axes.enabled():
        assert device.axes.states() == ("operation enabled", "operation enabled")
    assert device.axes.states() == ("switch on disabled", "switch on disabled")


def test_axes_are_switched_off_when_something_goes_wrong(device: Device) -> None:
    with pytest.raises(ZeroDivisionError), device.axes.enabled():
        _ = 1 / 0
    assert device.axes.states() == ("switch on disabled", "switch on disabled")


def test_silent_host_is_reported_and_the_axes_can_be_enabled_again(device: Device) -> None:
    device.axes.enable()
    sim = device.link.bus.sim  # type: ignore[attr-defined]
    sim.run(10_000)  # one second in which the host does nothing
    with pytest.raises(EmcyError, match=r"8130h: the host's heartbeat ceased"):
        device.wait(lambda: False, 0.5, "waits")
    with device.axes.enabled():
        assert device.axes.states() == ("operation enabled", "operation enabled")


def test_host_that_only_waits_keeps_its_heartbeat(device: Device) -> None:
    with device.axes.enabled():
        device.link.wait(lambda: False, 3.0)
        device.faults.check()


def test_info_tells_who_answers(device: Device) -> None:
    info = device.info()
    assert (info.name, info.num, info.control_hz, info.controller) == ("Kontur", "f32", 10_000, "ccu")
    assert info.state == ("switch on disabled", "switch on disabled")


def test_drive_that_does_not_answer_is_named() -> None:
    with can.Bus(interface="virtual", channel="nobody") as bus, pytest.raises(NoAnswerError) as caught:
        Device(Link(bus, 7))
    assert "node 7" in str(caught.value)
    assert "does not answer" in str(caught.value)


def test_bus_that_cannot_be_opened_is_named_with_what_to_do() -> None:
    with pytest.raises(BusError, match=r"bus socketcan nocan0 cannot be opened: .*Check -i, -c and -b"):
        open_bus({"interface": "socketcan", "channel": "nocan0"})
