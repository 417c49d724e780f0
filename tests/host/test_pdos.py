# SPDX-License-Identifier: Apache-2.0
"""PDOs that another master has changed or stored: said before an axis is enabled, and set for the run on request."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from kontur import machine
from kontur.can import wire
from kontur.can.bad_bus import BadBus, BusFaults
from kontur.can.bus import open_bus
from kontur.can.link import Link
from kontur.drive import single_axis
from kontur.drive.device import Device, connected
from kontur.drive.target import Target, open_drive
from kontur.errors import DeviceError
from kontur.path import shapes
from kontur.planning.bounds import limits
from kontur.planning.planner import Trajectory, plan
from kontur.runs.runner import run
from kontur.sim.process import SimProcess, start

MACHINE = machine.load()
UNUSED = 1 << 31
STEAL_STATUS = [("tpdo1.cob_id", UNUSED | 0x181), ("tpdo2.cob_id", UNUSED | 0x281), ("tpdo2.cob_id", 0x181)]
OTHER_MAPPING = [
    ("rpdo1.cob_id", UNUSED | 0x201),
    ("rpdo1_map.highest_sub", 0),
    ("rpdo1_map.map_1", 0x68400010),
    ("rpdo1_map.map_2", 0x60400010),
    ("rpdo1_map.highest_sub", 2),
    ("rpdo1.cob_id", 0x201),
]
# what another master may have written, and the first object that kontur names
COMMANDS = {
    "controlwords with another identifier": (
        [("rpdo1.cob_id", UNUSED | 0x201), ("rpdo1.cob_id", 0x205)],
        "1400h:1 rpdo1.cob_id is 205h, not 201h",
    ),
    "axes changed over": (OTHER_MAPPING, "1600h:1 rpdo1_map.map_1 is 68400010h, not 60400010h"),
    "controlwords at SYNC": ([("rpdo1.type", 1)], "1400h:2 rpdo1.type is 1, not 254"),
    "knots not in use": ([("rpdo2.cob_id", UNUSED | 0x301)], "1401h:1 rpdo2.cob_id is 80000301h, not 301h"),
    "statuswords not in use": ([("tpdo1.cob_id", UNUSED | 0x181)], "1800h:1 tpdo1.cob_id is 80000181h, not 40000181h"),
    "statuswords at a change only": ([("tpdo1.event_ms", 0)], "1800h:5 tpdo1.event_ms is 0, not 10"),
    "statuswords seldom": (
        [("tpdo1.cob_id", UNUSED | 0x181), ("tpdo1.inhibit", 100_000), ("tpdo1.cob_id", 0x181)],
        "1800h:3 tpdo1.inhibit is 100000, not 0",
    ),
    "telemetry in place of statuswords": (STEAL_STATUS, "1800h:1 tpdo1.cob_id is 80000181h, not 40000181h"),
    "another RPDO at the identifier of controlwords": (
        [("rpdo3.cob_id", UNUSED | 0x401), ("rpdo3.cob_id", 0x201)],
        "1402h:1 rpdo3.cob_id is 201h, not 401h",
    ),
    "no EMCY": ([("emcy_cob_id", UNUSED | 0x81)], "1014h emcy_cob_id is 80000081h, not 81h"),
}
TELEMETRY = {
    "positions elsewhere": ([("tpdo3.cob_id", 0x385)], "1802h:1 tpdo3.cob_id is 385h, not 40000381h"),
    "positions each 5 ms": ([("tpdo3.event_ms", 5)], "1802h:5 tpdo3.event_ms is 5, not 1"),
}


def as_another_master(device: Device, writes: list[tuple[str, int]]) -> None:
    device.link.send(wire.NMT, bytes([wire.NMT_PRE_OPERATIONAL, 1]))
    for name, value in writes:
        device.write(name, value)


@pytest.fixture
def device() -> Iterator[Device]:
    with connected(can.Bus(interface="kontur", channel="sim", machine=MACHINE), 1) as drive:
        drive.parameters.set(MACHINE.parameters())
        yield drive


def still_off(device: Device) -> bool:
    return device.info().state == ("switch on disabled", "switch on disabled") and device.read("master.holder") == 0


@pytest.mark.parametrize("what", COMMANDS)
def test_changed_pdo_is_named_before_an_axis_is_enabled(device: Device, what: str) -> None:
    writes, said = COMMANDS[what]
    as_another_master(device, writes)
    seen: list[tuple[str, str]] = []
    device.link._network.subscribe(wire.TPDO1 + 1, lambda *_: seen.append(device.axes.states()))
    with pytest.raises(DeviceError) as refused, device.axes.enabled():
        pass
    assert said in str(refused.value)
    assert "--set-pdos" in str(refused.value)
    assert still_off(device)
    assert not seen


@pytest.mark.parametrize("what", COMMANDS)
def test_changed_pdo_is_set_on_request_and_the_axes_move(device: Device, what: str) -> None:
    as_another_master(device, COMMANDS[what][0])
    device.pdos.may_set = True
    with device.axes.enabled():
        assert single_axis.jog(device, {"x": 0.02}, 0.2)
    assert device.position_m()[0] == pytest.approx(0.004, abs=5e-4)
    device.pdos.may_set = False
    device.pdos.require("rpdo1", "rpdo2", "tpdo1")


def test_first_differences_are_named_and_the_others_counted(device: Device) -> None:
    as_another_master(device, [write for what in ("axes changed over", "no EMCY") for write in COMMANDS[what][0]])
    as_another_master(device, COMMANDS["controlwords at SYNC"][0] + [("tpdo1.event_ms", 0)])
    with pytest.raises(DeviceError, match=r"1014h .*1400h:2 .*1600h:1 .*, and 2 more\. Another master"):
        device.axes.enable()


@pytest.mark.parametrize(
    "harmless",
    [
        [("rpdo1.type", 255), ("tpdo1.type", 255)],
        [("rpdo1.cob_id", UNUSED | 0x201), ("rpdo1.cob_id", 0x40000201)],
        [("rpdo3.cob_id", UNUSED | 0x401), ("rpdo3.cob_id", 0x405)],
        [("tpdo5.cob_id", UNUSED | 0x6A0)],
    ],
)
def test_what_makes_no_difference_to_kontur_is_left_as_it_is(device: Device, harmless: list[tuple[str, int]]) -> None:
    device.pdos.may_set = True
    as_another_master(device, harmless)
    with device.axes.enabled():
        pass
    for name, value in dict(harmless).items():
        assert device.read(name) == value


def circle() -> Trajectory:
    return plan(shapes.circle(0.005, 0.05), limits(MACHINE))


@pytest.fixture
def process(tmp_path: Path) -> Iterator[SimProcess]:
    there = MACHINE.starting_at((0.005, 0.0))
    with start(slcan_tcp="0", pace="sync", machine=there, store=tmp_path / "flash") as sim:
        with open_drive(Target(MACHINE, bus=sim.options())) as device:
            device.parameters.set(there.parameters())
        yield sim


@pytest.mark.parametrize("what", TELEMETRY)
def test_run_needs_its_telemetry_and_a_jog_does_not(process: SimProcess, what: str) -> None:
    writes, said = TELEMETRY[what]
    target = Target(MACHINE, bus=process.options())
    with open_drive(target) as device:
        as_another_master(device, writes)
    with pytest.raises(DeviceError) as refused:
        run(circle(), "ccu", target)
    assert said in str(refused.value)
    with open_drive(target) as device:
        assert still_off(device)
        with device.axes.enabled():
            pass
    log = run(circle(), "ccu", dataclasses.replace(target, set_pdos=True)).log
    assert log.meta["frames_lost"] == 0


def test_what_another_master_has_stored_is_there_again_after_a_reset(process: SimProcess) -> None:
    target = Target(MACHINE, bus=process.options())
    with open_drive(target) as device:
        as_another_master(device, OTHER_MAPPING)
        device.parameters.save(all_objects=True)
    assert run(circle(), "ccu", dataclasses.replace(target, set_pdos=True)).completed
    with open_drive(target) as device:
        assert device.read("rpdo1_map.map_1") == 0x60400010
        states: list[int] = []
        device.link._network.subscribe(wire.HEARTBEAT + 1, lambda _id, data, _t: states.append(data[0]))
        device.link.send(wire.NMT, bytes([129, 1]))
        assert device.link.wait(lambda: 0 in states, 3.0)
        assert device.read("rpdo1_map.map_1") == 0x68400010
        with pytest.raises(DeviceError, match="1600h:1"):
            device.axes.enable()


@pytest.mark.parametrize("seed", range(1, 6))
def test_pdos_are_set_on_a_bad_bus_too(seed: int) -> None:
    with open_bus({"interface": "kontur", "machine": MACHINE}) as inner:
        as_another_master(Device(Link(inner, 1)), OTHER_MAPPING)
        with BadBus(inner=inner, faults=BusFaults(drop=0.02, duplicate=0.01, flip=0.005, seed=seed)) as bus:
            device = Device(Link(bus, 1))
            device.pdos.may_set = True
            with device.axes.enabled():
                pass
            assert device.read("rpdo1_map.map_1") == 0x60400010


def test_what_only_reads_compares_nothing(device: Device) -> None:
    as_another_master(device, OTHER_MAPPING)
    before = device.link.frames
    device.info()
    assert device.link.frames - before < 60
