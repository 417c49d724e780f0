# SPDX-License-Identifier: Apache-2.0
"""Show the telemetry of a drive that runs no path of this program: it jogs, homes, or another program moves it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np
from numpy.typing import NDArray

from kontur.can import signals
from kontur.can.wire import TelemetryStream
from kontur.drive.device import Device
from kontur.drive.pdos import TELEMETRY
from kontur.errors import DeviceError
from kontur.live.view import WATCHED_S, View
from kontur.runs import log
from kontur.runs.columns import measured

_COLUMNS = (
    ("tick", 0),
    ("time_s", 6),
    *(
        (s.column.name, s.column.digits)
        for s in signals.SIGNALS
        if s.telemetry is not None and s.column is not None and s.column.name not in log.RANGE
    ),
)


@contextmanager
def following(device: Device, view: View, title: str) -> Iterator[None]:
    """Show all telemetry that `device` sends inside. It is switched on, unless another program holds the drive: then
    what is on is shown."""
    link = device.link
    stream = TelemetryStream(device.position_nm())
    first: int | None = None

    def take(function: NDArray[np.int64], payload: NDArray[np.uint8], last: bool = False) -> None:
        nonlocal first
        telemetry = stream.add(function, payload, last)
        if first is None and len(telemetry.tick):
            first = int(telemetry.tick[0])
        time_s = (telemetry.tick - (first or 0)) * 1e-3
        found = {"tick": telemetry.tick, "time_s": time_s} | measured(telemetry)
        view.add(np.column_stack([found[name] for name, _ in _COLUMNS]), link.reported)

    view.begin({"title": title, "machine": str(link.bus.channel_info)}, _COLUMNS, paced=link.by_device_time)
    with suppress(DeviceError):
        device.pdos.require(*TELEMETRY)
    try:
        with link.telemetry_watched(take, WATCHED_S):
            yield
    finally:
        take(np.empty(0, dtype=np.int64), np.empty((0, 8), dtype=np.uint8), last=True)
