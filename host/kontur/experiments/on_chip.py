# SPDX-License-Identifier: Apache-2.0
"""The machine that the drive itself simulates (`onchip_plant`), compared with the simulator's in runs without noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kontur.drive.target import Target
from kontur.errors import SimulatorError
from kontur.machine import ON_CHIP, Machine
from kontur.path import shapes
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.runs.runner import run

# radius in m, feed in m/s
CIRCLES = ((0.004, 0.004488), (0.004, 0.02), (0.004, 0.1), (0.02, 0.1))


def compare(
    machine: Machine,
    num: str = "f32",
    circles: Sequence[tuple[float, float]] = CIRCLES,
    progress: Callable[[float], None] = lambda share: None,
) -> list[dict[str, Any]]:
    """Distance of the true positions at the control rate, on one lap of each circle under `ccu`: a row each.

    `machine` is one with the model "on_chip"; its force noise is left out, as it is drawn differently.
    """
    quiet = replace(
        machine, model=ON_CHIP, x=replace(machine.x, force_noise_N=0.0), y=replace(machine.y, force_noise_N=0.0)
    )
    rows = []
    for i, (radius_m, feed_mps) in enumerate(circles):
        apart_m = np.abs(
            _positions(quiet, num, radius_m, feed_mps)
            - _positions(replace(quiet, model="full"), num, radius_m, feed_mps)
        )
        rows.append(
            {
                "radius_mm": radius_m * 1e3,
                "feed_mm_s": feed_mps * 1e3,
                "mean_nm": float(apart_m.mean() * 1e9),
                "max_nm": float(apart_m.max() * 1e9),
            }
        )
        progress((i + 1) / len(circles))
    return rows


def _positions(machine: Machine, num: str, radius_m: float, feed_mps: float) -> NDArray[np.float64]:
    """True positions (n, 2) in m."""
    target = Target(machine, num=num)
    truth = run(plan(shapes.circle(radius_m, feed_mps), limits(machine)), "ccu", target).truth
    if truth is None:
        raise SimulatorError("the bus does not offer the true positions")
    return truth.pos_m
