# SPDX-License-Identifier: Apache-2.0
"""The scope of the simulated drive, read by block upload: values against the truth, where the trigger is, faults."""

from __future__ import annotations

import csv
import json
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import generate_signals
import numpy as np
import pytest
from asammdf import MDF
from click.testing import CliRunner
from stepped_stream import SteppedStream

from kontur import machine
from kontur.can.bad_bus import BusFaults
from kontur.can.bus import open_bus
from kontur.can.link import Link
from kontur.cli import main
from kontur.drive import scope
from kontur.drive.device import Device, connected
from kontur.drive.pdos import TELEMETRY
from kontur.drive.scope import Capture, Setup, Trigger
from kontur.drive.state_machine import RUN_PATH
from kontur.drive.target import Target
from kontur.errors import DeviceError, EmcyError, ParameterError
from kontur.path import shapes
from kontur.planning import planner
from kontur.planning.bounds import limits
from kontur.report import capture_file
from kontur.runs.runner import RunOptions, run
from kontur.sim.bus import KonturBus
from kontur.sim.process import start as start_process

ROOT = Path(__file__).resolve().parents[2]
RADIUS_M, FEED_MPS = 0.02, 0.1
TABLE = machine.load()
MACHINE = TABLE.starting_at((RADIUS_M, 0.0))
TARGET = Target(machine=TABLE)
CIRCLE = planner.plan(shapes.circle(RADIUS_M, FEED_MPS), limits(MACHINE))
TOO_FAST = {"limits.velocity": 0.09}


@pytest.fixture
def bus() -> Iterator[KonturBus]:
    with can.Bus(interface="kontur", channel="sim", machine=MACHINE, seed=1) as bus:
        assert isinstance(bus, KonturBus)
        yield bus


@pytest.fixture
def device(bus: KonturBus) -> Device:
    device = Device(Link(bus, 1))
    device.parameters.set(MACHINE.parameters())
    return device


def start(device: Device, **parameters: float) -> SteppedStream:
    """Enabled, and the first knots in the queue."""
    device.parameters.set({name.replace("__", "."): value for name, value in parameters.items()})
    device.axes.enable()
    return SteppedStream(device, CIRCLE.knots_nm)


def run_into_overspeed(device: Device) -> None:
    stream = start(device, limits__velocity=0.09)
    device.axes.controlwords(RUN_PATH, RUN_PATH)
    with pytest.raises(EmcyError, match="8400h"):
        stream.advance(2.0)


# --- what is committed ---


