# SPDX-License-Identifier: Apache-2.0
"""G-code, built of words and of nonsense: it is refused with a message, or gives a connected program of finite numbers.

By Hypothesis rather than a coverage-guided fuzzer: the parser is pure Python, its grammar is known, and the fuzzer for
Python has no package for all versions that this project runs on. Usage: gcode.py SECONDS SEED
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

from kontur.errors import FileError
from kontur.path import gcode
from kontur.path.geometry import Dwell, Program

CORPUS = Path(__file__).parent / "corpus" / "gcode"
BATCH = 200

_numbers = st.one_of(
    st.decimals(-500, 500, places=3).map(lambda d: f"{d:f}"),
    st.sampled_from(["0", "-0", "1.", ".5", "+3", "1e9", "99999999999999999999", "0.0000001", "--1", ""]),
)
_words = st.one_of(
    st.sampled_from(["G0", "G1", "G2", "G3", "G4", "G17", "G20", "G21", "G61", "G90", "G91", "G90.1", "G91.1", "M2"]),
    st.sampled_from(["M30", "%", "G18", "G41", "#1=2", "[1+2]", "/", "(a)", "(a", ";b"]),
    st.builds(str.__add__, st.sampled_from("XYIJRFPNxyGMZK"), _numbers),
)
_lines = st.one_of(st.lists(_words, max_size=7).map(" ".join), st.text(max_size=20))
_seeds = [path.read_text() for path in sorted(CORPUS.glob("*.ngc"))]
_changed = st.tuples(st.sampled_from(_seeds), st.integers(0, 400), _words).map(
    lambda change: change[0][: change[1]] + change[2] + change[0][change[1] + len(change[2]) :]
)
programs = st.one_of(st.lists(_lines, max_size=8).map("\n".join), _changed)


def check(text: str) -> None:
    """What holds for any text; raises AssertionError, or whatever the parser should not have raised."""
    try:
        program = gcode.parse(text, "p.ngc")
    except FileError as error:
        message = str(error)
    else:
        check_program(program)
        return
    assert message.startswith("p.ngc"), message


def check_program(program: Program) -> None:
    """Connected, and of finite numbers."""
    here = np.array(program.start_m)
    for item in program.items:
        if isinstance(item, Dwell):
            continue
        length = item.segment.length_m
        assert 0 < length < np.inf, item
        assert item.feed_mps > 0, item
        first, last = item.segment.point(np.array([0.0, length]))
        assert np.all(np.isfinite(last)), item
        np.testing.assert_allclose(first, here, atol=1e-9 * max(1.0, float(np.max(np.abs(here)))))
        here = last


def main(seconds: float, first_seed: int) -> None:
    """Run batches, each from its own seed, until the time is over; a failure ends it with Hypothesis' report."""
    begin, count, batch = time.monotonic(), 0, first_seed
    while time.monotonic() < begin + seconds:

        @seed(batch)
        @settings(max_examples=BATCH, database=None, deadline=None, suppress_health_check=list(HealthCheck))
        @given(programs)
        def one(text: str) -> None:
            nonlocal count
            count += 1
            check(text)

        one()
        batch += 1
    spent = time.monotonic() - begin
    print(f"gcode  {count:10d} executions {count / spent:8.0f} a second, no finding")


if __name__ == "__main__":
    main(float(sys.argv[1]), int(sys.argv[2]))
