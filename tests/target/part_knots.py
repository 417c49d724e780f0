# SPDX-License-Identifier: Apache-2.0
"""Writes the knots of a G-code part as a C header, for programs without a host to stream them: FILE.ngc -> stdout."""

from __future__ import annotations

import sys

from kontur import machine
from kontur.path import programs
from kontur.planning.bounds import limits
from kontur.planning.planner import plan

KNOTS = 10_000


def main(file: str) -> None:
    """The first 10 s of the part, which is long enough for 100,000 control periods."""
    knots_nm = plan(programs.load(file), limits(machine.load())).knots_nm[:KNOTS]
    print(f"/* The knots of {file}, nm. Made by part_knots.py. */\n#include <stdint.h>\n")
    print(f"enum {{ PART_KNOTS = {len(knots_nm)} }};\nstatic const int32_t part_knots[PART_KNOTS][2] = {{")
    for x, y in knots_nm:
        print(f"    {{{x}, {y}}},")
    print("};")


if __name__ == "__main__":
    main(sys.argv[1])
