# SPDX-License-Identifier: Apache-2.0
"""Other people's tools on the drive: python-canopen alone, cantools with the DBC."""

import subprocess
import sys
import time
from pathlib import Path

import canopen
import cantools
import pytest
from canopen.profiles.p402 import BaseNode402
from rig import PATIENCE_S, Rig
from targets import MACHINE, Target, needs_clock

from kontur.can import wire

ROOT = Path(__file__).resolve().parents[2]
DBC = ROOT / "host" / "kontur" / "kontur.dbc"
EDS = ROOT / "host" / "kontur" / "kontur.eds"
EXAMPLE = ROOT / "examples" / "canopen_only.py"
_ATTEMPTS = 10
_EXAMPLE_S, _LISTEN_S, _ANSWER_S = 180.0, PATIENCE_S, PATIENCE_S
_SWITCH_NM = -148_000_000


@pytest.mark.motion
def test_python_canopen_alone_drives_circles_by_records_and_by_knots(target: Target) -> None:
    if not target.simulated:
        pytest.skip("needs more room than the 2 mm of this suite: run examples/canopen_only.py by hand")
    needs_clock(target)
    with target.power_on(pace="clock") as drive:
        interface = {"kontur-slcan": "slcan"}.get(drive.bus_options["interface"], drive.bus_options["interface"])
        bus = ["-i", interface, "-c", str(drive.bus_options["channel"])]
        done = subprocess.run([sys.executable, EXAMPLE, *bus], capture_output=True, text=True, timeout=_EXAMPLE_S)
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()
    assert "both axes: operation enabled" in lines
    assert [line.split(":")[0] for line in lines if "done" in line] == ["circle by 60C1h/68C1h", "circle by knots"]
    assert lines[-3:] == ["both axes: switch on disabled", "EMCY received: none", "EMCY history:  none"]


def test_cantools_reads_the_frames_by_the_dbc(clock_rig: Rig) -> None:
    if clock_rig.drive.node_id != 1:
        pytest.skip("the DBC is that of node 1")
    database = cantools.database.load_file(DBC, strict=True)
    clock_rig.nmt(1)
    wanted = {wire.TPDO1 + 1, wire.HEARTBEAT + 1}
    end_s = time.monotonic() + _LISTEN_S
    while wanted and time.monotonic() < end_s:
        message = clock_rig.bus.recv(0.1)
        if message is None or message.is_error_frame:
            continue
        signals = database.decode_message(message.arbitration_id, message.data, decode_choices=False)
        if message.arbitration_id == wire.TPDO1 + 1:
            status = wire.unpack_status(bytes(message.data))
            assert list(signals.values()) == [*status.statusword, status.free, status.accepted]
        wanted.discard(message.arbitration_id)
    assert not wanted


@pytest.mark.motion
def test_python_canopen_alone_homes_again_with_other_methods_and_offsets(target: Target) -> None:
    """By its own CiA 402 node, which takes bit 12 of the first statusword for the end of the homing."""
    if not target.simulated:
        pytest.skip("needs more room than the 2 mm of this suite")
    needs_clock(target)
    with (
        target.power_on(pace="clock", plant=MACHINE.starting_at((-0.14, 0.0))) as drive,
        canopen.Network() as network,
    ):
        network.connect(**drive.bus_options)
        node = network.add_node(BaseNode402(drive.node_id, str(EDS)))
        node.sdo.RESPONSE_TIMEOUT = _ANSWER_S / _ATTEMPTS
        node.sdo.MAX_RETRIES = _ATTEMPTS  # a busy host loses frames, and this library asks once by itself
        node.TIMEOUT_SWITCH_OP_MODE = node.TIMEOUT_CHECK_TPDO = _ANSWER_S
        node.TIMEOUT_SWITCH_STATE_SINGLE, node.TIMEOUT_SWITCH_STATE_FINAL = _ANSWER_S / _ATTEMPTS, _ANSWER_S
        for number in range(2, 6):  # the telemetry, which a busy host would be late with
            node.sdo[0x1800 + number - 1][1].raw |= 1 << 31
        node.nmt.state = "OPERATIONAL"
        node.setup_402_state_machine()
        for method, offset_nm, around_nm in ((37, 20_000_000, 100), (17, _SWITCH_NM, 500_000), (35, 5_000_000, 100)):
            node.state = "SWITCH ON DISABLED"
            node.sdo[0x6098].raw, node.sdo[0x607C].raw = method, offset_nm
            # By a statusword from before its command, a late host may call it interrupted; never attained.
            assert any(node.homing(timeout=_ANSWER_S) for _ in range(5)), f"method {method}"
            assert node.sdo[0x6064].raw == pytest.approx(offset_nm, abs=around_nm), f"method {method}"
            assert node.is_homed()
