# SPDX-License-Identifier: Apache-2.0
"""How the search puts poles into the parameters of the contouring law."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from kontur.design import laws, search
from kontur.machine import MACHINES, load

BALL_SCREW = load(MACHINES / "ball_screw.toml")


@pytest.mark.parametrize("share", [0.1, 0.25, 0.8])
def test_the_law_has_the_poles_that_are_searched_for(share: float) -> None:
    """(s + lambda) (s + K) + B, but for beta gamma, which (10) adds to lambda; B is 0 where real poles do."""
    gains = laws._smc((300.0, share))
    slope, k, b = gains["smc.lambda"], gains["smc.k_0"], gains["smc.stiffness"]
    assert (slope + k, slope * k + b) == pytest.approx((300.0, share * 300.0**2))
    assert (b > 0.0) == (share > 0.25)
    assert gains["smc.k_max"] == gains["smc.zeta"] == k


@pytest.mark.parametrize("controller", list(laws.LAWS))
def test_whatever_is_searched_for_is_within_what_the_drive_takes(controller: str) -> None:
    problem = search.Problem(BALL_SCREW, controller, "full", 2.0, 2.0)
    for corner in itertools.product(*problem.bounds[: -len(search._FILTER)]):
        gains = problem.gains(np.array(corner))
        assert [problem.objects.on_wire(name, value) for name, value in gains.items()]
