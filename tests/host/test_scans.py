# SPDX-License-Identifier: Apache-2.0
"""How fast an axis with a scale is scanned along its travel."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from kontur.commissioning import identify
from kontur.commissioning.first_moves import Agreed
from kontur.commissioning.recording import Scan


@pytest.mark.parametrize(
    ("travel_m", "speed_mps", "fastest_mps"), [(0.6, 0.5, 0.2), (0.6, 0.08, 0.08), (0.15, 0.5, 0.1)]
)
def test_scan_of_the_whole_travel_slows_where_it_is_short(
    travel_m: float, speed_mps: float, fastest_mps: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else there are too few periods in it for what goes by the screw."""
    asked: list[float] = []
    none = np.zeros(2)

    def scan(mover: object, velocity_mps: float, longest_s: float, settle_s: float) -> Scan:
        asked.append(velocity_mps)
        return Scan(none, none, none, none)

    monkeypatch.setattr(identify, "scan", scan)
    mover = SimpleNamespace(low_m=0.0, high_m=travel_m, longest_s=lambda *_: 5.0, go=lambda *_: None)
    identify._scans(mover, Agreed(100.0, speed_mps))  # type: ignore[arg-type]
    assert asked == pytest.approx([0.02, -0.02, fastest_mps, -fastest_mps])
