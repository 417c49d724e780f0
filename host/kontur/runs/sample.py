# SPDX-License-Identifier: Apache-2.0
"""A sample of the rows of a run, so that memory is bounded however long it is, and totals of all rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROWS_MAX = 100_000


@dataclass(frozen=True)
class Total:
    """The known values of a column: their number, means, least and greatest; NaN where there is none."""

    count: int = 0
    mean: float = math.nan
    mean_abs: float = math.nan
    rms: float = math.nan
    least: float = math.nan
    greatest: float = math.nan


def total_of(values: Array) -> Total:
    """The total of a column (n,)."""
    known = values[np.isfinite(values)]
    if not known.size:
        return Total()
    return Total(
        int(known.size),
        float(np.mean(known)),
        float(np.mean(np.abs(known))),
        float(np.sqrt(np.mean(known**2))),
        float(np.min(known)),
        float(np.max(known)),
    )


class Sample:
    """All rows up to ROWS_MAX; of more rows the first of every stretch, and those with the least and the greatest value
    of each column in it. A stretch is a power of two of rows, which doubles when there are too many again."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = list(names)
        self._stretch = 1
        self._rows = 0
        self._kept = [np.empty((0, len(names)))]
        self._numbers = [np.empty(0, dtype=np.int64)]
        self._kept_rows = 0
        self._totals = {name: Total() for name in names}

    @property
    def is_whole(self) -> bool:
        """Whether it has all rows."""
        return self._stretch == 1

    def add(self, table: Array) -> None:
        """Take in the next rows (n, columns)."""
        if not len(table):
            return
        for name, values in zip(self.names, table.T, strict=True):
            self._totals[name] = _together(self._totals[name], total_of(values))
        self._kept.append(table)
        self._numbers.append(self._rows + np.arange(len(table)))
        self._rows += len(table)
        self._kept_rows += len(table)
        while self._kept_rows > ROWS_MAX:
            self._stretch *= 2
            self._thin()

    def table(self) -> Array:
        """The rows (n, columns) of the sample, in order."""
        if not self.is_whole:
            self._thin()
        return np.concatenate(self._kept)

    def even(self) -> NDArray[np.bool_]:
        """Which rows (n,) of table() are evenly spaced in the run."""
        return np.asarray(np.concatenate(self._numbers) % self._stretch == 0)

    def totals(self) -> dict[str, Total]:
        """The totals of all rows, by column."""
        return dict(self._totals)

    def _thin(self) -> None:
        table, number = np.concatenate(self._kept), np.concatenate(self._numbers)
        stretch = number // self._stretch
        first = np.flatnonzero(np.diff(stretch, prepend=-1))
        keep = np.zeros(len(table), dtype=bool)
        keep[first] = keep[-1] = True
        count = np.diff(np.append(first, len(table)))
        for values in table.T:
            for extreme, unknown in ((np.minimum, np.inf), (np.maximum, -np.inf)):
                known = np.where(np.isnan(values), unknown, values)
                at = np.flatnonzero(known == np.repeat(extreme.reduceat(known, first), count))
                _, once = np.unique(stretch[at], return_index=True)
                keep[at[once]] = True
        self._kept, self._numbers = [table[keep]], [number[keep]]
        self._kept_rows = int(np.count_nonzero(keep))


def _together(a: Total, b: Total) -> Total:
    """The total of two parts of a column."""
    if not a.count or not b.count:
        return b if b.count else a
    count = a.count + b.count
    of_a, of_b = a.count / count, b.count / count
    return Total(
        count,
        of_a * a.mean + of_b * b.mean,
        of_a * a.mean_abs + of_b * b.mean_abs,
        math.sqrt(of_a * a.rms**2 + of_b * b.rms**2),
        min(a.least, b.least),
        max(a.greatest, b.greatest),
    )
