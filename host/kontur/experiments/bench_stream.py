# SPDX-License-Identifier: Apache-2.0
"""Speed and reliability of streaming: a circle next to the position of the axes."""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kontur.can.bad_bus import BadBus
from kontur.drive.device import Device
from kontur.drive.pdos import TELEMETRY
from kontur.drive.stream import Operator, stream
from kontur.drive.target import Target, open_drive, tell
from kontur.errors import EmcyError, StreamError
from kontur.path import shapes
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.sim import process as sim_process

RADIUS_M, FEED_MPS = 0.002, 0.02


def bench(
    target: Target,
    knots: int,
    progress: Callable[[float], None] = lambda share: None,
    stop_requested: Callable[[], bool] = lambda: False,
) -> dict[str, Any]:
    """Stream `knots` knots, 1000 or more, to the drive of `target`, or to a process where it names no bus.

    `lost` are the knots that were not executed; `retransmitted` and `underruns` as counted on the two ends;
    `told` is what the drive was told of its machine, None where only its owner knows; `contour_mean_um`,
    `contour_max_um`: the drive's own estimate of the contour error (2211h).
    `checksum_ok`: the drive executed these knots, each once and in order; `error`: the message if not; `warnings`:
    EMCY codes. In process the CPU time is the drive's, too. Raises BusError, DeviceError before the stream has begun;
    KeyboardInterrupt when the stop was requested.
    """
    asked = target
    with _target(target) as target, open_drive(target) as device, device.axes.enabled(also=TELEMETRY):
        here_nm = np.array(device.position_nm())
        knots_nm = _circle(target, knots) + here_nm
        knots_nm = knots_nm.astype(np.int32)
        frames, cpu_s, begin_s = device.link.frames, time.process_time(), time.perf_counter()
        error, retransmitted = None, 0
        try:
            result = stream(device, knots_nm, Operator(progress=progress, stop_requested=stop_requested))
            retransmitted = result.retransmitted
            if not result.completed:
                raise KeyboardInterrupt
        except (StreamError, EmcyError) as raised:
            error = str(raised)
        seconds, cpu_s = time.perf_counter() - begin_s, time.process_time() - cpu_s
        frames = device.link.frames - frames
        return {
            "bus": str(device.link.bus.channel_info),
            "knots": len(knots_nm),
            "lost": len(knots_nm) - int(device.read_stable("stream.executed")),
            "retransmitted": retransmitted,
            "underruns": int(device.read_stable("stream.underruns")),
            "checksum_ok": device.read_stable("stream.checksum") == zlib.crc32(knots_nm.astype("<i4").tobytes()),
            "told": target.told if asked.bus is None or target.in_process else None,
            "contour_mean_um": device.read_stable("estimated_contour_error.mean") * 1e6,
            "contour_max_um": device.read_stable("estimated_contour_error.max") * 1e6,
            "seconds": seconds,
            "knots_per_s": len(knots_nm) / seconds,
            "frames": frames,
            "host_cpu_us_per_frame": cpu_s / frames * 1e6,
            "faults": _faults(device),
            "warnings": device.faults.warnings(),
            "error": error,
        }


@contextmanager
def _target(target: Target) -> Iterator[Target]:
    """`target`; where it names no bus, a process whose time passes with SYNC, over slcan."""
    if target.bus is not None:
        yield target
        return
    with sim_process.start(
        slcan_tcp="0",
        pace="sync",
        machine=target.machine,
        seed=target.seed,
        node_id=target.node_id,
        num=target.num,
    ) as process:
        own = replace(target, bus=process.options())
        tell(replace(own, faults=None))
        yield own


def _circle(target: Target, knots: int) -> NDArray[np.int64]:
    """Knots relative to the first one, with acceleration and deceleration."""
    allowed = limits(target.machine)

    def path(duration_s: float) -> NDArray[np.int32]:
        planned: NDArray[np.int32] = plan(shapes.circle(RADIUS_M, FEED_MPS, duration_s=duration_s), allowed).knots_nm
        return planned

    more = len(path(0.5)) - 500
    knots_nm: NDArray[np.int64] = path((knots - more) * 1e-3).astype(np.int64)
    knots_nm -= knots_nm[0].copy()
    return knots_nm


def _faults(device: Device) -> dict[str, dict[str, int]] | None:
    bus = device.link.bus
    if not isinstance(bus, BadBus):
        return None
    return {"to_drive": dict(vars(bus.to_drive)), "to_host": dict(vars(bus.to_host))}
