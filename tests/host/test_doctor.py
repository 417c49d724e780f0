# SPDX-License-Identifier: Apache-2.0
"""`kontur doctor`: what it finds wrong, what it says to do, and that it moves and changes nothing."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from kontur.can import wire
from kontur.can.link import Link
from kontur.can.simulated import simulated
from kontur.cli import main
from kontur.commissioning import doctor, doctor_bus
from kontur.commissioning.doctor import Finding
from kontur.drive.device import Device
from kontur.drive.target import Target, open_drive
from kontur.errors import DeviceError
from kontur.machine import MACHINES
from kontur.sim.process import start


@contextmanager
def drive(answers: dict[str, Any]) -> Iterator[Device]:
    """A simulated drive that reads some of its objects otherwise than they are."""
    with open_drive(Target()) as device:
        read = device.read
        device.read = lambda name: answers.get(name, read(name))  # type: ignore[method-assign]
        yield device


def level_of(found: list[Finding], check: str) -> str:
    """The worst level of a check."""
    levels = [one.level for one in found if one.check == check]
    assert levels, f"{check}: not looked at; there are {sorted({one.check for one in found})}"
    return max(levels, key=[doctor.OK, doctor.WARNING, doctor.ERROR].index)


def test_drive_that_is_well_has_nothing_wrong_and_all_was_looked_at() -> None:
    done = CliRunner().invoke(main, ["doctor", "--json"])
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout)
    assert result["ok"] is True
    assert {one["check"] for one in result["findings"]} >= {
        "bus", "node", "bit rate", "firmware", "dictionary", "bus errors", "PDO mappings", "master", "supply", "faults",
        "inputs x", "wiring y", "encoder x", "position y", "at rest x", "load of the tick", "flash",
    }  # fmt: skip
    for one in result["findings"]:
        assert set(one) == {"check", "level", "text", "remedy"}
        assert one["level"] in ("ok", "warning")
        assert bool(one["remedy"]) == (one["level"] != "ok"), one


def test_nothing_moves_and_no_parameter_changes() -> None:
    with open_drive(Target()) as device:
        sim = simulated(device.link.bus)
        assert sim is not None
        sim.start_recording()
        before = device.parameters.dump()
        list(doctor.findings(device))
        truth = sim.take_truth()
        assert not truth.force_N.any()
        assert (truth.pos_m == truth.pos_m[0]).all()
        assert device.parameters.dump() == before
        assert device.read("master.holder") == 0


def test_nothing_is_written_so_a_drive_that_another_program_holds_has_good_mappings() -> None:
    with open_drive(Target()) as device, Device(Link(device.link.bus, 1)).master.held():
        sent: list[bytes] = []
        send = device.link.send

        def noted(identifier: int, data: bytes) -> None:
            sent.append(data if identifier == 0x601 else b"")
            send(identifier, data)

        device.link.send = noted  # type: ignore[method-assign]
        found = list(doctor.findings(device))
        assert level_of(found, "master") == "warning"
        assert level_of(found, "PDO mappings") == "ok"
        assert any(sent)
        assert not [data.hex() for data in sent if data and data[0] >> 5 == 1]  # downloads


@pytest.mark.parametrize(
    ("answers", "check", "level", "remedy"),
    [
        ({"can.state": 2, "can.tx_errors": 128}, "bus errors", "error", "termination"),
        ({"can.bus_offs": 1}, "bus errors", "warning", "termination"),
        ({"software_version": "0.0.9"}, "firmware", "warning", "flash"),
        ({"identity.revision": 0x20000}, "dictionary", "error", "one version"),
        ({"smc.lambda": 1e9}, "dictionary", "error", "one version"),
        ({"rpdo2.cob_id": 0x355}, "PDO mappings", "error", "--set-pdos"),
        ({"master.holder": 5}, "master", "warning", "stop that program"),
        ({"reset_cause": 6}, "supply", "warning", "3.3 V"),
        ({"error_register": 4, "errors.entry_1": 0x5110}, "supply", "error", "supply"),
        ({"error_register": 1, "errors.entry_1": 0x8611}, "faults", "error", "plant_x"),
        ({"error_register": 1, "errors.entry_1": 0xFF31}, "faults", "warning", ""),
        ({"error_register": 1, "errors.entry_1": 0x1234}, "faults", "error", "docs/faults.md"),
        ({"digital_inputs_x": 3}, "inputs x", "error", "cable"),
        ({"digital_inputs_y": 1}, "inputs y", "warning", "lower end"),
        ({"digital_inputs_y": 2}, "inputs y", "warning", "upper end"),
        ({"digital_inputs_x": 1 << 16}, "inputs x", "error", "amplifier"),
        ({"digital_inputs_x": 1 << 17}, "inputs x", "error", "cable"),
        ({"digital_inputs_y": 1 << 18}, "inputs y", "error", "emergency stop"),
        ({"plant_x.force_limit": 900.0}, "wiring x", "warning", "full_scale"),
        ({"onchip_plant.simulated": 1}, "wiring", "warning", "simulated=0"),
        ({"plant_y.encoder": 0.0001}, "encoder y", "error", "plant_y.encoder"),
        ({"plant_y.encoder": 0.02}, "encoder y", "warning", "limits.velocity"),
        ({"plant_y.encoder": 0.25}, "encoder y", "ok", ""),
        ({"wiring_x.index_counts": 131079}, "index x", "ok", ""),
        ({"second_encoder_x.length": 0.1}, "second encoder x", "ok", ""),
        ({"position_actual_x": 200_000_000}, "position x", "error", "home"),
        ({"statusword_x": 0x27}, "at rest", "ok", ""),
        ({"tick_cycles.worst": 4000}, "load of the tick", "ok", ""),
        ({"tick_cycles.worst": 14000}, "load of the tick", "warning", "10 kHz"),
        ({"tick_cycles.worst": 17000}, "load of the tick", "error", "10 kHz"),
        ({"flash_wear.erases": 19000}, "flash", "warning", "less often"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_found_and_has_a_remedy(answers: dict[str, Any], check: str, level: str, remedy: str) -> None:
    with drive(answers) as device:
        found = list(doctor.findings(device))
    assert level_of(found, check) == level
    assert any(remedy in one.remedy for one in found if one.check == check and one.level == level)
    others = [one for one in found if one.check != check and one.level == doctor.ERROR]
    assert not others or "errors.entry_1" in answers


def test_axis_that_moves_without_power_is_seen() -> None:
    with drive({}) as device:
        places, read = iter(range(0, 10**9, 10_000)), device.read
        device.read = lambda name: next(places) if name == "position_actual_y" else read(name)  # type: ignore[method-assign]
        found = list(doctor.findings(device))
    assert level_of(found, "at rest y") == "error"
    assert level_of(found, "at rest x") == "ok"


def test_parameter_that_an_older_firmware_lacks_is_named() -> None:
    from canopen.sdo import SdoAbortedError

    with drive({}) as device:
        read = device.read

        def older(name: str) -> Any:
            if name == "smc.xi":
                raise DeviceError("refused") from SdoAbortedError(0x06020000)
            return read(name)

        device.read = older  # type: ignore[method-assign]
        found = [one for one in doctor.findings(device) if one.check == "dictionary"]
    assert found[0].level == "error"
    assert "such as smc.xi" in found[0].text


def test_slow_answers_and_frames_of_others_are_told() -> None:
    with drive({}) as device:
        device.link.count_dropped("foreign")
        for _ in range(16):
            device.link.answered(0.03)
        device.link.answered = lambda round_trip_s: None  # type: ignore[method-assign]
        found = list(doctor.findings(device))
    assert level_of(found, "answers") == "warning"
    assert level_of(found, "frames") == "warning"


# --- the bus ----------------------------------------------------------------------------------------------------------
def network(folder: Path, **files: str) -> Path:
    """What Linux says of interfaces: can0 as given, and a network card."""
    for name, content in {"type": "280", "flags": "0x40c1", "tx_queue_len": "10", **files}.items():
        (folder / "can0").mkdir(exist_ok=True)
        (folder / "can0" / name).write_text(content)
    (folder / "eth0").mkdir()
    (folder / "eth0" / "type").write_text("1")
    return folder


def of_interface(folder: Path, channel: str = "can0") -> dict[str, Finding]:
    options = {"interface": "socketcan", "channel": channel}
    return {one.check: one for one in doctor_bus._interface(options, folder)}


def test_interface_that_is_down_is_said_how_to_bring_up(tmp_path: Path) -> None:
    found = of_interface(network(tmp_path, flags="0x40c0"))["interface"]
    assert found.level == "error"
    assert "ip link set can0 up type can bitrate 1000000" in found.remedy


def test_interfaces_that_there_are_stand_beside_one_that_is_not(tmp_path: Path) -> None:
    network(tmp_path)
    missing, card = of_interface(tmp_path, "can7")["interface"], of_interface(tmp_path, "eth0")["interface"]
    assert (missing.level, card.level) == ("error", "error")
    assert "CAN interfaces here: can0" in missing.text
    assert "eth0 is no CAN interface" in card.text


@pytest.mark.parametrize(
    ("detail", "check", "level", "words"),
    [
        ({"state": "ERROR-ACTIVE", "bittiming": {"bitrate": 1000000}}, "interface", "ok", ""),
        ({"state": "BUS-OFF"}, "interface", "error", "termination"),
        ({"state": "ERROR-ACTIVE", "bittiming": {"bitrate": 800000}}, "bit rate of the interface", "warning", "500000"),
        ({"state": "ERROR-ACTIVE", "bittiming": {"bitrate": 250000}}, "bit rate of the interface", "ok", ""),
        ({}, "queue", "warning", "txqueuelen 1000"),
    ],
)
def test_state_bit_rate_and_queue_of_an_interface_are_judged(
    detail: dict[str, Any], check: str, level: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor_bus, "_details", lambda channel: detail)
    found = of_interface(network(tmp_path))[check]
    assert found.level == level
    assert words in found.remedy


def test_long_queue_is_good(tmp_path: Path) -> None:
    assert of_interface(network(tmp_path, tx_queue_len="1000"))["queue"].level == "ok"


def test_computer_without_iproute2_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert doctor_bus._details("can0") == {}


def test_port_that_the_user_may_not_use_names_its_group(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.access", lambda path, mode: False)
    (found,) = doctor_bus._interface({"interface": "slcan", "channel": "/dev/null@1000000"}, Path("/sys/class/net"))
    assert (found.check, found.level) == ("permissions", "error")
    assert "usermod -aG root" in found.remedy


@pytest.mark.parametrize(
    ("channel", "words"),
    [
        (["-i", "slcan", "-c", "/dev/ttyNOT@1000000"], "there is no /dev/ttyNOT"),
        (["-i", "socketcan", "-c", "can97"], "there is no interface 'can97'"),
        (["-i", "slcan", "-c", "socket://127.0.0.1:1"], "cannot be opened"),
        (["-i", "nonsense", "-c", "0"], "cannot be opened"),
    ],
)
def test_channel_that_is_wrong_is_a_finding_and_the_code_is_1(channel: list[str], words: str) -> None:
    done = CliRunner().invoke(main, ["doctor", "--json", *channel])
    assert done.exit_code == 1
    result = json.loads(done.stdout)
    assert result["ok"] is False
    (wrong,) = [one for one in result["findings"] if one["level"] == "error"]
    assert words in wrong["text"]
    assert wrong["remedy"]
    plain = CliRunner().invoke(main, ["doctor", *channel])
    assert plain.exit_code == 1
    assert "-> " in plain.stdout
    assert "1 wrong" in plain.stdout


def test_drive_over_slcan_is_well_and_one_of_another_node_is_named() -> None:
    # Table 1's machine has no friction for 1.4 of 5.6 s, and force noise moves it then, as the doctor says
    with start(slcan_tcp="0", node_id=3, machine=MACHINES / "ball_screw.toml") as sim:
        bus = ["-i", sim.interface, "-c", sim.channel]
        good = CliRunner().invoke(main, ["doctor", "--node", "3", "-b", "500000", *bus])
        wrong = CliRunner().invoke(main, ["doctor", *bus])
    assert good.exit_code == 0, good.output
    assert "0 wrong" in good.stdout
    assert "WARNING  bit rate" in good.stdout
    assert wrong.exit_code == 1
    assert "--node 3" in wrong.stdout


@pytest.mark.parametrize(
    ("heard", "words"),
    [
        ({}, "supply"),
        ({0x181: 30}, "the bus works"),
        ({wire.HEARTBEAT + 1: 3}, "it sends heartbeats"),
    ],
)
def test_remedy_for_a_silent_drive_goes_by_what_was_heard(heard: dict[int, int], words: str) -> None:
    from collections import Counter

    from kontur.errors import NoAnswerError

    found = doctor_bus._silent(NoAnswerError("no answer. Is the drive powered?"), Counter(heard), Target())
    assert words in found.remedy
    assert found.text == "no answer."


def test_error_frames_are_an_error() -> None:
    from collections import Counter

    found = list(doctor_bus._traffic(Counter({-1: 4, 0x181: 3}), 1))
    assert [one.level for one in found] == ["error", "ok"]
