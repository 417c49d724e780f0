# SPDX-License-Identifier: Apache-2.0
"""A circular test as a record: its conditions, and what it found at each feed; as a JSON file, to compare with later.

A file holds no wall clock, so equal tests give equal files, byte for byte.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from kontur.errors import FileError
from kontur.files import read_text, write_atomically
from kontur.runs.circularity import PLACES, PROFILE, SENSES, Circularity, Floats, Spike, circularity, profiles

VERSION = 1
BY = ("true", "drive")
"""By which positions: the true ones of a simulation, and those that the drive reports."""
_LONGEST = 200  # characters of a text of the file
_GREATEST = 1e9  # of its numbers


@dataclass(frozen=True)
class Trace:
    """What one kind of position says of both laps: figures and profiles (PROFILE,) in um."""

    figures: Circularity
    ccw_um: Floats
    cw_um: Floats


@dataclass(frozen=True)
class Circle:
    """Both laps at one feed, the planned one of the lap; `traces` by a name of BY. A real drive has no true one."""

    feed_mmps: float
    traces: Mapping[str, Trace]

    @property
    def best(self) -> Trace:
        """By the true position where it is known."""
        return next(self.traces[by] for by in BY if by in self.traces)


@dataclass(frozen=True)
class CircleTest:
    """A test: `conditions` (name to text or number), and a circle for each feed."""

    radius_mm: float
    conditions: Mapping[str, Any]
    circles: tuple[Circle, ...]

    def at(self, feed_mmps: float) -> Circle | None:
        """The circle at this feed, to a thousandth."""
        return next((one for one in self.circles if math.isclose(one.feed_mmps, feed_mmps, rel_tol=1e-3)), None)


def trace(ccw_mm: Floats, cw_mm: Floats, radius_mm: float) -> Trace:
    """The trace of two laps about the programmed centre."""
    return Trace(circularity(ccw_mm, cw_mm, radius_mm), *profiles(ccw_mm, cw_mm, radius_mm))


def figures(test: CircleTest) -> dict[str, Any]:
    """The test without its profiles, as JSON values."""
    return {
        "radius_mm": test.radius_mm,
        "conditions": dict(test.conditions),
        "circles": [
            {"feed_mmps": one.feed_mmps} | {by: asdict(found.figures) for by, found in one.traces.items()}
            for one in test.circles
        ],
    }


DEVIATIONS = {
    "g_ccw_um": "G ccw",
    "g_cw_um": "G cw",
    "g_both_um": "G(b)",
    "f_max_ccw_um": "Fmax ccw",
    "f_min_ccw_um": "Fmin ccw",
    "f_max_cw_um": "Fmax cw",
    "f_min_cw_um": "Fmin cw",
    "d_um": "D",
}
CAUSES = {
    "scale_um_per_m": "x longer than y, µm/m",
    "squareness_um_per_m": "squareness, µm/m",
    "backlash_x_um": "backlash x, µm",
    "backlash_y_um": "backlash y, µm",
    "lag_um": "x lags more, µm",
    "centre_x_um": "centre x, µm",
    "centre_y_um": "centre y, µm",
}
"""The columns of the tables for people, with their headings."""
HEADINGS = {"feed": "mm/s", "by": "position", "sense": "sense"} | DEVIATIONS | CAUSES


def rows(test: CircleTest, before: CircleTest | None, names: Mapping[str, str]) -> list[dict[str, Any]]:
    """A table of the figures `names`: a row for each feed and kind of position; below it that of the test `before`."""
    return [head | {name: getattr(found.figures, name) for name in names} for head, found in _traces(test, before)]


def spike_rows(test: CircleTest, before: CircleTest | None) -> list[dict[str, Any]]:
    """A table of the spikes: a row for each feed, kind of position and sense; height in um and width in degrees."""
    return [
        head
        | {"sense": sense}
        | {
            one.place: f"{one.height_um:+.3g}, {one.width_deg:.2g}°" if one.height_um else "0"
            for one in found.figures.spikes
            if one.sense == sense
        }
        for head, found in _traces(test, before)
        for sense in SENSES
    ]


def _traces(test: CircleTest, before: CircleTest | None) -> Iterator[tuple[dict[str, Any], Trace]]:
    for one in test.circles:
        earlier = before.at(one.feed_mmps) if before is not None else None
        for by, found in one.traces.items():
            yield {"feed": one.feed_mmps, "by": by}, found
            if earlier is not None and by in earlier.traces:
                yield {"feed": one.feed_mmps, "by": f"{by}, before"}, earlier.traces[by]


def save(test: CircleTest, path: Path) -> None:
    """Write figures and profiles as JSON. Raises FileError."""
    record = {"kontur_circle_test": VERSION} | figures(test)
    for row, one in zip(record["circles"], test.circles, strict=True):
        for by, found in one.traces.items():
            row[by] |= {f"{sense}_um": [round(v, 4) for v in getattr(found, f"{sense}_um")] for sense in SENSES}
    write_atomically(path, (json.dumps(record) + "\n").encode())


def load(path: Path) -> CircleTest:
    """A test that save() wrote. Raises FileError."""
    text = read_text(path)
    try:
        record = json.loads(text)
        if record["kontur_circle_test"] != VERSION:
            raise ValueError
        circles = tuple(
            Circle(_number(row["feed_mmps"]), {by: _trace(row[by]) for by in BY if by in row})
            for row in record["circles"]
        )
        conditions = {str(name): _text(value) for name, value in record["conditions"].items()}
        if not circles or not all(one.traces for one in circles):
            raise ValueError
        return CircleTest(_number(record["radius_mm"]), conditions, circles)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise FileError(path, "is no circular test; write one with `kontur circle-test --save FILE`") from error


def _trace(row: Mapping[str, Any]) -> Trace:
    numbers = {f.name: _number(row[f.name]) for f in fields(Circularity) if f.name != "spikes"}
    spikes = tuple(
        Spike(
            _one_of(PLACES, one["place"]),
            _one_of(SENSES, one["sense"]),
            _number(one["height_um"]),
            _number(one["width_deg"]),
        )
        for one in row["spikes"]
    )
    found = [np.array([_number(value) for value in row[f"{sense}_um"]]) for sense in SENSES]
    if any(len(one) != PROFILE for one in found) or len(spikes) != len(PLACES) * len(SENSES):
        raise ValueError
    return Trace(Circularity(**numbers, spikes=spikes), *found)


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= _GREATEST:
        raise ValueError
    return float(value)


def _text(value: Any) -> Any:
    if not isinstance(value, str):
        _number(value)
    elif len(value) > _LONGEST:
        raise ValueError
    return value


def _one_of(names: tuple[str, ...], value: object) -> str:
    if value not in names:
        raise ValueError
    return str(value)
