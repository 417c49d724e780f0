#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes the C table of faults, the page, the host's table and that of the tests from firmware/supervision/faults.toml.

    generate_faults.py OUTDIR [--docs PATH] [--json PATH]

writes OUTDIR/fault_gen.h, fault_gen.c and fault_rows.h, and the others where asked. The output depends on faults.toml
alone.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from source import ROOT, SourceError, c_head, load_toml, run

SOURCE = "firmware/supervision/faults.toml"
C_HEAD = c_head(SOURCE, "tools/generate_faults.py")
REACTIONS = {
    "warn": "REACT_WARN",
    "refuse": "REACT_WARN",
    "path stop": "REACT_PATH_STOP",
    "quick stop": "REACT_QUICK_STOP",
    "disable": "REACT_DISABLE",
}
REGISTERS = ("generic", "current", "voltage", "communication", "profile", "manufacturer")
DELAY = "1 ms"  # where `delay` is left out: the step of supervision/fault_monitor
REGISTER = "manufacturer"  # where `register` is left out
LATCHED_CLEARED = "fault reset"  # where `cleared` is left out
WARNING_CLEARED = "when its cause is gone"  # the same, of a warning
MOST = 32  # bits of a word
PERIODS_PER_MS = 10  # at the usual CONTROL_HZ: for tests


class FaultsError(SourceError):
    """faults.toml is not usable; the message says which row and what is wrong."""


@dataclass(frozen=True)
class Fault:
    """A row of faults.toml; see there."""

    name: str
    fault: str
    cause: str
    detection: str
    reaction: str
    emcy: int
    remedy: str
    delay: str = DELAY
    register: str = REGISTER
    option: str = ""
    cleared: str = ""
    capture: bool = False
    node: bool = False

    @property
    def latched(self) -> bool:
        return REACTIONS[self.reaction] != "REACT_WARN"

    @property
    def captured(self) -> bool:
        return self.latched or self.capture

    @property
    def delay_periods(self) -> int:
        """What `delay` says before a semicolon, in control periods, without what objects or the cause add."""
        text = self.delay.split(";")[0]
        counts = [(int(n), unit) for n, unit in re.findall(r"(\d+) (control period|ms)", text)]
        if not counts and "at once" not in text:
            raise FaultsError(f"{self.name}: delay counts control periods or ms, or says at once")
        return sum(n * (1 if unit == "control period" else PERIODS_PER_MS) for n, unit in counts)


def row(name: str, given: dict[str, Any]) -> Fault:
    try:
        f = Fault(name, **given)
    except TypeError as error:
        raise FaultsError(f"{name}: {error}") from error
    if not re.fullmatch(r"[a-z][a-z_]*", name):
        raise FaultsError(f"{name}: a name is lower-case words")
    for key in ("fault", "cause", "detection", "delay", "remedy", "option", "cleared"):
        text = getattr(f, key)
        if not isinstance(text, str) or not text.isascii() or "\n" in text:
            raise FaultsError(f"{name}: {key} is to be a line of ASCII")
    if f.reaction not in REACTIONS or f.register not in REGISTERS:
        raise FaultsError(f"{name}: reaction is one of {', '.join(REACTIONS)}, register of {', '.join(REGISTERS)}")
    if not isinstance(f.emcy, int) or not 0 < f.emcy <= 0xFFFF:
        raise FaultsError(f"{name}: emcy is a code of 16 bits")
    if f.node and f.captured:
        raise FaultsError(f"{name}: what the node raises stops no axis, and triggers no capture")
    _ = f.delay_periods
    return f


def load(path: Path) -> list[Fault]:
    """All rows, in the order written. Raises SourceError."""
    faults = [row(name, given) for name, given in load_toml(path)["fault"].items()]
    codes = [f.emcy for f in faults]
    for f in faults:
        if codes.count(f.emcy) > 1:
            raise FaultsError(f"{f.name}: {f.emcy:04X}h is the code of another row, too")
    if sum(not f.node for f in faults) > MOST:
        raise FaultsError(f"more than {MOST} rows without `node`")
    return faults


def c_header(faults: list[Fault]) -> str:
    lines = [C_HEAD, "#ifndef FAULT_GEN_H", "#define FAULT_GEN_H", "", "enum fault {"]
    lines += [f"    FAULT_{f.name.upper()}, /* {f.fault} */" for f in faults if not f.node]
    captured = [f"FAULT_BIT(FAULT_{f.name.upper()})" for f in faults if f.capture]
    lines += ["    FAULTS", "};", "", "/* The scope keeps what led to these, also where they are only warned of. */"]
    return "\n".join([*lines, f"#define FAULTS_CAPTURED ({' | '.join(captured) or '0u'})", "#endif", ""])


def c_source(faults: list[Fault]) -> str:
    lines = [
        C_HEAD,
        '#include "supervision/fault.h"',
        "",
        '#include "od/od.h"',
        "",
        "const struct fault_row fault_table[FAULTS] = {",
    ]
    for f in faults:
        if not f.node:
            values = f"0x{f.emcy:04X}, CO_REG_{f.register.upper()}, {REACTIONS[f.reaction]}"
            lines.append(f"    [FAULT_{f.name.upper()}] = {{{values}}},")
    return "\n".join([*lines, "};", ""])


