# SPDX-License-Identifier: Apache-2.0
"""The spline that the drive makes of knots, by SciPy: what the planner's tests measure with."""

import numpy as np
from scipy.interpolate import BSpline


def spline(knots, start=None):
    """Spline over path time in ms, 0 .. n-1, of knots (n, 2), continued by `start` (or the first) and the last."""
    start = knots[0] if start is None else start
    control = np.vstack([[start], knots, knots[-1:]]).astype(float)
    return BSpline(np.arange(len(control) + 4) - 3.0, control, 3)
