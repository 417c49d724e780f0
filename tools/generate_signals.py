#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes of signals.toml, the one description of the servo's signals, what C, the page and the host have of them.

    generate_signals.py OUTDIR [--docs PATH] [--json PATH]

writes the C files under OUTDIR, and page and JSON where asked; the head of signals.toml lists them. The output depends
on signals.toml and objects.toml alone.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

from objects import Entry
from objects import load as load_objects
from source import ROOT, SourceError, c_head, load_toml, note, run

SOURCE, OBJECTS = "firmware/scope/signals.toml", "firmware/od/objects.toml"
GENERATOR = "tools/generate_signals.py"
C_HEAD = c_head(SOURCE, GENERATOR)
KINDS = {
    **{"num": "num", "acc": "acc_t", "pos": "pos_t", "reference": "pos_t"},
    **{"path": "struct path_state", "i32": "int32_t", "u8": "uint8_t"},
}
COPIES = {**KINDS, "acc": "num"}
BASES = {
    **{"out": "servo_out", "servo": "servo_state", "path": "path_state"},
    **{"in": "hal_drive_in", "scope": "scope", "range": "contour_range"},
}
UNITS = {
    **{"": ("1", ""), "%": ("0.01", "")},
    **{"m": ("1", "m"), "mm": ("1e-3", "m"), "um": ("1e-6", "m"), "nm": ("1e-9", "m")},
    **{"m/s": ("1", "m/s"), "mm/s": ("1e-3", "m/s"), "um/s": ("1e-6", "m/s"), "m/s2": ("1", "m/s2")},
    **{"N": ("1", "N"), "kg": ("1", "kg"), "J": ("1", "J"), "1/s": ("1", "1/s"), "ms": ("1e-3", "s")},
    "Hz": ("1", "Hz"),
}
"""Each unit of the signals and of their objects in SI units."""
SNAPSHOT_SUFFIX = {
    **{("1e-9", "m"): "_nm", ("1e-6", "m/s"): "_umps", ("1e-3", "m/s2"): "_mmps2", ("1e-3", "J"): "_mJ"},
    **{("0.1", "N"): "_dN", ("1e-3", "N"): "_mN", ("1e-3", "kg"): "_g", ("0.1", "1/s"): "_per_10s"},
    **{("1e-3", ""): "_permille", ("1", ""): "", ("1e-3", "Hz"): "_mHz"},
}
"""How the name of a member of the snapshot ends, by what one count is in SI units."""
COLUMN_SUFFIX = {"um": "_um", "mm": "_mm", "N": "_N", "1/s": "_per_s", "m/s2": "_mps2", "J": "_J"}
"""How the name of a log's column ends, by its unit."""


class SignalsError(SourceError):
    """signals.toml is not usable; the message says which row and what is wrong."""


@dataclass(frozen=True)
class Telemetry:
    """Where a signal is in a TPDO. `wraps`: as the low bits of its value, else values beyond the range are limited."""

    entry: Entry
    cob_id: int
    period_ms: int
    bit: int
    wraps: bool


@dataclass(frozen=True)
class Published:
    """How a signal is published each millisecond. `member`: its place in struct servo_snapshot.

    `scale`: counts of the snapshot in one unit of the core (num, acc). `copy`: its place in struct telemetry_copies,
    empty if the tick need not copy it. `sum`: names of the signals whose sum it is; it has no member then.
    """

    member: str
    scale: int
    copy: str
    slow: bool
    sum: tuple[str, ...]
    object: Entry | None
    telemetry: Telemetry | None
    log: dict[str, Any] | None

    @property
    def entries(self) -> list[tuple[Entry, Telemetry | None]]:
        """The objects that it goes to."""
        places = [(self.object, None), (self.telemetry.entry if self.telemetry else None, self.telemetry)]
        return [(entry, telemetry) for entry, telemetry in places if entry]


@dataclass(frozen=True)
class Signal:
    """One signal; see signals.toml.

    `axis`: 0 or 1 of a list, else 0. `scale`: counts of the scope in one unit of the core.
    """

    number: int | None
    name: str
    base: str
    member: str
    axis: int
    kind: str
    unit: str
    factor: Decimal
    scale: int
    description: str
    published: Published | None

    @property
    def place(self) -> str:
        """In C, of a pointer with the name of the base."""
        return f"{self.base}->{self.member}" if self.member else f"*{self.base}"


