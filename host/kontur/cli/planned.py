# SPDX-License-Identifier: Apache-2.0
"""The planning of a path, shown on a terminal, and the motion as soon as it may start."""

from __future__ import annotations

import ctypes
from contextlib import suppress
from typing import TYPE_CHECKING

from kontur.cli.options import progress_bar

if TYPE_CHECKING:
    from kontur.path.geometry import Program
    from kontur.planning.ahead import Planned
    from kontur.planning.bounds import Limits
    from kontur.planning.checks import Travel

_M_MMAP_THRESHOLD = -3  # malloc.h; mallopt(3)
_SHOWN_S = 0.05  # between two steps of the progress


def planned(
    program: Program, bounds: Limits, travel_m: Travel, tolerance_mm: float | None, whole: bool, passed: int = 0
) -> Planned:
    """The trajectory; unless it is to be `whole`, so much of it that it can be driven, from behind so many `passed`
    knots on, while the rest is planned."""
    from kontur.path.smoothing import TOLERANCE_M, toleranced
    from kontur.planning.ahead import Ahead
    from kontur.planning.planner import Planning

    with suppress(OSError, AttributeError):  # where the C library is glibc
        ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, 1 << 20)  # arrays that are freed go back to the system at once
    program = toleranced(program, None if tolerance_mm is None else tolerance_mm * 1e-3)
    ahead = Ahead(Planning(program, bounds, None, travel_m, TOLERANCE_M), passed)
    with progress_bar("planning") as progress:
        while not ahead.ended(_SHOWN_S):
            progress(ahead.share)
            if not whole and ahead.may_start:
                return ahead
    return ahead.trajectory()
