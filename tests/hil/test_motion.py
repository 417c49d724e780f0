# SPDX-License-Identifier: Apache-2.0
"""Circles through the wire: whole, halted, interrupted, with a host that stalls."""

import os
import pty
import re
import select
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rig import Rig, checksum
from stepped_stream import SteppedStream
from targets import Target

from kontur.drive.pdos import TELEMETRY
from kontur.drive.state_machine import BIT_PATH_RUNS, ENABLE, RUN_PATH
from kontur.drive.stream import Operator, stream

pytestmark = pytest.mark.motion

HALT = 0x100
DONE = 4
STALL_S = 0.2


def test_circle_is_gone_through_from_start_to_end(rig: Rig) -> None:
    knots_nm = rig.circle(2.0)
    with rig.device.axes.enabled():
        result = stream(rig.device, knots_nm, before_start=rig.link.record_telemetry)
        assert result.completed
        assert result.executed == result.accepted == len(knots_nm)
        assert rig.device.read("stream.state") == DONE
        assert rig.device.read("stream.checksum") == checksum(knots_nm)
        assert np.abs(np.array(rig.device.position_nm()) - knots_nm[-1]).max() < 20_000
    assert rig.device.axes.states() == ("switch on disabled", "switch on disabled")


def test_clean_bus_loses_and_repeats_nothing(rig: Rig) -> None:
    if not rig.drive.stepped:
        pytest.skip("a host that shares its processor may lose frames; inproc, and slcan and vcan by SYNC, may not")
    with rig.device.axes.enabled(also=TELEMETRY):
        result = stream(rig.device, rig.circle(2.0), before_start=rig.link.record_telemetry)
        telemetry = rig.link.recorded_telemetry(rig.device.position_nm())
        assert result.retransmitted == 0
        assert set(result.rejected.values()) == {0}
        assert rig.device.read("stream.underruns") == 0
    assert telemetry.frames_lost == 0


@pytest.mark.parametrize("controlword", [RUN_PATH | HALT, ENABLE], ids=["halt", "bit 4"])
def test_stop_and_go_on_is_on_the_path_and_loses_no_knot(rig: Rig, controlword: int) -> None:
    device = rig.device
    knots_nm = rig.circle(4.0)
    device.axes.enable()
    rig.link.record_telemetry()
    stepped = SteppedStream(device, knots_nm)
    stepped.start()
    for share in (0.4, 0.7):
        stepped.advance_to(share)
        device.wait(lambda: device.axes.both(BIT_PATH_RUNS), 1.0, "does not run")
        device.axes.controlwords(controlword, controlword)
        device.wait(lambda: device.axes.both(BIT_PATH_RUNS, False), 3.0, "does not stop")
        assert device.axes.states() == ("operation enabled", "operation enabled")
        stood_nm = np.array(device.position_nm())
        rig.link.wait(lambda: False, 0.2)
        assert np.abs(np.array(device.position_nm()) - stood_nm).max() < 5_000, "it does not stand"
        device.axes.controlwords(RUN_PATH, RUN_PATH)
        device.wait(lambda: device.axes.both(BIT_PATH_RUNS), 1.0, "does not go on")
    end_s = rig.link.time_s + 30.0
    while device.axes.both(BIT_PATH_RUNS):
        stepped.step()
        assert rig.link.time_s < end_s, "it does not come to the end"
    assert device.read("stream.state") == DONE
    assert device.read("stream.checksum") == checksum(knots_nm)
    device.axes.disable()
    count_m = device.read("plant_x.encoder") * 1e-6
    position_m, _ = rig.positions_m()
    assert rig.off_circle_m(position_m).max() < 25e-6 + count_m


def test_stop_that_was_requested_is_on_the_path(rig: Rig) -> None:
    knots_nm = rig.circle(12.0)
    rig.device.axes.enable()
    asked = False

    def stop_requested() -> bool:
        return asked

    def progress(share: float) -> None:
        nonlocal asked
        asked = share > 0.6

    result = stream(
        rig.device,
        knots_nm,
        Operator(progress=progress, stop_requested=stop_requested),
        before_start=rig.link.record_telemetry,
    )
    assert not result.completed
    assert result.executed < len(knots_nm)
    rig.assert_stopped_on_the_path()


def test_host_that_stalls_for_200_ms_is_not_noticed(rig: Rig) -> None:
    knots_nm = rig.circle(8.0)
    stall_at = [0.3, 0.6]

    def progress(share: float) -> None:
        if stall_at and share > stall_at[0]:
            stall_at.pop(0)
            rig.stall(STALL_S)

    with rig.device.axes.enabled():
        result = stream(rig.device, knots_nm, Operator(progress=progress))
        assert rig.device.read("stream.underruns") == 0
        assert rig.device.read("stream.checksum") == checksum(knots_nm)
    assert not stall_at
    assert result.completed


def test_ctrl_c_on_the_command_line_stops_on_the_path(target: Target, tmp_path: Path) -> None:
    with target.power_on() as drive:
        rig = Rig(drive)
        with rig:
            x_m, y_m = rig.device.position_m()
            rig.circle(1.0)
        program = tmp_path / "circles.ngc"
        turn = f"G3 X{x_m * 1e3:.6f} Y{y_m * 1e3:.6f} I{-rig.radius_m * 1e3:g} J0\n"
        program.write_text(f"F{rig.feed_mps * 60e3:g}\nG0 X{x_m * 1e3:.6f} Y{y_m * 1e3:.6f}\n" + 40 * turn)
        bus = command_line(drive.bus_options) if target.outlives_host else []
        status, shown = interrupted_at(
            25, [sys.executable, "-m", "kontur.cli", "run", str(program), "--approach", *bus]
        )
        assert status == 130, shown[-200:]
        assert "Interrupted: the drive stopped on the path" in shown
        if target.outlives_host and drive.simulated:
            rig.connect()
            assert rig.device.info().error_code == (0, 0)
            if drive.truth_m is not None:
                rig.assert_stopped_on_the_path()
            rig.bus.shutdown()


def command_line(bus_options: dict[str, object]) -> list[str]:
    """Options of `kontur` for python-can's."""
    return [word for name, value in bus_options.items() for word in ("--bus", f"{name}={value}")]


def interrupted_at(percent: int, command: list[str]) -> tuple[int, str]:
    """Run `command` on a terminal and press Ctrl-C when its progress bar shows `percent` of "ccu" or more: exit status,
    and what it showed."""
    terminal, its_terminal = pty.openpty()
    shown, pressed = "", False
    environment = os.environ | {"COLUMNS": "100", "TERM": "xterm", "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=its_terminal, stderr=its_terminal, env=environment
    ) as process:
        os.close(its_terminal)
        try:
            while select.select([terminal], [], [], 60.0)[0]:
                try:
                    shown += os.read(terminal, 4096).decode(errors="replace")
                except OSError:  # it has ended
                    return process.wait(60.0), shown
                if not pressed and any(int(p) >= percent for p in re.findall(r"ccu .*?(\d+) ?%", shown)):
                    pressed = True
                    process.send_signal(signal.SIGINT)
        finally:
            process.kill()
            os.close(terminal)
    raise AssertionError(f"nothing more is shown after: {shown[-200:]}")
