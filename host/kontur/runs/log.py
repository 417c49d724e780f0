# SPDX-License-Identifier: Apache-2.0
"""The log of one run: what was run (`meta`) and one row a telemetry tick (`columns`), as CSV or MF4.

`COLUMNS` has names, units and digits of all columns; those of the telemetry are the signals' (kontur.can.signals).
`META` has the keys of `meta`. A log holds no wall clock, so equal runs give equal files, byte for byte. CSV carries the
digits of the table, MF4 the doubles themselves. Files are written atomically.
"""

from __future__ import annotations

import gc
import io
import json
import math
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timezone
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kontur.can import signals
from kontur.errors import FileError, LogError
from kontur.files import read_bytes, write_atomically
from kontur.runs.head import problem_of_kinds, problem_of_values

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
    *_measured(fast=False),
    Column("true_position_x_mm", "mm", 9, "true position of the simulated machine, x"),
    Column("true_position_y_mm", "mm", 9, "true position of the simulated machine, y"),
    Column("true_contour_error_um", "um", 6, "true distance to the programmed path, positive on its left"),
    Column("true_tangential_error_um", "um", 6, "true error along the programmed path, negative behind"),
)

META = {
    "program": "name of the part program or shape",
    "controller": "name of the control law",
    "status": "complete, interrupted or fault: why the rows end",
    "fault": "message of the fault that ended the run",
    "trajectory": "SHA-256 of the knots",
    "machine": "name of the machine, or of the bus of a real drive",
    "plant": "the simulated machine's values",
    "seed": "seed of the simulated noise",
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
    "force_max_N": "greatest force of an axis at the control rate",
    "force_step_N": "mean change of force from one control period to the next",
}
REQUIRED_META = ("program", "controller", "status")
STATUS = ("complete", "interrupted", "fault")

_FIRST_LINE = "# kontur log 1"
_BY_NAME = {column.name: column for column in COLUMNS}
_EPOCH = datetime(2000, 1, 1, tzinfo=timezone.utc)  # MF4 demands a start time; the true one would differ each run


@dataclass(frozen=True)
class RunLog:
    """One run: `meta` (keys of `META`, JSON values) and `columns` (names of `COLUMNS`, each (n,); NaN: unknown).

    Columns are put into the order of the table.

    Raises LogError: a key or column of the required ones is missing, a column is unknown or of another length, ticks do
    not increase.
    """

    meta: Mapping[str, Any]
    columns: Mapping[str, Array]

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


def write(run: RunLog, path: str | Path) -> None:
    """Write CSV or MF4, by the suffix of `path`. Raises LogError: another suffix; FileError."""
    path = Path(path)
    content = _mf4_bytes(run) if _suffix(path) == ".mf4" else csv_text(run).encode()
    write_atomically(path, content)


def read(path: str | Path) -> RunLog:
    """Read CSV or MF4, by the suffix. Raises LogError: another suffix; FileError: not readable as a log of kontur."""
    path = Path(path)
    suffix = _suffix(path)
    content = read_bytes(path)
    return _parse_mf4(content, path) if suffix == ".mf4" else _parse_csv(content, path)


def csv_text(run: RunLog) -> str:
    """The log as CSV: `# key: JSON` lines, one header row, one row a tick; an unknown value is an empty cell."""
    head = [_FIRST_LINE, *(f"# {key}: {json.dumps(value)}" for key, value in run.meta.items()), ",".join(run.columns)]
    row = ",".join(f"%.{_BY_NAME[name].digits}f" for name in run.columns)
    rows = [row % values for values in zip(*(column.tolist() for column in run.columns.values()), strict=True)]
    return "\n".join(head) + "\n" + "".join(line.replace("nan", "") + "\n" for line in rows)


def _parse_csv(content: bytes, path: Path) -> RunLog:
    try:
        lines = content.decode().splitlines()
    except UnicodeDecodeError as error:
        raise FileError(path, "is not text; a CSV log of kontur was expected") from error
    if not lines or lines[0] != _FIRST_LINE:
        raise FileError(path, f"is not a log of kontur: the first line must be '{_FIRST_LINE}'", line=1)
    meta: dict[str, Any] = {}
    head = 1
    while head < len(lines) and lines[head].startswith("#"):
        key, _, value = lines[head][1:].partition(":")
        try:
            meta[key.strip()] = json.loads(value)
        except (ValueError, RecursionError) as error:
            raise FileError(path, "the value after ':' is not JSON", line=head + 1, word=key.strip()) from error
        head += 1
    if head == len(lines):
        raise FileError(path, "ends before the header row", line=head)
    names = lines[head].split(",")
    table = np.array(
        [_csv_row(line, names, path, number) for number, line in enumerate(lines[head + 1 :], start=head + 2)]
    ).reshape(-1, len(names))
    columns = dict(zip(names, table.T.copy(), strict=True))
    if len(columns) != len(names):
        raise FileError(path, "a column stands there twice", line=head + 1)
    return _checked(meta, columns, path, head + 1)


