#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How well `kontur identify` finds simulated machines, whose drives know lengths and limits only.

    .venv/bin/python tools/identified.py ball_screw long_axis 910 911 -o rows.json

Names are machines of the package, numbers are seeds of `kontur.experiments.machines.draw`. Prints a row for each
figure of each axis: what was found, its error, and whether the truth is inside its stated uncertainty; then a summary.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from typing import Any

from kontur.commissioning import machine_file
from kontur.commissioning.first_moves import Agreed
from kontur.commissioning.session import identify_axes
from kontur.drive.target import Target, open_drive
from kontur.errors import KonturError
from kontur.experiments.machines import draw
from kontur.machine import LENGTHS, MACHINES, Axis, Machine, load

LIMITS = {
    "mass_kg": 0.05,
    "resonance_Hz": 0.05,
    "viscous_Nspm": 0.15,
    "coulomb_N": 0.15,
}
"""Largest relative errors; of lag and delay together 0.1 ms. The others have none."""
LAG_LIMIT_S = 1e-4


def truth(axis: Axis, delay_periods: int) -> dict[str, float]:
    """What each figure of `kontur identify --json` should be."""
    return {
        "mass_kg": axis.mass_kg,
        "viscous_Nspm": axis.viscous_Nspm,
        "coulomb_N": axis.coulomb_N,
        "breakaway": axis.breakaway,
        "stribeck_mps": axis.stribeck_mps,
        "lag_delay_s": axis.current_lag_s + delay_periods * 1e-4,
        "resonance_Hz": axis.resonance_Hz,
        "resonance_damping": axis.resonance_damping,
        "motor_share": axis.motor_share,
        "presliding_m": axis.presliding_m,
        "cogging_N": axis.cogging_N,
        "ripple": axis.ripple,
        "backlash_m": axis.backlash_m,
        "lead_error": axis.lead_error,
        "lead_once_m": axis.lead_once_m,
        "friction_share": axis.friction_share,
    }


def rows(machine: Machine) -> list[dict[str, Any]]:
    """A row a figure, of both axes."""
    began_s = time.process_time()
    with open_drive(Target(machine=machine, told=LENGTHS)) as device:
        device_axes = {name: getattr(machine, name) for name in "xy"}
        agreed = {name: Agreed(0.5 * axis.force_limit_N) for name, axis in device_axes.items()}
        ratings = {f"plant_{name}.force_limit": axis.force_limit_N for name, axis in device_axes.items()}
        ratings |= machine_file.scales(machine)
        found = identify_axes(device, agreed, ratings, lambda text: None, lambda: False)
    made = []
    for name, one in found.items():
        said = machine_file.as_json(one)
        for key, true in truth(device_axes[name], machine.delay_periods).items():
            value = said.get(key)
            row: dict[str, Any] = {
                "machine": machine.name,
                "axis": name,
                "key": key,
                "true": true,
                "drive_s": one.drive_s,
            }
            if isinstance(value, dict):
                error = value["value"] - true
                row |= value | {"error": error, "relative": error / true if true else None}
                row["inside"] = bool(abs(error) <= value["uncertainty"])
                limit = LAG_LIMIT_S if key == "lag_delay_s" else LIMITS[key] * true if key in LIMITS else None
                row["within"] = None if limit is None else bool(abs(error) <= limit)
            made.append(row)
    drive_s = sum(one.drive_s for one in found.values())
    print(f"{machine.name}: {time.process_time() - began_s:.0f} s of CPU, {drive_s:.0f} s of the drive", flush=True)
    return made


def show(made: list[dict[str, Any]]) -> None:
    for row in made:
        where = f"{row['machine']:22.22} {row['axis']} {row['key']:18} true {row['true']:10.4g}"
        if "value" not in row:
            print(f"{where}  not seen")
            continue
        share = "" if row["relative"] is None else f"{100.0 * row['relative']:+8.2f} %"
        marks = ("" if row["inside"] else "  OUTSIDE") + ("  BEYOND" if row["within"] is False else "")
        print(f"{where}  found {row['value']:10.4g} +- {row['uncertainty']:9.3g}  {share}{marks}")


def summary(made: list[dict[str, Any]]) -> None:
    for key in dict.fromkeys(row["key"] for row in made):
        of = [row for row in made if row["key"] == key]
        seen = [row for row in of if "value" in row]
        limited = [row for row in seen if row["within"] is not None]
        inside = sum(row["inside"] for row in seen)
        text = f"{key:18} seen {len(seen):3} of {len(of):3}, inside {inside:3}"
        if limited:
            text += f", within the limit {sum(row['within'] for row in limited):3}"
        print(text)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("machine", nargs="+", help="name of a machine of the package, or seed")
    parser.add_argument("-o", "--out", help="write all rows here, as JSON")
    asked = parser.parse_args()
    made: list[dict[str, Any]] = []
    for one in asked.machine:
        machine = draw(int(one)) if one.isdigit() else load(MACHINES / f"{one}.toml")
        try:
            found = rows(machine)
        except KonturError as error:
            print(f"{machine.name}: {error}", flush=True)
            continue
        show(found)
        sys.stdout.flush()
        made += found
        if asked.out:
            with open(asked.out, "w") as file:
                json.dump(made, file, indent=1)
    summary(made)


if __name__ == "__main__":
    main()
