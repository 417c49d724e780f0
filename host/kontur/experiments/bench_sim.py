# SPDX-License-Identifier: Apache-2.0
"""Speed of the simulation: the NumPy model (reference/oracle.py), the library, and the library over CAN frames."""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from kontur.can.link import HEARTBEAT_S
from kontur.drive.device import Device
from kontur.drive.knot_sender import begin_stream
from kontur.drive.pdos import TELEMETRY
from kontur.drive.state_machine import RUN_PATH
from kontur.drive.stream import stream
from kontur.drive.target import Target, open_drive
from kontur.errors import LibraryError
from kontur.path import shapes
from kontur.planning.bounds import limits
from kontur.planning.planner import Trajectory, plan
from kontur.sim.bus import KonturBus

ORACLE = Path(__file__).parents[3] / "reference" / "oracle.py"
ORACLE_PERIODS = 3000
_PATH_S = 20.0


def bench(target: Target) -> dict[str, Any]:
    """Control periods a second of the three, on the same circle (r 20 mm, 100 mm/s) under `ccu`, and their ratios.

    Raises LibraryError: there is no oracle, since this is not a checkout of the source.
    """
    program = shapes.circle(0.020, 0.100, duration_s=_PATH_S)
    trajectory = plan(program, limits(target.machine))
    oracle, direct, over_can = _oracle(trajectory), _direct(trajectory, target), _over_can(trajectory, target)
    return {
        "oracle_periods_per_s": oracle,
        "direct_periods_per_s": direct,
        "can_periods_per_s": over_can,
        "direct_over_oracle": direct / oracle,
        "can_over_oracle": over_can / oracle,
    }


def _oracle(trajectory: Trajectory) -> float:
    """Servo and plant of the NumPy model, stepped in Python."""
    spec = importlib.util.spec_from_file_location("oracle", ORACLE)
    if not ORACLE.exists() or spec is None or spec.loader is None:
        raise LibraryError(f"{ORACLE}: there is no oracle to compare with; run this in a checkout of the source")
    oracle = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = oracle  # its dataclasses look themselves up there
    spec.loader.exec_module(oracle)
    loop = oracle.Loop(oracle.Params(), trajectory.knots_nm, seed=1)
    begin_s = time.perf_counter()
    for _ in range(ORACLE_PERIODS):
        loop.step()
    return ORACLE_PERIODS / (time.perf_counter() - begin_s)


def _direct(trajectory: Trajectory, target: Target) -> float:
    """The library: knots by function call, many control periods in each call."""
    with _ready(trajectory, target) as device:
        assert isinstance(device.link.bus, KonturBus)
        sim = device.link.bus.sim
        begin_stream(device, trajectory.knots_nm)
        knots_nm, chunk = trajectory.knots_nm, round(HEARTBEAT_S * sim.control_hz)
        pushed = sim.push_knots(knots_nm)
        device.axes.controlwords(RUN_PATH, RUN_PATH)
        begin, begin_s = sim.tick, time.perf_counter()
        while pushed < len(knots_nm):
            sim.run(chunk)
            device.link.send_heartbeat()
            pushed += sim.push_knots(knots_nm[pushed:])
        rate = (sim.tick - begin) / (time.perf_counter() - begin_s)
        while sim.recv() is not None:
            pass  # discard the telemetry
        return rate


def _over_can(trajectory: Trajectory, target: Target) -> float:
    """As in every run: knots and telemetry as CAN frames through python-can."""
    with _ready(trajectory, target) as device:
        begin, begin_s = device.link.time_s, time.perf_counter()
        stream(device, trajectory.knots_nm, before_start=device.link.record_telemetry)
        periods = (device.link.time_s - begin) * float(device.read("clock.control_hz"))
        return periods / (time.perf_counter() - begin_s)


@contextmanager
def _ready(trajectory: Trajectory, target: Target) -> Iterator[Device]:
    start = target.machine.starting_at(trajectory.program.start_m)
    with open_drive(replace(target, bus=None, machine=start)) as device:
        device.select_controller("ccu")
        with device.axes.enabled(also=TELEMETRY):
            yield device
