#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes the C table, the EDS, the DBC and the reference page from firmware/od/objects.toml.

    generate_objects.py OUTDIR [--eds PATH] [--units PATH] [--dbc PATH] [--docs PATH] [--controllers PATH]

writes OUTDIR/od_gen.h and OUTDIR/od_gen.c, and the others where asked. The output depends on objects.toml and
firmware/core/controllers.h alone.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import controllers
from dbc import dbc
from objects import AXES, PDO_ENTRIES, SOURCE, Device, Entry, Object, load
from source import ROOT, c_head, note, run

GENERATOR = "tools/generate_objects.py"
C_HEAD = c_head(SOURCE, GENERATOR)
KIND_CODE = {"var": 7, "array": 8, "record": 9}
AREAS = (
    (0x1000, "Communication (CiA 301)"),
    (0x2000, "Kontur: control"),
    (0x2200, "Kontur: stream and telemetry"),
    (0x2300, "Kontur: scope"),
    (0x2800, "Kontur: control, axis y"),
    (0x6000, "Axes (CiA 402)"),
)


def unit_text(e: Entry) -> str:
    """Factor and unit of one count, as '1e-9 m'; empty for a bare number."""
    parts = [] if e.factor == 1 else [format(float(e.factor), "g").replace("e-0", "e-")]
    return " ".join(parts + ([e.unit] if e.unit else []))


def pdo_counts(objects: list[Object]) -> tuple[int, int]:
    """How many RPDOs and TPDOs there are. They are numbered from 1 without a gap."""
    rpdos, tpdos = (sum(low <= o.index < low + 0x200 for o in objects) for low in (0x1400, 0x1800))
    return rpdos, tpdos


# ---- C ----


def c_member(e: Entry, name: str) -> str:
    text = ", ".join(t for t in (unit_text(e), e.description) if t)
    star = "" if e.type.c.endswith("*") else " "
    return f"{e.type.c}{star}{name};" + (f" /* {text} */" if text else "")


def c_declare(o: Object) -> list[str]:
    """Members of struct od_data (or od_axis) for one object; empty when all of it is constant."""
    stored = [e for e in o.entries if e.field]
    if o.kind == "record":
        return [f"struct od_{o.c_name} {o.c_name};"] if stored else []
    if o.kind == "array":
        count = [f"uint8_t {o.c_name}_count;"] if o.counted else []
        return [*count, c_member(o.entries[1], f"{o.c_name}[{len(o.entries) - 1}]")]
    return [c_member(o.entries[0], o.c_name)] if stored else []


def is_mapping(o: Object) -> bool:
    """Whether it is the mapping object of a PDO."""
    return o.index & 0xFE00 in (0x1600, 0x1A00)


def c_numbers(objects: list[Object]) -> list[str]:
    """OBJ_NAME, the index of each object (OBJ_NAME_X and _Y for each axis), and SUB_NAME_ENTRY, the sub-indices."""
    lines = ["/* Indices of the objects, and their sub-indices. */", "enum {"]
    for o in objects:
        lines.append(f"    OBJ_{o.name.upper()} = 0x{o.index:04X},")
        if o.kind == "record" and o.axis in (None, 0) and not is_mapping(o):
            lines += [f"    SUB_{o.c_name.upper()}_{e.name.upper()} = {e.sub}," for e in o.entries if e.sub > 0]
    return [*lines, "};", ""]


