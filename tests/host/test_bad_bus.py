# SPDX-License-Identifier: Apache-2.0
"""A drive on a bus that loses, repeats, swaps, delays and corrupts frames: the work is done, or the failure is said."""

import dataclasses
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import can
import numpy as np
import pytest
from hooked_bus import Fault, HookedBus
from numpy.typing import NDArray

from kontur import machine
from kontur.can import wire
from kontur.can.bad_bus import BadBus, BusFaults
from kontur.can.bus import open_bus
from kontur.can.link import Link
from kontur.drive.device import Device
from kontur.drive.state_machine import ENABLE
from kontur.drive.stream import Operator, StreamResult, stream
from kontur.errors import EmcyError
from kontur.path import shapes
from kontur.planning import planner
from kontur.planning.bounds import limits
from kontur.sim import process as sim_process
from kontur.sim.bus import KonturBus

RADIUS_M = 0.02
MACHINE = machine.load().starting_at((RADIUS_M, 0.0))
QUIET = dataclasses.replace(  # its axes do not creep while a bad bus keeps them from getting power
    MACHINE,
    x=dataclasses.replace(MACHINE.x, force_noise_N=0.0),
    y=dataclasses.replace(MACHINE.y, force_noise_N=0.0),
)
BAD = BusFaults(drop=0.02, duplicate=0.01, reorder=0.01, flip=0.005, seed=2)
START_S = 4.0
KNOT, CONTROL, STATUS = wire.RPDO2 + 1, wire.RPDO1 + 1, wire.TPDO1 + 1
SDO_REQUEST, SDO_RESPONSE, EMCY = 0x601, 0x581, 0x081


def circle(duration_s: float) -> NDArray[np.int32]:
    knots: NDArray[np.int32] = planner.plan(
        shapes.circle(RADIUS_M, 0.1, duration_s=duration_s), limits(MACHINE)
    ).knots_nm
    return knots


@contextmanager
def drive_on(bus: can.BusABC) -> Iterator[Device]:
    with bus:
        clean = bus.inner if isinstance(bus, BadBus) else bus
        Device(Link(clean, 1)).parameters.set(MACHINE.parameters())  # on a bad bus the axes would creep for longer
        yield Device(Link(bus, 1))


@pytest.fixture
def bus() -> HookedBus:
    return HookedBus(machine=MACHINE)


@pytest.fixture
def device(bus: HookedBus) -> Iterator[Device]:
    with drive_on(bus) as device:
        yield device


def changed(message: can.Message, **fields: object) -> can.Message:
    whole = {"arbitration_id": message.arbitration_id, "data": message.data} | fields
    return can.Message(is_extended_id=False, **whole)  # type: ignore[arg-type]


def flipped(message: can.Message, byte: int, bit: int) -> can.Message:
    data = bytearray(message.data)
    data[byte] ^= 1 << bit
    return changed(message, data=data)


def first(count: int, match: Callable[[can.Message], bool], fault: Fault) -> Fault:
    """`fault` for the first `count` frames that match."""
    left = count

    def act(message: can.Message) -> can.Message | None:
        nonlocal left
        if left and match(message):
            left -= 1
            return fault(message)
        return message

    return act


def has_id(can_id: int) -> Callable[[can.Message], bool]:
    return lambda message: message.arbitration_id == can_id


def lost(_message: can.Message) -> None:
    return None


# --- all faults at once ---


@dataclasses.dataclass
class Job:
    result: StreamResult
    contour_um: NDArray[np.float64]
    bus: BadBus


def job(knots_nm: NDArray[np.int32], faults: BusFaults, plant: machine.Machine = MACHINE) -> Job:
    """Motion starts at the same time on every bus, because the gains adapt from power-on."""
    bus = BadBus(machine=plant, faults=faults)
    inner = bus.inner
    assert isinstance(inner, KonturBus)
    with drive_on(bus) as device, device.axes.enabled():

        def wait_and_record() -> None:
            device.link.wait(lambda: bus.time_s >= START_S, START_S)
            inner.sim.record(True)

        result = stream(device, knots_nm, before_start=wait_and_record)
        assert device.read_stable("stream.underruns") == 0
        truth = inner.sim.truth()
    return Job(result, np.abs(np.hypot(*truth.pos_m.T) - RADIUS_M) * 1e6, bus)


def test_every_one_of_100000_knots_arrives_once_in_order_and_the_contour_error_is_that_of_a_clean_bus() -> None:
    knots_nm = circle(100.0)
    assert len(knots_nm) >= 100_000
    clean, bad = job(knots_nm, BusFaults()), job(knots_nm, BAD)
    assert clean.result.retransmitted == 0
    assert bad.result.completed  # which stream() says only if the drive's checksum is that of these knots
    assert bad.result.executed == len(knots_nm)
    for counts in (bad.bus.to_drive, bad.bus.to_host):
        assert counts.lost > 0.015 * counts.frames
        assert min(counts.duplicated, counts.reordered) > 0.008 * counts.frames
        assert counts.flipped > 0.004 * counts.frames
    count_um = MACHINE.x.encoder_m * 1e6
    assert bad.contour_um.max() <= clean.contour_um.max() + count_um
    assert bad.contour_um.mean() == pytest.approx(clean.contour_um.mean(), abs=0.02 * count_um)


