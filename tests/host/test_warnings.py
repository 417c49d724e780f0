# SPDX-License-Identifier: Apache-2.0
"""What the drive only warns of is told with its remedy: by `kontur info`, at the end of a run, in its log."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from kontur import machine
from kontur.can.emcy import describe_emcy
from kontur.cli import main
from kontur.cli.options import drive_of
from kontur.drive import scope
from kontur.drive.device import Device
from kontur.drive.fault_reports import FaultReports
from kontur.drive.target import Target, open_drive
from kontur.errors import DeviceError, NoAnswerError
from kontur.runs import log

CIRCLE = ("run", "circle", "--radius", "4", "--feed", "50")
NARROW = ("--set", "tunnel.radius=200", "--set", "tunnel.debounce=0", "--set", "tunnel.reaction=0")
TUNNEL, CONFIG_ENABLED = 0xFF14, 0xFF18


def kontur(*args: str) -> Result:
    result = CliRunner().invoke(main, args)
    assert result.exit_code == 0, result.output
    return result


def refuse_a_parameter(device: Device) -> None:
    """While an axis has power the drive warns of it for a second."""
    with device.axes.enabled(), pytest.raises(DeviceError, match="refuses"):
        device.write("smc.k_0", 120.0)


def test_run_without_a_warning_tells_none() -> None:
    result = kontur(*CIRCLE, "--json")
    assert json.loads(result.stdout)["warnings"] == []
    assert result.stderr == ""


def test_run_tells_each_warning_once_with_its_remedy_and_keeps_it_in_the_log(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    result = kontur(*CIRCLE, *NARROW, "--controller", "track", "--controller", "cc", "--log", str(path), "--json")
    text = describe_emcy(TUNNEL)
    assert result.stderr == f"Warning: the drive reports {text}.\n"
    assert json.loads(result.stdout)["warnings"] == [{"code": "FF14h", "text": text}]
    assert "Remedy: lower the feed" in text
    assert log.read(tmp_path / "run-cc.csv").meta["warnings"] == [text]


def test_tunnel_that_only_warns_leaves_its_capture_beside_the_log(tmp_path: Path) -> None:
    kontur(*CIRCLE, *NARROW, "--controller", "track", "--log", str(tmp_path / "run.csv"))
    head = (tmp_path / "run-warning.csv").read_text().splitlines()
    assert '# fault: "FF14h"' in head
    assert (tmp_path / "run-warning.png").exists()


def test_warnings_are_those_since_the_connection_and_those_in_effect() -> None:
    with open_drive(Target(machine=machine.load())) as device:
        assert device.faults.warnings() == ()
        assert device.faults.errors() == ()
        refuse_a_parameter(device)
        assert device.faults.errors() == (CONFIG_ENABLED,)
        assert device.info().warnings == (CONFIG_ENABLED,)
        device.link.wait(lambda: False, 1.1)
        assert device.faults.errors() == ()
        assert device.faults.warnings() == (CONFIG_ENABLED,)


def test_warning_from_before_the_connection_is_reported_while_it_lasts() -> None:
    with open_drive(Target(machine=machine.load())) as device:
        refuse_a_parameter(device)
        device.link.reported.clear()  # as if another host had been there
        assert device.faults.warnings() == (CONFIG_ENABLED,)


@pytest.mark.parametrize(("error", "told"), [(DeviceError, True), (KeyboardInterrupt, True), (NoAnswerError, False)])
def test_command_that_fails_tells_the_warnings_too_unless_nobody_answers(
    error: type[BaseException], told: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail() -> None:
        with drive_of(Target(machine=machine.load())) as device:
            refuse_a_parameter(device)
            raise error("what happened first")

    with pytest.raises(error, match="first"):
        fail()
    assert (describe_emcy(CONFIG_ENABLED) in capsys.readouterr().err) == told


def test_bench_stream_tells_the_warnings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FaultReports, "warnings", lambda self: (CONFIG_ENABLED,))
    result = kontur("bench", "stream", "--knots", "1000", "-i", "kontur", "-c", "sim", "--json")
    text = describe_emcy(CONFIG_ENABLED)
    assert result.stderr == f"Warning: the drive reports {text}.\n"
    assert json.loads(result.stdout)["warnings"] == [{"code": "FF18h", "text": text}]


def test_fault_is_no_warning() -> None:
    with open_drive(Target(machine=machine.load())) as device:
        device.link.reported.append(0x8611)
        device.link.reported.append(TUNNEL)  # stops the axes by default
        device.link.reported.append(0x1234)
        assert device.faults.warnings() == ()


def test_capture_names_what_triggered_it_though_the_drive_is_not_in_fault() -> None:
    result = kontur(*CIRCLE, *NARROW, "--controller", "track", "--json")
    assert "FF14h" in result.stdout
    bits = {code: fault.bit for code, fault in scope.emcy.faults().items()}
    assert bits[TUNNEL] is not None
    assert bits[0x8120] is None
