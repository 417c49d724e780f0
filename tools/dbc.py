# SPDX-License-Identifier: Apache-2.0
"""The DBC of a drive as it comes: every frame between host and node 1 with PDOs as they are mapped by default.

Services of CiA 301 and CiA 305 (LSS) have their fields as laid out there; the data of SDO and LSS stay numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal

from objects import Entry, Object

NODE, HOST = 1, 127
DRIVE_NAME, HOST_NAME = "kontur", "host"
NMT_COMMANDS = {
    1: "start",
    2: "stop",
    128: "enter pre-operational",
    129: "reset node",
    130: "reset communication",
}
NMT_STATES = {0: "boot-up", 4: "stopped", 5: "operational", 127: "pre-operational"}


@dataclass(frozen=True)
class Signal:
    """Little-endian bits of a frame; low and high in counts."""

    name: str
    start: int
    bits: int
    signed: bool = False
    factor: Decimal = Decimal(1)
    unit: str = ""
    comment: str = ""
    low: int | None = None
    high: int | None = None
    values: dict[int, str] | None = None


@dataclass(frozen=True)
class Message:
    """A frame of `length` bytes, sent by the drive or the host."""

    name: str
    can_id: int
    length: int
    by_drive: bool
    comment: str
    signals: tuple[Signal, ...] = ()
    cycle_ms: int = 0


def services() -> list[Message]:
    """What is no PDO."""
    sdo = (Signal("command", 0, 8), Signal("index", 8, 16), Signal("sub", 24, 8), Signal("data", 32, 32))
    lss = (Signal("command", 0, 8), Signal("data", 8, 56))
    state = (Signal("state", 0, 8, values=NMT_STATES),)
    emcy = (
        Signal("code", 0, 16, comment="0: an error has ended"),
        Signal("error_register", 16, 8, comment="1001h"),
        Signal("details", 24, 32),
    )
    nmt = (Signal("command", 0, 8, values=NMT_COMMANDS), Signal("node_id", 8, 8, comment="0: all"))
    return [
        Message("NMT", 0x000, 2, False, "NMT command", nmt),
        Message("SYNC", 0x080, 0, False, "SYNC"),
        Message("EMCY", 0x080 + NODE, 8, True, "emergency", emcy),
        Message("SDO_response", 0x580 + NODE, 8, True, "SDO, outside block segments", sdo),
        Message("SDO_request", 0x600 + NODE, 8, False, "SDO, outside block segments", sdo),
        Message("heartbeat", 0x700 + NODE, 1, True, "heartbeat of the drive; boot-up", state, 100),
        Message("heartbeat_host", 0x700 + HOST, 1, False, "heartbeat of the host", state, 100),
        Message("LSS_response", 0x7E4, 8, True, "LSS", lss),
        Message("LSS_request", 0x7E5, 8, False, "LSS", lss),
    ]


def pdo(communication: Object, mapping: Object, objects: dict[tuple[int, int], tuple[str, Entry]]) -> Message:
    """The PDO with its default mapping."""
    signals, at = [], 0
    for e in mapping.entries[1:]:
        value = int(e.default)
        if value == 0:
            continue
        name, mapped = objects[value >> 16, value >> 8 & 0xFF]
        signals.append(
            Signal(
                name.replace(".", "_"),
                at,
                mapped.type.bits,
                mapped.type.signed,
                mapped.factor,
                mapped.unit,
                mapped.description,
                mapped.low,
                mapped.high,
            )
        )
        at += mapped.type.bits
    subs = {e.name: e.default for e in communication.entries}
    can_id = (int(subs["cob_id"]) & 0x7FF) + NODE
    return Message(
        communication.name.upper(),
        can_id,
        at // 8,
        communication.index >= 0x1800,
        communication.description,
        tuple(signals),
        int(subs.get("event_ms", 0)),
    )


def number(value: Decimal) -> str:
    return format(value.normalize(), "f") if abs(value) >= Decimal("1e-9") or not value else format(value, "g")


def dbc(objects: list[Object], note: str) -> str:
    """The file; `note` says where it comes from."""
    named = {
        (e.index, e.sub): (o.name if o.kind == "var" else f"{o.name}.{e.name}", e) for o in objects for e in o.entries
    }
    by_index = {o.index: o for o in objects}
    pdos = [pdo(o, by_index[o.index + 0x200], named) for o in objects if o.index & 0xFE00 in (0x1400, 0x1800)]
    messages = sorted(services() + pdos, key=lambda m: m.can_id)
    lines = ['VERSION ""', "", "NS_ :", "", "BS_:", "", f"BU_: {DRIVE_NAME} {HOST_NAME}", ""]
    for m in messages:
        sender, receiver = (DRIVE_NAME, HOST_NAME) if m.by_drive else (HOST_NAME, DRIVE_NAME)
        lines.append(f"BO_ {m.can_id} {m.name}: {m.length} {sender}")
        lines += [signal_line(s, receiver) for s in m.signals]
        lines.append("")
    lines.append(f'CM_ "Kontur, node 1, default mapping. {note}.";')
    for m in messages:
        lines.append(f'CM_ BO_ {m.can_id} "{m.comment}";')
        lines += [f'CM_ SG_ {m.can_id} {s.name} "{s.comment}";' for s in m.signals if s.comment]
    lines += ['BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;', 'BA_DEF_DEF_ "GenMsgCycleTime" 0;']
    lines += [f'BA_ "GenMsgCycleTime" BO_ {m.can_id} {m.cycle_ms};' for m in messages if m.cycle_ms]
    for m in messages:
        for s in m.signals:
            if s.values:
                texts = " ".join(f'{value} "{text}"' for value, text in s.values.items())
                lines.append(f"VAL_ {m.can_id} {s.name} {texts} ;")
    return "\n".join([*lines, ""])


def signal_line(s: Signal, receiver: str) -> str:
    low = s.low if s.low is not None else 0
    high = s.high if s.high is not None else (1 << s.bits) - 1
    span = f"[{number(low * s.factor)}|{number(high * s.factor)}]"
    scale = f"({number(s.factor)},0)"
    return f' SG_ {s.name} : {s.start}|{s.bits}@1{"-" if s.signed else "+"} {scale} {span} "{s.unit}" {receiver}'
