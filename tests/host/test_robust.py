# SPDX-License-Identifier: Apache-2.0
"""The robustness experiment: what it draws, what it counts, and that the default gains stand two draws of it."""

from __future__ import annotations

from typing import Any

import pytest

from kontur import machine as machines
from kontur.experiments import COMPARED
from kontur.experiments.robust import draw, robust, summarise

NOMINAL = machines.load(machines.DEFAULT)


def row(seed: int, **mean_um: float | None) -> dict[str, Any]:
    return {
        "seed": seed,
        "controllers": {
            name: {
                "mean_um": mean,
                "rms_um": mean,
                "max_um": mean and 1.0 / mean,
                "unstable": "tripped" if mean is None else None,
            }
            for name, mean in mean_um.items()
        },
    }


def test_a_seed_always_draws_the_same() -> None:
    assert draw(7, NOMINAL).machine == draw(7, NOMINAL).machine
    assert draw(7, NOMINAL).machine != draw(8, NOMINAL).machine


def test_draws_fill_the_ranges_they_promise_and_do_not_leave_them() -> None:
    drawn = [draw(seed, NOMINAL) for seed in range(200)]
    ratios: dict[str, list[float]] = {
        "mass": [d.machine.x.mass_kg / NOMINAL.x.mass_kg for d in drawn],
        "viscous": [d.machine.y.viscous_Nspm / NOMINAL.y.viscous_Nspm for d in drawn],
        "coulomb": [d.machine.y.coulomb_N / NOMINAL.y.coulomb_N for d in drawn],
        "noise": [d.machine.x.force_noise_N / NOMINAL.x.force_noise_N for d in drawn],
        "encoder": [d.machine.x.encoder_m * 1e9 for d in drawn],
        "lag": [d.machine.x.current_lag_s * 1e3 for d in drawn],
        "delay": [d.machine.delay_periods for d in drawn],
        "acceleration": [d.acceleration_mps2 for d in drawn],
    }
    for name, low, high in (
        ("mass", 0.7, 1.3),
        ("viscous", 0.5, 1.5),
        ("coulomb", 0.5, 1.5),
        ("noise", 1.0, 3.0),
        ("encoder", 10.0, 1000.0),
        ("lag", 0.0, 0.5),
        ("delay", 1, 2),
        ("acceleration", 2.0, 35.0),
    ):
        assert low <= min(ratios[name]) <= low + 0.1 * (high - low), name
        assert high - 0.1 * (high - low) <= max(ratios[name]) <= high, name
    assert {d.shape for d in drawn} == {"circle", "eight", "square", "spiral"}


def test_summary_compares_draw_by_draw_and_leaves_out_what_was_unstable() -> None:
    rows = [row(1, ccu=1.0, ccc=2.0), row(2, ccu=1.0, ccc=8.0), row(3, ccu=2.0, ccc=None), row(4, ccu=None, ccc=1.0)]
    found = summarise(rows)
    assert found["unstable"] == 2
    assert found["seeds"] == 4
    ccc = found["controllers"]["ccc"]
    assert (ccc["unstable"], ccc["median_um"], ccc["worst_um"], ccc["worst_seed"]) == (1, 2.0, 8.0, 2)
    assert (ccc["over_ccu_median"], ccc["over_ccu_worst"]) == (5.0, 2.0)
    assert (ccc["over_ccu_rms_worst"], ccc["over_ccu_max_worst"]) == (2.0, 0.125)  # of the max ccu was not the best


def test_default_gains_are_stable_and_ccu_is_the_best_on_machines_that_it_does_not_know() -> None:
    rows = robust(NOMINAL, range(1, 3))
    assert summarise(rows)["unstable"] == 0
    for one in rows:
        mean = {name: one["controllers"][name]["mean_um"] for name in COMPARED}
        assert mean["ccu"] < 0.5 * mean["cascade"], one["seed"]


def test_a_drive_that_trips_is_counted_and_does_not_end_the_experiment() -> None:
    rows = robust(NOMINAL, [1], parameters={"plant_x.mass": 1000.0, "plant_y.mass": 1000.0})
    assert summarise(rows)["unstable"] == len(COMPARED), rows[0]["controllers"]
    assert all(isinstance(found["unstable"], str) for found in rows[0]["controllers"].values())


@pytest.mark.parametrize("num", ["f32", "fix"])
def test_default_gains_are_stable_on_either_back_end(num: str) -> None:
    assert summarise(robust(NOMINAL, [2], num))["unstable"] == 0
