# SPDX-License-Identifier: Apache-2.0
"""What docs/paper.md says in words around its tables."""

HEAD = """# The paper, run again

<!-- Made by `tools/paper_page.py`; edit tools/paper/ instead. -->

“Adaptive Sliding Mode Contouring Control Design Based on Reference Adjustment and Uncertainty Compensation for Feed
Drive Systems”, its tables and figures, on the simulated drive: the same firmware, over CAN frames. Every figure that
is not marked as the paper's comes from the run that made this page. What was decided where the paper is silent or
misprinted is in [control-law.md](control-law.md); all parameters are in [objects.md](objects.md).

CCU is the paper's here: without the learned feedforward that `ccu` has besides, which is not in the paper. Rows “with
learned feedforward” show the drive as it is.

What cannot be compared with the paper's own figures:

- the energy: printed in µJ, far below what moves such masses; the motor's constants of (26)–(30) are not given. Only
  ratios can be compared.
- the noise: “mean 0, variance, and standard deviation” without the values; ours is white force noise.
- the start: the paper's errors hold an unknown initial transient; ours start at rest on the path.
- sampling, encoder and velocity measurement are not mentioned; ours are in
  [table1.toml](../host/kontur/machines/table1.toml).
- e_n2 is the estimate. The paper has no true contour error.
- the fast circle's radius is not given: two are shown.
"""

PRINTED = """## The laws as printed

Each decision of [control-law.md](control-law.md#where-we-differ-from-the-print) that can be switched off, put back to
what the paper prints. Errors are true contour errors; step N: mean |Δu| of the force vector per control period; J:
energy.
"""

NOT_SHOWN = """
Not shown, for there is nothing to run or no sense in running it: B and θ̂ without their dots (15), u = ū + v with v an
acceleration (18), the letters lost in (28), (30) and (32).
"""

SENSITIVITY = """## Where the paper gives no value

What was chosen (units in [objects.md](objects.md)), halved and doubled; `ccu`, true contour error. Inside its boundary
layer the compensator knows µ_0/φ only: to halve one is to double the other. “along”: changed by the same factor, or by
its inverse, where the drive demands it (k̄ e_max ≤ 4, µ_0 ≤ µ_max).
"""

ESTIMATOR = """## The estimate of the contour error

`kontur experiment estimator --num f32`, and `--num fix`: |e_n2 − exact| in nm, the greatest of many places on each
curve, axes up to 50 µm off the path and up to 1 mm ahead or behind. The exact foot point is chosen on the B-spline of
the knots (double precision), and the axes are put at a known distance along its normal. A cell is
**f32 · fix · the paper's (6), without the Newton step**. Radius: the smallest radius of curvature between foot point
and reference.

The rows “planned” are runs from rest to rest by the planner within the machine's limits, half of the places where the
speed changes, lags up to `contour.lag_max`, above 1 mm/s. Where the speed changes by half or more within the lag, which
takes accelerations far beyond those limits, one Newton step leaves more.

With the Newton step and a lag of at most a fifth of the radius the estimate is never off by more than {greatest}.

The last column is for the drive as it is, up to lag/radius 0.2: it keeps few knots of the past, and looks for the foot
point no further than `contour.lag_max`. What lags more in time seems further off the path than it is, by about
(rest of the lag)²/(2 radius).
"""
