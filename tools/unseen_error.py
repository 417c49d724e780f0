#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How much of the true errors of `kontur experiment machines --json` no law sees, and what ratio_law that leaves.

    tools/unseen_error.py MACHINES.json

Each machine of the file drives each path again, with the file's designs of the cascade and of ccu with all
compensations. The table has means along the path, in µm, from telemetry once a millisecond:

- true: distance of the tool to the path.
- seen: the same as the drive's encoders and compensations have it. A better law makes it smaller.
- unseen: of their difference. It would be left if the encoders followed the path exactly while the rest of the machine
  moved as it did.
- at most: the ratio_law that this would be, with the lesser unseen error of both laws.

It is an estimate, not a proof: what the table does behind the encoder depends on how a law moves the motor. A law that
knew of that could leave less.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from linear_bound import LAWS, read

from kontur.drive.target import Target
from kontur.errors import DeviceError
from kontur.experiments import machines
from kontur.experiments.machines import Case
from kontur.machine import FULL, NOTHING, Machine
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.runs.log import RunLog
from kontur.runs.runner import RunOptions, run

HEAD = "| machine | path | " + " | ".join(f"{law}: true, seen, unseen" for law in LAWS) + " | ratio | at most |"


def split(log: RunLog, from_s: float = 0.0) -> tuple[float, float, float]:
    """Mean sizes of the true contour error, of what is seen of it, and of their difference, µm, from a path time on."""
    time_s, true_um, seen_um = (log.columns[name] for name in ("time_s", "true_contour_error_um", "contour_error_um"))
    rows = (time_s >= from_s) & np.isfinite(true_um) & np.isfinite(seen_um)
    true, seen, unseen = (float(np.mean(np.abs(one[rows]))) for one in (true_um, seen_um, true_um - seen_um))
    return true, seen, unseen


def driven(machine: Machine, case: Case, law: str, gains: Mapping[str, float]) -> tuple[float, float, float] | None:
    """split() of a path; None: the drive stopped."""
    options = RunOptions(parameters={**machine.parameters(compensation=FULL), **gains})
    try:
        log = run(plan(case.program, limits(machine)), law, Target(machine=machine, seed=1, told=NOTHING), options).log
    except DeviceError:
        return None
    return split(log, case.score_from_s)


def rows(machine: Machine, designs: Mapping[str, Mapping[str, float]]) -> Iterator[str]:
    """A line of the table for each path."""
    for name, case in machines.cases().items():
        found = [driven(machine, case, law, designs[law]) for law in LAWS]
        cells = ["stopped" if one is None else ", ".join(f"{um:.3g}" for um in one) for one in found]
        ccu, cascade = found
        if ccu is not None and cascade is not None:
            cells += [f"{cascade[0] / ccu[0]:.2f}", f"{cascade[0] / min(ccu[2], cascade[2]):.2f}"]
        else:
            cells += ["", ""]
        yield f"| {machine.name} | {name} | " + " | ".join(cells) + " |"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="what `kontur experiment machines --json` wrote")
    given = parser.parse_args(arguments)
    try:
        work = read(given.file)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    print(HEAD + "\n|---|---|" + "---|" * (len(LAWS) + 2))
    for machine, designs in work:
        for row in rows(machine, designs):
            print(row, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
