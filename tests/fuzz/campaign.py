# SPDX-License-Identifier: Apache-2.0
"""Fuzz until RUNS executions have been made, one fuzzer after the other, and log what was done.

The campaign has rounds of a fiftieth of RUNS each. In a round every fuzzer gets its share twice: with
UndefinedBehaviorSanitizer alone, and with AddressSanitizer as well. A round has one seed, SEED plus its number. Each
run of a fuzzer is a line of build/fuzz/campaign.jsonl. When the campaign is started again, it continues after the last
line, with the programs as they are built then. A finding ends it.

Usage: campaign.py RUNS SEED [SECONDS]   fuzz, for about SECONDS at most
       campaign.py --short SECONDS SEED  fuzz for SECONDS with each fuzzer, with AddressSanitizer, without the log
       campaign.py --write FILE          write the table of the log between the two marks of a Markdown file
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import corpus

BUILD = Path("build/fuzz")  # the programs are in build/fuzz-asan and build/fuzz-ub
LOG = BUILD / "campaign.jsonl"
MARKS = ("<!-- fuzz campaign: begin -->", "<!-- fuzz campaign: end -->")
ROUNDS = 50
FUZZERS = {"can": 0.05, "sdo": 0.2, "slcan": 0.65, "store": 0.1}  # parts of the executions
SANITIZERS = {"ub": 0.9, "asan": 0.1}  # their parts of the executions
GCODE_SECONDS = 4.0  # a round


def lines() -> list[dict[str, Any]]:
    """Lines of the log."""
    return [json.loads(line) for line in LOG.read_text().splitlines()] if LOG.exists() else []


def note(**line: Any) -> None:
    """Add a line to the log, with the time and the commit."""
    commit = subprocess.run(["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=True)
    head = {"date": datetime.now(timezone.utc).isoformat(timespec="seconds"), "commit": commit.stdout.strip()}
    with LOG.open("a") as log:
        log.write(json.dumps(head | line) + "\n")


def fuzz(name: str, sanitizers: str, limit: str, seed: int) -> dict[str, Any]:
    """Run a C fuzzer once, up to a limit in libFuzzer's words; SystemExit on a finding."""
    found, seeds = BUILD / "corpus" / name, BUILD / "seeds" / name
    found.mkdir(parents=True, exist_ok=True)
    corpus.unpack(name, seeds)
    command = [f"{BUILD}-{sanitizers}/{name}", limit, f"-seed={seed}", "-max_len=160", "-len_control=0"]
    command += ["-entropic=0", "-detect_leaks=0", "-print_final_stats=1", f"-artifact_prefix={BUILD}/{name}-"]
    command += [str(found), str(seeds)]
    begin = time.monotonic()
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    seconds = time.monotonic() - begin
    if run.returncode != 0:
        print(run.stderr[-4000:])
        sys.exit(f"campaign.py: {name}: a finding; run it again: {command[0]} {BUILD}/{name}-crash-...")
    done = [int(n) for n in re.findall(r"number_of_executed_units: (\d+)", run.stderr)]
    edges = [int(n) for n in re.findall(r"DONE +cov: (\d+)", run.stderr)]
    result = {"executions": done[-1], "edges": edges[-1], "seconds": round(seconds, 1)}
    return {"fuzzer": name, "sanitizers": sanitizers, "seed": seed, **result}


def fuzz_gcode(seed: int) -> None:
    """Run the fuzzer in Python once; SystemExit on a finding."""
    command = [sys.executable, "tests/fuzz/gcode.py", str(GCODE_SECONDS), str(1000 * seed)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    if run.returncode != 0:
        sys.exit(run.stdout + run.stderr)
    executions = int(run.stdout.split()[1])
    note(fuzzer="gcode", sanitizers="", seed=1000 * seed, executions=executions, edges=0, seconds=GCODE_SECONDS)


def campaign(runs: int, seed: int, seconds: float) -> None:
    """Run rounds until `runs` executions are reached or the time is over."""
    end = time.monotonic() + seconds
    number = 1 + max((line["round"] for line in lines() if "round" in line), default=-1)
    while (total := sum(line["executions"] for line in lines() if "executions" in line)) < runs:
        print(f"round {number}: {total} executions so far", flush=True)
        for name, part in FUZZERS.items():
            for sanitizers, share in SANITIZERS.items():
                note(**fuzz(name, sanitizers, f"-runs={round(runs / ROUNDS * part * share)}", seed + number))
                if time.monotonic() > end:
                    return
        fuzz_gcode(seed + number)
        note(round=number)
        number += 1


def short(seconds: int, seed: int) -> None:
    """Run each fuzzer for some seconds, and print what each has done."""
    for name in FUZZERS:
        done = fuzz(name, "asan", f"-max_total_time={seconds}", seed)
        rate = done["executions"] / done["seconds"]
        print(f"{name:6} {done['executions']:10} executions {rate:8.0f} a second, no finding", flush=True)
    command = [sys.executable, "tests/fuzz/gcode.py", str(seconds), str(seed)]
    sys.exit(subprocess.run(command, check=False).returncode)


def table() -> str:
    """The log as a Markdown table, after a line that says which runs it sums up."""
    done = [line for line in lines() if "executions" in line]
    rows = ["| Fuzzer | Executions | of these with ASan | a second | Edges reached |", "|---|---|---|---|---|"]
    for name in [*FUZZERS, "gcode"]:
        own = [line for line in done if line["fuzzer"] == name]
        count = sum(line["executions"] for line in own)
        with_asan = sum(line["executions"] for line in own if line["sanitizers"] == "asan")
        rate = count / max(1e-9, sum(line["seconds"] for line in own))
        edges = max((line["edges"] for line in own), default=0)
        rows.append(f"| `{name}` | {count:,} | {with_asan:,} | {rate:,.0f} | {edges or '-'} |")
    seeds = sorted({line["seed"] for line in done if line["fuzzer"] != "gcode"})
    commits = list(dict.fromkeys(line["commit"] for line in done))
    total = sum(line["executions"] for line in done)
    summary = (
        f"{total:,} executions from {done[0]['date'][:16]} to {done[-1]['date'][:16]} UTC, seeds {seeds[0]} to"
        f" {seeds[-1]}, commits {', '.join(commits)}:"
    )
    return "\n".join([summary, "", *rows])


def write(path: Path) -> None:
    """Replace the table in a Markdown file."""
    before, rest = path.read_text().split(MARKS[0])
    path.write_text(f"{before}{MARKS[0]}\n{table()}\n{MARKS[1]}{rest.split(MARKS[1])[1]}")


if __name__ == "__main__":
    if sys.argv[1] == "--write":
        write(Path(sys.argv[2]))
    elif sys.argv[1] == "--short":
        short(int(sys.argv[2]), int(sys.argv[3]))
    else:
        campaign(int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]) if len(sys.argv) > 3 else float("inf"))
