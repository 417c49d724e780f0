# SPDX-License-Identifier: Apache-2.0
"""Memory of a long run: the hour that can be planned stays below 400 MB."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from kontur.planning import knots
from kontur.runs import log, sample

LIMIT_MB = 400.0
# Says at its end what its memory was at most. The parent cannot: its figure counts the memory of before the exec, too.
KONTUR = """
import atexit, sys
from pathlib import Path
from kontur.cli import main
atexit.register(lambda: Path(sys.argv[1]).write_text(Path("/proc/self/status").read_text()))
main(sys.argv[2:])
"""
HOUR = ["run", "circle", "--radius", "20", "--feed", "100", "--laps", "2860"]
PATIENCE_S = 300.0  # on a loaded machine


def test_an_hour_with_log_and_report_stays_below_400_mb(tmp_path: Path) -> None:
    """All of it is planned. The run is stopped when more rows have come than are kept in memory; what follows is
    thinned as those are."""
    running = tmp_path / "a-running.csv"
    status, report = tmp_path / "status", tmp_path / "a.html"
    process = subprocess.Popen(
        [sys.executable, "-c", KONTUR, str(status), *HOUR, "--log", str(tmp_path / "a.csv"), "--report", str(report)],
        stdout=subprocess.DEVNULL,
    )
    end_s = time.monotonic() + PATIENCE_S
    while not running.exists() or running.stat().st_size < 200 * sample.ROWS_MAX:
        assert process.poll() is None
        assert time.monotonic() < end_s, "waited too long"
        time.sleep(0.1)
    process.send_signal(signal.SIGTERM)
    assert process.wait() == 128 + signal.SIGTERM
    assert report.exists()
    with log.opened(tmp_path / "a.csv") as rows:
        assert sum(len(table) for table in rows) > sample.ROWS_MAX
    (peak_kb,) = re.findall(r"VmHWM:\s+(\d+) kB", status.read_text())
    assert int(peak_kb) / 1024.0 < LIMIT_MB


def test_knots_planned_in_parts_are_those_of_the_whole_bit_for_bit(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    position_m = np.cumsum(np.random.default_rng(1).normal(0.0, 1e-4, (20_000, 2)), axis=0)
    whole = knots.control_points(position_m)
    monkeypatch.setattr(knots, "ROWS", 1000)
    np.testing.assert_array_equal(knots.control_points(position_m), whole)
    np.testing.assert_array_equal(knots.to_nm(whole), np.rint(whole * 1e9).astype("<i4"))