class _Objects:
    """What signals.toml needs to know of objects.toml."""

    def __init__(self, path: Path) -> None:
        _, objects = load_objects(path)
        self.by_field = {entry.field: entry for o in objects for entry in o.entries if entry.field}
        self.pdos: dict[str, tuple[int, int, int]] = {}
        for name, pdo in load_toml(path)["pdo"].items():
            bit = 0
            for field in pdo["map"] if name.startswith("tpdo") else []:
                entry = self.by_field.get(field)
                if entry is not None and field.startswith("telemetry."):
                    self.pdos[field] = (pdo["cob_id"], pdo["event_ms"], bit)
                    bit += entry.type.bits

    def entry(self, field: str, name: str) -> Entry:
        if field not in self.by_field:
            raise SignalsError(f"{name}: objects.toml has no {field}")
        return self.by_field[field]

    def telemetry(self, name: str, wraps: bool) -> Telemetry:
        field = f"telemetry.{name}"
        entry = self.entry(field, name)
        if field not in self.pdos:
            raise SignalsError(f"{name}: no TPDO of objects.toml maps {field}")
        return Telemetry(entry, *self.pdos[field], wraps)


def si(factor: Decimal, unit: str, name: str) -> tuple[Decimal, str]:
    """`factor` `unit`s in SI units. Raises SignalsError: a unit that is not known here."""
    if unit not in UNITS:
        raise SignalsError(f"{name}: unit '{unit}' is none of {', '.join(filter(None, UNITS))}")
    return factor * Decimal(UNITS[unit][0]), UNITS[unit][1]


def rows(given: dict[str, Any], objects: _Objects) -> list[Signal]:
    """The one or two signals of a row."""
    given = (OF_CORE if "core" in given else OTHER) | given
    names = given["name"] if isinstance(given["name"], list) else [given["name"]]
    texts = given["description"] if isinstance(given["description"], list) else [given["description"]] * len(names)
    if not all(re.fullmatch(r"[a-z][a-z0-9_]*", name) for name in names):
        raise SignalsError(f"{names[0]}: a name is lower case letters, digits and _")
    unknown = given.keys() - KEYS
    if unknown:
        raise SignalsError(f"{names[0]}: unknown key {', '.join(sorted(unknown))}")
    if "log" in given and not (given.get("telemetry") and given["log"]["unit"] in COLUMN_SUFFIX):
        raise SignalsError(f"{names[0]}: a column is one of telemetry, in one of {', '.join(COLUMN_SUFFIX)}")
    return [_signal(given, i, names, text, objects) for i, text in enumerate(texts)]


# What a row of a number of the core need not say, and any other row
OF_CORE: dict[str, Any] = {"kind": "num", "factor": Decimal("1e-5")}
OTHER: dict[str, Any] = {"kind": "i32", "factor": Decimal(1)}
KEYS = {
    *("name", "number", "from", "kind", "unit", "factor", "core", "description"),
    *("object", "telemetry", "wraps", "snapshot", "slow", "sum", "log"),
}


def _signal(given: dict[str, Any], i: int, names: list[str], text: str, objects: _Objects) -> Signal:
    name, kind, factor = names[i], given["kind"], Decimal(given["factor"])
    base, _, member = given.get("from", "out").format(xy="xy"[i], i=i).partition(".")
    if kind not in KINDS or base not in BASES:
        raise SignalsError(f"{name}: kind is one of {', '.join(KINDS)}, from begins with {', '.join(BASES)}")
    return Signal(
        number=given["number"] + i if "number" in given else None,
        name=name,
        base=base,
        member=member,
        axis=i,
        kind=kind,
        unit=given["unit"],
        factor=factor,
        scale=_whole(Decimal(given.get("core", 0)) / factor, kind, name),
        description=text,
        published=_published(given, i, names, objects),
    )


