# SPDX-License-Identifier: Apache-2.0
"""The log of one run: what was run (`meta`) and one row a telemetry tick (`columns`), as CSV or MF4.

`COLUMNS` has names, units and digits of all columns; those of the telemetry are the signals' (kontur.can.signals).
`META` has the keys of `meta`. A log holds no wall clock, so equal runs give equal files, byte for byte. CSV carries the
digits of the table, MF4 the doubles that it is given.

In a CSV what is known when a run begins stands before the rows, and what is known when it ends stands after them. So
`Growing` writes a log while the run goes. A file without the latter is of a run whose program was killed; it is read as
any other, with the status "killed".

A log of any length is read and written in tables of some thousand rows (`opened`, `Growing`, `convert`).
"""

from __future__ import annotations

import gc
import io
import itertools
import json
import math
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime, timezone
from html import escape
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kontur.can import signals
from kontur.errors import FileError, LogError
from kontur.files import atomic_writer, create_for, open_bytes, put_in_place, write_atomically
from kontur.runs.head import problem_of_kinds, problem_of_values
from kontur.runs.sample import Sample, Total, total_of

if TYPE_CHECKING:
    from asammdf import MDF

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Column:
    """A column: `name` ends in the unit, `unit` as MF4 shows it, `digits` after the point in CSV."""

    name: str
    unit: str
    digits: int
    what: str
    required: bool = False


_REQUIRED = ("tangential_error", "contour_error")


def _measured(fast: bool) -> tuple[Column, ...]:
    """The columns of the signals that the telemetry brings each millisecond, or less often."""
    return tuple(
        Column(s.column.name, s.column.unit, s.column.digits, s.description, required=s.name in _REQUIRED)
        for s in signals.SIGNALS
        if s.column is not None and s.telemetry is not None and (s.telemetry.period_ms == 1) == fast
    )


COLUMNS = (
    Column("tick", "ms", 0, "device tick (1 ms), unwrapped; a gap is a lost frame", required=True),
    Column("time_s", "s", 6, "time since the path began", required=True),
    *_measured(fast=True),
    Column("reference_x_mm", "mm", 6, "trajectory at this time, x"),
    Column("reference_y_mm", "mm", 6, "trajectory at this time, y"),
    Column("rapid", "1", 0, "1 on a rapid move (G0), 0 on a feed move"),
    Column("digital", "1", 0, "digital outputs by bit, as the path asks for them; 0 where it stops (2180h)"),
    Column("power", "1", 4, "power, likewise, as a share of full power"),
    *_measured(fast=False),
    Column("true_position_x_mm", "mm", 9, "true position of the simulated machine, x"),
    Column("true_position_y_mm", "mm", 9, "true position of the simulated machine, y"),
    Column("true_contour_error_um", "um", 6, "true distance to the programmed path, positive on its left"),
    Column("true_tangential_error_um", "um", 6, "true error along the programmed path, negative behind"),
)

RANGE = ("contour_error_least_um", "contour_error_greatest_um")
"""Columns of a run that asks for them."""

SWITCHED = ("digital", "power")
"""Columns of a path that switches something."""