def c_header(objects: list[Object]) -> str:
    once = [o for o in objects if o.axis in (None, 0)]
    rpdos, tpdos = pdo_counts(objects)
    lines = [C_HEAD, "#ifndef OD_GEN_H", "#define OD_GEN_H", "#include <stdint.h>", ""]
    lines += [f"enum {{ OD_RPDOS = {rpdos}, OD_TPDOS = {tpdos}, OD_PDO_ENTRIES = {PDO_ENTRIES} }};", ""]
    lines += c_numbers(objects)
    for o in once:
        if o.kind == "record" and any(e.field for e in o.entries):
            lines += [f"/* {o.index:04X}h {o.name} */", f"struct od_{o.c_name} {{"]
            lines += [f"    {c_member(e, e.name)}" for e in o.entries if e.field]
            lines += ["};", ""]
    lines += ["/* Objects that exist once an axis. */", "struct od_axis {"]
    lines += [f"    {m}" for o in once if o.axis == 0 for m in c_declare(o)]
    lines += ["};", "", "/* Every object that is no constant. */", "struct od_data {"]
    lines += [f"    {m}" for o in once if o.axis is None for m in c_declare(o)]
    lines += [f"    struct od_axis axis[{len(AXES)}];", "};", "#endif", ""]
    return "\n".join(lines)


def c_source(objects: list[Object]) -> str:
    entries = [e for o in objects for e in o.entries]
    lines = [C_HEAD, '#include "od/od.h"', "", "#include <stddef.h>", ""]
    lines += ["const struct od_data od_defaults = {"]
    for e in entries:
        if e.field and e.default:
            value = f'"{e.default}"' if isinstance(e.default, str) else f"{e.default}{'' if e.type.signed else 'u'}"
            lines.append(f"    .{e.field} = {value},")
    lines += ["};", "", "#define AT(field) (uint16_t)offsetof(struct od_data, field)", ""]
    lines += ["/* Sorted by index and sub. */", "const struct od_entry od_table[] = {"]
    for e in entries:
        access = {"ro": ["READ"], "rw": ["READ", "WRITE"], "wo": ["WRITE"], "const": ["READ", "CONST"]}[e.access]
        flags = access + ["CONFIG"] * e.config + ["LIVE"] * e.live + ["PDO"] * e.pdo + ["NODE_ID"] * e.node_id
        low, high = (e.default, e.default) if e.access == "const" else (e.low, e.high)
        place = f"AT({e.field})" if e.field else "0"
        kind, bits = f"OD_{e.type.name.upper()}", " | ".join(f"OD_{flag}" for flag in flags)
        lines.append(f"    {{0x{e.index:04X}, {e.sub}, {kind}, {bits}, {place}, {low}, {high}}}, /* {e.name} */")
    lines += ["};", "", "const uint16_t od_table_len = sizeof od_table / sizeof od_table[0];", ""]
    return "\n".join(lines)


# ---- EDS (CiA 306) ----


def eds_value(e: Entry) -> str:
    if isinstance(e.default, str):
        return e.default
    text = f"0x{e.default:X}" if not e.type.signed and e.default > 9 else str(e.default)
    return f"$NODEID+{text}" if e.node_id else text


def eds_entry(e: Entry, units: bool, object_description: str = "") -> list[str]:
    object_type = 2 if e.type.name == "domain" else 7
    lines = [
        f"ParameterName={e.name}",
        f"ObjectType=0x{object_type:X}",
        f"DataType=0x{e.type.code:04X}",
        f"AccessType={e.access}",
    ]
    if e.access != "wo" and e.type.name != "domain":
        lines.append(f"DefaultValue={eds_value(e)}")
    if e.limited and e.access != "const":
        lines += [f"LowLimit={e.low}", f"HighLimit={e.high}"]
    if e.type.name != "domain":  # CiA 306: a domain has none
        lines.append(f"PDOMapping={int(e.pdo)}")
    return lines + (additions(e, object_description) if units else [])


def additions(e: Entry, object_description: str) -> list[str]:
    """What python-canopen reads besides the keys of CiA 306."""
    lines = []
    if e.config:
        lines.append("StorageLocation=PARAMETER")
    if e.factor != 1:
        lines.append(f"Factor={float(e.factor):g}")
    if e.unit:
        lines.append(f"Unit={e.unit}")
    description = e.description or object_description
    if description:
        lines.append(f"Description={description}")
    return lines


