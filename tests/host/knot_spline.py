# SPDX-License-Identifier: Apache-2.0
"""The spline that the drive makes of knots, by SciPy: what the planner's tests measure with."""

import numpy as np
from scipy.interpolate import BSpline


def spline(knots, start=None):
    """Spline over path time in ms, 0 .. n-1, of knots (n, 2), continued by `start` (or the first) and the last."""
    start = knots[0] if start is None else start
    control = np.vstack([[start], knots, knots[-1:]]).astype(float)
    return BSpline(np.arange(len(control) + 4) - 3.0, control, 3)


ROUNDING = np.array([0.5e-6, 2e-3, 4.0])  # what knots rounded to 1 nm can add: m/s, m/s2, m/s3


def assert_within(trajectory, of):
    """Velocity, acceleration and jerk of both axes at all knots and between them."""
    curve = spline(trajectory.knots_nm * 1e-9)
    t = np.arange(0, (len(trajectory.knots_nm) - 1) * 4 + 1) / 4.0
    middle = np.arange(len(trajectory.knots_nm) - 1) + 0.5
    for order, limit, slack in zip(
        (1, 2, 3), (of.velocity_mps, of.acceleration_mps2, of.jerk_mps3), ROUNDING, strict=True
    ):
        values = np.abs(curve(middle if order == 3 else t, order)) * 1e3**order
        assert np.all(values <= np.array(limit) * (1.0 + 1e-3) + slack)


def greatest_force_N(trajectory, machine):
    """What a machine's axes (2,) need at most for the motion, at all knots and between them."""
    curve = spline(trajectory.knots_nm * 1e-9)
    t = np.arange(0, (len(trajectory.knots_nm) - 1) * 4 + 1) / 4.0
    speed, acceleration = curve(t, 1) * 1e3, curve(t, 2) * 1e6
    moving = np.where(np.abs(speed) > ROUNDING[0], np.sign(speed), 0.0)
    of = [(axis.mass_kg, axis.viscous_Nspm, axis.coulomb_N) for axis in machine.axes]
    mass, viscous, coulomb = np.array(of).T
    return np.max(np.abs(mass * acceleration + viscous * speed + coulomb * moving), axis=0)