META = {
    "program": "name of the part program or shape",
    "controller": "name of the control law",
    "status": "why the rows end: complete, interrupted (by the operator, or by a disk that is full), fault, error (of "
    "the bus, or an answer of the drive) or killed (the program)",
    "fault": "message of the fault or of the error that ended the run",
    "warnings": "messages of the drive's warnings",
    "feed": "the programmed feed, and what was planned of it by which limit",
    "smoothing": "where the path is smoothed within a tolerance: how far it is from the program's at most",
    "switched": "words of the program that switch something beside the axes, and how often",
    "trajectory": "SHA-256 of the knots",
    "machine": "name of the machine, or of the bus of a real drive",
    "plant": "the simulated machine's values",
    "seed": "seed of the simulated noise",
    "told": "what the simulated drive was told of its machine: all, lengths and limits, or nothing",
    "compensation": "where it was told all: full, what it has a parameter for; rigid, what a rigid axis has",
    "firmware": "build id of the firmware",
    "num": "numeric back end of the firmware",
    "control_hz": "control periods a second",
    "parameters": "the drive's parameters, name to value",
    "frames_lost": "telemetry frames that did not arrive",
    "accepted": "knots that the drive accepted",
    "rejected": "knot frames that the drive rejected, by reason",
    "dropped": "frames that the host received and did not use, by reason (kontur.can.link.DROPPED)",
    "command": "the command that makes this run again",
    "resumed_at_s": "path time at which a path that had been stopped was gone on with",
    "path": "length of the path, and what of it was covered (kontur.runs.coverage)",
    "score": "kontur.runs.scoring.Score of the run at the control rate, by field",
    "tracking_score": "where the path is smoothed: the same, by the distance to the smoothed path instead",
    "force_max_N": "greatest force of an axis at the control rate",
    "force_step_N": "mean change of force from one control period to the next",
}
REQUIRED_META = ("program", "controller", "status")
STATUS = ("complete", "interrupted", "fault", "error", "killed")
KNOWN_AT_THE_END = (
    "status",
    "fault",
    "resumed_at_s",
    "warnings",
    "frames_lost",
    "accepted",
    "rejected",
    "dropped",
    "path",
    "score",
    "tracking_score",
    "force_max_N",
    "force_step_N",
)

_FIRST_LINE = "# kontur log 1"
_NOT_INCREASING = "tick and time_s do not increase from row to row"
_BY_NAME = {column.name: column for column in COLUMNS}
_ROWS = 1 << 14  # of a table that is read or written at once
_EPOCH = datetime(2000, 1, 1, tzinfo=timezone.utc)  # MF4 demands a start time; the true one would differ each run


@dataclass(frozen=True)
class RunLog:
    """One run: `meta` (keys of `META`, JSON values) and `columns` (names of `COLUMNS`, each (n,); NaN: unknown).

    Columns are put into the order of the table.

    A long run may be thinned to rows that keep the extremes of every column (kontur.runs.sample). Then `even` (n,)
    tells which rows are evenly spaced in time, so that shares of time are counted by these, and `totals` has the totals
    of all rows. Otherwise both are None, and the rows are all rows of the run.

    Raises LogError: a key or column of the required ones is missing, a column is unknown or of another length, ticks do
    not increase.
    """

    meta: Mapping[str, Any]
    columns: Mapping[str, Array]
    even: NDArray[np.bool_] | None = None
    totals: Mapping[str, Total] | None = None

    def __post_init__(self) -> None:
        problem = _meta_problem(self.meta) or _columns_problem(self.columns)
        if problem:
            raise LogError(f"log of a run: {problem}")
        ordered = {
            c.name: np.asarray(self.columns[c.name], dtype=np.float64) for c in COLUMNS if c.name in self.columns
        }
        object.__setattr__(self, "columns", ordered)

    def __len__(self) -> int:
        return len(self.columns["tick"])

    @property
    def has_truth(self) -> bool:
        """Whether the true contour error is known, that is, the machine was simulated."""
        return "true_contour_error_um" in self.columns

    def total(self, name: str) -> Total:
        """Number and means of the known values of a column over the whole run."""
        return self.totals[name] if self.totals is not None else total_of(self.columns[name])


def write(run: RunLog, path: str | Path) -> None:
    """Write CSV or MF4, by the suffix of `path`. Raises LogError: another suffix; FileError."""
    path = Path(path)
    content = _mf4_bytes(run) if _suffix(path) == ".mf4" else csv_text(run).encode()
    write_atomically(path, content)


def read(path: str | Path, *, thinned: bool = False) -> RunLog:
    """Read CSV or MF4, by the suffix. `thinned`: a long log is thinned, so that memory is bounded (RunLog.even).

    Raises LogError: another suffix; FileError: not readable as a log of kontur.
    """
    with opened(path) as source:
        if thinned:
            sample = Sample(source.names)
            for table in source:
                sample.add(table)
            return of_sample(source.meta, sample)
        table = np.concatenate([np.empty((0, len(source.names))), *source])
        return RunLog(source.meta, dict(zip(source.names, table.T.copy(), strict=True)))


