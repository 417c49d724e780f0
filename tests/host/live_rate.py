# SPDX-License-Identifier: Apache-2.0
"""How many pictures a second a live page draws, and what memory it takes: `python tests/host/live_rate.py [SECONDS]`.

A circle runs at 1 kHz of telemetry beside the page in a headless Chromium. After SECONDS (20) it is stopped. No test,
since the rate hangs on what else the machine does.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from browsers import Tab

_FIRST_S = 5.0  # not counted


def main(seconds: float) -> None:
    """Print a line for each tenth of the time, and the figures of the whole."""
    laps = max(1, round(seconds / 3.0)) + 5  # of 3.1 s
    words = ["live", "--wait", "run", "circle", "--radius", "20", "--feed", "40", "--laps", str(laps)]
    with tempfile.TemporaryDirectory() as folder:
        command = subprocess.Popen(
            [sys.executable, "-m", "kontur.cli", *words], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
        )
        assert command.stderr is not None
        address = next(line for line in command.stderr if line.startswith("Live page: ")).split()[-1]
        with Tab(Path(folder)) as tab:
            tab.open(address)
            tab.wait(f"window.kontur && kontur.last.time_s > {_FIRST_S}")
            begin = _now(tab, command.pid)
            for _ in range(10):
                time.sleep(0.1 * seconds)
                now = _now(tab, command.pid)
                print(f"{now['at_s'] - begin['at_s']:6.0f} s: {_rate(begin, now):5.1f} pictures/s, page "
                      f"{now['heap'] / 1e6:.1f} MB, command {now['rss'] / 1e6:.0f} MB", flush=True)  # fmt: skip
            tab.value("document.getElementById('stop').click()")
            tab.wait("kontur.ended")
        command.communicate()
    rows = now["count"] - begin["count"]
    drawing_ms = (now["total_ms"] - begin["total_ms"]) / (now["pictures"] - begin["pictures"])
    share = {
        who: (now[f"{who}_s"] - begin[f"{who}_s"]) / (now["at_s"] - begin["at_s"]) for who in ("browser", "command")
    }
    cpu_ms = 1e3 * (now["browser_s"] - begin["browser_s"]) / (now["pictures"] - begin["pictures"])
    print(f"{rows} rows in {now['at_s'] - begin['at_s']:.1f} s, {now['missed']} missed")
    print(f"Of a processor the browser takes {share['browser']:.0%}, the command {share['command']:.0%}")
    print(f"{_rate(begin, now):.1f} pictures/s; one takes {cpu_ms:.1f} ms of a processor; the page's script "
          f"takes {drawing_ms:.2f} ms, {now['least_ms']:.2f} at best")  # fmt: skip


def _now(tab: Tab, pid: int) -> dict[str, Any]:
    tab.call("HeapProfiler.collectGarbage")
    found: dict[str, Any] = tab.value(
        "({at_s: performance.now() / 1000, pictures: kontur.pictures, total_ms: kontur.drawn_ms, "
        "least_ms: kontur.drawing_ms, count: kontur.count, missed: kontur.missed, "
        "heap: performance.memory.usedJSHeapSize})"
    )
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return found | {"rss": pages * 4096, "command_s": _cpu_s({pid}), "browser_s": _cpu_s(_with_children(tab.pid))}


def _with_children(pid: int) -> set[int]:
    found = {pid}
    parents = {}
    for file in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parents[int(file.parent.name)] = int(file.read_text().rpartition(")")[2].split()[1])
    while new := {child for child, parent in parents.items() if parent in found} - found:
        found |= new
    return found


def _cpu_s(pids: set[int]) -> float:
    ticks = 0
    for pid in pids:
        with suppress(OSError):
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def _rate(begin: dict[str, Any], now: dict[str, Any]) -> float:
    return float((now["pictures"] - begin["pictures"]) / (now["at_s"] - begin["at_s"]))


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 20.0)
