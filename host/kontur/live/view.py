# SPDX-License-Identifier: Apache-2.0
"""What a live page shows, and what its operator asks for.

The thread of the run adds rows, and any number of viewers read them, each at its own rate. The run never waits for a
viewer: it puts rows into a ring, and a viewer that is late misses the oldest ones.
"""

from __future__ import annotations

import json
import math
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from kontur.can.emcy import faults

Floats = NDArray[np.float64]

WATCHED_S = 0.03
"""Rows of so much time are shown together."""
_RING_S = 4.0  # a viewer may be late by that
_SKETCH_ROWS = 4000  # of what was before, for a viewer that comes late or again
_OUTLINE_POINTS = 3000
_ERRORS = ("true_contour_error_um", "contour_error_um")  # what the sketch keeps the greatest values of
OVERRIDE_MAX = 120.0
OVERRIDE_MIN = 0.1


class Panel(Protocol):
    """What the operator asks of a command, as kontur.cli.live_page says. `offers`: what it obeys."""

    held: bool
    percent: float
    stop: bool
    offers: Sequence[str]


@dataclass
class _Shown:
    """A run, or another movement: `head` for the page, and its rows."""

    number: int
    head: dict[str, Any]
    names: list[str]
    digits: list[int]
    paced: bool
    pieces: deque[tuple[int, Floats]]  # number of the first row, and rows
    sketch: Sketch
    rows: int = 0
    began_s: float = field(default_factory=time.monotonic)


class Sketch:
    """At most `most` rows (n, columns) of any number: from each stretch the one with the greatest value of a column."""

    def __init__(self, column: int, most: int = _SKETCH_ROWS) -> None:
        self._column, self._most = column, most
        self._stretch, self._seen = 1, 0
        self._kept: dict[int, Floats] = {}

    def add(self, table: Floats) -> None:
        """Take in the next rows."""
        stretch = (self._seen + np.arange(len(table))) // self._stretch
        self._seen += len(table)
        for at in np.unique(stretch):
            part = table[stretch == at]
            self._keep(int(at), part[np.argmax(np.abs(part[:, self._column]))].copy())
        while len(self._kept) > self._most:
            kept, self._kept, self._stretch = self._kept, {}, self._stretch * 2
            for at, row in kept.items():
                self._keep(at // 2, row)

    def table(self) -> list[Floats]:
        """The rows."""
        return list(self._kept.values())

    def _keep(self, at: int, row: Floats) -> None:
        before = self._kept.get(at)
        if before is None or abs(row[self._column]) > abs(before[self._column]):
            self._kept[at] = row


@dataclass
class Viewer:
    """Up to where a viewer has been told."""

    number: int = 0
    row: int = 0
    state: str = ""
    missed: int = 0


class View:
    """The state of one page. `begin` and `add` are those of kontur.runs.recorder.Watcher."""

    every_s = WATCHED_S

    def __init__(self, panel: Panel) -> None:
        self.panel = panel
        self.opened = threading.Event()
        """Set when somebody looks."""
        self._lock = threading.Lock()
        self._shown: _Shown | None = None
        self._codes: tuple[int, ...] = ()
        self._end: str | None = None

    def begin(
        self,
        about: dict[str, str],
        columns: Sequence[tuple[str, int]],
        path_m: Floats | None = None,
        paced: bool = False,
    ) -> None:
        """Show a new movement: rows of `columns`, name and digits of each, come from now on.

        `path_m` (n, 2) is drawn below. `paced`: time is a simulated one, which add() lets pass no faster than the
        clock on the wall.
        """
        names = [name for name, _ in columns]
        head: dict[str, Any] = {"about": about, "columns": names, "path": _outline(path_m)}
        error = next((names.index(name) for name in _ERRORS if name in names), 0)
        number = self._shown.number + 1 if self._shown is not None else 1
        pieces: deque[tuple[int, Floats]] = deque(maxlen=math.ceil(_RING_S / WATCHED_S))
        shown = _Shown(number, head, names, [digits for _, digits in columns], paced, pieces, Sketch(error))
        with self._lock:
            self._shown, self._end = shown, None

    def add(self, table: Floats, codes: Sequence[int]) -> None:
        """Show more rows (n, columns), and the EMCY codes that the drive has reported so far."""
        shown = self._shown
        assert shown is not None
        with self._lock:
            self._codes = tuple(code for code in codes if code)
            if len(table):
                shown.pieces.append((shown.rows, table))
                shown.rows += len(table)
                shown.sketch.add(table)
        if shown.paced and len(table):
            ahead_s = table[-1, shown.names.index("time_s")] - (time.monotonic() - shown.began_s)
            time.sleep(min(max(ahead_s, 0.0), 0.5))

    def end(self, text: str = "The command has ended.") -> None:
        """Say how the movement ended, once."""
        self._end = self._end or text

    def news(self, viewer: Viewer) -> Iterator[str]:
        """The messages (JSON) that `viewer` has not got yet."""
        with self._lock:
            shown = self._shown
            rows = [] if shown is None else self._rows_for(viewer, shown)
        if shown is not None and viewer.number != shown.number:
            viewer.number = shown.number
            viewer.state = ""
            yield json.dumps({"head": shown.head})
        for first, table in rows:
            assert shown is not None
            yield _rows_message(shown, first, table, viewer.missed)
        if (state := json.dumps({"state": self._state()})) != viewer.state:
            viewer.state = state
            yield state

    def _rows_for(self, viewer: Viewer, shown: _Shown) -> list[tuple[int, Floats]]:
        """Rows that are new to `viewer`; a viewer that has not seen this run gets the sketch of it first."""
        pieces = list(shown.pieces)
        if viewer.number != shown.number:
            viewer.missed, viewer.row = 0, shown.rows
            return [(shown.rows, np.array(sketch))] if (sketch := shown.sketch.table()) else []
        if pieces and pieces[0][0] > viewer.row:
            viewer.missed += pieces[0][0] - viewer.row
        new = [piece for piece in pieces if piece[0] >= viewer.row]
        viewer.row = shown.rows
        return new

    def _state(self) -> dict[str, Any]:
        known = faults()
        panel = self.panel
        return {
            "held": panel.held,
            "percent": panel.percent,
            "stop": panel.stop,
            "offers": list(panel.offers),
            "end": self._end,
            "faults": [
                {"code": f"{code:04X}h"}
                | ({key: getattr(known[code], key) for key in ("fault", "cause", "remedy")} if code in known else {})
                for code in self._codes
            ],
        }


def _rows_message(shown: _Shown, first: int, table: Floats, missed: int) -> str:
    """Rows with the digits of the log."""
    columns = {
        name: [None if math.isnan(value) else round(value, digits) for value in values.tolist()]
        for name, digits, values in zip(shown.names, shown.digits, table.T, strict=True)
    }
    return json.dumps({"first": first, "rows": columns, "missed": missed})


def _outline(path_m: Floats | None) -> list[list[float]] | None:
    """x and y in mm of a path, for drawing."""
    if path_m is None or not len(path_m):
        return None
    at = np.unique(np.linspace(0, len(path_m) - 1, _OUTLINE_POINTS).round().astype(int))
    outline: list[list[float]] = np.round(path_m[at].T * 1e3, 4).tolist()
    return outline
