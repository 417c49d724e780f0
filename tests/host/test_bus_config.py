# SPDX-License-Identifier: Apache-2.0
"""python-can's configuration (can.conf, CAN_CONFIG): one message for what is wrong with it, and nothing is simulated
in place of a bus that was meant."""

from __future__ import annotations

from pathlib import Path

import can
import can.util
import pytest
from click.testing import CliRunner, Result

from kontur.can.bus import open_bus
from kontur.cli import main


@pytest.fixture
def conf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's can.conf, and no other configuration."""
    monkeypatch.setattr(can.util, "CONFIG_FILES", ["~/can.conf"])
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    for name in ("CONFIG", "INTERFACE", "CHANNEL", "BITRATE"):
        monkeypatch.delenv(f"CAN_{name}", raising=False)
    return tmp_path / "can.conf"


def info(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["info", *arguments])


def message(*arguments: str) -> str:
    result = info(*arguments)
    assert result.exit_code == 1, result.output
    assert isinstance(result.exception, SystemExit), result.exception
    assert result.stderr.count("\n") == 1
    assert result.stdout == ""
    return result.stderr


NAMELESS = "no interface"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"interface = socketcan\n", "no section headers"),
        (b"[DEFAULT]\ninterface = socketcan\n", "no section [default]"),
        (b"[bench]\ninterface = socketcan\n", "no section [default]"),
        (b"[default]\ninterface = socketcan\nchannel = can%0\n", "write %%"),
        (b"[default]\ninterface = socketcan\ninterface = slcan\n", "already exists"),
        (b"[default]\n[default]\n", "already exists"),
        (b"\xff\xfe\x00\x01", "can't decode"),
        (b"\x00\x01\x02", "no section headers"),
        (b"[default]\nchannel = can0\n", NAMELESS),
        (b"[default]\ninterface =\nchannel = can0\n", NAMELESS),
        (b"[default]\nbustype = socketcan\nchannel = can0\n", 'rename it to "interface"'),
    ],
)
def test_bad_file_is_named_in_one_message(conf: Path, content: bytes, said: str) -> None:
    conf.write_bytes(content)
    text = message()
    assert str(conf) in text
    assert said in text


@pytest.mark.parametrize("content", [b"interface = socketcan\n", b"\xff", b"[default]\nchannel = can%0\n"])
def test_bad_file_is_named_where_an_interface_is_given_too(conf: Path, content: bytes) -> None:
    conf.write_bytes(content)
    assert str(conf) in message("-i", "socketcan", "-c", "nocan0")


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("{", "not JSON"),
        ("[1]", "it is no object"),
        ("5", "it is no object"),
        ("null", "it is no object"),
        ("[" * 100_000, "not JSON"),
        ('{"channel": "can0"}', NAMELESS),
        ('{"bustype": "socketcan"}', 'rename it to "interface"'),
        ('{"interface": ["socketcan"]}', "cannot be opened"),
        ('{"interface": {}}', NAMELESS),
        ('{"interface": "socketcan", "channel": {"a": 1}}', "cannot be opened"),
        ('{"interface": "slcan", "channel": 5}', "cannot be opened"),
        ('{"interface": "slcan", "channel": "/dev/null", "bitrate": "fast"}', "cannot be opened"),
    ],
)
def test_bad_environment_is_named_in_one_message(
    conf: Path, monkeypatch: pytest.MonkeyPatch, value: str, said: str
) -> None:
    monkeypatch.setenv("CAN_CONFIG", value)
    text = message()
    assert said in text
    assert "cannot be opened" in text or "CAN_CONFIG" in text


def test_channel_in_the_environment_alone_is_not_simulated(conf: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CAN_CHANNEL", "can0")
    assert "CAN_CHANNEL" in message()


def test_simulation_by_name_needs_no_configuration(conf: Path) -> None:
    conf.write_bytes(b"\xff")
    assert info("-i", "kontur").exit_code == 0


@pytest.mark.parametrize("content", [None, b"", b"# nothing\n", b"[default]\n"])
def test_without_configuration_the_drive_is_simulated(conf: Path, content: bytes | None) -> None:
    if content is not None:
        conf.write_bytes(content)
    result = info()
    assert result.exit_code == 0, result.output
    assert "simulated drive" in result.stdout


def test_good_file_completes_what_is_given(conf: Path) -> None:
    conf.write_text("[default]\ninterface = virtual\nchannel = there\n")
    with open_bus({}) as bus, open_bus({"interface": "virtual"}) as other:
        bus.send(can.Message(arbitration_id=5, is_extended_id=False))
        received = other.recv(5.0)
    assert received is not None
    assert received.arbitration_id == 5


@pytest.mark.parametrize("interface", sorted(can.VALID_INTERFACES - {"kontur", "kontur-bad-bus", "virtual"}))
def test_interface_that_cannot_be_opened_is_one_message(conf: Path, interface: str) -> None:
    assert "cannot be opened" in message("-i", interface, "-c", "no such channel")
