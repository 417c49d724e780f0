#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How good a commissioning is on simulated machines, whose drives know lengths and limits only.

    .venv/bin/python tools/commissioned.py ball_screw 910 911 --out DIR

Names are machines of the package, numbers are seeds of `kontur.experiments.machines.draw`. Each machine is commissioned
by the command that a user gives (`kontur commission --untold --yes --json`). Then `ccu` drives the four paths of
`kontur experiment machines`: with what was found, and with the design that was told the truth. Errors that no sensor of
the machine sees are left out of both. DIR keeps a file a machine; what is there already is not done again. The table
says of each machine how it ended, which figures are beyond their limit or outside their uncertainty, the greatest
measured Ms, times of drive and computing, and the mean error found and told, and their ratio.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from identified import LAG_LIMIT_S, LIMITS, truth

from kontur.commissioning import machine_file
from kontur.design.search import design
from kontur.drive import parameter_file
from kontur.drive.target import Target
from kontur.errors import DeviceError
from kontur.experiments import machines
from kontur.machine import LENGTHS, MACHINES, NOTHING, Axis, Machine, load
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.runs import summary
from kontur.runs.runner import RunOptions, run

HEAD = "| machine | ended | beyond | outside | Ms | drive s | computing s | found µm | told µm | ratio |"
_UNSEEN = {"lead_error": 0.0, "lead_once_m": 0.0, "encoder_once_m": 0.0}


def seen(machine: Machine) -> Machine:
    """The machine without the errors that none of its sensors sees."""

    def axis(one: Axis) -> Axis:
        sensed = one.scale_m > 0.0 or one.encoder_at == "table"
        return replace(one, squareness_rad=0.0, **({} if sensed else _UNSEEN))

    return replace(machine, x=axis(machine.x), y=axis(machine.y))


def errors(machine: Machine, values: dict[str, float]) -> dict[str, float | None]:
    """Mean true error of ccu on each path, µm; None: the drive stopped."""
    found: dict[str, float | None] = {}
    for name, case in machines.cases().items():
        options = RunOptions(parameters=values, score_from_s=case.score_from_s)
        try:
            target = Target(machine=machine, seed=1, told=NOTHING)
            log = run(plan(case.program, limits(machine)), "ccu", target, options).log
        except DeviceError:
            found[name] = None
        else:
            found[name] = summary.summarise(log).mean_um
    return found


def judged(machine: Machine, said: dict[str, Any]) -> tuple[list[str], list[str], int]:
    """Figures beyond the limits of the issue's kind, those outside their uncertainty, and how many were found."""
    beyond, outside, count = [], [], 0
    for name in "xy":
        for key, true in truth(getattr(machine, name), machine.delay_periods).items():
            value = said[name].get(key)
            if not isinstance(value, dict):
                if key in LIMITS or key == "lag_delay_s":
                    beyond.append(f"{name} {key} not seen")
                continue
            error = abs(value["value"] - true)
            count += 1
            limit = LAG_LIMIT_S if key == "lag_delay_s" else LIMITS[key] * true if key in LIMITS else None
            text = f"{name} {key} {value['value']:.4g} for {true:.4g}"
            if limit is not None and error > limit:
                beyond.append(text)
            if error > value["uncertainty"]:
                outside.append(f"{text} ± {value['uncertainty']:.2g}")
    return beyond, outside, count


def commissioned(name: str, out: Path) -> dict[str, Any]:
    """The row of a machine."""
    machine = machines.draw(int(name)) if name.isdigit() else load(MACHINES / f"{name}.toml")
    file, folder = out / f"{name}.toml", out / name
    file.write_bytes(machine_file.text(machine).encode())
    kontur = str(Path(sys.executable).with_name("kontur"))
    words = [kontur, "commission", "--machine", str(file), "--untold", "--yes", "--json", "--out", str(folder)]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    row: dict[str, Any] = {"name": name, "rc": ended.returncode, "said": ended.stderr[-2000:]}
    if ended.returncode:
        return row
    result = json.loads(ended.stdout)
    row["saved"] = result["saved"]
    row["beyond"], row["outside"], row["figures"] = judged(machine, result["axes"])
    row["ms"] = max(one["ms_measured"] for one in result["proof"] if one["controller"] == "ccu")
    row |= {name: result["time"][name] for name in ("drive_s", "computing_s")}
    known = seen(machine)
    found = known.parameters(told=LENGTHS) | parameter_file.read(folder / "params-ccu.toml")
    told = replace(known, gains={}).parameters() | design(known, "ccu").parameters
    row["found_um"], row["told_um"] = errors(known, found), errors(known, told)
    return row


def line(row: dict[str, Any]) -> str:
    """The row in the table."""
    if row["rc"]:
        words = row["said"].strip().splitlines()
        return f"| {row['name']} | rc {row['rc']}: {words[-1] if words else ''} |" + " |" * 8
    pairs = [(row["found_um"][one], row["told_um"][one]) for one in row["found_um"]]
    cells = [row["name"], "stored" if row["saved"] else "not stored", "; ".join(row["beyond"])]
    cells += ["; ".join(row["outside"]), f"{row['ms']:.2f}", f"{row['drive_s']:.0f}", f"{row['computing_s']:.0f}"]
    if any(None in pair for pair in pairs):
        cells += ["stopped" if any(pair[at] is None for pair in pairs) else "" for at in (0, 1)] + [""]
    else:
        means = [float(np.mean([pair[at] for pair in pairs])) for at in (0, 1)]
        cells += [f"{one:.3f}" for one in means] + [f"{means[0] / means[1]:.2f}"]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("machine", nargs="+", help="name of a machine of the package, or seed")
    parser.add_argument("--out", type=Path, required=True, help="folder for what was found")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    print(HEAD + "\n|" + "---|" * HEAD.count(" |"))
    for name in asked.machine:
        kept = asked.out / f"{name}.json"
        if not kept.exists():
            kept.write_text(json.dumps(commissioned(name, asked.out), indent=1))
        print(line(json.loads(kept.read_text())), flush=True)


if __name__ == "__main__":
    main()
