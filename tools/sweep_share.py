# SPDX-License-Identifier: Apache-2.0
"""What share of the cores a sweep of circles uses, and whether one that is killed twice ends with the same table.

`python tools/sweep_share.py` takes some minutes on a machine that does nothing else.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import click

SWEEP = """
path = "circle"
radius = [2, 4]
feed = [50, 100]
seed = {{ first = 1, count = {seeds} }}
"""
LOOK_S = 0.1


def start(folder: Path, name: str) -> subprocess.Popen[bytes]:
    """The sweep of `folder`, into the table `name`."""
    command = [sys.executable, "-m", "kontur.cli", "sweep", str(folder / "sweep.toml"), "-o", str(folder / name)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL)


def rows(file: Path) -> int:
    return file.read_bytes().count(b"\n") - 1 if file.exists() else 0


def kill_at(process: subprocess.Popen[bytes], file: Path, count: int) -> None:
    """Kill `process` when `file` has `count` rows."""
    while rows(file) < count:
        try:
            process.wait(LOOK_S)
        except subprocess.TimeoutExpired:
            continue
        raise click.ClickException(f"the sweep has ended with {rows(file)} rows")
    process.kill()
    process.wait()


@click.command()
@click.option("--runs", type=click.IntRange(12), default=1000, show_default=True, help="Runs, rounded to fours.")
def main(*, runs: int) -> None:
    """Run a sweep of circles without a break, then the same one killed after a third and after two thirds."""
    cores = len(os.sched_getaffinity(0))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "sweep.toml").write_text(SWEEP.format(seeds=runs // 4))
        begun = time.monotonic()
        if start(folder, "whole.csv").wait() != 0:
            raise click.ClickException("the sweep has failed")
        wall_s, used = time.monotonic() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu_s = used.ru_utime + used.ru_stime
        click.echo(f"{rows(folder / 'whole.rows')} runs: {wall_s:.1f} s, {cpu_s:.1f} s of processor, "
                   f"{100.0 * cpu_s / (wall_s * cores):.1f} % of {cores} cores")  # fmt: skip
        for third in (1, 2):
            kill_at(start(folder, "killed.csv"), folder / "killed.rows", third * runs // 3)
        if start(folder, "killed.csv").wait() != 0:
            raise click.ClickException("the sweep does not go on")
        same = (folder / "killed.csv").read_bytes() == (folder / "whole.csv").read_bytes()
        click.echo(f"killed twice: {'the same table' if same else 'ANOTHER TABLE'}")
        sys.exit(not same)


if __name__ == "__main__":
    main()