@pytest.mark.parametrize("seed", range(8, 20))
def test_short_jobs_end_well_whatever_is_hit(seed: int) -> None:
    knots_nm = circle(3.0)
    faults = dataclasses.replace(BAD, delay=0.01, burst=0.0005, burst_frames=3, seed=seed)
    assert job(knots_nm, faults, QUIET).result.executed == len(knots_nm)


def test_bus_that_goes_off_stops_the_drive_on_the_path_and_the_fault_is_reported_though_its_emcy_is_lost() -> None:
    knots_nm = circle(10.0)
    bus = BadBus(machine=MACHINE, faults=BusFaults(bus_off_s=1.0))
    inner = bus.inner
    assert isinstance(inner, KonturBus)
    with drive_on(bus) as device:
        device.axes.enable()

        def off(share: float) -> None:
            if share > 0.3 and not bus.to_drive.lost_bus_off and not bus.to_host.lost_bus_off:
                bus.go_bus_off()

        with pytest.raises(EmcyError, match="8130h"):
            stream(device, knots_nm, Operator(progress=off), before_start=lambda: inner.sim.record(True))
        assert device.axes.states() == ("fault", "fault")
        truth = inner.sim.truth()
        powered = np.flatnonzero(np.abs(truth.force_N).max(axis=1))[-1]  # after it, noise moves the axes
        contour_um = np.abs(np.hypot(*truth.pos_m[:powered].T) - RADIUS_M) * 1e6
        assert contour_um.max() < 4.0
        device.axes.enable()  # and on again
        assert device.axes.states() == ("operation enabled", "operation enabled")


# --- one frame at a time ---


@pytest.mark.parametrize("fault", [lost, lambda m: flipped(m, 0, 3), lambda m: changed(m, data=m.data[:5])])
@pytest.mark.parametrize("way", ["on_send", "on_recv"])
def test_sdo_frames_that_are_lost_or_corrupted_are_requested_again(
    device: Device, bus: HookedBus, way: str, fault: Fault
) -> None:
    setattr(bus, way, first(1, has_id(SDO_REQUEST if way == "on_send" else SDO_RESPONSE), fault))
    device.write("smc.lambda", 150.5)
    assert device.read("smc.lambda") == 150.5


def test_answers_that_come_twice_are_not_taken_for_answers_to_later_requests(device: Device, bus: HookedBus) -> None:
    twice: list[can.Message] = []

    def late(message: can.Message) -> can.Message:
        if message.arbitration_id == SDO_RESPONSE:
            twice.append(message)
            if len(twice) > 1:
                return twice[-2]
        return message

    bus.on_recv = late
    device.link.node.sdo.RESPONSE_TIMEOUT = 0.01
    device.read("smc.lambda")
    bus.on_recv = lambda message: message
    assert device.read("stream.free") == device.read("ip_buffer_x.size")


def test_value_corrupted_on_its_way_into_the_drive_is_noticed_and_set_again(device: Device, bus: HookedBus) -> None:
    def download(message: can.Message) -> bool:
        return message.arbitration_id == SDO_REQUEST and message.data[0] >> 5 == 1

    bus.on_send = first(1, download, lambda m: flipped(m, 4, 0))
    device.write("smc.lambda", 150.5)
    assert device.link.node.sdo.upload(0x2110, 1) == (150_500).to_bytes(4, "little")


def test_parameter_that_a_corrupted_request_has_set_instead_gets_its_value_back(device: Device, bus: HookedBus) -> None:
    device.write("smc.gamma", 2.0)
    address = {name: device._variables[name].subindex for name in ("smc.lambda", "smc.gamma")}
    into_gamma = address["smc.lambda"] ^ address["smc.gamma"]

    def download(message: can.Message) -> bool:
        return message.arbitration_id == SDO_REQUEST and message.data[0] >> 5 == 1

    bus.on_send = first(1, download, lambda m: changed(m, data=[*m.data[:3], m.data[3] ^ into_gamma, *m.data[4:8]]))
    device.write("smc.lambda", 10.0)
    assert (device.read("smc.lambda"), device.read("smc.gamma")) == (10.0, 2.0)


def test_nmt_command_that_is_lost_is_sent_again_and_one_that_became_reset_undoes_no_parameter(
    device: Device, bus: HookedBus
) -> None:
    device.write("smc.lambda", 150.5)
    lose, reset = first(1, has_id(0), lost), first(1, has_id(0), lambda m: flipped(m, 0, 7))
    bus.on_send = lambda m: None if lose(m) is None else reset(m)
    device.axes.enable()
    assert device.axes.states() == ("operation enabled", "operation enabled")
    assert device.read("smc.lambda") == 150.5