def _csv_row(line: str, names: list[str], path: Path, number: int) -> list[float]:
    cells = line.split(",")
    if len(cells) != len(names):
        raise FileError(path, f"{len(cells)} cells where the header row has {len(names)}", line=number)
    try:
        return [float(cell) if cell else math.nan for cell in cells]
    except ValueError as error:
        raise FileError(path, f"a cell is not a number: {error}", line=number) from error


def _mf4_bytes(run: RunLog) -> bytes:
    columns = [Mf4Channel(n, _BY_NAME[n].unit, _BY_NAME[n].what, v) for n, v in run.columns.items() if n != "time_s"]
    return mf4_bytes("log", run.meta, "telemetry", run.columns["time_s"], columns)


@dataclass(frozen=True)
class Mf4Channel:
    """A signal on its way to an MF4 file."""

    name: str
    unit: str
    what: str
    values: Array


def mf4_bytes(kind: str, meta: Mapping[str, Any], group: str, time_s: Array, channels: Sequence[Mf4Channel]) -> bytes:
    """An MF4 file of one group of `channels` over `time_s`; `meta` is its comment. Equal contents give equal bytes."""
    from asammdf import MDF, Signal  # importing it takes half a second
    from asammdf.blocks.v4_blocks import FileHistory

    mdf = MDF(version="4.10")
    try:
        mdf.start_time = _EPOCH
        mdf.header.comment = f"<HDcomment><TX>{escape(json.dumps(meta), quote=False)}</TX></HDcomment>"
        history = FileHistory()
        history.time_stamp = _EPOCH
        history.comment = f"<FHcomment><TX>kontur {kind} 1</TX><tool_id>kontur</tool_id></FHcomment>"
        mdf.file_history.append(history)
        mdf.append(
            [Signal(c.values, time_s, name=c.name, unit=c.unit, comment=c.what) for c in channels],
            acq_name=group,
            common_timebase=True,
        )
        out = io.BytesIO()
        mdf.save(out, add_history_block=False)
        return out.getvalue()
    finally:
        mdf.close()


def _parse_mf4(content: bytes, path: Path) -> RunLog:
    mdf = _open_mf4(content)
    if mdf is None:
        raise FileError(path, "is not an MF4 file, or an incomplete one")
    try:
        meta = json.loads(mdf.header.description)
        signals = [mdf.get(name, group=0) for name in mdf.channels_db if name in _BY_NAME and name != "tick"]
        tick = mdf.get("tick", group=0)
    except Exception as error:
        raise FileError(path, "is an MF4 file, but not a log of kontur") from error
    finally:
        mdf.close()
    columns = {"tick": tick.samples, "time_s": tick.timestamps} | {s.name: s.samples for s in signals}
    return _checked(meta, columns, path, None)


def _open_mf4(content: bytes) -> MDF | None:
    from asammdf import MDF

    mdf = None
    with suppress(Exception):  # its parser raises many kinds
        mdf = MDF(io.BytesIO(content))
    if mdf is None:  # the destructor fails on a file that the constructor could not read, and would print that
        hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
        gc.collect()
        sys.unraisablehook = hook
    return mdf


def _checked(meta: dict[str, Any], columns: dict[str, Array], path: Path, line: int | None) -> RunLog:
    problem = _meta_problem(meta) or _columns_problem(columns)
    if problem:
        raise FileError(path, problem, line=line)
    return RunLog(meta, columns)


def _meta_problem(meta: object) -> str | None:
    if not isinstance(meta, Mapping):
        return "there is no head that describes the run"
    missing = [key for key in REQUIRED_META if key not in meta]
    if missing:
        return f"the head lacks {', '.join(missing)}"
    if meta["status"] not in STATUS:
        return f"status is {meta['status']!r}, not one of {', '.join(STATUS)}"
    return problem_of_kinds(meta)


def _columns_problem(columns: Mapping[str, Array]) -> str | None:
    missing = [column.name for column in COLUMNS if column.required and column.name not in columns]
    if missing:
        return f"column {', '.join(missing)} is missing"
    unknown = [name for name in columns if name not in _BY_NAME]
    if unknown:
        return f"column {', '.join(unknown)} is unknown; known are {', '.join(_BY_NAME)}"
    if len({np.shape(values) for values in columns.values()}) != 1 or np.ndim(columns["tick"]) != 1:
        return "columns differ in length"
    if not all(
        np.all(np.isfinite(columns[name])) and np.all(np.diff(columns[name]) > 0) for name in ("tick", "time_s")
    ):
        return "tick and time_s do not increase from row to row"
    return problem_of_values(columns)


def _suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".mf4"):
        raise LogError(f"{path}: a log ends in .csv or .mf4")
    return suffix
