# SPDX-License-Identifier: Apache-2.0
"""The bus on the side of this computer, and who speaks on it: the part of `kontur doctor` before a drive answers."""

from __future__ import annotations

import json
import os
import re
import subprocess
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import can

from kontur.can import wire
from kontur.can.bus import open_bus
from kontur.can.link import Link
from kontur.can.simulated import simulated
from kontur.commissioning import doctor
from kontur.commissioning.doctor import ERROR, OK, WARNING, Finding
from kontur.drive.device import Device
from kontur.drive.target import Target
from kontur.errors import KonturError, NoAnswerError

NETWORK = Path("/sys/class/net")
_CAN_TYPE = "280"  # ARPHRD_CAN
_UP = 1  # of the flags
_QUEUE = 100  # frames: what a stream sends in 50 ms
_BITRATES = (1_000_000, 500_000, 250_000, 125_000)  # of a board
_LISTEN_S, _LISTEN_FRAMES = 0.35, 4000
_NODE_IDS = range(1, 128)


def examine(target: Target, network: Path = NETWORK) -> list[Finding]:
    """All findings about the bus of `target` and the drive on it, as far as they can be had."""
    found = list(_interface(target.options(), network))
    if any(one.level == ERROR for one in found):
        return found
    try:
        bus = open_bus(target.options())
    except KonturError as error:
        return [*found, Finding("bus", ERROR, str(error), "mend this first; what comes behind it was not looked at")]
    try:
        found.append(Finding("bus", OK, f"{bus.channel_info} is open"))
        found += _on(bus, target)
    except KonturError as error:
        found.append(Finding("bus", ERROR, str(error), "mend this first, then look again"))
    finally:
        bus.shutdown()
    return found


def _on(bus: can.BusABC, target: Target) -> Iterator[Finding]:
    heard = _listen(bus)
    yield from _traffic(heard, target.node_id)
    try:
        device = Device(Link(bus, target.node_id))
    except NoAnswerError as error:
        yield _silent(error, heard, target)
        return
    if simulated(bus):
        device.parameters.set(target.parameters())
    yield Finding("node", OK, f"node {target.node_id} answers")
    yield from _bitrate(device, target)
    yield from doctor.findings(device)


# --- this computer ----------------------------------------------------------------------------------------------------
def _interface(options: dict[str, Any], network: Path) -> Iterator[Finding]:
    kind, channel = str(options.get("inner", options.get("interface"))), str(options.get("channel", ""))
    if kind == "socketcan":
        yield from _socketcan(channel, network)
    elif kind == "slcan" and "://" not in channel:
        yield from _serial(Path(channel.partition("@")[0]))


def _socketcan(channel: str, network: Path) -> Iterator[Finding]:
    folder = network / channel
    there = sorted(one.name for one in network.glob("*") if _text(one / "type") == _CAN_TYPE)
    if not channel or not folder.exists():
        yield Finding(
            "interface",
            ERROR,
            f"there is no interface {channel!r}; CAN interfaces here: {', '.join(there) or 'none'}",
            "plug the adapter in and load its driver (dmesg shows it), or name another one with -c",
        )
        return
    if channel not in there:
        yield Finding(
            "interface",
            ERROR,
            f"{channel} is no CAN interface; there are {', '.join(there) or 'none'}",
            "name another one with -c",
        )
        return
    up = f"as root: ip link set {channel} up type can bitrate 1000000 restart-ms 100"
    if not int(_text(folder / "flags") or "0x0", 16) & _UP:
        yield Finding("interface", ERROR, f"{channel} is down", up)
        return
    detail = _details(channel)
    state, rate = detail.get("state"), detail.get("bittiming", {}).get("bitrate")
    if state in ("ERROR-PASSIVE", "BUS-OFF"):
        yield Finding(
            "interface",
            ERROR,
            f"{channel} is {state}: nobody acknowledges what this computer sends",
            f"check supply, cable, termination and bit rate of the drive; then {up}",
        )
    else:
        yield Finding("interface", OK, f"{channel} is up{f', {state}' if state else ''}")
    if rate is not None:
        known = rate in _BITRATES
        yield Finding(
            "bit rate of the interface",
            OK if known else WARNING,
            f"{rate} bit/s",
            "" if known else f"a board has {', '.join(map(str, _BITRATES))}; {up}",
        )
    queue = int(_text(folder / "tx_queue_len") or 0)
    if queue < _QUEUE:
        yield Finding(
            "queue",
            WARNING,
            f"{channel} queues {queue} frames; a stream of knots may wait for it",
            f"as root: ip link set {channel} txqueuelen 1000",
        )
    else:
        yield Finding("queue", OK, f"{channel} queues {queue} frames")


