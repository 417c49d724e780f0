#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Holds the branch coverage that gcovr has found: table, and what is wrong with it.

    check_coverage.py COVERAGE_JSON UNCOVERED_TOML [--source ROOT]

Every branch of the folders in `HELD` is taken by a test, or listed in uncovered.toml with the reason; what is listed
there is not taken. Entries name the source text, so that they stay right when lines move. Exit code 1 and a message
for each finding.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOMS = ("core", "od", "canopen", "motion", "supervision", "scope", "drive", "onchip")
HELD = (*(f"firmware/{room}" for room in ROOMS), "firmware")  # "firmware": device.c
LEAST = dict.fromkeys((*HELD[:-1], "firmware/port", "firmware"), 0.95)  # of the branches of each folder


@dataclass(frozen=True, order=True)
class Place:
    """Where a branch is: file and function, and the text of its line."""

    file: str
    function: str
    source: str

    def toml(self, missed: int, reason: str = "") -> str:
        """The entry of uncovered.toml."""
        source = f"'{self.source}'" if "'" not in self.source else json.dumps(self.source)
        return (
            f'[[branch]]\nfile = "{self.file}"\nfunction = "{self.function}"\nsource = {source}\n'
            f'missed = {missed}\nreason = "{reason}"'
        )


@dataclass
class Coverage:
    """Branches of each file, those that were taken, and how many were not at which place."""

    branches: Counter[str]
    taken: Counter[str]
    missed: Counter[Place]
    lines: dict[Place, list[int]]


def read_coverage(path: Path, root: Path) -> Coverage:
    """What gcovr's JSON (its manual, "JSON Output") says of the files below `root`."""
    found = Coverage(Counter(), Counter(), Counter(), {})
    for file in json.loads(path.read_text())["files"]:
        name = file["file"]
        text = (root / name).read_text().splitlines()
        for line in file["lines"]:
            taken = [branch["count"] > 0 for branch in line.get("branches", [])]
            found.branches[name] += len(taken)
            found.taken[name] += sum(taken)
            if not all(taken):
                place = Place(name, line.get("function_name", ""), text[line["line_number"] - 1].strip())
                found.missed[place] += taken.count(False)
                found.lines.setdefault(place, []).append(line["line_number"])
    return found


def read_listed(path: Path) -> Counter[Place]:
    """How many branches uncovered.toml lists at which place; an entry without a reason is a KeyError or ValueError."""
    listed: Counter[Place] = Counter()
    for entry in tomllib.loads(path.read_text()).get("branch", []):
        place = Place(entry["file"], entry["function"], entry["source"])
        if not entry["reason"].strip():
            raise ValueError(f"{place.file}: {place.source}: no reason")
        listed[place] += entry["missed"]
    return listed


def folder_of(file: str) -> str:
    """The folder of `LEAST` that a file counts for; for others its own."""
    return next((folder for folder in LEAST if file.startswith(folder + "/")), str(Path(file).parent))


def findings(found: Coverage, listed: Mapping[Place, int]) -> list[str]:
    """What is wrong, a message each."""
    held = {place: count for place, count in found.missed.items() if folder_of(place.file) in HELD}
    wrong = []
    for place in sorted(set(held) | set(listed)):
        missed, known = held.get(place, 0), listed.get(place, 0)
        where = f"{place.file}:{','.join(map(str, found.lines.get(place, ['?'])))}"
        if missed > known:
            wrong.append(
                f"{where}: branches that no test takes: {missed}, listed: {known}. Write a test that takes them "
                f"(build/coverage/html shows which), or list them with the reason:\n{place.toml(missed)}"
            )
        elif missed < known:
            wrong.append(
                f"{place.file}: branches listed as not taken: {known}, found: {missed}. They are taken now, or "
                f"the line has changed. Correct the entry:\n{place.toml(known)}"
            )
    for folder, least in LEAST.items():
        branches, taken = totals(found, folder)
        if taken < least * branches:
            wrong.append(f"{folder}: {taken} of {branches} branches taken, at least {least:.0%} must be")
    return wrong


def totals(found: Coverage, folder: str) -> tuple[int, int]:
    """Branches of a folder, and how many of them were taken."""
    files = [file for file in found.branches if folder_of(file) == folder]
    return sum(found.branches[file] for file in files), sum(found.taken[file] for file in files)


def table(found: Coverage, listed: Mapping[Place, int]) -> str:
    """For people: each file that has branches, each folder."""
    rows = [f"{'':34}{'branches':>9}{'taken':>7}{'listed':>7}{'%':>7}"]
    for folder in sorted({folder_of(file) for file in found.branches}):
        files = [file for file in sorted(found.branches) if folder_of(file) == folder and found.branches[file]]
        for name, members in [*((f"  {file.removeprefix(folder + '/')}", [file]) for file in files), (folder, files)]:
            branches, taken = sum(found.branches[f] for f in members), sum(found.taken[f] for f in members)
            known = sum(count for place, count in listed.items() if place.file in members)
            rows.append(f"{name:34}{branches:9}{taken:7}{known or '':>7}{100 * taken / max(branches, 1):7.1f}")
    return "\n".join(rows)


def main() -> int:
    """The command line above."""
    parser = argparse.ArgumentParser(description="Holds the branch coverage that gcovr has found.")
    parser.add_argument("coverage", type=Path)
    parser.add_argument("uncovered", type=Path)
    parser.add_argument("--source", type=Path, default=Path())
    args = parser.parse_args()
    found = read_coverage(args.coverage, args.source)
    try:
        listed = read_listed(args.uncovered)
    except (KeyError, ValueError) as error:  # a TOML error is a ValueError
        print(f"{args.uncovered}: {error}; each [[branch]] has file, function, source, missed and reason")
        return 1
    print(table(found, listed))
    wrong = findings(found, listed)
    print(*wrong, sep="\n\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
