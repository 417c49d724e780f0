# SPDX-License-Identifier: Apache-2.0
"""One program at a time commands a drive: claiming, holding, releasing, and what the others are told."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import can
import pytest
from click.testing import CliRunner

from kontur.can import wire
from kontur.can.bus import open_bus
from kontur.can.link import Link
from kontur.cli import main
from kontur.drive.device import Device, connected
from kontur.drive.state_machine import ENABLE, SHUTDOWN
from kontur.errors import DeviceError, EmcyError, HeldError
from kontur.sim.process import start

GUARD_S = 0.5


@pytest.fixture
def bus() -> Iterator[can.BusABC]:
    with can.Bus(interface="kontur", channel="sim") as bus:
        yield bus


@pytest.fixture
def device(bus: can.BusABC) -> Device:
    return Device(Link(bus, 1))


@pytest.fixture
def other(bus: can.BusABC) -> Device:
    """Another program, with the same node id."""
    return Device(Link(bus, 1))


def heartbeats(device: Device) -> list[int]:
    """Those that `device` sends from now on."""
    sent: list[int] = []
    before = device.link.send

    def send(cob_id: int, data: bytes) -> None:
        if cob_id == wire.HEARTBEAT + wire.HOST_NODE_ID:
            sent.append(data[0])
        before(cob_id, data)

    device.link.send = send  # type: ignore[method-assign]
    return sent


def test_drive_is_held_inside_and_free_afterwards(device: Device) -> None:
    assert device.read("master.holder") == 0
    with device.master.held():
        assert device.read("master.holder") == wire.HOST_NODE_ID
        with device.axes.enabled():
            assert device.read("master.holder") == wire.HOST_NODE_ID
        assert device.read("master.holder") == wire.HOST_NODE_ID
        device.link.wait(lambda: False, 3 * GUARD_S)
        assert device.read("master.holder") == wire.HOST_NODE_ID
    assert device.read("master.holder") == 0


@pytest.mark.parametrize("error", [ZeroDivisionError, KeyboardInterrupt])
def test_drive_is_released_whatever_happens(device: Device, error: type[BaseException]) -> None:
    with pytest.raises(error), device.master.held(), device.axes.enabled():
        raise error
    assert device.read("master.holder") == 0
    assert device.axes.states() == ("switch on disabled", "switch on disabled")


def test_second_program_is_refused_with_the_name_of_the_holder_though_its_id_is_the_same(
    device: Device, other: Device
) -> None:
    with device.master.held():
        for command in (other.master.claim, other.axes.enable):
            with pytest.raises(HeldError, match=r"drive 1 on .* is held by master 127.*stop that program.* 500 ms"):
                command()
        with pytest.raises(HeldError), other.master.held():
            raise AssertionError
        assert device.read("master.refused") >= 3
        device.link.wait(lambda: False, 2 * GUARD_S)
        device.axes.enable()
        device.axes.disable()
    with other.axes.enabled():
        assert other.read("master.holder") == wire.HOST_NODE_ID


def test_second_program_does_not_disturb_the_first_ones_axes(device: Device, other: Device) -> None:
    with device.axes.enabled():
        with pytest.raises(HeldError):
            other.axes.enable()
        with pytest.raises(DeviceError):
            other.master.release()
        device.link.wait(lambda: False, 2 * GUARD_S)
        assert device.axes.states() == ("operation enabled", "operation enabled")
        device.faults.check()


def test_who_only_looks_on_sends_no_heartbeat_for_a_holder_that_has_died(device: Device, other: Device) -> None:
    sent = heartbeats(other)
    device.axes.enable()
    device.link.stop_heartbeat()  # it has died
    other.info()
    with pytest.raises(EmcyError, match="8130h"):
        other.wait(lambda: False, 3 * GUARD_S, "waits")
    assert sent == []
    with other.axes.enabled():
        assert sent


def test_drive_that_somebody_enabled_without_a_claim_is_left_alone(device: Device, other: Device) -> None:
    device.axes.start_node()
    device.axes.controlwords(SHUTDOWN, SHUTDOWN)
    device.link.wait(lambda: False, 0.05)
    device.axes.controlwords(ENABLE, ENABLE)
    device.link.wait(lambda: False, 0.05)
    assert device.axes.states() == ("operation enabled", "operation enabled")
    with pytest.raises(HeldError, match="has power for a master that has not claimed it: switch it off there"):
        other.master.claim()
    device.link.wait(lambda: False, 0.05)
    assert device.axes.states() == ("operation enabled", "operation enabled")


def test_claim_that_was_lost_in_a_pause_is_made_again(device: Device) -> None:
    with device.master.held():
        device.link.bus.sim.run(10_000)  # type: ignore[attr-defined]
        assert device.read("master.holder") == 0
        with device.axes.enabled():
            assert device.axes.states() == ("operation enabled", "operation enabled")


def test_claim_whose_answers_are_lost_is_no_second_master(device: Device) -> None:
    bus = device.link.bus
    receive, lost = bus.recv, 0

    def lossy(timeout: float | None = None) -> can.Message | None:
        nonlocal lost
        message = receive(timeout)
        if message is not None and message.arbitration_id == 0x581 and lost < 2:
            lost += 1
            return None
        return message

    bus.recv = lossy  # type: ignore[method-assign]
    with device.axes.enabled():
        assert device.axes.states() == ("operation enabled", "operation enabled")
    assert lost == 2
    assert device.read("master.refused") == 0


@pytest.fixture
def held_drive() -> Iterator[list[str]]:
    """Bus options of a drive that another program holds."""
    with start(slcan_tcp="0") as sim:
        with connected(open_bus(sim.options()), 1) as device:
            device.link.node.sdo[0x1016][1].raw = wire.HOST_NODE_ID << 16 | 60_000  # ms: it need not live on
            device.master.claim()
        yield ["-i", sim.interface, "-c", sim.channel]


def test_commands_that_write_or_move_are_refused_and_those_that_read_are_not(
    held_drive: list[str], tmp_path: Path
) -> None:
    file = tmp_path / "parameters.toml"
    for reading in (["info"], ["param", "get", "smc.lambda"], ["param", "dump", str(file)]):
        result = CliRunner().invoke(main, [*reading, *held_drive])
        assert result.exit_code == 0, result.output
    for writing in (
        ["run", "circle", "--radius", "2", "--feed", "10"],
        ["jog", "--x", "1"],
        ["home", "x"],
        ["param", "set", "smc.lambda=150"],
        ["param", "load", str(file)],
        ["param", "save"],
        ["param", "restore"],
    ):
        result = CliRunner().invoke(main, [*writing, *held_drive])
        assert result.exit_code == 1, result.output
        assert "held by master 127" in result.stderr
        assert "stop that program" in result.stderr
        assert "Traceback" not in result.stderr
    with connected(open_bus({"interface": "slcan", "channel": held_drive[3]}), 1) as device:
        assert dataclasses.astuple(device.info())[6] == ("switch on disabled", "switch on disabled")
        assert device.read("smc.lambda") == 22.0