def _published(given: dict[str, Any], i: int, names: list[str], objects: _Objects) -> Published | None:
    name, kind, unit = names[i], given["kind"], given["unit"]
    entry = objects.entry(given["object"].format(xy="xy"[i], i=i), name) if "object" in given else None
    telemetry = objects.telemetry(name, given.get("wraps", False)) if given.get("telemetry") else None
    counts = {si(e.factor, e.unit, name) for e in (entry, telemetry and telemetry.entry) if e}
    if "snapshot" in given:
        counts.add((Decimal(given["snapshot"]), UNITS[unit][1]))
    if not counts:
        return None
    count, *others = counts
    of_scope = si(Decimal(given["factor"]), unit, name)
    summed = "sum" in given
    if others or count[1] != of_scope[1] or (kind not in ("num", "acc") and not summed and count != of_scope):
        raise SignalsError(f"{name}: all its objects have one factor; that of the signal where kind is not num or acc")
    return Published(
        member="" if summed else _member(names, i, count),
        scale=_whole(si(Decimal(given.get("core", 0)), unit, name)[0] / count[0], kind, name),
        copy="" if summed or given["from"].startswith("out.") else _element(names, i),
        slow=given.get("slow", False),
        sum=tuple(given["sum"].format(xy=xy) for xy in "xy") if summed else (),
        object=entry,
        telemetry=telemetry,
        log=given.get("log"),
    )


def _whole(scale: Decimal, kind: str, name: str) -> int:
    if (kind in ("num", "acc")) != (0 < scale < 1 << 24) or scale != int(scale):
        raise SignalsError(f"{name}: core over factor must be an integer below 2^24, for num and acc only")
    return int(scale)


def _element(names: list[str], i: int) -> str:
    """The C member of signal i: an element of a list where the names differ in their last letter alone."""
    stems = {re.sub(r"_[xy12]$", "", name) for name in names}
    return f"{stems.pop()}[{i}]" if len(names) == 2 and len(stems) == 1 else names[i]


def _member(names: list[str], i: int, per_count: tuple[Decimal, str]) -> str:
    suffix = {(Decimal(factor), unit): s for (factor, unit), s in SNAPSHOT_SUFFIX.items()}
    if per_count not in suffix:
        raise SignalsError(f"{names[i]}: SNAPSHOT_SUFFIX has no name for a count of {per_count[0]} {per_count[1]}")
    stem, bracket, rest = _element(names, i).partition("[")
    return stem + suffix[per_count] + bracket + rest


def load(path: Path, objects_path: Path) -> list[Signal]:
    """All signals in the order of signals.toml. Raises SourceError."""
    objects = _Objects(objects_path)
    try:
        signals = [s for given in load_toml(path)["signal"] for s in rows(given, objects)]
    except (KeyError, TypeError, ValueError) as error:
        raise SignalsError(f"{path}: {error!r}") from error
    numbers, names = [s.number for s in signals], [s.name for s in signals]
    for s in signals:
        usable = s.number is None or (numbers.count(s.number) == 1 and 1 <= s.number <= 255)
        if names.count(s.name) > 1 or not usable:
            raise SignalsError(f"{s.name}: number {s.number} or name is another signal's, or not 1..255")
    missing = objects.pdos.keys() - {"telemetry.tick"}
    missing -= {e.field for s in signals if s.published for e, _ in s.published.entries}
    if missing:
        raise SignalsError(f"no signal goes to {', '.join(sorted(missing))}, which a TPDO maps")
    return signals


def recorded(signals: list[Signal]) -> list[Signal]:
    """What the scope can record, by number."""
    return sorted((s for s in signals if s.number is not None), key=lambda s: s.number or 0)


# ---- the scope's table ----


def scope_header(signals: list[Signal]) -> str:
    lines = [C_HEAD, "#ifndef SIGNAL_GEN_H", "#define SIGNAL_GEN_H", "", "enum signal {"]
    lines += [f"    SIGNAL_{s.name.upper()} = {s.number}," for s in recorded(signals)]
    return "\n".join([*lines, f"    SIGNALS = {(recorded(signals)[-1].number or 0) + 1}", "};", "#endif", ""])


def scope_source(signals: list[Signal]) -> str:
    lines = [C_HEAD, "#include <stddef.h>", "", '#include "core/servo.h"', '#include "hal/hal.h"']
    lines += ['#include "scope/scope.h"', ""]
    for s in recorded(signals):
        place = f"((struct {BASES[s.base]} *)0)->{s.member}" if s.member else f"struct {BASES[s.base]}"
        lines.append(f'_Static_assert(sizeof({place}) == sizeof({KINDS[s.kind]}), "{s.name}: kind");')
    lines += ["", "const struct scope_signal scope_signals[SIGNALS] = {"]
    for s in recorded(signals):
        offset = f"offsetof(struct {BASES[s.base]}, {s.member})" if s.member else "0"
        values = f"SCOPE_{s.kind.upper()}, SCOPE_BASE_{s.base.upper()}, {s.axis}, {offset}, {s.scale}"
        lines.append(f"    [SIGNAL_{s.name.upper()}] = {{{values}}},")
    return "\n".join([*lines, "};", ""])