def of_sample(meta: Mapping[str, Any], sample: Sample) -> RunLog:
    """The log of the rows in `sample`."""
    columns = dict(zip(sample.names, sample.table().T.copy(), strict=True))
    return RunLog(meta, columns, None if sample.is_whole else sample.even(), sample.totals())


@dataclass
class Source:
    """A log that is being read. Iterating gives its rows once, in order, as tables (n, columns); `meta` is complete
    after the last one. `names` are those of the columns."""

    meta: dict[str, Any]
    names: list[str]
    tables: Iterator[Array]

    def __iter__(self) -> Iterator[Array]:
        return self.tables


@contextmanager
def opened(path: str | Path) -> Iterator[Source]:
    """Open CSV or MF4, by the suffix, to read it table by table.

    Raises LogError: another suffix; FileError, also while it is read: not readable as a log of kontur.
    """
    path = Path(path)
    suffix = _suffix(path)
    with open_bytes(path) as file:
        if suffix == ".csv":
            yield _open_csv(file, path)
            return
        mdf = _open_mf4(file)
        if mdf is None:
            raise FileError(path, "is not an MF4 file, or an incomplete one")
        try:
            yield _of_mf4(mdf, path)
        finally:
            mdf.close()


def convert(source: str | Path, target: str | Path) -> None:
    """Write the log `source` as `target`; each is CSV or MF4, by the suffix. Raises LogError, FileError."""
    target = Path(target)
    suffix = _suffix(target)
    with opened(source) as log, atomic_writer(target) as file:
        if suffix == ".mf4":
            _save_log_mf4(file, log.meta, log.names, log)
            return
        file.write(_head_text(log.meta, log.names))
        for table in log:
            file.write(_rows_text(_row_format(log.names), table))
        file.write(_tail_text(log.meta))


class Growing:
    """A log that is written to disk while it comes: what was appended is there, whatever ends the program.

    It grows beside its final place, as NAME-running.csv, or -running-2 and so on where that exists; finish() puts it in
    its place. `file` is where it is, `rows` how many rows it has.

    Raises FileError: it cannot be written, also by append() and finish(); what was written before stays in `file`.
    """

    def __init__(self, path: Path, meta: Mapping[str, Any], names: Sequence[str]) -> None:
        self._path = path
        self._suffix = _suffix(path)
        self._format = _row_format(names)
        self._known = frozenset(meta)  # at the beginning
        self._end = 0  # of what is whole
        self.rows = 0
        beside = Path(os.path.realpath(path))
        for number in itertools.count(1):
            self.file = beside.with_name(f"{beside.stem}-running{'' if number == 1 else f'-{number}'}.csv")
            try:
                self._out = create_for(path, self.file)
                break
            except FileExistsError:
                pass  # of a run that was killed, or that goes on
            except OSError as error:
                raise _unwritable(self.file, error) from error
        try:
            self._write(_head_text(meta, names))
        except FileError:
            self.discard()
            raise

    def append(self, table: Array) -> None:
        """Write rows (n, columns)."""
        self._write(_rows_text(self._format, table))
        self.rows += len(table)

    def finish(self, meta: Mapping[str, Any]) -> None:
        """Write what is known at the end, and put the log in its place."""
        late = {key: value for key, value in meta.items() if key not in self._known}
        self._write(_meta_text(late, at_the_end=False) + _tail_text(meta))
        self._out.close()
        if self._suffix == ".mf4":
            convert(self.file, self._path)
            self.file.unlink()
        else:
            put_in_place(self.file, self._path)
        self.file = self._path

    def close(self) -> None:
        """Leave it as it is."""
        self._out.close()

    def discard(self) -> None:
        """Remove it."""
        self._out.close()
        self.file.unlink(missing_ok=True)

    def _write(self, content: bytes) -> None:
        try:
            self._out.seek(self._end)
            self._out.truncate()  # what an interrupt left of a write
            done = 0
            while done < len(content):
                done += self._out.write(memoryview(content)[done:]) or 0
        except OSError as error:
            with suppress(OSError):
                self._out.truncate(self._end)
            raise _unwritable(self.file, error) from error
        self._end += len(content)


