# SPDX-License-Identifier: Apache-2.0
"""The DBC in the hands of cantools: it loads, and what it makes of a recorded job is what kontur makes of it."""

from pathlib import Path

import can
import cantools
import numpy as np
import pytest
from cantools.database.can import Database

from kontur import machine
from kontur.can import wire
from kontur.can.link import Link
from kontur.can.wire import Telemetry
from kontur.drive.device import Device
from kontur.drive.master import CHANNELS
from kontur.drive.pdos import TELEMETRY
from kontur.drive.stream import stream
from kontur.path import shapes
from kontur.planning import planner
from kontur.planning.bounds import limits
from kontur.sim.bus import KonturBus

DBC = Path(__file__).resolve().parents[2] / "host" / "kontur" / "kontur.dbc"


class LoggedBus(KonturBus):
    """Writes every frame of both directions to `log`, a file of any kind that python-can writes."""

    def __init__(self, log: Path, **options: object) -> None:
        self.log = can.Logger(str(log))
        super().__init__(**options)  # type: ignore[arg-type]

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self.log.on_message_received(can.Message(self.time_s, msg.arbitration_id, False, data=msg.data))
        super().send(msg, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        message = super().recv(timeout)
        if message is not None:
            self.log.on_message_received(message)
        return message

    def shutdown(self) -> None:
        super().shutdown()
        self.log.stop()


@pytest.fixture(scope="module")
def database() -> Database:
    loaded = cantools.database.load_file(DBC, strict=True)
    assert isinstance(loaded, Database)
    return loaded


@pytest.fixture(scope="module")
def knots_nm() -> "np.ndarray[tuple[int, int], np.dtype[np.int32]]":
    return planner.plan(shapes.circle(0.005, 0.1), limits(machine.load())).knots_nm


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory, knots_nm: np.ndarray) -> tuple[list[can.Message], Telemetry]:
    """A job from power-on to the end, and a fault after it: all its frames as read back from a BLF file, and the
    telemetry as kontur recorded it."""
    log = tmp_path_factory.mktemp("job") / "job.blf"
    x, y = (float(v) * 1e-9 for v in knots_nm[0])
    with LoggedBus(log, machine=machine.load().starting_at((x, y))) as bus:
        link = Link(bus, 1)
        device = Device(link)
        with device.axes.enabled(also=TELEMETRY):
            start_nm = device.position_nm()
            link.record_telemetry()
            stream(device, knots_nm)
            telemetry = link.recorded_telemetry(start_nm)
        link.send(0x80, b"")
        link.send(0x80, b"\x01")  # too long: EMCY
        link.poll(0.1)
    frames = [m for m in can.LogReader(str(log)) if isinstance(m, can.Message)]
    # the identifiers of a holder's own channel are drawn, so a DBC cannot have them
    named = [m for m in frames if m.arbitration_id & ~1 not in CHANNELS]
    assert len(named) < len(frames)
    return named, telemetry


def test_dbc_names_every_frame_of_a_job_and_gives_each_its_length(
    database: Database, job: tuple[list[can.Message], Telemetry]
) -> None:
    seen = set()
    for message in job[0]:
        frame = database.get_message_by_frame_id(message.arbitration_id)
        database.decode_message(message.arbitration_id, message.data)
        if bytes(message.data) != b"\x01":  # the SYNC that is too long on purpose
            assert frame.length == len(message.data), frame.name
        seen.add(frame.name)
    assert seen >= {
        "NMT", "SYNC", "EMCY", "SDO_request", "SDO_response", "heartbeat", "heartbeat_host", "RPDO1", "RPDO2",
        "TPDO1", "TPDO2", "TPDO3", "TPDO4", "TPDO5",
    }  # fmt: skip


