# SPDX-License-Identifier: Apache-2.0
"""Outputs beside the axes: what a program switches, at which knots, and what the drive makes of it."""

import itertools
import random

import can
import numpy as np
import pytest
from hooked_bus import HookedBus
from numpy.typing import NDArray

from kontur import machine
from kontur.can import wire
from kontur.can.link import Link
from kontur.can.outputs import BY_RATE, FULL_POWER
from kontur.drive.device import Device
from kontur.drive.stream import Operator, stream
from kontur.drive.target import Target
from kontur.errors import FileError, StreamError
from kontur.path import gcode
from kontur.path.smoothing import TOLERANCE_M
from kontur.planning.bounds import limits
from kontur.planning.outputs import FLOOD, LEFT, MIST, ON, P0, PEN, Tool, of_rest, of_words, passed_over, words
from kontur.planning.planner import Trajectory, plan
from kontur.planning.rest import rest, whole
from kontur.runs.runner import RunOptions, run
from kontur.sim.bus import KonturBus

MACHINE = machine.load()
LASER = Tool(1000.0, laser=True)


def planned(*lines: str) -> Trajectory:
    return plan(gcode.parse("\n".join(lines), "a.ngc"), limits(MACHINE), tolerance_m=TOLERANCE_M)


def split(word: NDArray[np.uint32]) -> tuple[NDArray[np.uint32], NDArray[np.float64]]:
    """Digital outputs, and power from 0 to 1."""
    return word & 0xFFFF, (word >> 16) / FULL_POWER


def raster(pixels: int, feed_mps: float, length_m: float = 0.1) -> tuple[Trajectory, NDArray[np.float64]]:
    """A line with a power of its own in each pixel, black and grey in turn; and where the pixels begin."""
    power = np.where(np.arange(pixels) % 2, 0, 1 + np.arange(pixels) % 1000)
    at_mm = 8.0 + 1e3 * length_m * np.arange(pixels + 1) / pixels
    pixel = (f"G1 X{at_mm[i + 1]:.6f} S{power[i]}" for i in range(pixels))
    trajectory = planned(f"G1 F{feed_mps * 60e3:g} M3 S0", "G1 X8", *pixel, f"G1 X{at_mm[-1] + 8.0:.6f} S0", "M5")
    return trajectory, at_mm * 1e-3


# --- what a program switches, by knot ---------------------------------------------------------------------------------


def test_words_switch_their_bits_at_their_place_and_all_goes_off_at_the_end() -> None:
    t = planned(
        "G1 X1 F1200", "M3 S250", "G1 X2", "M4 M7", "G1 X3", "M8 S500", "G1 X4", "M9 M62 P3", "G1 X5", "M5 M64 P0",
        "G1 X6", "M63 P3", "G1 X7",
    )  # fmt: skip
    digital, power = split(words(t, Tool()))
    at = np.searchsorted(t.path_s_m, (np.arange(7) + 0.5) * 1e-3)
    p0, p3 = P0, P0 << 3
    left = ON | LEFT
    assert digital[at].tolist() == [0, ON, left | MIST, left | MIST | FLOOD, left | p3, p3 | p0, p0]
    assert power[at] == pytest.approx([0, 0.25, 0.25, 0.5, 0.5, 0, 0], abs=1e-4)
    assert words(t, Tool())[-2:].tolist() == [0, 0]
    edges = t.path_s_m[of_words(words(t, Tool())).knot]
    assert np.abs(edges - np.array([1, 2, 3, 4, 5, 6, 7]) * 1e-3).max() <= 0.5 * 20e-3 * 1e-3 + 1e-9


def test_pen_is_down_at_z_of_zero_or_below_while_the_path_rests() -> None:
    t = planned("G0 Z5", "G0 X10", "G1 Z-1 F600", "G1 X20", "G0 Z5", "G0 X30", "G1 Z0", "G1 X40")
    down = split(words(t, Tool()))[0] == PEN
    x_mm = t.position_m[:, 0] * 1e3
    assert down[(x_mm > 10.001) & (x_mm < 19.999)].all()
    assert down[(x_mm > 30.001) & (x_mm < 39.999)].all()
    assert not down[(x_mm < 9.999) | ((x_mm > 20.001) & (x_mm < 29.999))].any()
    assert np.abs(np.diff(x_mm)[np.flatnonzero(np.diff(down))]).max() < 2e-5  # it stands, to 20 nm


def test_dwell_keeps_what_is_switched_before_and_behind_it_apart() -> None:
    t = planned("G1 X1 F600", "M3 S1000", "G4 P0.5", "M62 P0", "G4 P0.25", "M5", "G1 X2")
    digital, power = split(words(t, Tool()))
    assert np.count_nonzero(power) == pytest.approx(750, abs=6)
    assert np.count_nonzero(digital == ON) == pytest.approx(500, abs=3)
    on = np.flatnonzero(digital == ON | P0)
    assert len(on) == pytest.approx(250, abs=6)
    assert np.ptp(t.path_s_m[power > 0]) < 1e-9


