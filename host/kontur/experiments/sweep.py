# SPDX-License-Identifier: Apache-2.0
"""A sweep: what runs it has, on simulated machines over a grid and a sample of inputs, and what a run of it gives.

A sweep is a TOML file. Each key is an input of every run: a value, or a list of values. The grid is the product of all
lists. A table {low, high, log} is a range, which is drawn anew in each of `draws`; a draw meets every point of the
grid. A table {first, count} is a list of integers.
"""

from __future__ import annotations

import functools
import hashlib
import itertools
import math
import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from kontur.drive import parameter_file
from kontur.drive.controllers import CONTROLLERS, named
from kontur.drive.objects import unknown
from kontur.drive.target import Target, open_drive
from kontur.errors import FileError, KonturError, ParameterError
from kontur.experiments.engine import Row
from kontur.files import read_bytes, read_toml
from kontur.machine import ALL, COMPENSATIONS, DEFAULT, FULL, MACHINES, TOLD, Axis, Machine
from kontur.machine import load as load_machine
from kontur.path import programs
from kontur.path.sizes import DEFAULT_FEED_MPS, SHAPES, shape
from kontur.planning.bounds import limits
from kontur.planning.planner import Trajectory, plan
from kontur.runs.runner import RunOptions, RunResult, run
from kontur.runs.summary import NOT_MOVED, SUMMARY, summarise, summary
from kontur.sim import NUMS

Inputs = dict[str, Any]

_SIZES = sorted({size for sizes in SHAPES.values() for size in sizes})
_FILES = ("path", "machine", "params")
_NUMBERS = ("feed", "accel", "jerk", "score_from", *_SIZES)
_CHOICES = {"controller": CONTROLLERS, "num": NUMS, "told": TOLD, "compensation": COMPENSATIONS}
_PREFIXES = ("set.", "x.", "y.")
_AXIS = {field.name for field in fields(Axis) if field.type == "float"}
_RUNS_MAX = 1_000_000


@dataclass(frozen=True)
class Sweep:
    """The inputs of each run, in the order of the table, and the files that they name."""

    runs: tuple[Inputs, ...]
    files: frozenset[str]


def load(file: Path) -> Sweep:
    """Read the file of a sweep. Raises FileError, which names the key and what is wrong with it."""
    table = _flat(read_toml(file))
    draws, seed = _whole(file, "draws", table.pop("draws", 1), 1), _whole(file, "draw_seed", table.pop("draw_seed", 1))
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
    _check_files(file, runs)
    files = {run[key] for run in runs for key in _FILES if key in run and os.path.isabs(run[key])}
    return Sweep(tuple(runs), frozenset(files))


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


def _whole(file: Path, key: str, value: Any, least: int = 0) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value < 2**63:
        raise FileError(file, f"must be an integer from {least} on", word=key)
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
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


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
    """The name of a shape or of a packaged machine as it is; of a file, beside that of the sweep or here, absolute."""
    if key == "path" and name in SHAPES:
        return name
    found = next((place for place in (file.parent / name, Path(name)) if os.path.isfile(place)), None)
    if found is not None:
        return os.path.abspath(found)
    if key == "machine" and os.sep not in name and os.path.isfile(MACHINES / f"{name}.toml"):
        return name
    raise FileError(
        file, f"there is no {key} of this name: a file beside this one, or a name that comes along", word=name
    )


def _check_files(file: Path, runs: Sequence[Inputs]) -> None:
    """Refuse files that cannot be read, and names of parameters that no drive has, before anything runs.

    A value that cannot be is the problem of a run.
    """
    for name in {one.get("machine", DEFAULT.stem) for one in runs}:
        _machine({"machine": name})
    for path, feed in {one["path"]: one.get("feed") for one in runs}.items():
        if path not in SHAPES:
            programs.load(path, None if feed is None else feed * 1e-3)
    names = [(file, key.removeprefix("set.")) for key in runs[0] if key.startswith("set.")]
    for params in sorted({Path(one["params"]) for one in runs if "params" in one}):
        names += [(params, name) for name in parameter_file.read(params)]
    if names:
        with open_drive(Target()) as device:
            for where, name in names:
                if name not in device.parameters:
                    raise FileError(where, unknown(name, device.parameters), word=name)


def one_run(inputs: Inputs) -> Row:
    """The figures of a run (kontur.runs.summary.SUMMARY), and `problem`: why it has none, or ended before its end."""
    row: Row = dict.fromkeys((*SUMMARY, "problem"))
    try:
        machine = _machine(inputs)
        path = tuple((key, inputs[key]) for key in ("path", *_NUMBERS) if key in inputs and key != "score_from")
        content = b"" if inputs["path"] in SHAPES else hashlib.sha256(read_bytes(Path(inputs["path"]))).digest()
        trajectory = _planned(machine, path, content)
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
        row["problem"] = _problem(result, options)
    except KonturError as error:
        row["problem"] = str(error)
    except Exception as error:  # the other runs have their figures all the same
        row["problem"] = f"error in Kontur itself, which should be reported: {type(error).__name__}: {error}"
    return row


def _problem(result: RunResult, options: RunOptions) -> str | None:
    """Why the figures are missing, or not those of the whole run that was asked for."""
    for broken_off in (result.error, result.fault):
        if broken_off is not None:
            return str(broken_off)
    found = summarise(result.log)
    if not found.scored:
        return NOT_MOVED
    if found.from_s < options.score_from_s:
        return "score_from is after the end of the run; its figures are those of all of it"
    return None


def _machine(inputs: Inputs) -> Machine:
    name = inputs.get("machine", DEFAULT.stem)
    changes = {
        axis: {key[2:]: float(inputs[key]) for key in inputs if key.startswith(f"{axis}.")} for axis in ("x", "y")
    }
    return load_machine(name if os.path.isabs(name) else MACHINES / f"{name}.toml", changes)


@functools.lru_cache(4)
def _planned(machine: Machine, inputs: tuple[tuple[str, Any], ...], content: bytes) -> Trajectory:
    """`content` is a digest of the file, which may be another one when a worker is asked again."""
    given = dict(inputs)
    feed_mps = given["feed"] * 1e-3 if "feed" in given else None
    if given["path"] in SHAPES:
        sizes = {size: float(given[size]) for size in _SIZES if size in given}
        program = shape(given["path"], sizes, DEFAULT_FEED_MPS if feed_mps is None else feed_mps)
    else:
        program = programs.load(given["path"], feed_mps)
    bounds = limits(machine, given.get("accel"), given.get("jerk"))
    return plan(program, bounds, travel_m=machine.soft_limits_m)