def test_what_is_committed_is_what_signals_toml_generates(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    committed = {"--json": ROOT / "host" / "kontur" / "signals.json", "--docs": ROOT / "docs" / "signals.md"}
    options = [text for option, path in committed.items() for text in (option, str(tmp_path / path.name))]
    monkeypatch.setattr("sys.argv", ["generate_signals.py", str(tmp_path), *options])
    assert generate_signals.main() == 0
    for path in committed.values():
        assert (tmp_path / path.name).read_text() == path.read_text(), "signals.toml changed: run `make lib`"


def test_signals_can_be_chosen_by_every_number_and_no_other(device: Device) -> None:
    numbers = {signal.number for signal in scope.RECORDED.values()}
    for number in range(256):
        if number in numbers | {0}:
            device.write("scope_channels.entry_1", number)
        else:
            with pytest.raises(DeviceError, match="06090030"):
                device.write("scope_channels.entry_1", number)


# --- values ---


def test_capture_is_what_the_servo_did_period_by_period(bus: KonturBus, device: Device) -> None:
    """Forces equal the truth to their last count; positions are the encoder's, within what the observer filters."""
    stream = start(device)
    bus.sim.start_schedule()
    first = bus.sim.tick
    bus.sim.record(True)
    names = ("force_x", "force_y", "position_x", "position_y")
    scope.arm(device, Setup(names, Trigger("<", "position_x", 19.0), pre=0.5))
    device.axes.controlwords(RUN_PATH, RUN_PATH)
    stream.advance(0.5)
    assert scope.wait(device, 0.0)
    capture = scope.read(device)
    truth = bus.sim.truth()
    rows = capture.first_period - first + np.arange(len(capture.values))
    assert len(rows) == 1536
    force_N = np.column_stack([capture["force_x"], capture["force_y"]])
    assert np.abs(force_N - truth.force_N[rows]).max() <= 0.0006  # the plant is told whole mN
    assert np.abs(truth.force_N[rows]).max() > 20.0
    position_m = np.column_stack([capture["position_x"], capture["position_y"]]) * 1e-3
    assert np.abs(position_m - truth.pos_m[rows]).max() < 0.5e-6
    # where the trigger is: the first period of the observed position below the level, in the middle
    below = np.flatnonzero(capture["position_x"] < 19.0)
    assert capture.trigger_frame == below[0] == 768
    assert capture.trigger_period == capture.first_period + below[0]
    assert capture.time_s[capture.trigger_frame] == 0.0


def test_errors_are_those_of_the_telemetry(device: Device) -> None:
    stream = start(device)
    device.pdos.require(*TELEMETRY)
    scope.arm(device, Setup(("tangential_error", "contour_error"), Trigger("now")))
    device.link.record_telemetry()
    device.axes.controlwords(RUN_PATH, RUN_PATH)
    stream.advance(0.3)
    assert scope.wait(device, 1.0)
    telemetry = device.link.recorded_telemetry((int(RADIUS_M * 1e9), 0))
    capture = scope.read(device)
    # the row of tick i ms was taken in control period 10 i - 1, counted from 0
    rows = telemetry.tick * 10 - 1 - capture.first_period
    inside = (rows >= 0) & (rows < len(capture.values))
    assert inside.sum() > 100
    captured_m = np.column_stack([capture["tangential_error"], capture["contour_error"]])[rows[inside]] * 1e-6
    assert np.abs(captured_m - telemetry.columns("tangential_error", "contour_error")[inside]).max() <= 0.51e-9
    assert np.abs(captured_m).max() > 10e-9


def test_decimated_capture_spans_as_much_more_time(device: Device) -> None:
    scope.arm(device, Setup(tuple(scope.RECORDED)[:8], Trigger("now"), divider=7))
    assert scope.wait(device, 1.0)
    capture = scope.read(device)
    assert capture.values.shape == (768, 8)
    assert capture.values.size >= 6000
    assert np.allclose(np.diff(capture.time_s), 7e-4)


# --- faults ---


def test_fault_leaves_the_500_ms_before_it_without_being_asked(bus: KonturBus, device: Device) -> None:
    stream = start(device)
    device.axes.controlwords(RUN_PATH, RUN_PATH)
    stream.advance(0.7)
    device.link.stop_heartbeat()  # fall silent
    with pytest.raises(EmcyError, match="8130h"):
        stream.advance(1.0)
    capture = scope.held(device)
    assert capture is not None
    assert capture.fault == 0x8130
    assert [signal.name for signal in capture.signals] == [
        "contour_error",
        "following_error_x",
        "following_error_y",
        "force_x",
        "force_y",
    ]
    assert capture.time_s[0] <= -0.5
    assert capture.time_s[-1] >= 0.1


def test_overspeed_is_captured_in_the_period_that_cut_the_force(bus: KonturBus, device: Device) -> None:
    stream = start(device, limits__velocity=0.09)
    scope.arm(device, Setup(("force_x", "force_y", "velocity_x", "velocity_y"), Trigger("fault"), pre=0.5))
    first = bus.sim.tick
    bus.sim.record(True)
    device.axes.controlwords(RUN_PATH, RUN_PATH)
    with pytest.raises(EmcyError, match="8400h"):
        stream.advance(2.0)
    capture = scope.held(device)
    assert capture is not None
    speed = np.abs(np.column_stack([capture["velocity_x"], capture["velocity_y"]])).max(axis=1)
    assert capture.trigger_frame == np.flatnonzero(speed > 90.0)[0]
    force_N = bus.sim.truth().force_N
    assert np.any(force_N[capture.trigger_period - first - 1] != 0.0)
    assert np.all(force_N[capture.trigger_period - first] == 0.0)


def test_capture_of_a_fault_stays_until_the_fault_is_reset(device: Device) -> None:
    run_into_overspeed(device)
    capture = scope.held(device)
    assert capture is not None
    device.axes.disable()
    device.link.wait(lambda: False, 5.0)
    for take in (lambda: scope.arm(device, Setup(("path_rate",), Trigger("now"))), lambda: scope.release(device)):
        with pytest.raises(DeviceError, match="holds the capture of a fault: read it with `kontur scope --last`"):
            take()
    again = scope.held(device)
    assert again is not None
    assert np.array_equal(again.values, capture.values)
    assert again.trigger_period == capture.trigger_period
    device.parameters.set({"limits.velocity": 0.5})
    device.axes.enable()  # resets the fault
    assert scope.held(device) is None
    assert device.read("scope.state") == scope.WAITING
    with pytest.raises(DeviceError, match="No data available"):
        scope.read(device)


def test_release_arms_for_faults_as_at_power_on(device: Device) -> None:
    before = [device.read(f"scope_channels.entry_{i}") for i in range(1, 9)]
    scope.arm(device, Setup(("path_rate",), Trigger("now")))
    scope.release(device)
    assert [device.read(f"scope_channels.entry_{i}") for i in range(1, 9)] == before
    assert (device.read("scope.state"), device.read("scope.trigger")) == (scope.WAITING, 1)


# --- on its way ---


def test_capture_comes_whole_over_a_bad_bus() -> None:
    options = {"interface": "kontur", "channel": "sim", "machine": MACHINE, "seed": 1}
    faults = BusFaults(drop=0.002, flip=0.001, seed=3)
    bad = {**options, "interface": "kontur-bad-bus", "inner": "kontur", "faults": faults}
    captures = []
    for one in (options, bad):
        with connected(open_bus(one), 1) as device:
            scope.arm(device, Setup(("encoder_count_x", "position_x", "path_time"), Trigger("now")))
            assert scope.wait(device, 1.0)
            captures.append(scope.read(device))
    assert captures[0].values.shape == captures[1].values.shape == (2048, 3)
    assert np.abs(captures[0].values - captures[1].values)[:, 0].max() <= 2  # other periods of the same rest


def test_reading_is_ended_by_arming_again(device: Device) -> None:
    scope.arm(device, Setup(("contour_error",), Trigger("now")))
    assert scope.wait(device, 1.0)
    with device.link.node.sdo.open(0x2302, 0, "rb", buffering=0, block_transfer=True) as stream:
        stream.read(7)
        device.link.bus.sim.send(0x000, bytes([0x81, 1]), False)  # reset node: armed anew
        with pytest.raises(Exception):  # noqa: B017, PT011 - which one is the library's affair
            stream.readall()


# --- what the user sees ---


@pytest.mark.parametrize(
    "text", ["", "later", "contour_error", "contour_error>", "contour_error>much", "nothing>3", ">3"]
)
def test_trigger_that_makes_no_sense_is_refused(text: str) -> None:
    with pytest.raises(ParameterError):
        scope.trigger(text)


def test_trigger_is_read_as_it_is_written() -> None:
    assert scope.trigger("contour_error>2.5") == Trigger(">", "contour_error", 2.5)
    assert scope.trigger("force_x < -3e2") == Trigger("<", "force_x", -300.0)
    assert str(scope.trigger("contour_error>2.5")) == "contour_error>2.5"


def test_unknown_signal_is_refused_with_those_that_are_near() -> None:
    with pytest.raises(ParameterError, match=r"did you mean .*force_x"):
        scope.names("contour_error,force_z")


def made() -> Capture:
    signals = (scope.RECORDED["contour_error"], scope.RECORDED["force_x"])
    values = np.column_stack([np.arange(6) * 0.5, np.arange(6) * -100.0])
    return Capture(signals, values, 10_000, 2, 1000, 1005, 3, 0x8611)


def test_files_hold_time_from_the_trigger_values_and_units(tmp_path: Path) -> None:
    for suffix in capture_file.SUFFIXES:
        capture_file.save(made(), tmp_path / f"c{suffix}")
    lines = (tmp_path / "c.csv").read_text().splitlines()
    assert lines[0] == "# kontur scope 1"
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert list(rows[0]) == ["period", "time_s", "contour_error_um", "force_x_N"]
    assert rows[3] == {"period": "1006", "time_s": "0.000100", "contour_error_um": "1.50000", "force_x_N": "-300.0000"}
    with MDF(tmp_path / "c.mf4") as mdf:
        force = mdf.get("force_x")
        assert (force.unit, list(force.samples)) == ("N", list(made()["force_x"]))
        assert np.allclose(force.timestamps, made().time_s)
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")
    assert "8611h" in (tmp_path / "c.svg").read_text()


def test_command_records_at_once_and_saves(tmp_path: Path) -> None:
    args = [
        "scope",
        "--signals",
        "contour_error,encoder_count_x",
        "--trigger",
        "now",
        "--json",
        "-o",
        str(tmp_path / "c.csv"),
    ]
    result = CliRunner().invoke(main, args)
    assert result.exit_code == 0, result.output
    told = json.loads(result.output)
    assert told["frames"] == 3072
    assert [row["signal"] for row in told["signals"]] == ["contour_error", "encoder_count_x"]
    assert len((tmp_path / "c.csv").read_text().splitlines()) > 2048


def test_ctrl_c_ends_the_wait_and_leaves_the_drive_armed_for_faults(monkeypatch: pytest.MonkeyPatch) -> None:
    released: list[int] = []

    def interrupt(device: Device, timeout_s: float, stop_requested: Callable[[], bool]) -> bool:
        os.kill(os.getpid(), signal.SIGINT)
        assert stop_requested()
        return False

    def release(device: Device) -> None:
        released.append(int(device.read("scope.trigger")))

    monkeypatch.setattr(scope, "wait", interrupt)
    monkeypatch.setattr(scope, "release", release)
    result = CliRunner().invoke(main, ["scope", "--trigger", "contour_error>5"])
    assert result.exit_code == 130
    assert "Interrupted: there was no trigger." in result.stderr
    assert released == [2]


def test_command_tells_what_keeps_it(tmp_path: Path) -> None:
    for args, message in (
        (["--last"], "holds no capture"),
        (["--trigger", "contour_error>50", "--wait", "0.2"], "has come within 0.2 s"),
        (["--signals", "e_n3"], "signal 'e_n3' is unknown"),
        (["-o", str(tmp_path / "c.txt")], "must end in"),
        (["--signals", ",".join(["tangential_error"] * 9)], "9 signals"),
    ):
        result = CliRunner().invoke(main, ["scope", *args])
        assert result.exit_code == 1, args
        assert message in result.stderr
        assert "Traceback" not in result.stderr


def test_run_that_ends_in_a_fault_leaves_its_capture_beside_the_log(tmp_path: Path) -> None:
    log = tmp_path / "f.csv"
    args = ["run", "circle", "--radius", "20", "--feed", "100", "--set", "limits.velocity=0.09", "--log", str(log)]
    result = CliRunner().invoke(main, args)
    assert result.exit_code == 1
    assert "8400h" in result.stderr
    assert '# fault: "8400h"' in (tmp_path / "f-fault.csv").read_text()
    assert (tmp_path / "f-fault.png").read_bytes().startswith(b"\x89PNG")


def test_last_capture_outlives_the_master_that_was_there_at_the_fault(tmp_path: Path) -> None:
    """As in docs/scope.md, at 10 kHz: one command runs into a fault, another one fetches its picture."""
    path = tmp_path / "last.png"
    with start_process(slcan_tcp="0", pace="sync") as process:
        bus = ["-i", process.interface, "-c", process.channel]
        args = ["run", "circle", "--radius", "20", "--feed", "100", "--approach", "--set", "limits.velocity=0.09", *bus]
        scope_args = ["--scope", "contour_error,force_x,force_y", "--scope-trigger", "fault", "--scope-pre", "0.25"]
        result = CliRunner().invoke(main, [*args, *scope_args, "--scope-out", str(tmp_path / "a.csv")])
        assert result.exit_code == 1
        assert "8400h" in result.stderr
        result = CliRunner().invoke(main, ["scope", "--trigger", "now", *bus])
        assert result.exit_code == 1
        assert "`kontur scope --last`" in result.stderr
        for _ in range(2):
            result = CliRunner().invoke(main, ["scope", "--last", "--json", "-o", str(path), *bus])
            assert result.exit_code == 0, result.output
            told = json.loads(result.output)
            assert [row["signal"] for row in told["signals"]] == ["contour_error", "force_x", "force_y"]
            assert (told["fault"], told["interval_s"], told["frames"]) == ("8400h", 1e-4, 2048)
            assert told["trigger_frame"] == 512
    assert path.read_bytes().startswith(b"\x89PNG")


def test_run_records_around_a_level(tmp_path: Path) -> None:
    path = tmp_path / "c.csv"
    args = [
        "run",
        "circle",
        "--radius",
        "20",
        "--feed",
        "100",
        "--scope",
        "contour_error,velocity_y",
        "--scope-out",
        str(path),
    ]
    result = CliRunner().invoke(main, [*args, "--scope-trigger", "velocity_y>50", "--scope-pre", "0.25"])
    assert result.exit_code == 0, result.output
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    values = np.genfromtxt(lines, delimiter=",", names=True)
    assert np.flatnonzero(values["velocity_y_mm_per_s"] > 50.0)[0] == 768
    assert values["time_s"][768] == 0.0


def test_scope_changes_nothing_of_the_run() -> None:
    runs = [
        run(CIRCLE, "ccu", TARGET, RunOptions(scope=setup))
        for setup in (None, Setup(("contour_error",), Trigger("fault")))
    ]
    means = [result.log.meta["score"]["mean_um"] for result in runs]
    assert means[0] == pytest.approx(means[1], rel=0.05)  # the noise is another one: arming takes time
    assert runs[1].capture is None
