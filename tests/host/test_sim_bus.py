# SPDX-License-Identifier: Apache-2.0
"""The simulated drive as a python-can bus, used by python-can alone."""

import dataclasses
import time
from pathlib import Path

import can
import pytest

from kontur import machine
from kontur.errors import LibraryError
from kontur.sim import library

HEARTBEAT = 0x701
PATIENCE_S = 60.0
READ_DEVICE_TYPE = can.Message(arbitration_id=0x601, data=[0x40, 0, 0x10, 0, 0, 0, 0, 0], is_extended_id=False)


def open_bus(**options: object) -> can.BusABC:
    return can.Bus(interface="kontur", channel="sim", **options)


def first(bus: can.BusABC, can_id: int) -> can.Message:
    while True:
        message = bus.recv(1.0)
        assert message is not None
        if message.arbitration_id == can_id:
            return message


def test_python_can_opens_the_simulated_drive_by_name() -> None:
    with open_bus() as bus:
        assert first(bus, HEARTBEAT).data == b"\x00"  # boot-up message


def test_request_is_answered_without_time_passing() -> None:
    with open_bus() as bus:
        first(bus, HEARTBEAT)
        bus.send(READ_DEVICE_TYPE)
        answer = first(bus, 0x581)
        assert bytes(answer.data) == bytes.fromhex("43 00 10 00 92 01 ff ff")
        assert bus.time_s == 0.0  # type: ignore[attr-defined]


def test_time_of_the_device_passes_in_recv_by_its_timeout_without_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "sleep", lambda seconds: pytest.fail(f"it waits for {seconds} s"))
    with open_bus() as bus:
        first(bus, HEARTBEAT)
        assert bus.recv(0.05) is None
        assert bus.time_s == pytest.approx(0.05, abs=1e-9)  # type: ignore[attr-defined]
        assert bus.recv(0.0) is None
        assert bus.time_s == pytest.approx(0.05, abs=1e-9)  # type: ignore[attr-defined]


def test_frames_carry_the_time_of_the_device() -> None:
    with open_bus() as bus:
        first(bus, HEARTBEAT)
        second, third = first(bus, HEARTBEAT), first(bus, HEARTBEAT)
        assert third.timestamp - second.timestamp == pytest.approx(0.1, abs=1e-9)


def test_filtered_frames_do_not_end_a_recv() -> None:
    with open_bus(can_filters=[{"can_id": HEARTBEAT, "can_mask": 0x7FF}]) as bus:
        bus.send(READ_DEVICE_TYPE)
        ids = {bus.recv(1.0).arbitration_id for _ in range(5)}  # type: ignore[union-attr]
        assert ids == {HEARTBEAT}


def test_runs_with_the_same_seed_are_equal_and_with_another_differ() -> None:
    table1 = machine.load()
    smooth = dataclasses.replace(table1, x=dataclasses.replace(table1.x, coulomb_N=0.0))  # lets the noise through

    def run(seed: int) -> list[tuple[float, int, bytes]]:
        with open_bus(seed=seed, machine=smooth) as bus:
            switch_on = [0x23, 0x02, 0x18, 1, 0x81, 3, 0, 0]  # TPDO3, which has the positions
            bus.send(can.Message(arbitration_id=0x601, data=switch_on, is_extended_id=False))
            bus.send(can.Message(arbitration_id=0, data=[1, 0], is_extended_id=False))
            bus.send(can.Message(arbitration_id=0x201, data=[6, 0, 6, 0], is_extended_id=False))
            bus.send(can.Message(arbitration_id=0x201, data=[7, 0, 7, 0], is_extended_id=False))
            bus.send(can.Message(arbitration_id=0x201, data=[15, 0, 15, 0], is_extended_id=False))
            frames = [bus.recv(1.0) for _ in range(500)]
            return [(m.timestamp, m.arbitration_id, bytes(m.data)) for m in frames if m is not None]

    assert run(1) == run(1)
    assert run(1) != run(2)


def test_node_id_moves_all_identifiers() -> None:
    with open_bus(node_id=9) as bus:
        assert first(bus, 0x709).data == b"\x00"


def test_clock_pace_does_not_outrun_the_wall_clock() -> None:
    begin = time.monotonic()  # before the drive's clock starts: it may be behind later, and catch up
    with open_bus(pace="clock") as bus:
        while bus.time_s < 1.0:  # type: ignore[attr-defined]
            bus.recv(0.05)
        assert time.monotonic() - begin >= 0.99


def test_an_answer_at_clock_pace_takes_the_time_of_a_wire() -> None:
    with open_bus(pace="clock") as bus:
        for _ in range(5):
            beat = first(bus, HEARTBEAT)
            bus.send(READ_DEVICE_TYPE)
            assert bus.time_s - beat.timestamp > 1.9e-4  # type: ignore[attr-defined]


def test_time_passes_with_sync_alone_at_sync_pace() -> None:
    with open_bus(pace="sync", on_for_ms=5) as bus:
        assert bus.recv(1.0) is None
        assert bus.time_s == 0.005  # type: ignore[attr-defined]
        bus.send(can.Message(arbitration_id=0x080, is_extended_id=False))
        assert bus.time_s == 0.006  # type: ignore[attr-defined]


def test_notifier_thread_of_python_can_works_at_clock_pace() -> None:
    with open_bus(pace="clock") as bus:
        reader = can.BufferedReader()
        notifier = can.Notifier(bus, [reader], timeout=0.01)
        try:
            bus.send(READ_DEVICE_TYPE)
            # before it come the boot-up message, and heartbeats on a machine that lets the thread wait
            while (message := reader.get_message(PATIENCE_S)) is not None and message.arbitration_id != 0x581:
                pass
        finally:
            notifier.stop()
        assert message is not None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"machine": "nowhere.toml"}, r"nowhere\.toml: cannot be read"),
        ({"node_id": 32}, r"node id 32 must be 1\.\.31"),
        ({"num": "q99"}, r"no such numeric back end; built are: .*f32"),
        ({"pace": "fast"}, r"pace must be one of lockstep, clock, sync"),
        ({"seed": -1}, r"seed|overflow|negative|convert"),
    ],
)
def test_bus_that_cannot_be_opened_says_why(options: dict[str, object], message: str) -> None:
    with pytest.raises(can.CanInitializationError, match=message):
        open_bus(**options)


def test_library_that_is_not_built_is_named_with_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(library, "LIBRARIES", tmp_path)
    with pytest.raises(LibraryError, match="the simulator is not built; run `make lib`"):
        library.Sim(machine.load(), seed=1, num="not loaded before")


def test_truth_has_a_row_each_control_period_since_it_was_requested() -> None:
    sim = library.Sim(machine.load().starting_at((0.01, -0.02)), seed=1)
    sim.run(100)
    assert len(sim.truth().pos_m) == 0
    sim.record(True)
    sim.run(50)
    truth = sim.truth()
    assert truth.pos_m.shape == truth.vel_mps.shape == truth.force_N.shape == truth.friction_N.shape == (50, 2)
    assert (truth.pos_m == [0.01, -0.02]).all()  # not enabled: stiction holds it
    sim.close()