def test_laser_is_on_in_moves_at_a_feed_alone() -> None:
    t = planned("M3 S600", "G0 X10", "G1 X20 F3000", "G0 X30", "G1 X40", "X40 Y10", "M5", "G0 X0 Y0")
    digital, power = split(words(t, LASER))
    v = np.hypot(*np.gradient(t.position_m, 1e-3, axis=0).T)
    x, y = t.position_m.T * 1e3
    cuts = ((y == 0) & (((x > 10.1) & (x < 19.9)) | ((x > 30.1) & (x < 39.9)))) | ((y > 0.1) & (y < 9.9) & (x == 40))
    assert power[cuts] == pytest.approx(0.6, abs=1e-4)
    assert not power[(y == 0) & ((x < 9.9) | ((x > 20.1) & (x < 29.9)))].any()
    assert not power[:-1][(v[:-1] == 0.0) & (v[1:] == 0.0)].any()  # but in the knot from which it goes on
    assert not (digital & BY_RATE).any()


def test_power_of_m4_goes_with_the_speed() -> None:
    t = planned("M4 S1000", "G1 X20 F3000", "M5")
    digital, power = split(words(t, LASER))
    v = np.hypot(*np.gradient(t.position_m, 1e-3, axis=0).T)
    on = power > 0
    assert power[on] == pytest.approx(v[on] / 0.05, abs=0.0026)
    assert (digital[on] == ON | BY_RATE).all()
    assert power.max() == pytest.approx(1.0, abs=1e-4)


def test_analog_value_needs_no_spindle_and_m5_ends_it() -> None:
    t = planned("M67 E0 Q250", "G1 X1 F1200", "M68 E0 Q5000", "G1 X2", "M5", "G1 X3")
    _, power = split(words(t, Tool()))
    at = np.searchsorted(t.path_s_m, (np.arange(3) + 0.5) * 1e-3)
    assert power[at] == pytest.approx([0.25, 1.0, 0.0], abs=1e-4)


@pytest.mark.parametrize(
    ("line", "word"),
    [("M62", "P0 to P3"), ("M63 P4", "P0 to P3"), ("M64 P0.5", "P0 to P3"), ("M67 E1 Q5", "E0 Q500"),
     ("M68 E0", "E0 Q500"), ("G1 X1 F600 P1", "P belongs"), ("G1 X1 F600 Q1", "Q belongs")],
)  # fmt: skip
def test_outputs_that_there_are_not_are_refused(line: str, word: str) -> None:
    with pytest.raises(FileError, match=word):
        planned("G1 X5 F600", line, "G1 X6")


@pytest.mark.parametrize("feed_mps", [0.01, 0.1])
def test_raster_of_10000_changes_runs_at_constant_speed_and_switches_within_a_knot(feed_mps: float) -> None:
    t, begins_m = raster(10_000, feed_mps)
    x = t.position_m[:, 0]
    inside = (x > begins_m[0]) & (x < begins_m[-1])
    assert np.gradient(x, 1e-3)[inside] == pytest.approx(feed_mps, rel=1e-9)
    _, power = split(words(t, LASER))
    nearest = [np.clip(np.searchsorted(begins_m, x[inside] + d * feed_mps * 1e-3, side="right") - 1, 0, 9999)
               for d in (-1.0, 1.0)]  # fmt: skip
    asked = np.where(np.arange(10_000) % 2, 0, 1 + np.arange(10_000) % 1000) / 1000
    found = power[inside]
    # The power of each knot is one that the program asks for within a knot of it.
    ok = np.zeros(len(found), dtype=bool)
    for shift in range(int(np.max(nearest[1] - nearest[0])) + 1):
        ok |= np.abs(asked[np.minimum(nearest[0] + shift, nearest[1])] - found) < 2e-5
    assert ok.all()
    if feed_mps <= 0.01:  # a change each knot at most: none is left out
        assert len(of_words(words(t, LASER))) == pytest.approx(10_000, abs=3)


def test_changes_that_follow_within_a_millisecond_are_told() -> None:
    assert passed_over(raster(100, 0.01, length_m=0.001)[0]) == []
    (note,) = passed_over(raster(100, 0.02, length_m=0.001)[0])
    assert 40 <= int(note.split()[3]) <= 60
    assert "first in line " in note


