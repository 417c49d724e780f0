# SPDX-License-Identifier: Apache-2.0
"""Slow reversals of axes that stick and slip, since their friction falls steeply with the speed."""

from __future__ import annotations

import pytest
from test_reversal import presliding_of

from kontur.experiments.machines import draw


@pytest.mark.parametrize("seed", [2005, 2008])
def test_axis_that_sticks_and_slips_shows_its_presliding_and_gap(seed: int) -> None:
    axis, found = presliding_of(draw(seed))
    assert found is not None
    for value, true, most in (
        (found.distance_m, axis.presliding_m, 0.2),
        (found.backlash_m, axis.backlash_m, 0.25),
        (found.friction_share, axis.friction_share, 0.15),
        (found.rest_N, axis.coulomb_N * axis.breakaway, 0.06),
    ):
        assert value is not None
        assert abs(value.value - true) <= min(value.uncertainty, most * true)