def csv_text(run: RunLog) -> str:
    """The log as CSV: `# key: JSON` lines, one header row, one row a tick, and again `# key: JSON` lines; an unknown
    value is an empty cell."""
    names = list(run.columns)
    table = np.column_stack(list(run.columns.values()))
    return (_head_text(run.meta, names) + _rows_text(_row_format(names), table) + _tail_text(run.meta)).decode()


def _head_text(meta: Mapping[str, Any], names: Sequence[str]) -> bytes:
    return f"{_FIRST_LINE}\n".encode() + _meta_text(meta, at_the_end=False) + f"{','.join(names)}\n".encode()


def _tail_text(meta: Mapping[str, Any]) -> bytes:
    return _meta_text(meta, at_the_end=True)


def _meta_text(meta: Mapping[str, Any], at_the_end: bool) -> bytes:
    lines = (f"# {key}: {json.dumps(meta[key])}\n" for key in meta if (key in KNOWN_AT_THE_END) == at_the_end)
    return "".join(lines).encode()


def _row_format(names: Sequence[str]) -> str:
    return ",".join(f"%.{_BY_NAME[name].digits}f" for name in names)


def _rows_text(row: str, table: Array) -> bytes:
    text = f"{row}\n" * len(table) % tuple(table.ravel().tolist())
    return text.replace("nan", "").encode()


def _open_csv(file: IO[bytes], path: Path) -> Source:
    lines = _text_lines(file, path)
    meta: dict[str, Any] = {}
    names: list[str] | None = None
    number = 0
    for number, line in lines:
        if number == 1:
            if line.rstrip("\n") != _FIRST_LINE:
                break
        elif line.startswith("#"):
            _read_meta(meta, line, path, number)
        else:
            names = line.rstrip("\n").split(",")
            break
    if number == 0 or (number == 1 and names is None and line.rstrip("\n") != _FIRST_LINE):
        raise FileError(path, f"is not a log of kontur: the first line must be '{_FIRST_LINE}'", line=1)
    if names is None:
        raise FileError(path, "ends before the header row", line=number)
    if len(set(names)) != len(names):
        raise FileError(path, "a column stands there twice", line=number)
    problem = _names_problem(names)
    if problem:
        raise FileError(path, problem, line=number)
    return Source(meta, names, _csv_tables(lines, meta, names, path, number))


def _csv_tables(
    lines: Iterator[tuple[int, str]], meta: dict[str, Any], names: list[str], path: Path, head: int
) -> Iterator[Array]:
    """The rows, while the lines after them fill in `meta`."""
    rows: list[list[float]] = []
    at: list[int] = []  # the lines of these
    check = _Increasing(names)
    cut = ""  # a last line that is not whole
    for number, line in lines:
        if not line.endswith("\n"):
            cut = line
        if line.startswith("#"):
            if not cut or "status" in meta:
                _read_meta(meta, line, path, number)
            continue
        try:
            rows.append(_csv_row(line.rstrip("\n"), names, path, number))
        except FileError:
            if cut and "status" not in meta:
                break
            raise
        at.append(number)
        if cut and "status" not in meta:
            rows.pop()  # its last cell may be cut, too
        if len(rows) == _ROWS:
            yield check.checked(np.array(rows), path, at)
            rows, at = [], []
    meta.setdefault("status", "killed")
    problem = _meta_problem(meta)
    if problem:
        raise FileError(path, problem, line=head)
    if rows:
        yield check.checked(np.array(rows), path, at)


def _text_lines(file: IO[bytes], path: Path) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(file, start=1):
        try:
            yield number, line.decode().replace("\r\n", "\n")
        except UnicodeDecodeError as error:
            raise FileError(path, "is not text; a CSV log of kontur was expected") from error


