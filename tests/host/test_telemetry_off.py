# SPDX-License-Identifier: Apache-2.0
"""Telemetry is off until a host needs it, and off again when the host leaves, whatever happened."""

from __future__ import annotations

from collections.abc import Iterator

import can
import pytest
from click.testing import CliRunner

from kontur import machine
from kontur.can import bus_load, wire
from kontur.can.link import Link
from kontur.cli import main
from kontur.drive.device import Device
from kontur.drive.master import CHANNELS
from kontur.drive.pdos import RANGE, TELEMETRY
from kontur.drive.target import Target, open_drive
from kontur.sim.process import SimProcess, start

MACHINE = machine.load()
TPDO1_ALONE = {"tpdo1": 0x181}
COMMANDS = [
    ["jog", "--x", "10", "--duration", "0.1"],
    ["home", "x", "--method", "here"],
    ["run", "circle", "--radius", "2", "--feed", "100", "--approach"],
    ["info"],
]


@pytest.fixture(scope="module")
def process(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimProcess]:
    with start(slcan_tcp="0", pace="sync", machine=MACHINE, store=tmp_path_factory.mktemp("sim") / "flash") as sim:
        with open_drive(Target(MACHINE, bus=sim.options())) as device:
            device.parameters.set(MACHINE.parameters())
        yield sim


def sent(process: SimProcess) -> dict[str, int]:
    with open_drive(Target(MACHINE, bus=process.options())) as device:
        return device.info().tpdos


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command[0])
def test_command_leaves_the_drive_as_it_found_it(process: SimProcess, command: list[str]) -> None:
    assert sent(process) == TPDO1_ALONE
    options = process.options()
    bus = ["-i", str(options["interface"]), "-c", str(options["channel"])]
    result = CliRunner().invoke(main, [*command, *bus])
    assert result.exit_code == 0, result.output
    assert sent(process) == TPDO1_ALONE


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_telemetry_is_off_after_ctrl_c_and_errors(process: SimProcess, error: type[BaseException]) -> None:
    def interrupted() -> None:
        with open_drive(Target(MACHINE, bus=process.options())) as device, device.axes.enabled(also=TELEMETRY):
            assert set(device.pdos.sent()) == {"tpdo1", *TELEMETRY}
            raise error

    with pytest.raises(error):
        interrupted()
    assert sent(process) == TPDO1_ALONE


def test_what_another_master_has_switched_on_stays_on(process: SimProcess) -> None:
    target = Target(MACHINE, bus=process.options())
    with open_drive(target) as device:
        device.write("tpdo3.cob_id", 0x381)
    try:
        with open_drive(target) as device, device.axes.enabled(also=TELEMETRY):
            pass
        assert sent(process) == TPDO1_ALONE | {"tpdo3": 0x381}
    finally:
        with open_drive(target) as device:
            device.write("tpdo3.cob_id", 1 << 31 | 0x381)


def test_default_set_is_quiet_and_fits_slow_buses() -> None:
    """All that a drive sends by itself takes less than an eighth of 125 kbit/s, in the worst case."""
    with can.Bus(interface="kontur", channel="sim") as bus:
        link = Link(bus, 1)
        frames: list[can.Message] = []
        link.send(wire.NMT, bytes([wire.NMT_START, 1]))
        end_s = link.time_s + 1.0
        while link.time_s < end_s:
            if (message := bus.recv(0.1)) is not None:
                frames.append(message)
    bits = sum(bus_load.worst_case_bits(message.dlc) for message in frames)
    assert {message.arbitration_id for message in frames} <= {0x181, 0x701}
    assert 0 < bits < 125_000 / 8


@pytest.mark.parametrize("node_id", [1, 31])
def test_no_tpdo_has_an_identifier_of_another_node(node_id: int) -> None:
    """CiA 301: those of PDOs are 180h, 200h, ... 500h + the node id, and no service has 680h to 6DFh."""
    with can.Bus(interface="kontur", channel="sim", node_id=node_id) as bus:
        device = Device(Link(bus, node_id))
        device.pdos.require(*TELEMETRY, *RANGE)
        sent = device.pdos.sent()
        assert set(sent) == {"tpdo1", *TELEMETRY, *RANGE}
        for cob_id in sent.values():
            assert cob_id & 0x7F == node_id or 0x680 <= cob_id < CHANNELS.start


def test_info_says_what_the_drive_sends() -> None:
    result = CliRunner().invoke(main, ["info"])
    assert "sends       TPDO1 181h\n" in result.output
