# SPDX-License-Identifier: Apache-2.0
"""Reads and checks firmware/od/objects.toml: the list of all objects, in wire units, those of each axis apart.

The format stands at the head of objects.toml. Every mistake in it raises ObjectsError with the name of the object.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

import controllers
from source import ROOT, SourceError, load_toml

SOURCE = "firmware/od/objects.toml"
AXES = ("x", "y")
AXIS_STEP = 0x800
HIGHEST_SUB = "highest_sub"
PDO_ENTRIES = 8
OFF, NO_RTR = 1 << 31, 1 << 30  # bits of a COB-ID
TRANSMISSION_TYPES = "0: at the SYNC after an event; 1..240: every so many SYNCs; 254, 255: at events and by the timer"
RECEPTION_TYPES = "0..240: takes effect at the next SYNC; 254, 255: at once"


class ObjectsError(SourceError):
    """objects.toml is not usable; the message says which object and what is wrong."""


@dataclass(frozen=True)
class Type:
    """A CANopen data type: name in objects.toml, code (CiA 301, table 44), C type, bits (0: string, domain), sign."""

    name: str
    code: int
    c: str
    bits: int
    signed: bool

    @property
    def low(self) -> int:
        return -(1 << (self.bits - 1)) if self.signed else 0

    @property
    def high(self) -> int:
        return (1 << (self.bits - self.signed)) - 1 if self.bits else 0


TYPES = {
    t.name: t
    for t in (
        Type("i8", 0x02, "int8_t", 8, True),
        Type("i16", 0x03, "int16_t", 16, True),
        Type("i32", 0x04, "int32_t", 32, True),
        Type("u8", 0x05, "uint8_t", 8, False),
        Type("u16", 0x06, "uint16_t", 16, False),
        Type("u32", 0x07, "uint32_t", 32, False),
        Type("string", 0x09, "const char *", 0, False),
        Type("i24", 0x10, "int32_t", 24, True),
        Type("domain", 0x0F, "", 0, False),
    )
}


@dataclass(frozen=True)
class Entry:
    """One (index, sub). default, low, high are wire integers (default: text of a string)."""

    index: int
    sub: int
    name: str
    field: str
    """place in struct od_data; empty for constants and domains, which have none"""
    type: Type
    access: str
    default: int | str
    low: int
    high: int
    factor: Decimal
    unit: str
    description: str
    pdo: bool
    config: bool
    live: bool
    """a parameter that is taken with power, too"""
    node_id: bool
    """the node id is added to the default"""
    limited: bool
    """low or high is narrower than the type"""


@dataclass(frozen=True)
class Object:
    """One object as it is on the wire."""

    index: int
    name: str
    kind: str
    """var, record or array"""
    description: str
    entries: tuple[Entry, ...]
    c_name: str
    """name of the C field: the same for both axes"""
    axis: int | None
    counted: bool


@dataclass(frozen=True)
class Device:
    """Identity for the EDS."""

    vendor: str
    product: str
    product_code: int
    revision: int


CONTROLLERS_MAX = "controllers"  # as a `max`: the number of the last control law

OBJECT_KEYS = {"index", "axes", "config", "live", "sub", "used", "count", "counted", "description"}
ENTRY_KEYS = {"type", "access", "factor", "unit", "default", "min", "max", "pdo", "description", "config", "live"}


def load(path: Path = ROOT / SOURCE) -> tuple[Device, list[Object]]:
    """Read objects.toml. Returns the device and all objects sorted by index; raises ObjectsError."""
    try:
        toml = load_toml(path)
        device = Device(**toml["device"])
        sources = {**toml["object"]}
        maps = toml["pdo"]
    except SourceError as error:
        raise ObjectsError(*error.args) from error
    except (TypeError, KeyError) as error:
        raise ObjectsError(f"{path}: {error}") from error
    objects = [made for name, source in sources.items() for made in _objects(name, source)]
    _check_indices(objects)
    for name, source in maps.items():
        objects += _pdo(name, source, objects)
    _check_indices(objects)
    return device, sorted(objects, key=lambda o: o.index)


def _check_indices(objects: list[Object]) -> None:
    seen: dict[int, str] = {}
    names: set[str] = set()
    for o in objects:
        if o.index in seen:
            raise ObjectsError(f"{o.name}: index {o.index:04X}h is already taken by {seen[o.index]}")
        if o.name in names:
            raise ObjectsError(f"{o.name}: two objects have this name")
        seen[o.index] = o.name
        names.add(o.name)


def _objects(name: str, source: dict[str, Any]) -> list[Object]:
    """One [object.NAME]: one object, or one an axis."""
    unknown = source.keys() - OBJECT_KEYS - ENTRY_KEYS
    if unknown:
        raise ObjectsError(f"{name}: unknown key {', '.join(sorted(unknown))}")
    _check_name(name, name)
    index = source.get("index")
    if not isinstance(index, int) or not 0x1000 <= index <= 0xFFFF:
        raise ObjectsError(f"{name}: index must be 1000h..FFFFh")
    if not source.get("axes", False):
        return [_object(name, name, index, None, source)]
    return [_object(f"{name}_{axis}", name, index + AXIS_STEP * i, i, source) for i, axis in enumerate(AXES)]


def _check_name(name: str, where: str) -> None:
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise ObjectsError(f"{where}: a name is lower case letters, digits and _, not '{name}'")


def _object(name: str, c_name: str, index: int, axis: int | None, source: dict[str, Any]) -> Object:
    place = c_name if axis is None else f"axis[{axis}].{c_name}"
    description = source.get("description", "")
    counted = bool(source.get("counted", False))
    if "sub" in source:
        subs = source["sub"]
        names = [s.get("name", "") for s in subs]
        if len(set(names)) != len(subs):
            raise ObjectsError(f"{name}: two subs have the same name")
        for sub_name in names:
            _check_name(sub_name, name)
        of_all = {key: source.get(key, False) for key in ("config", "live")}
        entries = [_number(index, 0, HIGHEST_SUB, "u8", len(subs))]
        if "used" in source:
            keys_0 = {"type": "u8", "access": "rw", "default": source["used"], "max": len(subs)}
            entries = [_entry(index, 0, HIGHEST_SUB, f"{place}.{HIGHEST_SUB}", axis, keys_0, name)]
        for i, sub in enumerate(subs, 1):
            keys = {**of_all, **{k: v for k, v in sub.items() if k != "name"}}
            entries.append(_entry(index, i, sub["name"], f"{place}.{sub['name']}", axis, keys, name))
        return Object(index, name, "record", description, tuple(entries), c_name, axis, False)
    keys = {k: v for k, v in source.items() if k in ENTRY_KEYS}
    if "count" in source:
        count = source["count"]
        first = _number(index, 0, HIGHEST_SUB, "u8", count)
        if counted:
            keys_0 = {"type": "u8", "access": "rw"}
            first = _entry(index, 0, HIGHEST_SUB, f"{place}_count", axis, keys_0, name)
        entries = [first]
        for i in range(count):
            keys_i = keys
            if axis is None and isinstance(keys.get("default"), list):
                if len(keys["default"]) != count:
                    raise ObjectsError(f"{name}: a list of defaults needs {count} values")
                keys_i = {**keys, "default": keys["default"][i]}
            entries.append(_entry(index, i + 1, f"entry_{i + 1}", f"{place}[{i}]", axis, keys_i, name))
        return Object(index, name, "array", description, tuple(entries), c_name, axis, counted)
    entry = _entry(index, 0, name, place, axis, keys, name)
    return Object(index, name, "var", description, (entry,), c_name, axis, False)


def _number(index: int, sub: int, name: str, type_name: str, value: int) -> Entry:
    """A constant."""
    return _entry(index, sub, name, "", None, {"type": type_name, "access": "const", "default": value}, name)


def _entry(index: int, sub: int, name: str, field: str, axis: int | None, source: dict[str, Any], owner: str) -> Entry:
    where = owner if sub == 0 else f"{owner}.{name}"
    unknown = source.keys() - ENTRY_KEYS
    if unknown:
        raise ObjectsError(f"{where}: unknown key {', '.join(sorted(unknown))}")
    if source.get("type") not in TYPES:
        raise ObjectsError(f"{where}: type must be one of {', '.join(TYPES)}")
    kind = TYPES[source["type"]]
    if source.get("max") == CONTROLLERS_MAX:
        source = {**source, "max": len(controllers.load()) - 1}
    config = bool(source.get("config", False))
    access = source.get("access", "rw" if config else "ro")
    if access not in ("ro", "rw", "wo", "const"):
        raise ObjectsError(f"{where}: access must be ro, rw, wo or const, not {access}")
    if config and (access != "rw" or "default" not in source):
        raise ObjectsError(f"{where}: a parameter is rw and has a default")
    live = bool(source.get("live", False))
    if live and not config:
        raise ObjectsError(f"{where}: live is for parameters: config = true")
    default = source.get("default", 0 if kind.bits else "")
    if isinstance(default, list):
        if axis is None or len(default) != len(AXES):
            raise ObjectsError(f"{where}: a list of defaults needs axes = true and {len(AXES)} values")
        default = default[axis]
    factor = source.get("factor", 1)
    if not isinstance(factor, (int, Decimal)) or factor <= 0:
        raise ObjectsError(f"{where}: factor must be a positive number")
    factor = Decimal(factor)
    node_id = isinstance(default, str) and default.startswith("$NODEID+")
    if node_id:
        default = int(default.removeprefix("$NODEID+"), 0)
    if kind.bits:
        default = _wire(where, "default", default, factor)
        low = _wire(where, "min", source["min"], factor) if "min" in source else kind.low
        high = _wire(where, "max", source["max"], factor) if "max" in source else kind.high
        if not kind.low <= low <= high <= kind.high:
            raise ObjectsError(f"{where}: min..max is empty or does not fit into {kind.name}")
        if (access == "rw" or "default" in source) and not low <= default <= high:
            raise ObjectsError(f"{where}: default {default} is outside {low}..{high} (wire units)")
    elif not isinstance(default, str) or access == "wo" or access == "rw":
        raise ObjectsError(f"{where}: a string has a text as default and cannot be written")
    elif kind.name == "domain" and (default or access == "const"):
        raise ObjectsError(f"{where}: a domain has no default, and is made while it is read")
    else:
        low = high = 0
    return Entry(
        index=index,
        sub=sub,
        name=name,
        field="" if access == "const" or kind.name == "domain" else field,
        type=kind,
        access=access,
        default=default,
        low=low,
        high=high,
        factor=factor,
        unit=source.get("unit", ""),
        description=source.get("description", ""),
        pdo=bool(source.get("pdo", False)),
        config=config,
        live=live,
        node_id=node_id,
        limited=(low, high) != (kind.low, kind.high),
    )


def _wire(where: str, what: str, value: Any, factor: Decimal) -> int:
    """Value in units as a whole number of factors."""
    if isinstance(value, bool) or not isinstance(value, (int, Decimal)):
        raise ObjectsError(f"{where}: {what} must be a number, not {value!r}")
    counts = Decimal(value) / factor
    if counts != counts.to_integral_value():
        raise ObjectsError(f"{where}: {what} {value} is no whole number of {factor}")
    return int(counts)


def _pdo(name: str, source: dict[str, Any], objects: list[Object]) -> list[Object]:
    """Communication (14xxh, 18xxh) and mapping (16xxh, 1Axxh) object of one [pdo.NAME]."""
    match = re.fullmatch(r"([rt])pdo([1-9])", name)
    if not match or not source.keys() <= {"cob_id", "map", "event_ms", "off"}:
        raise ObjectsError(f"pdo.{name}: the name is rpdoN or tpdoN, the keys are cob_id, map, event_ms, off")
    transmit = match[1] == "t"
    index = (0x1800 if transmit else 0x1400) + int(match[2]) - 1
    flags = NO_RTR * transmit + OFF * source.get("off", False)
    subs: list[dict[str, Any]] = [
        {
            "name": "cob_id",
            "type": "u32",
            "access": "rw",
            "default": f"$NODEID+0x{source['cob_id'] + flags:X}",
            "description": "bit 31: not in use; bit 30: no RTR; the identifier changes only while not in use",
        },
        {
            "name": "type",
            "type": "u8",
            "access": "rw",
            "default": 254,
            "description": TRANSMISSION_TYPES if transmit else RECEPTION_TYPES,
        },
    ]
    inhibit = "type 254, 255: least time between frames, rounded up to ms; written while not in use"
    timer = "type 254, 255: time between two frames; 0: only when something happened"
    watched = "longest time from one frame to the next, from the first one on (EMCY 8250h, then 8130h); 0: not watched"
    subs += [
        {
            "name": "inhibit",
            "type": "u16",
            "access": "rw",
            "factor": 100,
            "unit": "us",
            "description": inhibit if transmit else "without effect",
        },
        {"name": "reserved", "type": "u8", "access": "const"},
        {
            "name": "event_ms",
            "type": "u16",
            "access": "rw",
            "unit": "ms",
            "default": source.get("event_ms", 0),
            "description": timer if transmit else watched,
        },
    ]
    if transmit:
        subs += [
            {
                "name": "sync_start",
                "type": "u8",
                "access": "rw",
                "max": 240,
                "description": "type 1..240: counter of the SYNC to count from; 0: any; written while not in use",
            },
        ]
    mappable = {o.name if o.kind == "var" else f"{o.name}.{e.name}": e for o in objects for e in o.entries if e.pdo}
    mapping, bits = [], 0
    for i, mapped in enumerate(source["map"], 1):
        if mapped not in mappable:
            raise ObjectsError(f"pdo.{name}: {mapped} does not exist or lacks pdo = true")
        e = mappable[mapped]
        if e.access not in (("ro", "rw") if transmit else ("wo", "rw")):
            raise ObjectsError(f"pdo.{name}: {mapped} is {e.access}")
        bits += e.type.bits
        value = e.index << 16 | e.sub << 8 | e.type.bits
        mapping.append({"name": f"map_{i}", "type": "u32", "access": "rw", "default": value})
    if bits > 64 or not mapping:
        raise ObjectsError(f"pdo.{name}: {bits} bits are mapped; a frame has 1..64")
    used = len(mapping)
    mapping += [{"name": f"map_{i}", "type": "u32", "access": "rw"} for i in range(used + 1, PDO_ENTRIES + 1)]
    what = "transmit" if transmit else "receive"
    return [
        *_objects(name, {"index": index, "description": f"{what} PDO {match[2]}", "sub": subs}),
        *_objects(
            f"{name}_map",
            {"index": index + 0x200, "description": ", ".join(source["map"]), "sub": mapping, "used": used},
        ),
    ]
