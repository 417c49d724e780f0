# SPDX-License-Identifier: Apache-2.0
"""Instructions of a servo tick against what is written down: cost.py [--write] NAME=FILE...

Each FILE is what bench_step.c printed for one target. More than 3 % above tests/target/cost.json is an error: make it
cheaper again, or `make cost` and name the change in CHANGELOG.md. `--write` writes that file and the table in
docs/performance.md.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
BASELINE = ROOT / "tests/target/cost.json"
PAGE = ROOT / "docs/performance.md"
BEGIN, END = "<!-- cost: made by `make cost` -->\n", "<!-- cost: end -->\n"
WORSE = 1.03

Cost = dict[str, dict[str, dict[str, int]]]


def table(cost: Cost) -> str:
    """The page's rows: mean and worst by controller and target."""
    names = list(cost)
    rows = [f"| controller | {' | '.join(f'{n} mean | worst' for n in names)} |", "|---" * (1 + 2 * len(names)) + "|"]
    for controller in next(iter(cost.values())):
        cells = [f"{cost[n][controller]['mean']} | {cost[n][controller]['worst']}" for n in names]
        rows.append(f"| {controller} | {' | '.join(cells)} |")
    return "\n".join(rows) + "\n"


def findings(cost: Cost, before: Cost) -> list[str]:
    """What costs more than is written down."""
    return [
        f"{target}: a tick under {controller} takes {value} instructions ({kind}), {before[target][controller][kind]} "
        "are written down: make it cheaper, or run `make cost` and name the change in CHANGELOG.md"
        for target, controllers in cost.items()
        for controller, values in controllers.items()
        for kind, value in values.items()
        if value > WORSE * before[target][controller][kind]
    ]


def main(arguments: list[str]) -> int:
    write = "--write" in arguments
    cost: Cost = {}
    for argument in arguments:
        if argument != "--write":
            name, file = argument.split("=", 1)
            cost[name] = json.loads(Path(file).read_text())
    if write:
        BASELINE.write_text(json.dumps(cost, indent=2) + "\n")
        page = PAGE.read_text()
        head, rest = page.split(BEGIN)
        PAGE.write_text(head + BEGIN + table(cost) + END + rest.split(END)[1])
        return 0
    found = findings(cost, json.loads(BASELINE.read_text()))
    print("\n".join(found) if found else "cost of the servo tick: not above what is written down")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
