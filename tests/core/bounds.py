# SPDX-License-Identifier: Apache-2.0
"""How far the core may be from the oracle: what rounding does, derived and not tuned.

Of a single call, num_bound.h tells: the control files themselves, compiled with running error analysis from the
rounding of one operation (float32: 2^-24 of the result; fixed point: 2^-20, half a step). What it cannot see is the
rounding of the oracle's own doubles, which sum absolute positions.
"""

from __future__ import annotations

import numpy as np
from oracle import KNOT_S

DOUBLE = 2.0**-53
"""Relative error of one rounding in double."""
QUANTUM_M = 2.0**-17 * 1e-9
"""Error of rounding a position, m."""
READ = 2.0**-33
"""Error of reading a value out of the core, in the core's units."""
UM, T0 = 1e-6, 5e-3


def size(v: object) -> float:
    """Length of a vector, magnitude of a number."""
    return float(np.linalg.norm(v))


def of_oracle(position_m: np.ndarray, derivative: int) -> float:
    """Rounding of what the oracle takes from positions about position_m (2,), for a derivative of this order."""
    return 16 * DOUBLE * size(position_m) / KNOT_S**derivative


def rounding(num: str, x: float, unit: float) -> float:
    """Error of one rounding of a signal of size x; `unit` is the core's, in SI."""
    return 2.0**-24 * x if num == "f32" else 2.0**-20 * unit