def eds(device: Device, objects: list[Object], name: str, units: bool) -> str:
    """The electronic data sheet, which has the keys of CiA 306 alone, or `units`: with the additions()."""
    about = (
        "StorageLocation=PARAMETER: a parameter; Factor, Unit: of one count"
        if units
        else ("Units, counts and descriptions are in kontur-units.eds and docs/objects.md")
    )
    rates = {f"BaudRate_{rate}": 1 for rate in (10, 20, 50, 125, 250, 500, 800, 1000)}
    rpdos, tpdos = pdo_counts(objects)
    sections: list[tuple[str, list[str]]] = [
        (
            "FileInfo",
            [
                f"FileName={name}",
                "FileVersion=1",
                "FileRevision=1",
                "EDSVersion=4.0",
                f"Description={note(SOURCE, GENERATOR)}",
                *(f"{what}Time=12:00AM" for what in ("Creation", "Modification")),  # of the first one: what is
                *(
                    f"{what}Date=11-22-2026" for what in ("Creation", "Modification")
                ),  # committed moves by contents only
                "CreatedBy=Kontur",
                "ModifiedBy=Kontur",
            ],
        ),
        (
            "DeviceInfo",
            [
                f"VendorName={device.vendor}",
                "VendorNumber=0",
                f"ProductName={device.product}",
                f"ProductNumber={device.product_code}",
                f"RevisionNumber=0x{device.revision:X}",
                "OrderCode=",
                *(f"{key}={value}" for key, value in rates.items()),
                "SimpleBootUpMaster=0",
                "SimpleBootUpSlave=1",
                "Granularity=8",
                "DynamicChannelsSupported=0",
                "CompactPDO=0",
                "GroupMessaging=0",
                f"NrOfRXPDO={rpdos}",
                f"NrOfTXPDO={tpdos}",
                "LSS_Supported=1",
            ],
        ),
        ("DeviceComissioning", ["NodeID=1", "Baudrate=1000"]),  # sic, CiA 306; dcfchk wants a $NODEID
        ("DummyUsage", [f"Dummy{i:04d}={int(i > 1)}" for i in range(1, 8)]),
        ("Comments", ["Lines=1", f"Line1={about}"]),
    ]
    mandatory = [o for o in objects if o.index in (0x1000, 0x1001, 0x1018)]
    own = [o for o in objects if 0x2000 <= o.index < 0x6000]
    optional = [o for o in objects if o not in mandatory and o not in own]
    for name, group in (("MandatoryObjects", mandatory), ("OptionalObjects", optional), ("ManufacturerObjects", own)):
        listing = [f"{i}=0x{o.index:04X}" for i, o in enumerate(group, 1)]
        sections.append((name, [f"SupportedObjects={len(group)}", *listing]))
        for o in group:
            if o.kind == "var":
                sections.append((f"{o.index:04X}", eds_entry(o.entries[0], units, o.description)))
                continue
            head = [f"ParameterName={o.name}", f"ObjectType=0x{KIND_CODE[o.kind]:X}", f"SubNumber={len(o.entries)}"]
            sections.append((f"{o.index:04X}", head))
            sections += [(f"{o.index:04X}sub{e.sub:X}", eds_entry(e, units)) for e in o.entries]
    return "\n".join(line for name, lines in sections for line in (f"[{name}]", *lines, ""))


# ---- docs/objects.md ----


def md_number(e: Entry, wire: int) -> str:
    """Wire value in the entry's unit."""
    value = (Decimal(wire) * e.factor).normalize()
    return format(value, "f") if abs(value) >= Decimal("1e-9") or not value else format(value, "E")


