# SPDX-License-Identifier: Apache-2.0
"""Control points ("knots") of the uniform cubic B-spline that the drive follows: one a millisecond, integer nanometres.

At path time i ms the spline is at (c[i-1] + 4 c[i] + c[i+1]) / 6. The drive continues the sequence with the start
position before c[0] and with the last knot after the end (docs/protocol.md, "Streaming knots").
"""

from __future__ import annotations

import hashlib

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_banded

from kontur.can.wire import DIFFERENCE_MAX_NM
from kontur.errors import PathError, shown
from kontur.path.geometry import FloatArray

ROWS = 1 << 17  # handled at once, to bound memory
OVERLAP = 128  # knots, after which the end of a part does not change a bit of what is inside
_POSITION_MAX_NM = (1 << 31) - 1
POSITION_RANGE_M = ((-2.147, 2.147), (-2.147, 2.147))  # what 32 bits can count


def control_points(position_m: FloatArray) -> FloatArray:
    """Control points (n, 2) in m of the spline that passes through `position_m` (n, 2) at 0, 1, 2 ... ms.

    The path rests at both ends: the first and the last positions repeat before and after it.
    """
    control = np.empty_like(position_m)
    for first in range(0, len(position_m), ROWS):
        low, high = max(0, first - OVERLAP), min(len(position_m), first + ROWS + OVERLAP)
        part = _control_points(position_m[low:high])
        control[first : first + ROWS] = part[first - low : first - low + ROWS]
    return control


def _control_points(position_m: FloatArray) -> FloatArray:
    bands = np.ones((3, len(position_m)))
    bands[1] = 4.0
    right = 6.0 * position_m
    right[0] -= position_m[0]
    right[-1] -= position_m[-1]
    return np.asarray(solve_banded((1, 1), bands, right, overwrite_b=True, check_finite=False))


def to_nm(control_m: FloatArray) -> npt.NDArray[np.int32]:
    """Control points (n, 2) in m as the integers of the wire.

    Raises PathError: a position beyond the 32 bits or a step beyond the 24 bits of the wire.
    """
    knots_nm = np.empty(control_m.shape, dtype="<i4")
    for first in range(0, len(control_m), ROWS):
        begin = max(0, first - 1)
        nm = np.rint(control_m[begin : first + ROWS] * 1e9)
        if np.max(np.abs(nm)) > _POSITION_MAX_NM:
            raise PathError(
                f"the path goes {shown(np.max(np.abs(control_m)))} m from the origin; the drive counts up to 2.147 m"
            )
        if np.max(np.abs(np.diff(nm, axis=0)), initial=0.0) > DIFFERENCE_MAX_NM:
            raise PathError("the path is faster than 8.3 m/s, which a knot frame cannot carry; lower the feed")
        knots_nm[first : first + ROWS] = nm[first - begin :]
    return knots_nm


def digest(knots_nm: npt.NDArray[np.int32]) -> str:
    """SHA-256 of the knots as they go over the wire (x, y, x, y ... little-endian int32), in hexadecimal."""
    return hashlib.sha256(np.ascontiguousarray(knots_nm, dtype="<i4").data).hexdigest()