def signals(database: Database, frames: list[can.Message], message: str, *names: str) -> np.ndarray:
    """Decoded values of all frames of one kind, a row each."""
    can_id = database.get_message_by_name(message).frame_id
    decoded = [database.decode_message(can_id, m.data) for m in frames if m.arbitration_id == can_id]
    return np.array([[d[name] for name in names] for d in decoded], dtype=float)


def test_dbc_gives_the_telemetry_that_kontur_unpacks(
    database: Database, job: tuple[list[can.Message], Telemetry]
) -> None:
    frames, telemetry = job
    assert telemetry.frames_lost == 0
    assert len(telemetry.tick) > 300
    error = signals(
        database, frames, "TPDO2", "telemetry_tick", "telemetry_tangential_error", "telemetry_contour_error"
    )
    first = int(np.flatnonzero(error[:, 0] == telemetry.tick[0])[0])
    rows = slice(first, first + len(telemetry.tick))
    np.testing.assert_array_equal(error[rows, 0], telemetry.tick)
    np.testing.assert_allclose(
        error[rows, 1:], telemetry.columns("tangential_error", "contour_error"), rtol=0, atol=1e-15
    )
    place = signals(database, frames, "TPDO3", "telemetry_position_x", "telemetry_position_y")[rows]
    np.testing.assert_allclose(place, telemetry.position_m, rtol=0, atol=1e-12)  # 24 bits suffice near the origin

    force_and_gain = signals(
        database,
        frames,
        "TPDO4",
        "telemetry_force_x",
        "telemetry_force_y",
        "telemetry_adaptive_gain_1",
        "telemetry_adaptive_gain_2",
    )
    ours = telemetry.columns("force_x", "force_y", "adaptive_gain_1", "adaptive_gain_2")
    ours = ours[~np.isnan(ours).any(axis=1)]
    assert {tuple(row) for row in np.round(ours, 6)} <= {tuple(row) for row in np.round(force_and_gain, 6)}
    slow = signals(
        database, frames, "TPDO5", "telemetry_switching_gain_1", "telemetry_switching_gain_2", "telemetry_energy"
    )
    ours = telemetry.columns("switching_gain_1", "switching_gain_2", "energy")
    ours = ours[~np.isnan(ours).any(axis=1)]
    assert {tuple(row) for row in np.round(ours, 6)} <= {tuple(row) for row in np.round(slow, 6)}


def test_dbc_gives_the_knots_that_were_sent(
    database: Database, job: tuple[list[can.Message], Telemetry], knots_nm: np.ndarray
) -> None:
    frames = [m for m in job[0] if len(m.data) == 8]
    steps = signals(database, frames, "RPDO2", "knot_sequence", "knot_dx", "knot_dy")
    assert len(steps) == len(knots_nm)
    np.testing.assert_array_equal(steps[:, 0], np.arange(len(knots_nm)) % 256)
    np.testing.assert_array_equal(np.cumsum(steps[:, 1:], axis=0) + knots_nm[0], knots_nm)


def test_dbc_gives_the_status_that_kontur_unpacks(database: Database, job: tuple[list[can.Message], Telemetry]) -> None:
    for message in job[0]:
        if message.arbitration_id == 0x181:
            decoded = database.decode_message(0x181, message.data)
            status = wire.unpack_status(bytes(message.data))
            assert (decoded["statusword_x"], decoded["statusword_y"]) == status.statusword
            assert (decoded["stream_free"], decoded["stream_accepted16"]) == (status.free, status.accepted)


def test_dbc_names_states_and_tells_the_emergency(database: Database, job: tuple[list[can.Message], Telemetry]) -> None:
    decoded = [(m.arbitration_id, database.decode_message(m.arbitration_id, m.data)) for m in job[0]]
    states = [str(values["state"]) for can_id, values in decoded if can_id == 0x701]
    assert states[0] == "boot-up"
    assert states[-1] == "operational"
    emergencies = [values for can_id, values in decoded if can_id == 0x081]
    assert emergencies == [{"code": 0x8240, "error_register": 0x11, "details": 1}]
