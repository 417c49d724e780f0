# SPDX-License-Identifier: Apache-2.0
"""A second program on the bus: refused, and the first one's motion goes on as if nobody had asked."""

import subprocess
import sys

import pytest
from rig import Rig, checksum
from targets import Target

from kontur.can.link import Link
from kontur.drive.device import Device
from kontur.drive.stream import Operator, stream
from kontur.errors import HeldError

pytestmark = pytest.mark.motion

_COMMAND_S = 60.0
_ATTEMPTS = 5


def assert_undisturbed(rig: Rig) -> None:
    assert rig.device.read("stream.underruns") == 0
    assert rig.device.axes.states() == ("operation enabled", "operation enabled")


def test_second_master_is_refused_while_the_first_ones_path_runs_on(rig: Rig) -> None:
    knots_nm = rig.circle(2.0)
    told: list[str] = []

    def ask(share: float) -> None:
        if share > 0.5 and not told:
            other = Device(Link(rig.bus, rig.drive.node_id))
            with pytest.raises(HeldError) as refused:
                other.axes.enable()
            told.append(str(refused.value))

    with rig.device.axes.enabled():
        result = stream(rig.device, knots_nm, Operator(progress=ask))
        assert_undisturbed(rig)
        assert rig.device.read("stream.checksum") == checksum(knots_nm)
    assert result.completed
    assert "held by master 127" in told[0]
    assert rig.device.read("master.refused") > 0
    assert rig.device.read("master.holder") == 0


def test_second_kontur_is_refused_while_the_first_one_runs(target: Target) -> None:
    """The drive's time passes with the first one's SYNC, so a busy machine does not make that one late."""
    with target.power_on() as drive, Rig(drive) as rig:
        if not drive.listeners:
            pytest.skip("a bus for one program; --target vcan has one for many")
        knots_nm = rig.circle(30.0)
        bus = ["-i", str(drive.bus_options["interface"]), "-c", str(drive.bus_options["channel"])]
        command = [sys.executable, "-m", "kontur.cli", "jog", "--x", "1", *bus, "--node", str(drive.node_id)]
        others: list[subprocess.Popen[str]] = []
        told: list[str] = []

        def ask(share: float = 1.0) -> None:
            if share > 0.1 and not told:
                others.append(subprocess.Popen(command, stderr=subprocess.PIPE, text=True))
                told.append("")

        def refused() -> bool:
            """Whether the last one has been told; where the busy machine answers it too late, the next one asks."""
            if not told or others[-1].poll() is None:
                return False
            told[-1] = told[-1] or others[-1].communicate()[1]
            if "does not answer" not in told[-1] or len(others) == _ATTEMPTS:
                return True
            told.clear()
            ask()
            return False

        with rig.device.axes.enabled():
            result = stream(rig.device, knots_nm, Operator(progress=ask, stop_requested=refused))
            assert result.fault is None
            rig.link.wait(refused, _COMMAND_S)  # however long it takes to start
            assert_undisturbed(rig)
        assert others[-1].returncode == 1
        assert "held by master 127" in told[-1]
