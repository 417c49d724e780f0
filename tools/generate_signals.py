#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes the C table, the page and the host's table of the scope's signals from signals.toml.

    signals.py OUTDIR [--docs PATH] [--json PATH]

writes OUTDIR/signal_gen.h and OUTDIR/signal_gen.c, and the others where asked. The output depends on signals.toml
alone.
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

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[1]
C_HEAD = "/* SPDX-License-Identifier: Apache-2.0 */\n/* Generated from signals.toml by signals.py: do not edit. */\n"
KINDS = {
    **{"num": "num", "acc": "acc_t", "pos": "pos_t", "reference": "pos_t"},
    **{"path": "struct path_state", "i32": "int32_t", "u8": "uint8_t"},
}
BASES = {"loop": "struct servo_loop", "out": "struct servo_out"}


class SignalsError(Exception):
    """signals.toml is not usable; the message says which row and what is wrong."""


@dataclass(frozen=True)
class Signal:
    """One signal; see signals.toml. `axis`: 0 or 1 of a list, else 0. `scale`: counts in one unit of the core."""

    number: int
    name: str
    base: str
    member: str
    axis: int
    kind: str
    unit: str
    factor: Decimal
    scale: int
    description: str


def rows(given: dict[str, Any]) -> list[Signal]:
    """The one or two signals of a row."""
    names = given["name"] if isinstance(given["name"], list) else [given["name"]]
    texts = given["description"] if isinstance(given["description"], list) else [given["description"]] * len(names)
    kind, factor = given["kind"], Decimal(given["factor"])
    core = Decimal(given.get("core", 0))
    base, _, member = given["from"].partition(".")
    if kind not in KINDS or base not in BASES:
        raise SignalsError(f"{names[0]}: kind is one of {', '.join(KINDS)}, from begins with {', '.join(BASES)}")
    scale = core / factor
    if (kind in ("num", "acc")) != (0 < scale < 1 << 24) or scale != int(scale):
        raise SignalsError(f"{names[0]}: core / factor is to be a whole number below 2^24, for num and acc only")
    if not all(re.fullmatch(r"[a-z][a-z0-9_]*", name) for name in names):
        raise SignalsError(f"{names[0]}: a name is lower case letters, digits and _")
    return [
        Signal(
            number=given["number"] + i,
            name=name,
            base=base,
            member=member.format(xy="xy"[i], i=i),
            axis=i,
            kind=kind,
            unit=given["unit"],
            factor=factor,
            scale=int(scale),
            description=text,
        )
        for i, (name, text) in enumerate(zip(names, texts, strict=True))
    ]


def load(path: Path) -> list[Signal]:
    """All signals by number. Raises SignalsError."""
    table = tomllib.loads(path.read_text("ascii"), parse_float=Decimal)
    signals = sorted((s for given in table["signal"] for s in rows(given)), key=lambda s: s.number)
    numbers, names = [s.number for s in signals], [s.name for s in signals]
    for s in signals:
        if numbers.count(s.number) > 1 or names.count(s.name) > 1 or not 1 <= s.number <= 255:
            raise SignalsError(f"{s.name}: number {s.number} or name is another signal's, or not 1..255")
    return signals


def c_header(signals: list[Signal]) -> str:
    lines = [C_HEAD, "#ifndef SIGNAL_GEN_H", "#define SIGNAL_GEN_H", "", "enum signal {"]
    lines += [f"    SIGNAL_{s.name.upper()} = {s.number}," for s in signals]
    return "\n".join([*lines, f"    SIGNALS = {signals[-1].number + 1}", "};", "#endif", ""])


def c_source(signals: list[Signal]) -> str:
    lines = [C_HEAD, "#include <stddef.h>", "", '#include "drive/servo_loop.h"', ""]
    for s in signals:
        place = f"(({BASES[s.base]} *)0)->{s.member}"
        lines.append(f'_Static_assert(sizeof {place} == sizeof({KINDS[s.kind]}), "{s.name}: kind");')
    lines += ["", "const struct scope_signal scope_signals[SIGNALS] = {"]
    for s in signals:
        place = f"offsetof({BASES[s.base]}, {s.member})"
        values = f"SCOPE_{s.kind.upper()}, SCOPE_{s.base.upper()}, {s.axis}, {place}, {s.scale}"
        lines.append(f"    [SIGNAL_{s.name.upper()}] = {{{values}}},")
    return "\n".join([*lines, "};", ""])


def docs(signals: list[Signal]) -> str:
    lines = [
        "# Signals of the scope",
        "",
        "Generated from `firmware/scope/signals.toml` by `tools/generate_signals.py`: do not edit.",
        "",
        "What the scope records ([scope.md](scope.md)): names for `kontur scope`, numbers for object 2301h. A sample "
        "on the wire is an i32; one count is *count* units. Numbers in brackets are equations of the paper "
        "([control-law.md](control-law.md)).",
        "",
        "| number | name | unit | count | |",
        "|---|---|---|---|---|",
    ]
    lines += [f"| {s.number} | {s.name} | {s.unit} | {float(s.factor):g} | {s.description} |" for s in signals]
    return "\n".join([*lines, ""])


def table(signals: list[Signal]) -> str:
    """What the host knows of each signal, in the order of their numbers."""
    lines = [
        json.dumps(
            {
                "number": s.number,
                "name": s.name,
                "unit": s.unit,
                "factor": float(s.factor),
                "description": s.description,
            }
        )
        for s in signals
    ]
    return "[\n" + ",\n".join(lines) + "\n]\n"


def main() -> int:
    parser = argparse.ArgumentParser(description="make C table, page and host's table from signals.toml")
    parser.add_argument("outdir", type=Path, help="folder for signal_gen.h and signal_gen.c")
    parser.add_argument("--docs", type=Path)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    try:
        signals = load(ROOT / "firmware/scope/signals.toml")
    except (SignalsError, KeyError, TypeError, ValueError) as error:
        print(f"signals.toml: {error}", file=sys.stderr)
        return 1
    args.outdir.mkdir(parents=True, exist_ok=True)
    outputs = {args.outdir / "signal_gen.h": c_header(signals), args.outdir / "signal_gen.c": c_source(signals)}
    if args.docs:
        outputs[args.docs] = docs(signals)
    if args.json:
        outputs[args.json] = table(signals)
    for path, text in outputs.items():
        path.write_text(text, "utf-8", newline="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