@pytest.mark.parametrize("bit", range(16))
@pytest.mark.parametrize("byte", [0, 2])
def test_any_corrupted_controlword_ends_in_the_state_requested(
    device: Device, bus: HookedBus, byte: int, bit: int
) -> None:
    bus.on_send = first(4, has_id(CONTROL), lambda m: flipped(m, byte + bit // 8, bit % 8))
    device.axes.enable()
    assert device.axes.states() == ("operation enabled", "operation enabled")
    bus.on_send = first(1, has_id(CONTROL), lambda m: flipped(m, byte + bit // 8, bit % 8))
    device.axes.disable()
    assert device.axes.states() == ("switch on disabled", "switch on disabled")


@pytest.mark.parametrize("fault", [lost, lambda m: flipped(m, 1, 0), lambda m: flipped(m, 0, 4)])
def test_command_to_run_the_path_is_repeated_until_it_runs(device: Device, bus: HookedBus, fault: Fault) -> None:
    with device.axes.enabled():
        bus.on_send = first(2, lambda m: m.arbitration_id == CONTROL and m.data[0] == 0x1F, fault)
        assert stream(device, circle(1.0)).completed


def test_end_of_the_path_command_that_is_lost_does_not_hinder_the_next_path(device: Device, bus: HookedBus) -> None:
    knots_nm = circle(0.5)
    with device.axes.enabled():
        bus.on_send = first(
            2, lambda m: m.arbitration_id == CONTROL and m.data[0] == ENABLE and device.read("stream.state") == 4, lost
        )
        assert stream(device, knots_nm).completed
        assert stream(device, knots_nm[::-1]).completed


@pytest.mark.parametrize("bit", range(64))
def test_corrupted_status_frames_change_nothing(bus: HookedBus, bit: int) -> None:
    knots_nm = circle(1.2)
    count = 0

    def corrupt(message: can.Message) -> can.Message:
        nonlocal count
        count += message.arbitration_id == STATUS
        return flipped(message, bit // 8, bit % 8) if message.arbitration_id == STATUS and count % 10 == 0 else message

    with drive_on(bus) as device, device.axes.enabled():
        bus.on_recv = corrupt
        result = stream(device, knots_nm)
        assert result.executed == len(knots_nm)
        assert device.read("stream.underruns") == 0


def test_false_emcy_is_not_believed_and_a_lost_one_not_missed(device: Device, bus: HookedBus) -> None:
    device.axes.enable()
    telemetry = first(3, has_id(wire.TPDO2 + 1), lambda m: changed(m, arbitration_id=EMCY))
    bus.on_recv = telemetry
    device.link.wait(lambda: False, 0.1)
    device.faults.check()
    bus.on_recv = lambda m: None if m.arbitration_id == EMCY else m
    bus.sim.run(10_000)  # a second in which the host does nothing
    with pytest.raises(EmcyError, match="8130h"):
        device.wait(lambda: False, 0.5, "waits")


@pytest.mark.parametrize("bit", range(11))
def test_knot_whose_identifier_is_corrupted_by_a_bit_does_nothing_else(bus: HookedBus, bit: int) -> None:
    """Among them 201h: a controlword, if the drive took it for one."""
    knots_nm = circle(1.2)
    count = 0

    def corrupt(message: can.Message) -> can.Message:
        nonlocal count
        count += message.arbitration_id == KNOT
        hit = message.arbitration_id == KNOT and count % 25 == 0
        return changed(message, arbitration_id=KNOT ^ 1 << bit) if hit else message

    with drive_on(bus) as device, device.axes.enabled():
        bus.on_send = corrupt
        result = stream(device, knots_nm)
    assert result.executed == len(knots_nm)


def test_stream_description_corrupted_in_the_drive_is_noticed_before_any_motion(device: Device, bus: HookedBus) -> None:
    def writes_total(message: can.Message) -> bool:
        return message.arbitration_id == SDO_REQUEST and bytes(message.data[:4]) == bytes([0x23, 0x00, 0x22, 4])

    knots_nm = circle(0.5)
    with device.axes.enabled():
        bus.on_send = first(1, writes_total, lambda m: flipped(m, 5, 0))
        assert stream(device, knots_nm).executed == len(knots_nm)


@pytest.mark.skipif(not sim_process.PROGRAM.exists(), reason="kontur-sim is not built; run `make lib`")
def test_corrupted_tick_does_not_part_the_clocks_of_host_and_drive_where_time_passes_with_sync() -> None:
    def is_tick(message: can.Message) -> bool:
        return message.arbitration_id == SDO_RESPONSE and bytes(message.data[:4]) == b"\x43\x20\x20\x03"

    with (
        sim_process.start(slcan_tcp="0", pace="sync", machine=MACHINE) as process,
        drive_on(bus := open_bus(process.options())) as device,
    ):
        receive, fault = bus.recv, first(1, is_tick, lambda m: flipped(m, 5, 0))
        bus.recv = lambda timeout=None: (m := receive(timeout)) and fault(m)  # type: ignore[method-assign]
        device.link.wait(lambda: False, 0.2)
        assert device.read("clock.tick") == round(device.link.time_s * 1e3)