def c_rows(faults: list[Fault]) -> str:
    """For tests: what each row promises, those of the node among them. See tests/unit/test_faults.h."""
    lines = [
        C_HEAD,
        "#ifndef FAULT_ROWS_H",
        "#define FAULT_ROWS_H",
        '#include "od/od.h"',
        '#include "supervision/fault.h"',
        "",
    ]
    lines += ["enum row {", *(f"    ROW_{f.name.upper()}," for f in faults), "    ROWS", "};", ""]
    lines += ["static const struct promise {"]
    lines += ["    uint32_t bit; /* FAULT_BIT(), 0: the node's */", "    uint16_t emcy;", "    uint8_t reg;"]
    names = {reaction: f"PROMISED_{reaction.upper().replace(' ', '_')}" for reaction in REACTIONS}
    lines += [f"    enum promised {{ {', '.join(names.values())} }} reaction;"]
    lines += ["    bool latched, captured;", "    unsigned delay; /* control periods */", "} promises[ROWS] = {"]
    for f in faults:
        bit = "0" if f.node else f"FAULT_BIT(FAULT_{f.name.upper()})"
        flags = f"{str(f.latched).lower()}, {str(f.captured).lower()}"
        values = f"{bit}, 0x{f.emcy:04X}, CO_REG_{f.register.upper()}, {names[f.reaction]}, {flags}, {f.delay_periods}"
        lines.append(f"    [ROW_{f.name.upper()}] = {{{values}}},")
    return "\n".join([*lines, "};", "#endif", ""])


def sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def docs(faults: list[Fault]) -> str:
    lines = [
        "# Faults",
        "",
        "Generated from `firmware/supervision/faults.toml` by `tools/generate_faults.py`: do not edit.",
        "",
        "What the drive watches, and what it does about it. Each row has a test that injects its cause on the "
        "simulated drive, of what a port finds out its report, and checks that it is detected within the delay, the "
        "reaction, whether it is latched, what clears it, the capture, EMCY, 603Fh and 1001h "
        "(`tests/unit/test_faults*.c`; `tests/host/test_fault_table.py` finds a row without one). "
        "The reaction comes within two control periods of the "
        "detection; *delay* is how long the detection takes; what it says after a semicolon is not measured there. "
        "The code is the one of the EMCY and, where an axis goes "
        "into fault, of 603Fh, "
        "which keeps the first one of several. A fault is latched until fault reset (controlword bit 7 of each axis) "
        "or NMT *reset node*, and comes back at once while its cause lasts. "
        "Warnings and refusals stop nothing: EMCY, statusword bit 7 of both axes while they last. "
        "*Capture*: the scope in the drive keeps what was before and after it "
        "([scope.md](scope.md)).",
        "",
        "- **disable**: power off now, in the servo tick that sees it.",
        "- **path stop**: both axes stop on their path (`limits.path_stop_time`), then power off.",
        "- **quick stop**: as 605Ah says: 0 power off now, else as a path stop; then power off.",
        "- **warn**, **refuse**: the drive reports it; with refuse it also refuses the command or frame.",
        "",
        "| code | fault | detection | delay | reaction | latched | capture | cleared |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for f in faults:
        reaction = f"{f.reaction}; {f.option}" if f.option else f.reaction
        cleared = f.cleared or (LATCHED_CLEARED if f.latched else WARNING_CLEARED)
        detection = f.detection.replace("|", "\\|")
        flags = ["yes" if flag else "no" for flag in (f.latched, f.captured)]
        cells = [f"{f.emcy:04X}h", f.name, detection, f.delay, reaction, *flags, cleared]
        lines.append("| " + " | ".join(cells) + " |")
    for f in faults:
        lines += ["", f"## {f.emcy:04X}h {f.name}", "", f"{sentence(f.fault)}.", ""]
        lines += [f"- Cause: {f.cause}.", f"- Remedy: {f.remedy}."]
    return "\n".join([*lines, ""])


def table(faults: list[Fault]) -> str:
    """What the host says of a code, by code; `bit` of a FAULT_BIT()."""
    keys = ("name", "fault", "cause", "remedy", "reaction", "captured")
    bits = {f.name: bit for bit, f in enumerate(f for f in faults if not f.node)}
    rows = {f"{f.emcy:04X}": {key: getattr(f, key) for key in keys} | {"bit": bits.get(f.name)} for f in faults}
    return json.dumps(rows, indent=1) + "\n"


def make(args: argparse.Namespace) -> dict[Path, str]:
    """The files that the command line asks for."""
    faults = load(ROOT / SOURCE)
    outputs = {
        args.outdir / "fault_gen.h": c_header(faults),
        args.outdir / "fault_gen.c": c_source(faults),
        args.outdir / "fault_rows.h": c_rows(faults),
    }
    if args.docs:
        outputs[args.docs] = docs(faults)
    if args.json:
        outputs[args.json] = table(faults)
    return outputs


def main() -> int:
    parser = argparse.ArgumentParser(description=f"make C table, page and host's table from {SOURCE}")
    parser.add_argument("outdir", type=Path, help="folder for fault_gen.h, fault_gen.c and fault_rows.h")
    parser.add_argument("--docs", type=Path)
    parser.add_argument("--json", type=Path)
    return run(parser, make)


if __name__ == "__main__":
    sys.exit(main())