def _details(channel: str) -> dict[str, Any]:
    """What iproute2 says of a CAN interface; nothing where it is not installed, or the interface has no such data."""
    with suppress(OSError, ValueError, LookupError, TypeError, subprocess.SubprocessError):
        done = subprocess.run(
            ["ip", "-details", "-json", "link", "show", channel], capture_output=True, timeout=5.0, check=True
        )
        found = json.loads(done.stdout)[0]["linkinfo"]["info_data"]
        return found if isinstance(found, dict) else {}
    return {}


def _serial(port: Path) -> Iterator[Finding]:
    if not port.exists():
        ports = sorted(str(one) for pattern in ("ttyUSB*", "ttyACM*") for one in Path("/dev").glob(pattern))
        yield Finding(
            "interface",
            ERROR,
            f"there is no {port}; serial ports here: {', '.join(ports) or 'none'}",
            "plug the adapter in (dmesg shows its name), or name another one with -c",
        )
    elif not os.access(port, os.R_OK | os.W_OK):
        group = _group(port)
        yield Finding(
            "permissions",
            ERROR,
            f"this user may not use {port}",
            f"as root: usermod -aG {group} YOUR-NAME; then log in again",
        )
    else:
        yield Finding("permissions", OK, f"this user may use {port}")


def _group(port: Path) -> str:
    try:
        return port.group()
    except (OSError, KeyError, NotImplementedError):  # no such name, or no such thing on this system
        return "dialout"


def _text(file: Path) -> str:
    try:
        return file.read_text().strip()
    except OSError:
        return ""


# --- who speaks -------------------------------------------------------------------------------------------------------
def _listen(bus: can.BusABC) -> Counter[int]:
    """Frames by identifier, -1 for error frames, that come while this computer sends nothing."""
    drive = simulated(bus)
    clock = time.monotonic if drive is None or drive.by_clock else lambda: drive.time_s
    heard: Counter[int] = Counter()
    end_s = clock() + _LISTEN_S
    while (left_s := end_s - clock()) > 0.0 and heard.total() < _LISTEN_FRAMES:
        if (message := bus.recv(left_s)) is not None:
            heard[-1 if message.is_error_frame else message.arbitration_id] += 1
    return heard


def _traffic(heard: Counter[int], node_id: int) -> Iterator[Finding]:
    if heard[-1]:
        yield Finding(
            "traffic",
            ERROR,
            f"{heard[-1]} error frames in {_LISTEN_S:g} s",
            "check that all nodes have one bit rate, and termination, cable and ground",
        )
    others = [node for node in _NODE_IDS if node != node_id and heard[wire.HEARTBEAT + node]]
    what = f"{heard.total() / _LISTEN_S:.0f} frames a second"
    names = ", ".join(map(str, others))
    yield Finding("traffic", OK, f"{what}; other nodes: {names}" if others else what)


def _silent(error: NoAnswerError, heard: Counter[int], target: Target) -> Finding:
    others = [node for node in _NODE_IDS if heard[wire.HEARTBEAT + node] and node != target.node_id]
    if heard[wire.HEARTBEAT + target.node_id]:
        remedy = "it sends heartbeats: does another program talk to it by SDO, or lose frames? Stop it and look again"
    elif others:
        remedy = f"other nodes are there: if one of them is the drive, name it: --node {others[0]}"
    elif heard.total():
        remedy = "the bus works, the drive does not answer: check its supply, then its node id (--node)"
    else:
        remedy = "nothing comes: check the drive's supply (its light blinks), cable, termination, bit rate and -c"
    return Finding("node", ERROR, re.sub(r" Is the drive powered.*", "", str(error)), remedy)


def _bitrate(device: Device, target: Target) -> Iterator[Finding]:
    stored = 1000 * int(device.read("node.bitrate"))
    given = (target.bus or {}).get("bitrate")
    text = f"the drive has {stored} bit/s from its next start on"
    if given is not None and int(given) != stored:
        yield Finding(
            "bit rate",
            WARNING,
            f"{text}, and this bus was opened with {given}",
            f"after its next start use -b {stored}, or set node.bitrate to {int(given) // 1000}",
        )
    else:
        yield Finding("bit rate", OK, text)