def _read_meta(meta: dict[str, Any], line: str, path: Path, number: int) -> None:
    key, _, value = line[1:].partition(":")
    try:
        meta[key.strip()] = json.loads(value)
    except (ValueError, RecursionError) as error:
        raise FileError(path, "the value after ':' is not JSON", line=number, word=key.strip()) from error
    problem = _values_problem({key.strip(): meta[key.strip()]})
    if problem:
        raise FileError(path, problem, line=number)


def _csv_row(line: str, names: list[str], path: Path, number: int) -> list[float]:
    cells = line.split(",")
    if len(cells) != len(names):
        raise FileError(path, f"{len(cells)} cells where the header row has {len(names)}", line=number)
    try:
        return [float(cell) if cell else math.nan for cell in cells]
    except ValueError as error:
        raise FileError(path, f"a cell is not a number: {str(error)[:80]}", line=number) from error


@dataclass(frozen=True)
class Mf4Channel:
    """A signal of an MF4 file."""

    name: str
    unit: str
    what: str


def mf4_bytes(
    kind: str, meta: Mapping[str, Any], group: str, time_s: Array, channels: Sequence[Mf4Channel], table: Array
) -> bytes:
    """An MF4 file of one group: `channels` over `time_s` (n,), with the values of `table` (n, channels); `meta` is its
    comment. Equal contents give equal bytes."""
    out = io.BytesIO()
    _save_mf4(out, kind, meta, group, channels, [(time_s, table)])
    return out.getvalue()


def _save_mf4(
    out: IO[bytes],
    kind: str,
    meta: Mapping[str, Any],
    group: str,
    channels: Sequence[Mf4Channel],
    tables: Iterable[tuple[Array, Array]],
) -> None:
    """mf4_bytes() of `tables`, each with its times, into a file. `meta` is read after the last one."""
    from asammdf import MDF, Signal  # importing it takes half a second
    from asammdf.blocks.v4_blocks import FileHistory

    mdf = MDF(version="4.10")
    try:
        mdf.start_time = _EPOCH
        history = FileHistory()
        history.time_stamp = _EPOCH
        history.comment = f"<FHcomment><TX>kontur {kind} 1</TX><tool_id>kontur</tool_id></FHcomment>"
        mdf.file_history.append(history)
        tables = iter(tables)
        time_s, table = next(tables, (np.empty(0), np.empty((0, len(channels)))))
        mdf.append(
            [
                Signal(values.copy(), time_s, name=c.name, unit=c.unit, comment=c.what)
                for c, values in zip(channels, table.T, strict=True)
            ],
            acq_name=group,
            common_timebase=True,
        )
        for time_s, table in tables:
            mdf.extend(0, [(time_s, None), *((values.copy(), None) for values in table.T)])
        mdf.header.comment = f"<HDcomment><TX>{escape(json.dumps(meta), quote=False)}</TX></HDcomment>"
        mdf.save(out, add_history_block=False)
    finally:
        mdf.close()


def _save_log_mf4(out: IO[bytes], meta: Mapping[str, Any], names: Sequence[str], tables: Iterable[Array]) -> None:
    time = list(names).index("time_s")
    channels = [Mf4Channel(name, _BY_NAME[name].unit, _BY_NAME[name].what) for name in names if name != "time_s"]
    over_time = ((table[:, time].copy(), np.delete(table, time, axis=1)) for table in tables)
    _save_mf4(out, "log", meta, "telemetry", channels, over_time)


def _mf4_bytes(run: RunLog) -> bytes:
    out = io.BytesIO()
    _save_log_mf4(out, run.meta, list(run.columns), [np.column_stack(list(run.columns.values()))])
    return out.getvalue()


def _of_mf4(mdf: MDF, path: Path) -> Source:
    try:
        meta = json.loads(mdf.header.description)
        rows = int(mdf.groups[0].channel_group.cycles_nr)
        names = ["tick", "time_s", *(name for name in mdf.channels_db if name in _BY_NAME and name != "tick")]
        mdf.get("tick", group=0, record_count=1)
    except Exception as error:
        raise FileError(path, "is an MF4 file, but not a log of kontur") from error
    names = [column.name for column in COLUMNS if column.name in names]
    problem = _meta_problem(meta) or _names_problem(names)
    if problem:
        raise FileError(path, problem)
    return Source(meta, names, _mf4_tables(mdf, names, rows, path))