def test_rest_of_a_path_is_off_until_it_moves_and_then_as_it_was() -> None:
    t = planned("M3 S600", "G1 X20 F3000", "M8", "G1 X40", "M5", "M9", "G1 X50")
    word = words(t, Tool())
    assert (of_rest(word, whole(t)) == word).all()
    assert len(of_words(word)) == 3
    left = rest(t, 200, 100.0)
    outputs = of_words(of_rest(word, left))
    assert outputs.knot[0] == 3
    assert outputs.digital.tolist()[0] == ON
    places = left.trajectory.path_s_m[outputs.knot[1:]]
    assert places == pytest.approx(t.path_s_m[of_words(word).knot[1:]], abs=60e-6)


# --- the drive --------------------------------------------------------------------------------------------------------


def test_drive_switches_a_raster_within_a_knot_of_its_places() -> None:
    t, begins_m = raster(1000, 0.05)
    result = run(t, "ccu", Target(machine=MACHINE, place_at_start=True), RunOptions(tool=LASER))
    assert result.completed
    truth = result.truth
    assert truth is not None
    edges = np.flatnonzero(np.diff(truth.power)) + 1
    assert len(edges) == 1000
    off_m = truth.pos_m[edges, 0] - begins_m[:1000]
    assert np.abs(off_m).max() <= 0.05 * 1e-3 + 2e-6  # a knot, and what the axis is behind
    assert truth.power[-1] == 0.0
    columns = result.log.columns  # the row of a millisecond is that of its last control period
    last = np.rint(columns["time_s"] * 1e4).astype(int)
    same = np.isclose(columns["power"], truth.power[last], atol=1e-4)
    assert same.mean() > 0.999
    assert result.log.meta["switched"] == "S ×1002, M3, M5"


def test_lost_frames_lose_no_output() -> None:
    t, _ = raster(400, 0.05, 0.02)
    outputs = of_words(words(t, LASER))
    chance, lost = random.Random(1), []

    def lossy(message: can.Message) -> can.Message | None:
        if chance.random() < {wire.RPDO5 + 1: 0.2, wire.RPDO2 + 1: 0.05}.get(message.arbitration_id, 0.0):
            lost.append(message.arbitration_id)
            return None
        return message

    with HookedBus(machine=MACHINE.starting_at((0.0, 0.0))) as bus:
        device = Device(Link(bus, 1))
        bus.on_send = lossy
        bus.sim.record(True)
        with device.axes.enabled():
            assert stream(device, t.knots_nm, outputs=outputs).completed
        assert lost.count(wire.RPDO5 + 1) > 20
        assert device.read("outputs.changes") == len(outputs)
        power = bus.sim.truth().power
    assert np.count_nonzero(np.diff(power)) == np.count_nonzero(np.diff(outputs.power, prepend=np.uint16(0)))


def test_each_output_is_switched_once_after_a_stop_and_overrides() -> None:
    t, _ = raster(400, 0.05, 0.04)
    outputs = of_words(words(t, LASER))
    rates = itertools.cycle([1.0] * 40 + [0.5] * 30 + [0.0] * 5 + [1.2] * 30)
    with KonturBus(machine=MACHINE.starting_at((0.0, 0.0))) as bus:
        device = Device(Link(bus, 1))
        bus.sim.record(True)
        with device.axes.enabled():
            stopping = Operator(stop_requested=lambda: device.read("stream.executed") > 400)
            assert not stream(device, t.knots_nm, stopping, outputs=outputs).completed
        before = bus.sim.truth().power
        assert before.max() > 0.0
        assert before[-1] == 0.0
        with device.axes.enabled():
            going = Operator(feed_override=lambda: next(rates))
            result = stream(device, t.knots_nm, going, outputs=outputs, resume=True)
        assert result.completed
        assert result.passed > 50
        assert device.read("outputs.changes") == len(outputs)
        assert device.read("outputs.checksum") == outputs.checksum


def test_other_outputs_than_were_sent_are_an_error() -> None:
    """A frame becomes another one with the same CRC."""
    t, _ = raster(20, 0.05, 0.02)

    def other(message: can.Message) -> can.Message:
        if message.arbitration_id != wire.RPDO5 + 1:
            return message
        data = bytes(message.data)
        head = data[:1], data[2:4]
        made = (b"".join((head[0], head[1], power.to_bytes(2, "little"))) for power in range(0xFFFF))
        found = next(m for m in made if wire.crc8(np.frombuffer(m, np.uint8)) == data[1] and m[3:] != data[4:])
        return can.Message(arbitration_id=message.arbitration_id, data=data[:4] + found[3:], is_extended_id=False)

    with HookedBus(machine=MACHINE.starting_at((0.0, 0.0))) as bus:
        device = Device(Link(bus, 1))
        bus.on_send = other
        with device.axes.enabled(), pytest.raises(StreamError, match="switched other outputs than were sent"):
            stream(device, t.knots_nm, outputs=of_words(words(t, LASER)))