def md_row(first: str, name: str, e: Entry, description: str) -> str:
    default = span = ""
    if isinstance(e.default, str):
        default = e.default
    elif e.node_id:
        default = f"{e.default:X}h + n"
    elif e.access == "const" and e.default > 0xFFFF:
        default = f"{e.default:X}h"
    elif e.access in ("rw", "const"):
        default = md_number(e, e.default)
    if e.limited and e.access != "const":
        span = f"{md_number(e, e.low)} … {md_number(e, e.high)}"
    marks = " ".join(["P"] * e.config + ["L"] * e.live + ["M"] * e.pdo)
    cells = [first, name, e.type.name, e.access, marks, e.unit, default, span, unit_text(e), description]
    return "| " + " | ".join(cells) + " |"


def docs(objects: list[Object]) -> str:
    lines = [
        "# Object dictionary",
        "",
        "Generated from `firmware/od/objects.toml` by `tools/generate_objects.py`: do not edit.",
        "",
        "P: a parameter (writable only while no axis is in operation enabled; kept by `kontur param dump` and `save`); "
        "L: the same, but writable at any time and in effect from the next movement on; M: may be mapped into a PDO. "
        "Default and range are in the unit; *count* is what one count on the wire means. "
        "n is the node id. Sub-index 0 of a record holds its highest sub-index and is left out here.",
    ]
    head = ["", "| object | name | type | access | | unit | default | range | count | |", "|" + "---|" * 10]
    area = ""
    for o in objects:
        title = [text for low, text in AREAS if low <= o.index][-1]
        if title != area:
            lines += ["", f"## {title}", *head]
            area = title
        if o.kind == "var":
            lines.append(md_row(f"{o.index:04X}h", f"**{o.name}**", o.entries[0], o.entries[0].description))
            continue
        lines.append(f"| {o.index:04X}h | **{o.name}** | {o.kind} | | | | | | | {o.description} |")
        if is_mapping(o):
            lines.append(md_row(f"{o.index:04X}h:0", f"{o.name}.{o.entries[0].name}", o.entries[0], "entries in use"))
            text = "index << 16, sub << 8, bits; changes only while the PDO is not in use and sub 0 is 0"
            first = replace(o.entries[1], default="")
            lines.append(md_row(f"{o.index:04X}h:1…{PDO_ENTRIES}", f"{o.name}.map_1…", first, text))
        elif o.kind == "array":
            lines.append(md_row(f"{o.index:04X}h:1…{len(o.entries) - 1}", f"{o.name}.entry_1…", o.entries[1], ""))
        else:
            lines += [md_row(f"{o.index:04X}h:{e.sub}", f"{o.name}.{e.name}", e, e.description) for e in o.entries[1:]]
    return "\n".join([*lines, ""])


def make(args: argparse.Namespace) -> dict[Path, str]:
    """The files that the command line asks for."""
    device, objects = load(ROOT / SOURCE)
    outputs = {args.outdir / "od_gen.h": c_header(objects), args.outdir / "od_gen.c": c_source(objects)}
    if args.eds:
        outputs[args.eds] = eds(device, objects, args.eds.name, units=False)
    if args.units:
        outputs[args.units] = eds(device, objects, args.units.name, units=True)
    if args.dbc:
        outputs[args.dbc] = dbc(objects, note(SOURCE, GENERATOR))
    if args.docs:
        outputs[args.docs] = docs(objects)
    if args.controllers:
        outputs[args.controllers] = controllers.table(controllers.load())
    return outputs


def main() -> int:
    parser = argparse.ArgumentParser(description=f"make C table, EDS, DBC and reference page from {SOURCE}")
    parser.add_argument("outdir", type=Path, help="folder for od_gen.h and od_gen.c")
    parser.add_argument("--eds", type=Path)
    parser.add_argument("--units", type=Path, help="the EDS with python-canopen's additions")
    parser.add_argument("--dbc", type=Path)
    parser.add_argument("--docs", type=Path)
    parser.add_argument("--controllers", type=Path, help="the host's list of control laws")
    return run(parser, make)


if __name__ == "__main__":
    sys.exit(main())
