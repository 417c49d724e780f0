# SPDX-License-Identifier: Apache-2.0
"""Arcs as columns of numbers: what is asked of all arcs of a long program, for all of them at once."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
_NONE = np.empty(0, np.int64)


class ArcColumns:
    """k arcs, which are the rows `at` (k,), rising, of a table of moves. `values` (5, k): x and y of the centres in m,
    the radii in m, the angles of the starts and the sweeps in rad, as kontur.path.geometry.Arc has them. Each function
    gives, bit for bit, what an Arc gives."""

    def __init__(self, at: npt.NDArray[np.int64] = _NONE, values: FloatArray | None = None) -> None:
        self.at = at
        self.values = np.empty((5, len(at))) if values is None else values

    def __len__(self) -> int:
        return len(self.at)

    def part(self, first: int, last: int) -> ArcColumns:
        """The arcs in the rows from `first` until before `last`, which are counted from `first`."""
        some = slice(*np.searchsorted(self.at, [first, last]).tolist())
        return ArcColumns(self.at[some] - first, self.values[:, some])

    def chosen(self, arcs: slice | npt.NDArray[np.bool_]) -> ArcColumns:
        """Some of the arcs."""
        return ArcColumns(self.at[arcs], self.values[:, arcs])

    @property
    def length_m(self) -> FloatArray:
        """The lengths (k,)."""
        return np.asarray(self.values[2] * np.abs(self.values[4]))

    @property
    def curvature(self) -> FloatArray:
        """The curvatures (k,) in 1/m, positive to the left."""
        return np.asarray(np.copysign(1.0 / self.values[2], self.values[4]))

    def ends_m(self) -> FloatArray:
        """Where they begin and end (k, 4): x, y, x, y."""
        everything = slice(None)
        return np.hstack([self.point(everything, np.zeros(len(self))), self.point(everything, self.length_m)])

    def point(self, arc: npt.NDArray[np.intp] | slice, s_m: FloatArray) -> FloatArray:
        """Points (n, 2) of the arcs `arc` (n,), by number, at the distances `s_m` (n,) from their starts."""
        x, y, radius, _, _ = self.values[:, arc]
        angle = self._angle(arc, s_m)
        return np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=1)

    def tangent(self, arc: npt.NDArray[np.intp] | slice, s_m: FloatArray) -> FloatArray:
        """The unit tangents (n, 2) of the same."""
        angle, sense = self._angle(arc, s_m), np.copysign(1.0, self.values[4, arc])
        return np.stack([sense * -np.sin(angle), sense * np.cos(angle)], axis=1)

    def heading(self, arc: npt.NDArray[np.intp] | slice, s_m: FloatArray) -> FloatArray:
        """The direction (n,) of the same in rad."""
        angle, sense = self._angle(arc, s_m), np.copysign(1.0, self.values[4, arc])
        return np.asarray(np.arctan2(sense * np.cos(angle), sense * -np.sin(angle)))

    def extremes_m(self) -> FloatArray:
        """Points (k, 6, 2) of the arcs among which are their outermost: both ends, and those where a coordinate turns
        back, or a start in place of one that is not on the arc."""
        k, length, everything = len(self), self.length_m, slice(None)
        out = np.empty((k, 6, 2))
        out[:, 0] = self.point(everything, np.zeros(k))
        out[:, 1] = self.point(everything, length)
        _, _, radius, start, sweep = self.values
        for quarter in range(4):
            s = radius * (np.copysign(1.0, sweep) * (quarter * 0.5 * np.pi - start) % (2.0 * np.pi))
            out[:, 2 + quarter] = self.point(everything, np.where(s <= length, s, 0.0))
        return out

    def _angle(self, arc: npt.NDArray[np.intp] | slice, s_m: FloatArray) -> FloatArray:
        return np.asarray(self.values[3, arc] + self.curvature[arc] * s_m)