# ---- snapshot and telemetry ----


def members(fields: list[tuple[str, str]]) -> list[str]:
    """Declarations of (member, type), those of a list once."""
    last = {member.partition("[")[0]: (member, c_type) for member, c_type in fields}
    return [f"{c_type} {m[:-2] + '2]' if m.endswith('[1]') else m};" for m, c_type in last.values()]


def snapshot_header(signals: list[Signal]) -> str:
    fields = [(p.member, "uint8_t" if s.kind == "u8" else "int32_t") for s, p in published(signals) if p.member]
    lines = [C_HEAD, "#ifndef SNAPSHOT_GEN_H", "#define SNAPSHOT_GEN_H", ""]
    lines += ["/* Members of struct servo_snapshot (supervision/servo_snapshot.h) */", "#define SNAPSHOT_SIGNALS \\"]
    return "\n".join([*lines, " \\\n".join(f"    {line}" for line in members(fields))[:-1], "#endif", ""])


def published(signals: list[Signal]) -> list[tuple[Signal, Published]]:
    return [(s, s.published) for s in signals if s.published]


def telemetry_header(signals: list[Signal]) -> str:
    copies: dict[str, tuple[Signal, Published]] = {}
    for s, p in published(signals):
        if p.copy:
            copies.setdefault(s.place, (s, p))
    headers = ("core/servo.h", "drive/contour_range.h", "drive/telemetry_counts.h")
    headers += ("hal/hal.h", "od/od.h", "supervision/servo_snapshot.h")
    lines = [C_HEAD, "#ifndef TELEMETRY_GEN_H", "#define TELEMETRY_GEN_H"]
    lines += [f'#include "{header}"' for header in headers]
    lines += ["", "/* Signals that are published but are not in struct servo_out */", "struct telemetry_copies {"]
    lines += [f"    {line}" for line in members([(p.copy, COPIES[s.kind]) for s, p in copies.values()])]
    lines += ["};", ""]
    lines += _copier("telemetry_copy_slow", [(s, p) for s, p in copies.values() if p.slow])
    lines += _copier("telemetry_copy", [(s, p) for s, p in copies.values() if not p.slow])
    arguments = "struct servo_snapshot *snapshot, const struct servo_out *out, const struct telemetry_copies *copies"
    lines += [f"static inline void telemetry_scale_signals({arguments})", "{"]
    for s, p in published(signals):
        if p.member:
            place = f"copies->{copies[s.place][1].copy}" if p.copy else s.place
            lines.append(f"    snapshot->{p.member} = {_scaled(s, p, place)};")
    lines += ["}", "", "/* position_nm: of the user's zero */"]
    arguments = "struct od_data *od, const struct servo_snapshot *snapshot, const int32_t position_nm[2]"
    lines += [f"static inline void telemetry_report_signals({arguments})", "{"]
    member_of = {s.name: p.member for s, p in published(signals)}
    for s, p in published(signals):
        for entry, telemetry in p.entries:
            places = [f"snapshot->{member_of[name]}" for name in p.sum or (s.name,)]
            if s.kind == "pos":
                places = [f"position_nm[{s.axis}]"]
            lines.append(f"    od->{entry.field} = {_fitted(places, entry, telemetry)};")
    return "\n".join([*lines, "}", "#endif", ""])


def _copier(name: str, parts: list[tuple[Signal, Published]]) -> list[str]:
    bases = [base for base in BASES if any(s.base == base for s, _ in parts)]
    arguments = ", ".join(f"const struct {BASES[base]} *{base}" for base in bases)
    lines = [f"static inline void {name}(struct telemetry_copies *copies, {arguments})", "{"]
    for s, p in parts:
        lines.append(f"    copies->{p.copy} = {f'acc_to({s.place})' if s.kind == 'acc' else s.place};")
    return [*lines, "}", ""]


def _scaled(s: Signal, p: Published, place: str) -> str:
    if s.kind in ("num", "acc"):
        return f"telemetry_counts({place}, {p.scale})"
    if s.kind == "reference":
        return f"pos_to_nm(pos_add({place}, n_neg(out->contour.e_w.{'xy'[s.axis]})))"
    return f"pos_to_nm({place})" if s.kind == "pos" else place


