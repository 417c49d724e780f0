# SPDX-License-Identifier: Apache-2.0
"""What a run leaves, while it goes: telemetry and truth are made into rows, logged and scored piece by piece.

So memory is bounded, and after any end of the program the log on the disk lacks a second at most.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from kontur.can.link import Link
from kontur.can.simulated import SimulatedBus, Truth
from kontur.can.wire import TelemetryStream
from kontur.drive.stream import Motion
from kontur.errors import FileError
from kontur.planning.ahead import Planned
from kontur.planning.planner import Trajectory
from kontur.runs import log as logs
from kontur.runs.clock import RunClock
from kontur.runs.columns import along, columns, switched_columns, true_columns
from kontur.runs.coverage import Coverage
from kontur.runs.log import Growing, RunLog
from kontur.runs.sample import Sample
from kontur.runs.scoring import ContourError, Rapids, Scorer

Floats = NDArray[np.float64]

_ABOUT = ("controller", "machine", "command")
_TRUTH = tuple(field.name for field in dataclasses.fields(Truth))


class Watcher(Protocol):
    """Who looks on while a run goes (kontur.live.view, kontur.cli.run_progress). Its functions are called in the thread
    of the run, with the rows of `every_s` at a time."""

    every_s: float

    def begin(
        self, about: dict[str, str], columns: Sequence[tuple[str, int]], path_m: Floats | None, paced: bool
    ) -> None:
        """A run along `path_m` (n, 2) begins; its rows have `columns`, by name and digits in the log.

        `paced`: the drive's time is a simulated one, which passes only as the host receives.
        """

    def add(self, table: Floats, codes: Sequence[int]) -> None:
        """Rows (n, columns) have come; `codes` are all EMCY codes so far."""


class Recorder:
    """The log of one run on `link`, with the truth of `sim` if the drive is simulated.

    `meta` is what is known before; end() adds the rest. `file`: where the log goes, None: nowhere. `whole`: keep all
    rows of the log and the truth in memory; else a long log is thinned there (RunLog.even), and no truth is kept.
    `watch` gets the rows as they come.

    `switches`: the trajectory switches outputs, so the log has columns of them. `error_range`: it has columns of the
    drive's contour error in all control periods, which its TPDO6 sends.

    `problem`: why the log could not be written any further; None while all is well.
    """

    def __init__(
        self,
        link: Link,
        sim: SimulatedBus | None,
        meta: Mapping[str, Any],
        *,
        stop_time_s: float,
        score_from_s: float = 0.0,
        file: Path | None = None,
        whole: bool = True,
        watch: Watcher | None = None,
        switches: bool = False,
        error_range: bool = False,
    ) -> None:
        self._switches = switches
        left_out = (*(() if switches else logs.SWITCHED), *(() if error_range else logs.RANGE))
        known = [c for c in logs.COLUMNS if sim is not None or not c.name.startswith("true_")]
        self._columns = [c for c in known if c.name not in left_out]
        names = [column.name for column in self._columns]
        self.problem: FileError | None = None
        self.meta = dict(meta)
        self.growing = Growing(file, meta, names) if file is not None else None
        self._link, self._sim = link, sim
        self._stop_time_s, self._score_from_s = stop_time_s, score_from_s
        self._names, self._whole, self._watch = names, whole, watch
        self._clock: RunClock | None = None
        self._waiting: list[tuple[NDArray[np.int64], NDArray[np.uint8]]] = []  # frames from before the start is known
        self._rows = 0
        self._tables: list[Floats] = []
        self._sample = Sample(names)
        self._first_period = 0  # of the truth to come, since power-on
        self._truth: list[Truth] = []
        self._true: tuple[Floats, ContourError] | None = None  # of the periods from `_true_from` of the run on
        self._true_from = 0

    def begin(self, trajectory: Planned, start_nm: tuple[int, int], word: Callable[[], NDArray[np.uint32]]) -> None:
        """Record from now on: `trajectory` is about to start, at `start_nm`; `word()`: the outputs of its knots so far
        (kontur.planning.outputs)."""
        self._word = word
        program, from_s = trajectory.program, self._score_from_s
        self._trajectory = trajectory
        self._telemetry = TelemetryStream(start_nm)
        self._rapids = Rapids(program)
        self._scorer = Scorer(program, from_s) if self._sim is not None else None
        self._tracking: Scorer | None = None
        if self._sim is not None and isinstance(trajectory, Trajectory) and trajectory.is_smoothed:
            self._tracking = Scorer(dataclasses.replace(program, items=trajectory.driven), from_s)
        self._coverage = Coverage(program, from_s)
        if self._watch is None:
            self._link.record_telemetry(self._take)
        else:
            self._link.record_telemetry(self._take, self._watch.every_s)
            about = {"title": str(program.name)} | {k: str(v) for k, v in self.meta.items() if k in _ABOUT}
            columns = [(column.name, column.digits) for column in self._columns]
            self._watch.begin(about, columns, trajectory.position_m, self._link.by_device_time)
        if self._sim is not None:
            self._first_period = self._sim.start_recording()

    def started(self, motion: Motion) -> None:
        """The path has started."""
        self._clock = RunClock(self._trajectory, motion, self.meta["control_hz"], self._stop_time_s)

    def stop(self) -> None:
        """The axes stand: make rows of what is left."""
        assert self._clock is not None
        self._link.stop_recording()
        self._clock.finish()
        self._take(np.empty(0, dtype=np.int64), np.empty((0, 8), dtype=np.uint8), last=True)

    def end(self, meta: Mapping[str, Any]) -> RunLog:
        """Finish the log with `meta`, what is known of the end."""
        self._complete(meta)
        if self._whole:
            table = np.concatenate([np.empty((0, len(self._names))), *self._tables])
            run = RunLog(self.meta, dict(zip(self._names, table.T.copy(), strict=True)))
        else:
            run = logs.of_sample(self.meta, self._sample)
        self._finish_file()
        return run

    def fail(self, problem: str) -> RunLog | None:
        """End after an error: what was received stays, as a log; None without a row."""
        if self._clock is not None:
            self._link.stop_recording()
            self._clock.follow(self._link.time_s)
            self._take(np.empty(0, dtype=np.int64), np.empty((0, 8), dtype=np.uint8), last=True)
        if not self._rows:
            self.abandon({})
            return None
        return self.end({"status": "error", "fault": problem})

    def abandon(self, meta: Mapping[str, Any]) -> None:
        """End at once: what was logged stays in the file, with `meta`; without a row there is none."""
        if self.growing is None:
            return
        if not self.growing.rows:
            self.growing.discard()
            return
        self._complete(meta)
        self._finish_file()

    def truth(self) -> Truth | None:
        """The truth at the control rate from the start of the path to its end, if it was kept."""
        if self._sim is None or not self._whole:
            return None
        return Truth(*(np.concatenate([getattr(part, name) for part in self._truth]) for name in _TRUTH))

    def _complete(self, meta: Mapping[str, Any]) -> None:
        self.meta |= meta
        self.meta["frames_lost"] = self._telemetry.frames_lost
        self.meta["path"] = self._coverage.path()
        score = self._scorer.score() if self._scorer is not None else None
        if self._scorer is not None and score is not None:
            force_max_N, force_step_N = self._scorer.effort()
            self.meta |= {
                "score": dataclasses.asdict(score),
                "force_max_N": force_max_N,
                "force_step_N": force_step_N,
            }

        tracking = self._tracking.score() if self._tracking is not None else None
        if tracking is not None:
            self.meta["tracking_score"] = dataclasses.asdict(tracking)

    def _finish_file(self) -> None:
        if self.growing is None:
            return
        try:
            self.growing.finish(self.meta)
        except FileError as error:
            self.growing.close()
            self.problem = self.problem or error
        if self.problem is not None:
            self.problem.args = (f"{self.problem}\nThe log up to then is in {self.growing.file}.",)

    def _take(self, function: NDArray[np.int64], payload: NDArray[np.uint8], last: bool = False) -> None:
        """Make rows of the frames that have come."""
        self._waiting.append((function, payload))
        if self._clock is None:
            return
        if not last:
            self._clock.follow(self._link.time_s)
        function, payload = (np.concatenate(part) for part in zip(*self._waiting, strict=True))
        self._waiting = []
        telemetry = self._telemetry.add(function, payload, last)
        if self._sim is not None:
            self._take_truth(self._clock, self._sim.take_truth())
        time_s = self._clock.of_ticks(telemetry.tick, self._telemetry.path_began, self._link.by_device_time)
        end_s = np.inf if self._clock.periods is None else self._clock.periods / self._clock.control_hz
        rows = (time_s >= 0.0) & (time_s <= end_s)
        time_s = time_s[rows]
        if not time_s.size:
            return
        path_s_m = along(self._trajectory.path_s_m, self._clock.path_time(time_s))
        found = columns(
            telemetry, rows, time_s, self._clock.path_time(time_s), self._trajectory, self._rapids
        ) | self._true_at(time_s, self._clock)
        if self._switches:
            path_s, rate = self._clock.path_time(time_s), self._clock.rate(time_s)
            found |= switched_columns(self._word(), path_s, rate)
        self._clock.forget(time_s[-1])
        self._coverage.add(found, path_s_m)
        self._keep(np.column_stack([found[name] for name in self._names]))

    def _keep(self, table: Floats) -> None:
        self._rows += len(table)
        if self._whole:
            self._tables.append(table)
        else:
            self._sample.add(table)
        if self.growing is not None and self.problem is None:
            try:
                self.growing.append(table)
            except FileError as error:
                self.problem = error
        if self._watch is not None:
            self._watch.add(table, self._link.reported)

    def _take_truth(self, clock: RunClock, truth: Truth) -> None:
        """Score the truth that has come, of the path alone, both ends included."""
        assert self._scorer is not None
        first = self._first_period - clock.start_period  # of these rows, since the start of the path
        self._first_period += len(truth.pos_m)
        begin = max(0, -first)
        end = len(truth.pos_m) if clock.periods is None else max(begin, clock.periods + 1 - first)
        truth = Truth(*(getattr(truth, name)[begin:end] for name in _TRUTH))
        if not len(truth.pos_m):
            return
        first += begin
        time_s = np.arange(first, first + len(truth.pos_m)) / clock.control_hz
        path_s_m = along(self._trajectory.path_s_m, clock.path_time(time_s))
        error = self._scorer.add(time_s, truth.pos_m, path_s_m, truth.force_N)
        if self._tracking is not None:
            self._tracking.add(time_s, truth.pos_m, path_s_m, truth.force_N)
        if self._whole:
            self._truth.append(truth)
        if self._true is None:
            self._true, self._true_from = (truth.pos_m, error), first
        else:
            position, before = self._true
            both = (np.concatenate([getattr(e, f.name) for e in (before, error)]) for f in dataclasses.fields(error))
            self._true = np.concatenate([position, truth.pos_m]), ContourError(*both)

    def _true_at(self, time_s: Floats, clock: RunClock) -> dict[str, Floats]:
        """The true columns of the rows at `time_s`; what is before them is not needed any more."""
        if self._true is None:
            return {}
        period = np.rint(time_s * clock.control_hz).astype(np.int64)
        position, error = self._true
        at = period - self._true_from
        found = true_columns(position[at], ContourError(error.normal_m[at], error.tangential_m[at], error.foot_s_m[at]))
        rest = slice(int(at[-1]), None)
        self._true_from = int(period[-1])
        self._true = position[rest], ContourError(*(getattr(error, f.name)[rest] for f in dataclasses.fields(error)))
        return found
