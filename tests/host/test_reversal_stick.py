# SPDX-License-Identifier: Apache-2.0
"""Slow reversals of axes that stick and slip, since their friction falls steeply with the speed."""

from __future__ import annotations

from dataclasses import replace

import pytest
import test_reversal
from test_reversal import presliding_of

from kontur.commissioning.fit import Value
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


def test_axis_slips_with_its_friction_at_rest_however_uncertain_the_falling_friction_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What its runs show before they slip fits a friction that is half as much again, with a shorter presliding."""
    machine, known = draw(2010), test_reversal.known

    def uncertain(*of):  # type: ignore[no-untyped-def]
        dynamics, friction = known(*of)
        return dynamics, replace(friction, breakaway=Value(1.62, 0.7), stribeck_mps=Value(1.245e-3, 7e-4))

    monkeypatch.setattr(test_reversal, "known", uncertain)
    axis, found = presliding_of(machine)
    assert found is not None
    assert found.rest_N.value == pytest.approx(axis.coulomb_N * axis.breakaway, rel=0.05)
    assert found.distance_m.value == pytest.approx(axis.presliding_m, rel=0.15)