def _fitted(places: list[str], entry: Entry, telemetry: Telemetry | None) -> str:
    """The value at `places`, one or two to add, as it is put into an object."""
    if len(places) == 2:
        return f"telemetry_sum({', '.join(places)})"
    if telemetry and telemetry.wraps:
        return f"telemetry_low_bits({places[0]}, {entry.type.bits})"
    if entry.type.name == "i32":
        return places[0]
    limited = f"telemetry_limit({places[0]}, {entry.type.low}, {min(entry.type.high, 2**31 - 1)})"
    return limited if entry.type.c == "int32_t" else f"({entry.type.c}){limited}"


# ---- page and host ----


def docs(signals: list[Signal]) -> str:
    lines = [
        "# Signals of the servo",
        "",
        f"{note(f'`{SOURCE}`', f'`{GENERATOR}`')}.",
        "",
        "A signal has one name everywhere: for `kontur scope`, in the object dictionary and in the columns of a log. "
        "_1 is along the path, _2 across it. Numbers in brackets are equations of the paper, and symbols are its "
        "symbols ([control-law.md](control-law.md)).",
        "",
        "The scope ([scope.md](scope.md)) records those with a number, which is the value of object 2301h. A sample "
        "on the wire is an i32; one count is *count* units.",
        "",
        "| number | name | unit | count | |",
        "|---|---|---|---|---|",
    ]
    for s in recorded(signals):
        lines.append(f"| {s.number} | {s.name} | {s.unit} | {float(s.factor):g} | {s.description} |")
    lines += [
        "",
        "The drive publishes these each millisecond. One count of the object is *count* units. A log has a column of "
        "each signal that a TPDO carries.",
        "",
        "| name | object | count | unit | TPDO | column |",
        "|---|---|---|---|---|---|",
    ]
    for s, p in published(signals):
        for entry, t in p.entries:
            pdo = f"{t.cob_id:X}h, bit {t.bit}, each {t.period_ms} ms" if t else ""
            place, column = f"{entry.index:X}h:{entry.sub}", column_name(s, p) if t else ""
            lines.append(f"| {s.name} | {place} | {float(entry.factor):g} | {entry.unit} | {pdo} | {column} |")
    return "\n".join([*lines, ""])


def column_name(s: Signal, p: Published) -> str:
    return s.name + COLUMN_SUFFIX[p.log["unit"]] if p.log else ""


def table(signals: list[Signal]) -> str:
    """What the host knows of each signal, those of the scope first, by number."""
    rest = [s for s in signals if s.number is None]
    return "[\n" + ",\n".join(json.dumps(_row(s)) for s in [*recorded(signals), *rest]) + "\n]\n"


def _row(s: Signal) -> dict[str, Any]:
    row: dict[str, Any] = {"number": s.number} if s.number is not None else {}
    row |= {"name": s.name, "unit": s.unit, "factor": float(s.factor), "description": s.description}
    p = s.published
    if p and p.telemetry:
        row["telemetry"] = {
            "cob_id": p.telemetry.cob_id,
            "period_ms": p.telemetry.period_ms,
            "bit": p.telemetry.bit,
            "bits": p.telemetry.entry.type.bits,
            "signed": p.telemetry.entry.type.signed,
            "factor": float(p.telemetry.entry.factor),
            "unit": p.telemetry.entry.unit,
        }
    if p and p.log:
        row["column"] = {"name": column_name(s, p), "unit": p.log["unit"], "digits": p.log["digits"]}
    return row


def make(args: argparse.Namespace) -> dict[Path, str]:
    """The files that the command line asks for."""
    signals = load(ROOT / SOURCE, ROOT / OBJECTS)
    outputs = {
        args.outdir / "scope/signal_gen.h": scope_header(signals),
        args.outdir / "scope/signal_gen.c": scope_source(signals),
        args.outdir / "supervision/snapshot_gen.h": snapshot_header(signals),
        args.outdir / "drive/telemetry_gen.h": telemetry_header(signals),
    }
    if args.docs:
        outputs[args.docs] = docs(signals)
    if args.json:
        outputs[args.json] = table(signals)
    return outputs


def main() -> int:
    parser = argparse.ArgumentParser(description=f"make C, page and host's table from {SOURCE}")
    parser.add_argument("outdir", type=Path, help="folder of the generated C: scope/, supervision/ and drive/ in it")
    parser.add_argument("--docs", type=Path)
    parser.add_argument("--json", type=Path)
    return run(parser, make)


if __name__ == "__main__":
    sys.exit(main())
