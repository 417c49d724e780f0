# SPDX-License-Identifier: Apache-2.0
"""A sweep: runs on simulated machines over a grid and a sample of inputs, in processes, into one table.

A sweep is a TOML file. Each key is an input of every run: a value, or a list of values. The grid is the product of all
lists. A table {low, high, log} is a range, which is drawn anew in each of `draws`; a draw meets every point of the
grid. A table {first, count} is a list of integers.

A row depends on its inputs alone, so the table is the same with any number of workers, bit for bit. Rows are appended
to one file as they come, with what was swept in its first line. A sweep that was broken off goes on from there.
"""

from __future__ import annotations

import csv
import functools
import hashlib
import importlib.util
import io
import itertools
import json
import math
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from multiprocessing import connection, get_context, parent_process
from pathlib import Path
from typing import Any

import numpy as np

from kontur.drive import parameter_file
from kontur.drive.controllers import CONTROLLERS, named
from kontur.drive.target import Target
from kontur.errors import FileError, KonturError, ParameterError, SimulatorError
from kontur.files import read_bytes, read_toml, write_atomically
from kontur.machine import ALL, COMPENSATIONS, FULL, MACHINES, TOLD, Axis, Machine
from kontur.machine import load as load_machine
from kontur.path import programs
from kontur.path.sizes import DEFAULT_FEED_MPS, SHAPES, shape
from kontur.planning.bounds import limits
from kontur.planning.planner import Trajectory, plan
from kontur.runs.runner import RunOptions, run
from kontur.runs.summary import SUMMARY, summary
from kontur.sim import NUMS
from kontur.sim.library import LIBRARIES

Inputs = dict[str, Any]
Row = dict[str, Any]

_SIZES = sorted({size for sizes in SHAPES.values() for size in sizes})
_FILES = ("path", "machine", "params")
_NUMBERS = ("feed", "accel", "jerk", "score_from", *_SIZES)
_CHOICES = {"controller": CONTROLLERS, "num": NUMS, "told": TOLD, "compensation": COMPENSATIONS}
_PREFIXES = ("set.", "x.", "y.")
_AXIS = {field.name for field in fields(Axis) if field.type == "float"}
_RUNS_MAX = 1_000_000


@dataclass(frozen=True)
class Sweep:
    """The inputs of each run, in the order of the table, and the digest of all that decides the results."""

    runs: tuple[Inputs, ...]
    digest: str


def load(file: Path) -> Sweep:
    """Read the file of a sweep. Raises FileError, which names the key and what is wrong with it."""
    table = _flat(read_toml(file))
    draws, seed = _whole(file, "draws", table.pop("draws", 1)), _whole(file, "draw_seed", table.pop("draw_seed", 1))
    ranges: dict[str, tuple[float, float, bool]] = {}
    lists: dict[str, list[Any]] = {"path": ["circle"], "controller": ["ccu"], "seed": [1]}
    for key, value in table.items():
        if isinstance(value, Mapping) and "low" in value:
            ranges[key] = _range(file, key, value)
        else:
            lists[key] = _values(file, key, value)
            if not lists[key]:
                raise FileError(file, "has no value; give one, or leave the key out", word=key)
    count = draws * math.prod(len(values) for values in lists.values())
    if count > _RUNS_MAX:
        raise FileError(file, f"asks for {count} runs; at most {_RUNS_MAX} are possible")
    runs = []
    for draw in range(draws):
        rng = np.random.default_rng([seed, draw])
        drawn: Inputs = {"draw": draw} if draws > 1 or ranges else {}
        drawn |= {key: _drawn(rng, *bounds) for key, bounds in ranges.items()}
        runs += [
            _checked(file, dict(zip(lists, point, strict=True)) | drawn) for point in itertools.product(*lists.values())
        ]
    return Sweep(tuple(runs), _digest(runs))


