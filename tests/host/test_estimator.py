# SPDX-License-Identifier: Apache-2.0
"""The drive's estimate of the contour error against the exact foot point, on a reduced grid for both back ends."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from kontur import machine
from kontur.cli import main
from kontur.experiments import estimator
from kontur.experiments.estimator import Cell
from kontur.sim.library import estimate

MACHINE = machine.load()


def measure(num: str, **reduced) -> list[Cell]:
    return estimator.experiment(MACHINE, num, **reduced)[1]


# chk: a lag of a second, as at 1 mm/s, is a quotient beyond the error that it allows; no drive looks back as far.
@pytest.mark.parametrize(("num", "slowest_mps"), [("f32", 0.001), ("fix", 0.001), ("chk", 0.005)])
def test_with_the_newton_step_the_estimate_is_right_to_2_nm_up_to_a_fifth_of_the_radius(
    num: str, slowest_mps: float
) -> None:
    cells = measure(num, speeds_mps=(slowest_mps, 0.02, 0.2), stretches=12)
    tested = [cell for cell in cells if cell.rows and cell.lag_over_radius <= 0.2]
    assert {cell.curve for cell in tested} == {*estimator.curves(), *(f"{name}, planned" for name in estimator.PLANNED)}
    assert max(cell.newton_nm for cell in tested) < 2.0
    assert estimator.worst(cells) == max(cell.newton_nm for cell in tested)


def test_without_it_the_error_on_a_circle_is_that_of_the_papers_formula(monkeypatch: pytest.MonkeyPatch) -> None:
    """(5) takes the chord's projection R sin(phi) for the arc R phi; the foot is off by that difference, R d, and a
    point of a circle that is off by d along it seems to be R (1 - cos d) off the circle."""
    monkeypatch.setattr(estimator, "OFFSETS_M", (0.0,))
    monkeypatch.setattr(estimator, "curves", lambda: {"circle": estimator.Arc((0.0, 0.0), 0.004, 0.0, 2.0 * np.pi)})
    cells = measure("f32", speeds_mps=(0.1,), stretches=10)
    monkeypatch.setattr(estimator, "PLANNED", ())
    phi = estimator.LAG_M / 0.004
    assert max(cell.paper_nm for cell in cells if cell.rows) == pytest.approx(
        4e6 * (1.0 - np.cos(phi - np.sin(phi))), rel=0.02
    )


def test_the_drive_looks_no_further_than_its_longest_lag() -> None:
    """At 20 mm/s 6 ms are 0.12 mm: of a lag of 1 mm the rest stays, and makes lag^2 / 2R."""
    cells = [c for c in measure("f32", speeds_mps=(0.02,), stretches=8) if c.curve == "circle 20 mm" and c.rows]
    assert cells[0].newton_nm < 2.0
    assert cells[0].drive_nm > 10_000.0


def test_speed_and_bends_of_the_nurbs_vary() -> None:
    curve = estimator.nurbs()
    bend = curve.curvature(np.linspace(0.0, curve.length_m, 2000))
    assert bend.max() > 400.0
    assert bend.min() < -100.0
    ends = curve.point(np.array([0.0, curve.length_m]))
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-12)
    u = np.linspace(0.1, 7.9, 50)
    for order in (0, 1):
        slope = (curve.formula(u + 1e-6, order) - curve.formula(u - 1e-6, order)) / 2e-6
        np.testing.assert_allclose(slope, curve.formula(u, order + 1), atol=1e-7)


def test_estimate_refuses_what_does_not_fit() -> None:
    knots = np.zeros((4097, 2), dtype=np.int32)
    with pytest.raises(ValueError, match="4097 knots"):
        estimate(knots, np.zeros(1), np.zeros((1, 2)), lag_max_ms=6)
    with pytest.raises(ValueError, match="0 ms"):
        estimate(knots[:4], np.zeros(1), np.zeros((1, 2)), lag_max_ms=0)
    with pytest.raises(ValueError, match="do not fit"):
        estimate(knots[:4], np.zeros(2), np.zeros((1, 2)), lag_max_ms=6)


def test_command_prints_the_table_as_json() -> None:
    result = CliRunner().invoke(main, ["experiment", "estimator", "--num", "fix", "--stretches", "2", "--json"])
    assert result.exit_code == 0, result.output
    table = json.loads(result.output)
    assert table["num_backend"] == "fix"
    assert 0.0 < table["worst_nm"] < 2.0
    assert {row["speed_mps"] for row in table["cells"]} == set(estimator.SPEEDS_MPS)