def _mf4_tables(mdf: MDF, names: list[str], rows: int, path: Path) -> Iterator[Array]:
    check = _Increasing(names)
    channels = [name for name in names if name != "time_s"]
    for first in range(0, rows, _ROWS):
        try:
            signals = mdf.select(
                [(name, 0, None) for name in channels], record_offset=first, record_count=min(_ROWS, rows - first)
            )
            found = {name: signal.samples for name, signal in zip(channels, signals, strict=True)}
            found["time_s"] = signals[0].timestamps
            table = np.column_stack([np.asarray(found[name], dtype=np.float64) for name in names])
        except Exception as error:
            raise FileError(path, "is an MF4 file, but not a log of kontur") from error
        yield check.checked(table, path, None)


def _open_mf4(file: IO[bytes]) -> MDF | None:
    from asammdf import MDF

    mdf = None
    with suppress(Exception):  # its parser raises many kinds
        mdf = MDF(file)
    if mdf is None:  # the destructor fails on a file that the constructor could not read, and would print that
        hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
        gc.collect()
        sys.unraisablehook = hook
    return mdf


class _Increasing:
    """Checks that ticks and times increase from row to row, from one table to the next as well, and the values."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = list(names)
        self._at = [self._names.index(name) for name in ("tick", "time_s")]
        self._last = np.empty((0, 2))

    def checked(self, table: Array, path: Path, lines: Sequence[int] | None) -> Array:
        """`table`, whose rows stand in `lines` of a text file. Raises FileError."""
        both = np.concatenate([self._last, table[:, self._at]])
        good = np.isfinite(both).all(axis=1)
        with np.errstate(invalid="ignore"):
            good[1:] &= (np.diff(both, axis=0) > 0).all(axis=1)
        problem = (
            problem_of_values(dict(zip(self._names, table.T, strict=True)))
            if good.all()
            else (int(np.argmin(good)) - len(self._last), _NOT_INCREASING)
        )
        if problem:
            raise FileError(path, problem[1], line=lines[problem[0]] if lines is not None else None)
        self._last = both[-1:]
        return table


def _unwritable(path: Path, error: OSError) -> FileError:
    return FileError(path, f"cannot be written ({error.strerror}); make room, or name another file")


def _meta_problem(meta: object) -> str | None:
    if not isinstance(meta, Mapping):
        return "there is no head that describes the run"
    missing = [key for key in REQUIRED_META if key not in meta]
    if missing:
        return f"the head lacks {', '.join(missing)}"
    return _values_problem(meta)


def _values_problem(meta: Mapping[str, Any]) -> str | None:
    if "status" in meta and meta["status"] not in STATUS:
        return f"status is {meta['status']!r}, not one of {', '.join(STATUS)}"
    return problem_of_kinds(meta)


def _names_problem(names: Iterable[str]) -> str | None:
    missing = [column.name for column in COLUMNS if column.required and column.name not in names]
    if missing:
        return f"column {', '.join(missing)} is missing"
    unknown = [name for name in names if name not in _BY_NAME]
    if unknown:
        return f"column {', '.join(unknown)} is unknown; known are {', '.join(_BY_NAME)}"
    return None


def _columns_problem(columns: Mapping[str, Array]) -> str | None:
    problem = _names_problem(columns)
    if problem:
        return problem
    if len({np.shape(values) for values in columns.values()}) != 1 or np.ndim(columns["tick"]) != 1:
        return "columns differ in length"
    if not all(
        np.all(np.isfinite(columns[name])) and np.all(np.diff(columns[name]) > 0) for name in ("tick", "time_s")
    ):
        return _NOT_INCREASING
    problem_of_value = problem_of_values(columns)
    return problem_of_value[1] if problem_of_value else None


def _suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".mf4"):
        raise LogError(f"{path}: a log ends in .csv or .mf4")
    return suffix
