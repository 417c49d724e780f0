# SPDX-License-Identifier: Apache-2.0
"""How far a run is, on a terminal: its share, position, feed asked and reached, and contour error."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from kontur.cli.live_page import Panel
from kontur.cli.output import console

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from rich.progress import Progress

    from kontur.live.view import View
    from kontur.planning.ahead import Planned
    from kontur.runs.recorder import Watcher

    Floats = NDArray[np.float64]
_SHOWN_S = 0.25  # rows of so much time come together
_SPEED_ROWS = 100  # over which the speed is taken


@contextmanager
def run_progress(
    name: str, trajectory: Planned, asked: Panel, page: View | None
) -> Iterator[tuple[Callable[[float], None], Watcher | None]]:
    """A bar on a terminal, nothing when piped. Yields a function that takes the share of the path that is done, and who
    looks on while the run goes: `page` too, if there is one."""
    if not sys.stderr.isatty():
        yield (lambda share: None), page
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(10),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[now]}"),
    )
    progress = Progress(*columns, console=console(stderr=True), transient=True)
    line = _Line(progress, name, trajectory, asked, page)
    line.tell_time()  # before the first picture of the line
    with progress:
        yield line.done, line


class _Line:
    """The line of the terminal; kontur.runs.recorder.Watcher."""

    every_s = _SHOWN_S

    def __init__(self, progress: Progress, name: str, trajectory: Planned, asked: Panel, page: View | None) -> None:
        self._progress, self._panel, self._page = progress, asked, page
        self._task = progress.add_task(name, total=1.0, now="")
        self._share = 0.0
        if page is not None:
            self.every_s = min(self.every_s, page.every_s)
        from kontur.path.moves import feeds_mps, lengths_m

        moves = trajectory.program.moves
        self._trajectory = trajectory
        self._end_m, self._feed_mps = lengths_m(moves).cumsum(), feeds_mps(moves)

    def tell_time(self) -> None:
        """Say what the path takes as soon as it is planned, and about what before."""
        from kontur.planning.ahead import Ahead

        path = self._trajectory
        self._told = not isinstance(path, Ahead) or path.complete
        if isinstance(path, Ahead) and not self._told:
            takes = f"about {path.about_s():.4g} s; it is driven while the rest of it is planned"
        else:
            takes = f"{path.duration_s:.2f} s"
        self._progress.console.print(f"{path.program.name} takes {takes}", markup=False, highlight=False)

    def done(self, share: float) -> None:
        if not self._told and math.isfinite(self._trajectory.duration_s):
            self.tell_time()
        self._share = share
        self._progress.update(self._task, completed=share)

    def begin(
        self, about: dict[str, str], columns: Sequence[tuple[str, int]], path_m: Floats | None, paced: bool
    ) -> None:
        names = [name for name, _ in columns]
        self._place = [names.index(f"position_{axis}_mm") for axis in "xy"]
        self._reference = [names.index(f"reference_{axis}_mm") for axis in "xy"]
        self._time = names.index("time_s")
        self._error = names.index("true_contour_error_um" if "true_contour_error_um" in names else "contour_error_um")
        if self._page is not None:
            self._page.begin(about, columns, path_m, paced)

    def add(self, table: Floats, codes: Sequence[int]) -> None:
        if len(table) > 1:
            x, y = table[-1, self._place]
            error = abs(table[:, self._error]).max()
            now = f"x {x:.3f} y {y:.3f} mm  {self._speed(table)} mm/s  {error:.2f} µm"
            self._progress.update(self._task, now=now, refresh=True)
        if self._page is not None:
            self._page.add(table, codes)

    def _speed(self, table: Floats) -> str:
        """The feed that is reached, and the one that is asked for."""
        rows = table[-_SPEED_ROWS:]
        step = rows[1:, self._reference] - rows[:-1, self._reference]
        took_s = float(rows[-1, self._time] - rows[0, self._time])
        reached = float(((step**2).sum(axis=1) ** 0.5).sum()) / took_s
        path_m = self._trajectory.path_s_m
        knot = min(round(self._share * len(path_m)), len(path_m) - 1)
        move = min(int(self._end_m.searchsorted(path_m[knot])), len(self._end_m) - 1)
        asked = self._feed_mps[move] * 1e3 * self._panel.rate()
        return f"{reached:.1f} of {asked:.1f}" if math.isfinite(asked) else f"{reached:.1f}, rapid,"
