# SPDX-License-Identifier: Apache-2.0
"""The heat of motors and amplifiers along a planned motion, as the drive counts it (firmware/core/force_limit.h): the
mean square of the force over the thermal time constant, as a share of the square of the continuous force."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import lfilter

from kontur.path.geometry import KNOT_S, FloatArray
from kontur.planning.bounds import Force

HEAT = "the heat that the continuous force of an axis allows (continuous_force_N, thermal_s)"
"""What bounds the speed of a part that is planned slower for its heat."""
_MOST, _AT_END = 0.85, 0.8  # within a part, and at its end; the drive warns at 0.9 and lowers its limit from 0.95 on
_LOWER, _HIGHER = 0.95, 1.1  # change of the share that is tried next in the same part, at least, and in the next one
_LEAST = 0.1


class Heat:
    """Follows the heat of both axes, which are cold at first. `share`: of the speed, as it is planned with; it is 1
    where nothing becomes too hot."""

    def __init__(self, forces: tuple[Force, Force] | None) -> None:
        self._axes = [(axis, force) for axis, force in enumerate(forces or ()) if force.continuous_N > 0.0]
        self._heat = [0.0] * len(self._axes)
        self.share = 1.0

    @property
    def counts(self) -> bool:
        """Whether an axis has a continuous force at all."""
        return bool(self._axes)

    def over(self, points_m: list[FloatArray]) -> float:
        """The heat of a motion through all of `points_m` (n, 2), one each millisecond, over what is allowed."""
        return max(max(float(np.max(one)) / _MOST, float(one[-1]) / _AT_END) for one in self._along(points_m))

    def add(self, points_m: list[FloatArray]) -> None:
        """The motion goes on through all of `points_m` (n, 2)."""
        if points_m:
            self._heat = [float(one[-1]) for one in self._along(points_m)]

    def slower(self, over: float) -> bool:
        """Lower the share, with which the heat is so much `over` what is allowed; False: it is as low as it may be.

        Without friction the heat goes with the fourth power of the share."""
        self.share *= min(_LOWER, over**-0.25)
        return self.share > _LEAST

    def faster(self) -> None:
        """Try a higher share."""
        self.share = min(1.0, _HIGHER * self.share)

    def _along(self, points_m: list[FloatArray]) -> list[FloatArray]:
        """The heat (n,) of each axis that has a continuous force."""
        padded = np.pad(np.concatenate(points_m), ((1, 1), (0, 0)), mode="edge")
        speed = (padded[2:] - padded[:-2]) / (2.0 * KNOT_S)
        acceleration = np.diff(padded, 2, axis=0) / KNOT_S**2
        acceleration[[0, -1]] = 0.0  # the motion may go on there
        out = []
        for (axis, force), heat in zip(self._axes, self._heat, strict=True):
            v, a = speed[:, axis], acceleration[:, axis]
            share = (force.mass_kg * a + force.viscous_Nspm * v + force.coulomb_N * np.sign(v)) / force.continuous_N
            rate = -math.expm1(-KNOT_S / force.thermal_s)
            out.append(lfilter([rate], [1.0, rate - 1.0], share**2, zi=[(1.0 - rate) * heat])[0])
        return out