def _flat(table: Mapping[str, Any]) -> dict[str, Any]:
    """Keys of the tables set, x and y as `set.NAME` and so on; a name with a point may stand in quotes or not."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        if key in ("set", "x", "y") and isinstance(value, Mapping):
            for name, inner in value.items():
                if key == "set" and isinstance(inner, Mapping) and not {"low", "first"} & inner.keys():
                    flat |= {f"set.{name}.{last}": one for last, one in inner.items()}
                else:
                    flat[f"{key}.{name}"] = inner
        else:
            flat[key] = value
    return flat


def _values(file: Path, key: str, value: Any) -> list[Any]:
    if isinstance(value, Mapping):
        if value.keys() != {"first", "count"}:
            raise FileError(file, "must have low and high, or first and count", word=key)
        first, count = (_whole(file, f"{key}.{name}", value[name]) for name in ("first", "count"))
        return list(range(first, first + min(count, _RUNS_MAX + 1)))
    return list(value) if isinstance(value, list) else [value]


def _whole(file: Path, key: str, value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 2**63:
        raise FileError(file, "must be an integer from 0 on", word=key)
    return value


def _range(file: Path, key: str, value: Mapping[str, Any]) -> tuple[float, float, bool]:
    low, high, log = value["low"], value.get("high"), value.get("log", False)
    if value.keys() - {"low", "high", "log"} or not isinstance(log, bool) or not (_number(low) and _number(high)):
        raise FileError(
            file, "must be { low = NUMBER, high = NUMBER }, and log = true for a logarithmic scale", word=key
        )
    low, high = float(low), float(high)  # type: ignore[arg-type]
    if not low < high or (log and low <= 0.0):
        raise FileError(file, "low must be below high, and above 0 on a logarithmic scale", word=key)
    return low, high, log


def _drawn(rng: np.random.Generator, low: float, high: float, log: bool) -> float:
    share = rng.uniform()
    return float(low * (high / low) ** share if log else low + (high - low) * share)


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _checked(file: Path, inputs: Inputs) -> Inputs:
    """The inputs of a run, with names of files as they are opened. Raises FileError."""
    out = dict(inputs)
    for key, value in inputs.items():
        prefix = next((p for p in _PREFIXES if key.startswith(p)), "")
        known = key in (*_FILES, *_NUMBERS, *_CHOICES, "seed", "draw") or prefix == "set."
        if not known and key[len(prefix) :] not in (_AXIS if prefix else ()):
            names = f"set.PARAMETER, x.KEY, y.KEY of a machine, {', '.join((*_FILES, *_CHOICES, 'seed', *_NUMBERS))}"
            raise FileError(file, f"is no input of a run; inputs are {names}, and draws, draw_seed", word=key)
        if key in _FILES:
            if not isinstance(value, str):
                raise FileError(file, "must be a text", word=key)
            out[key] = _file(file, key, value)
        elif key in _CHOICES:
            out[key] = _choice(file, key, value)
        elif key in ("seed", "draw"):
            _whole(file, key, value)
        elif not _number(value):
            raise FileError(file, f"must be a number, not {value!r}", word=key)
    for size in inputs.keys() & set(_SIZES):
        if size not in SHAPES.get(out["path"], {}):
            raise FileError(file, f"does not belong to the path {out['path']}", word=size)
    return out


def _choice(file: Path, key: str, value: Any) -> str:
    if key == "controller" and isinstance(value, str):
        with suppress(ParameterError):
            return named(value)
    elif value in _CHOICES[key]:
        return str(value)
    raise FileError(file, f"must be one of {', '.join(_CHOICES[key])}, not {value!r}", word=key)


def _file(file: Path, key: str, name: str) -> str:
    """A shape or a packaged machine as it is, a file beside the file of the sweep, or as seen from here."""
    if key == "path" and name in SHAPES:
        return name
    packaged = MACHINES / f"{name}.toml"
    places = [file.parent / name, Path(name), *([packaged] if key == "machine" and os.sep not in name else [])]
    found = next((place for place in places if os.path.isfile(place)), None)
    if found is None:
        raise FileError(
            file, f"there is no {key} of this name: a file beside this one, or a name that comes along", word=name
        )
    return str(found)


def _digest(runs: Sequence[Inputs]) -> str:
    """Of the inputs, of the files that they name, and of the firmware."""
    named_files = {run[key] for run in runs for key in _FILES if key in run and run[key] not in SHAPES}
    found = hashlib.sha256(json.dumps(runs).encode())
    for name in [*sorted(named_files), *sorted(map(str, LIBRARIES.glob("libkontur_*")))]:
        found.update(hashlib.sha256(read_bytes(Path(name))).digest())
    return found.hexdigest()


def one_run(inputs: Inputs) -> Row:
    """The figures of a run (kontur.runs.summary.SUMMARY), and `problem`: why it has none, or ended before its end."""
    row: Row = dict.fromkeys((*SUMMARY, "problem"))
    try:
        machine = _machine(tuple((key, inputs[key]) for key in inputs if key == "machine" or key[:2] in ("x.", "y.")))
        trajectory = _planned(machine, tuple((key, inputs[key]) for key in ("path", *_NUMBERS) if key in inputs))
        values = parameter_file.read(inputs["params"]) if "params" in inputs else {}
        values |= {key.removeprefix("set."): float(inputs[key]) for key in inputs if key.startswith("set.")}
        target = Target(
            machine=machine,
            seed=inputs["seed"],
            num=inputs.get("num", NUMS[0]),
            told=inputs.get("told", ALL),
            compensation=inputs.get("compensation", FULL),
        )
        options = RunOptions(values, score_from_s=float(inputs.get("score_from", 0.0)), raise_fault=False, whole=False)
        result = run(trajectory, inputs["controller"], target, options)
        row |= summary(result.log)
        row["problem"] = next((str(one) for one in (result.error, result.fault) if one is not None), None)
    except KonturError as error:
        row["problem"] = str(error)
    return row


@functools.lru_cache(4)
def _machine(inputs: tuple[tuple[str, Any], ...]) -> Machine:
    given = dict(inputs)
    machine = load_machine(given.pop("machine")) if "machine" in given else load_machine()
    for axis in "xy":
        changed = {key[2:]: float(value) for key, value in given.items() if key.startswith(f"{axis}.")}
        machine = replace(machine, **{axis: replace(getattr(machine, axis), **changed)})
    return machine


@functools.lru_cache(4)
def _planned(machine: Machine, inputs: tuple[tuple[str, Any], ...]) -> Trajectory:
    given = dict(inputs)
    feed_mps = given["feed"] * 1e-3 if "feed" in given else None
    if given["path"] in SHAPES:
        sizes = {size: float(given[size]) for size in _SIZES if size in given}
        program = shape(given["path"], sizes, DEFAULT_FEED_MPS if feed_mps is None else feed_mps)
    else:
        program = programs.load(given["path"], feed_mps)
    bounds = limits(machine, given.get("accel"), given.get("jerk"))
    return plan(program, bounds, travel_m=machine.soft_limits_m)


def carry_out(
    sweep: Sweep, rows_file: Path, workers: int | None = None, progress: Callable[[float], None] = lambda share: None
) -> list[Row]:
    """Run what `rows_file` does not have yet, in `workers` processes (default: all cores), and append it there.

    Returns the rows in the order of the runs. Raises FileError: the file cannot be written, or is of another sweep;
    SimulatorError: a process was killed. What is done then stays in the file.
    """
    done = _begun(sweep, rows_file)
    left = [number for number in range(len(sweep.runs)) if number not in done]
    progress(len(done) / len(sweep.runs))
    try:
        with rows_file.open("ab") as file:
            for number, row in _results([(number, sweep.runs[number]) for number in left], workers):
                done[number] = row
                file.write(_line({"run": number} | row))
                file.flush()
                progress(len(done) / len(sweep.runs))
            os.fsync(file.fileno())
    except OSError as error:
        raise FileError(
            rows_file, f"cannot be written ({error.strerror}); the same command goes on from there"
        ) from error
    return [sweep.runs[number] | done[number] for number in range(len(sweep.runs))]


def _begun(sweep: Sweep, rows_file: Path) -> dict[int, Row]:
    """The rows that `rows_file` has, after a line that was cut off has been removed from it; begins a new file."""
    head = _line({"kontur_sweep": 1, "digest": sweep.digest, "runs": len(sweep.runs)})
    content = read_bytes(rows_file) if os.path.exists(rows_file) else b""
    whole = content[: content.rfind(b"\n") + 1]
    if not whole:
        if content and not head.startswith(content):
            raise FileError(rows_file, "is no file of a sweep; name another one")
        write_atomically(rows_file, head)
        return {}
    if not whole.startswith(head):
        raise FileError(
            rows_file, "is of another sweep, or of other files or firmware; remove it, or name another output"
        )
    try:
        done = {}
        for line in whole[len(head) :].splitlines():
            row = json.loads(line)
            done[row.pop("run")] = row
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise FileError(rows_file, "has a line that is no row of a sweep; remove the file, or name another") from error
    if whole != content:
        write_atomically(rows_file, whole)
    return done


def _line(value: Mapping[str, Any]) -> bytes:
    return json.dumps(value).encode() + b"\n"


def _results(jobs: Sequence[tuple[int, Inputs]], workers: int | None) -> Iterator[tuple[int, Row]]:
    """Number and row of each job, as they come."""
    jobs_left = iter(jobs)
    count = min(workers or os.cpu_count() or 1, max(len(jobs), 1))
    with ProcessPoolExecutor(count, get_context("spawn"), _start_worker) as pool:
        waiting: dict[Future[Row], int] = {}

        def submit(some: Iterable[tuple[int, Inputs]]) -> None:
            waiting.update({pool.submit(one_run, inputs): number for number, inputs in some})

        try:
            submit(itertools.islice(jobs_left, 2 * count))
            while waiting:
                for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                    yield waiting.pop(future), future.result()
                    submit(itertools.islice(jobs_left, 1))
        except BrokenProcessPool as error:
            raise SimulatorError(
                "a process of the sweep was killed, perhaps for lack of memory; the same command goes on from there, "
                "and --workers makes them fewer"
            ) from error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _start_worker() -> None:
    """Leave Ctrl-C to the parent, and end with it, however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    assert parent is not None

    def end_with_parent() -> None:
        connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()


def csv_bytes(rows: Sequence[Row]) -> bytes:
    """The table with a line for each run; an empty cell is not known. Numbers have all their digits."""
    out = io.StringIO()
    table = csv.DictWriter(out, list(rows[0]), lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return out.getvalue().encode()


def has_parquet() -> bool:
    """Whether the package pyarrow is there (the extra `sweep`)."""
    return importlib.util.find_spec("pyarrow") is not None


def parquet_bytes(rows: Sequence[Row]) -> bytes:
    """The same table as Parquet, by pyarrow."""
    import pyarrow
    import pyarrow.parquet

    out = io.BytesIO()
    columns = {name: pyarrow.array([row[name] for row in rows]) for name in rows[0]}
    pyarrow.parquet.write_table(pyarrow.table(columns), out)
    return out.getvalue()
