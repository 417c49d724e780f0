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

from objects import Entry, ObjectsError
from objects import load as load_objects

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[1]
C_HEAD = (
    "/* SPDX-License-Identifier: Apache-2.0 */\n"
    "/* Generated from scope/signals.toml by tools/generate_signals.py: do not edit. */\n"
)
KINDS = {
    **{"num": "num", "acc": "acc_t", "pos": "pos_t", "reference": "pos_t"},
    **{"path": "struct path_state", "i32": "int32_t", "u8": "uint8_t"},
}
COPIES = {**KINDS, "acc": "num"}
BASES = {
    **{"out": "servo_out", "servo": "servo_state", "path": "path_state"},
    **{"in": "hal_drive_in", "scope": "scope"},
}
UNITS = {
    **{"": ("1", ""), "m": ("1", "m"), "mm": ("1e-3", "m"), "um": ("1e-6", "m"), "nm": ("1e-9", "m")},
    **{"m/s": ("1", "m/s"), "mm/s": ("1e-3", "m/s"), "um/s": ("1e-6", "m/s"), "m/s2": ("1", "m/s2")},
    **{"N": ("1", "N"), "kg": ("1", "kg"), "J": ("1", "J"), "1/s": ("1", "1/s"), "ms": ("1e-3", "s")},
}
"""Each unit of the signals and of their objects in SI units."""
SNAPSHOT_SUFFIX = {
    **{("1e-9", "m"): "_nm", ("1e-6", "m/s"): "_umps", ("1e-3", "m/s2"): "_mmps2", ("1e-3", "J"): "_mJ"},
    **{("0.1", "N"): "_dN", ("1e-3", "N"): "_mN", ("1e-3", "kg"): "_g", ("0.1", "1/s"): "_per_10s"},
    **{("1e-3", ""): "_permille", ("1", ""): ""},
}
"""How the name of a member of the snapshot ends, by what one count is in SI units."""
COLUMN_SUFFIX = {"um": "_um", "mm": "_mm", "N": "_N", "1/s": "_per_s", "m/s2": "_mps2", "J": "_J"}
"""How the name of a log's column ends, by its unit."""


class SignalsError(Exception):
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
class Signal:
    """One signal; see signals.toml. `axis`: 0 or 1 of a list, else 0. `scale`: counts in one unit of the core.

    `snapshot`: its member of struct servo_snapshot, if it is published. `copy`: its member of struct telemetry_copies,
    if the tick has to copy it for that; `copy_type` is the member's type. `per_count`: one count in SI units.
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
    snapshot: str
    snapshot_scale: int
    copy: str
    slow: bool
    sum: tuple[str, str] | None
    object: Entry | None
    telemetry: Telemetry | None
    log: dict[str, Any] | None

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
        for name, pdo in tomllib.loads(path.read_text("ascii"), parse_float=Decimal)["pdo"].items():
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


KEYS = {
    *("name", "number", "from", "kind", "unit", "factor", "core", "description"),
    *("object", "telemetry", "wraps", "snapshot", "slow", "sum", "log"),
}


def _signal(given: dict[str, Any], i: int, names: list[str], text: str, objects: _Objects) -> Signal:
    def filled(pattern: str) -> str:
        return pattern.format(xy="xy"[i], i=i)

    name, kind, unit = names[i], given.get("kind", "i32"), given["unit"]
    factor, core = Decimal(given.get("factor", 1)), Decimal(given.get("core", 0))
    base, _, member = filled(given.get("from", "out")).partition(".")
    if kind not in KINDS or base not in BASES:
        raise SignalsError(f"{name}: kind is one of {', '.join(KINDS)}, from begins with {', '.join(BASES)}")
    scale = _whole(core / factor, kind, name)
    entry = objects.entry(filled(given["object"]), name) if "object" in given else None
    telemetry = objects.telemetry(name, given.get("wraps", False)) if given.get("telemetry") else None
    snapshot, snapshot_scale = "", 0
    published = [si(e.factor, e.unit, name) for e in (entry, telemetry.entry if telemetry else None) if e]
    if "snapshot" in given:
        published.append((Decimal(given["snapshot"]), UNITS[unit][1]))
    if published:
        if len(set(published)) > 1 or si(factor, unit, name)[1] != published[0][1]:
            raise SignalsError(f"{name}: its objects are to have one unit and one factor, those of the signal")
        snapshot = _member(names, i, published[0])
        snapshot_scale = _whole(si(core, unit, name)[0] / published[0][0], kind, name)
        if kind in ("i32", "u8", "pos", "reference") and "sum" not in given and si(factor, unit, name) != published[0]:
            raise SignalsError(f"{name}: kind {kind} is not scaled, so its object has the factor of the signal")
    return Signal(
        number=given["number"] + i if "number" in given else None,
        **{"name": name, "base": base, "member": member, "axis": i, "kind": kind, "unit": unit, "factor": factor},
        **{"scale": scale, "description": text, "snapshot": snapshot, "snapshot_scale": snapshot_scale},
        copy="" if not snapshot or base == "out" or "sum" in given else _element(names, i),
        slow=given.get("slow", False),
        sum=tuple(given["sum"].format(xy=xy) for xy in "xy") if "sum" in given else None,
        **{"object": entry, "telemetry": telemetry, "log": given.get("log")},
    )


def _whole(scale: Decimal, kind: str, name: str) -> int:
    if (kind in ("num", "acc")) != (0 < scale < 1 << 24) or scale != int(scale):
        raise SignalsError(f"{name}: core over factor is to be a whole number below 2^24, for num and acc only")
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
    """All signals in the order of signals.toml. Raises SignalsError, ObjectsError."""
    table = tomllib.loads(path.read_text("ascii"), parse_float=Decimal)
    objects = _Objects(objects_path)
    signals = [s for given in table["signal"] for s in rows(given, objects)]
    numbers, names = [s.number for s in signals], [s.name for s in signals]
    for s in signals:
        if names.count(s.name) > 1 or (s.number is not None and (numbers.count(s.number) > 1 or not 1 <= s.number <= 255)):
            raise SignalsError(f"{s.name}: number {s.number} or name is another signal's, or not 1..255")
    missing = objects.pdos.keys() - {s.telemetry.entry.field for s in signals if s.telemetry} - {"telemetry.tick"}
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
    fields = [(s.snapshot, "uint8_t" if s.kind == "u8" else "int32_t") for s in signals if s.snapshot and not s.sum]
    lines = [C_HEAD, "#ifndef SNAPSHOT_GEN_H", "#define SNAPSHOT_GEN_H", ""]
    lines += ["/* Members of struct servo_snapshot (supervision/servo_snapshot.h) */", "#define SNAPSHOT_SIGNALS \\"]
    return "\n".join([*lines, " \\\n".join(f"    {line}" for line in members(fields))[:-1], "#endif", ""])


def telemetry_header(signals: list[Signal]) -> str:
    copies = {s.place: s for s in reversed(signals) if s.copy}
    kept = [s for s in signals if s.copy and copies[s.place] is s]
    fields = members([(s.copy, COPIES[s.kind]) for s in kept])
    lines = [C_HEAD, "#ifndef TELEMETRY_GEN_H", "#define TELEMETRY_GEN_H"]
    lines += [f'#include "{name}"' for name in ("core/servo.h", "hal/hal.h", "od/od.h", "supervision/servo_snapshot.h")]
    lines += ["", "/* x within low..high */", "static inline int32_t telemetry_limit(int32_t x, int32_t low, int32_t high)"]
    lines += ["{", "    return x < low ? low : x > high ? high : x;", "}"]
    lines += ["", "/* The low `bits` of x, as a signed number */"]
    lines += ["static inline int32_t telemetry_low_bits(int32_t x, unsigned bits)", "{"]
    lines += ["    const uint32_t half = 1u << (bits - 1u);"]
    lines += ["    return (int32_t)(((uint32_t)x + half) & (2u * half - 1u)) - (int32_t)half;", "}"]
    lines += ["", "/* The sum, or 0 where it is negative */"]
    lines += ["static inline uint32_t telemetry_sum(int32_t one, int32_t other)", "{"]
    lines += ["    const int64_t sum = (int64_t)one + other;", "    return sum < 0 ? 0u : (uint32_t)sum;", "}"]
    lines += ["", "/* Signals that are published but are not in struct servo_out */", "struct telemetry_copies {"]
    lines += [*(f"    {line}" for line in fields), "};", ""]
    for slow in (True, False):
        parts = [s for s in kept if s.slow == slow]
        bases = [base for base in BASES if any(s.base == base for s in parts)]
        arguments = ", ".join(f"const struct {BASES[base]} *{base}" for base in bases)
        name = "telemetry_copy_slow" if slow else "telemetry_copy"
        lines += [f"static inline void {name}(struct telemetry_copies *copies, {arguments})", "{"]
        for s in parts:
            lines.append(f"    copies->{s.copy} = {f'acc_to({s.place})' if s.kind == 'acc' else s.place};")
        lines += ["}", ""]
    lines += ["static inline void telemetry_scale_signals(struct servo_snapshot *snapshot, const struct servo_out *out,"]
    lines += ["                                           const struct telemetry_copies *copies)", "{"]
    for s in signals:
        if s.snapshot and not s.sum:
            place = f"copies->{copies[s.place].copy}" if s.copy else s.place
            lines.append(f"    snapshot->{s.snapshot} = {_scaled(s, place)};")
    lines += ["}", "", "/* position_nm: of the user's zero */"]
    lines += ["static inline void telemetry_report_signals(struct od_data *od, const struct servo_snapshot *snapshot,"]
    lines += ["                                            const int32_t position_nm[2])", "{"]
    for s in signals:
        for entry, wraps in ((s.object, False), (s.telemetry and s.telemetry.entry, s.telemetry and s.telemetry.wraps)):
            if entry:
                lines.append(f"    od->{entry.field} = {_reported(s, entry, bool(wraps), signals)};")
    return "\n".join([*lines, "}", "#endif", ""])


def _scaled(s: Signal, place: str) -> str:
    if s.kind in ("num", "acc"):
        return f"n_to_scaled({place}, {s.snapshot_scale})"
    if s.kind == "reference":
        return f"pos_to_nm(pos_add({place}, n_neg(out->contour.e_w.{'xy'[s.axis]})))"
    return f"pos_to_nm({place})" if s.kind == "pos" else place


def _reported(s: Signal, entry: Entry, wraps: bool, signals: list[Signal]) -> str:
    if s.sum:
        one, other = (f"snapshot->{t.snapshot}" for name in s.sum for t in signals if t.name == name)
        return f"telemetry_sum({one}, {other})"
    place = f"position_nm[{s.axis}]" if s.kind == "pos" else f"snapshot->{s.snapshot}"
    if wraps:
        return f"telemetry_low_bits({place}, {entry.type.bits})"
    if entry.type.name == "i32":
        return place
    high = min(entry.type.high, 2**31 - 1)
    limited = f"telemetry_limit({place}, {entry.type.low}, {high})"
    return limited if entry.type.c == "int32_t" else f"({entry.type.c}){limited}"


# ---- page and host ----


def docs(signals: list[Signal]) -> str:
    lines = [
        "# Signals of the servo",
        "",
        "Generated from `firmware/scope/signals.toml` by `tools/generate_signals.py`: do not edit.",
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
    lines += [f"| {s.number} | {s.name} | {s.unit} | {float(s.factor):g} | {s.description} |" for s in recorded(signals)]
    lines += [
        "",
        "The drive publishes these each millisecond. One count of the object is *count* units. A log has a column of "
        "each signal that a TPDO carries.",
        "",
        "| name | object | count | unit | TPDO | column |",
        "|---|---|---|---|---|---|",
    ]
    for s in signals:
        for entry, t in ((s.object, None), (s.telemetry.entry if s.telemetry else None, s.telemetry)):
            if entry:
                pdo = f"{t.cob_id:X}h, bit {t.bit}, each {t.period_ms} ms" if t else ""
                place = f"{entry.index:X}h:{entry.sub}"
                column = column_name(s) if t and s.log else ""
                lines.append(f"| {s.name} | {place} | {float(entry.factor):g} | {entry.unit} | {pdo} | {column} |")
    return "\n".join([*lines, ""])


def column_name(s: Signal) -> str:
    return s.name + COLUMN_SUFFIX[s.log["unit"]] if s.log else ""


def table(signals: list[Signal]) -> str:
    """What the host knows of each signal, those of the scope first, by number."""
    rest = [s for s in signals if s.number is None]
    lines = [json.dumps(_row(s)) for s in [*recorded(signals), *rest] if s.number is not None or s.telemetry]
    return "[\n" + ",\n".join(lines) + "\n]\n"


def _row(s: Signal) -> dict[str, Any]:
    row: dict[str, Any] = {"number": s.number} if s.number is not None else {}
    row |= {"name": s.name, "unit": s.unit, "factor": float(s.factor), "description": s.description}
    if s.telemetry:
        entry = s.telemetry.entry
        row["telemetry"] = {
            **{"cob_id": s.telemetry.cob_id, "period_ms": s.telemetry.period_ms},
            **{"bit": s.telemetry.bit, "bits": entry.type.bits, "signed": entry.type.signed},
            **{"factor": float(entry.factor), "unit": entry.unit},
        }
    if s.log:
        row["column"] = {"name": column_name(s), "unit": s.log["unit"], "digits": s.log["digits"]}
    return row


def main() -> int:
    parser = argparse.ArgumentParser(description="make C, page and host's table from signals.toml")
    parser.add_argument("outdir", type=Path, help="folder of the generated C: scope/, supervision/ and drive/ in it")
    parser.add_argument("--docs", type=Path)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    try:
        signals = load(ROOT / "firmware/scope/signals.toml", ROOT / "firmware/od/objects.toml")
    except (SignalsError, ObjectsError, KeyError, TypeError, ValueError) as error:
        print(f"signals.toml: {error}", file=sys.stderr)
        return 1
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
    for path, text in outputs.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8", newline="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
