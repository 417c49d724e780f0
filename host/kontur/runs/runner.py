# SPDX-License-Identifier: Apache-2.0
"""One run: a planned trajectory, streamed to a drive under one controller, logged, and scored where the truth is known.

A simulated drive goes the same way as a real one, over CAN frames; what differs is that it starts where the program
starts, is told of the machine it moves, and that its true position is known.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kontur.can import emcy, wire
from kontur.can.simulated import Truth, simulated
from kontur.drive import scope as scopes
from kontur.drive.device import Device
from kontur.drive.stream import StreamResult, stream
from kontur.drive.target import Target, connect
from kontur.errors import DeviceError, EmcyError
from kontur.path.geometry import KNOT_S, Line, Move, Program
from kontur.planning import path_time
from kontur.planning.planner import Limits, Trajectory, plan
from kontur.runs import scoring
from kontur.runs.log import RunLog

APPROACH_FEED_MPS = 0.02
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RunResult:
    """`log` of the run; `truth` at the control rate from the start of the path to its end, None on a real drive.

    `fault`: what the drive reported, where that ended the run. `capture`: what its scope recorded, where that was asked
    for and triggered, or where a fault ended the run, or a warning that it captures came. `warnings`: EMCY codes of
    what the drive warned of.
    """

    log: RunLog
    truth: Truth | None
    completed: bool
    fault: EmcyError | None = None
    capture: scopes.Capture | None = None
    warnings: tuple[int, ...] = ()


def run(
    trajectory: Trajectory,
    controller: str,
    target: Target,
    *,
    parameters: Mapping[str, float] | None = None,
    score_from_s: float = 0.0,
    command: str = "",
    approach: Limits | None = None,
    progress: Callable[[float], None] = lambda share: None,
    stop_requested: Callable[[], bool] = lambda: False,
    rate: Callable[[], float] = lambda: 1.0,
    raise_fault: bool = True,
    scope: scopes.Setup | None = None,
    resume: bool = False,
) -> RunResult:
    """Run `trajectory`; `parameters` are set before, by name, in their units.

    A real drive that does not stand at the start goes there first if `approach` gives the limits for that, else this
    is refused. `command` is kept in the log. When `stop_requested` returns True the drive stops on the path, and the
    log ends there; so it does at a fault of the drive where `raise_fault` is False. `rate` tells the feed override,
    0 to 1.2, 0 to hold, which may change at any time. `scope` is armed just before the start. `resume`: go on with this
    same trajectory where the drive stopped on it, see stream(); the log has what is left.

    Raises BusError, DeviceError (NoAnswerError, StreamError, EmcyError), ParameterError; KeyboardInterrupt when the
    stop was requested on the way to the start, where there is no log yet.
    """
    start_m = trajectory.program.start_m
    if target.place_at_start:
        target = dataclasses.replace(target, machine=target.machine.starting_at(start_m))
    with connect(target) as device, device.held():
        bus = device.link.bus
        sim = simulated(bus)
        device.set_parameters(parameters or {})
        device.select_controller(controller)
        with device.enabled():
            if not resume:
                _go_to_start(device, start_m, approach, stop_requested)
            device.write("energy.reset", 1)
            start_nm = device.position_nm()

            recorded_from = 0

            def before_start() -> None:
                nonlocal recorded_from
                if scope is not None:
                    scopes.arm(device, scope)
                device.link.record()
                if sim is not None:
                    recorded_from = sim.start_recording()

            streamed = stream(
                device,
                trajectory.knots_nm,
                before_start=before_start,
                progress=progress,
                stop_requested=stop_requested,
                rate=rate,
                raise_fault=raise_fault,
                resume=resume,
            )
            truth = sim.truth() if sim is not None else None
            telemetry = device.link.recorded(start_nm)
        warnings = device.warnings()
        captured = streamed.fault is not None or any(emcy.faults()[code].captured for code in warnings)
        capture = scopes.held(device, progress) if scope is not None or captured else None
        if scope is not None and streamed.fault is None:
            scopes.release(device)
        meta: dict[str, Any] = {
            "program": trajectory.program.name,
            "controller": controller,
            "status": "complete" if streamed.completed else "fault" if streamed.fault else "interrupted",
            "trajectory": trajectory.digest,
            "machine": target.machine.name if sim is not None else str(bus.channel_info),
        }
        if streamed.fault is not None:
            meta["fault"] = str(streamed.fault)
        if resume:
            meta["resumed_at_s"] = streamed.passed * KNOT_S
        if warnings:
            meta["warnings"] = [emcy.describe_emcy(code) for code in warnings]
        if sim is not None:
            meta |= {"plant": dataclasses.asdict(target.machine), "seed": target.seed}
        meta |= {
            "firmware": device.read("build_id"),
            "num": device.read("num_backend"),
            "control_hz": device.read("clock.control_hz"),
            "parameters": device.dump(),
            "frames_lost": telemetry.frames_lost,
            "accepted": streamed.accepted,
            "rejected": streamed.rejected,
            "command": command,
        }
        clock = _PathClock(trajectory, streamed, meta["control_hz"], device.read("limits.path_stop_time") * 1e-3)
    time_s = clock.of_ticks(telemetry.tick, by_device_time=device.link.by_device_time)
    columns = _columns(telemetry, time_s, trajectory, clock)
    if truth is not None:
        truth = _cut(truth, clock.start_period - recorded_from, clock.periods)
        meta |= _score(columns, truth, trajectory, clock, score_from_s)
    return RunResult(RunLog(meta, columns), truth, streamed.completed, streamed.fault, capture, warnings)


def _go_to_start(
    device: Device, start_m: tuple[float, float], approach: Limits | None, stop_requested: Callable[[], bool]
) -> None:
    here_m = device.position_m()
    window_m = device.read("limits.start_window") * 1e-6
    if max(abs(a - b) for a, b in zip(here_m, start_m, strict=True)) <= window_m:
        return
    if approach is None:
        raise DeviceError(
            f"the axes stand at {_mm(here_m)} mm, the program starts at {_mm(start_m)} mm; "
            f"jog there, or let --approach go there in a straight line at {APPROACH_FEED_MPS * 1e3:g} mm/s"
        )
    line = Program("approach", (Move(Line(here_m, start_m), APPROACH_FEED_MPS),), here_m)
    if not stream(device, plan(line, approach).knots_nm, stop_requested=stop_requested).completed:
        raise KeyboardInterrupt


class _PathClock:
    """Time since the path was started, and how far path time came by then, at the rates asked for."""

    def __init__(self, trajectory: Trajectory, streamed: StreamResult, control_hz: int, stop_time_s: float) -> None:
        self.control_hz = control_hz
        self.start_period = round(streamed.start_s * control_hz)
        stop = round(stop_time_s * control_hz)
        wanted = [(round((at_s - streamed.start_s) * control_hz), rate) for at_s, rate in streamed.rates]
        if streamed.stop_s is not None:
            wanted.append((round((streamed.stop_s - streamed.start_s) * control_hz), 0.0))
        way = round(trajectory.duration_s * control_hz)
        last, rate = wanted[-1]
        if streamed.passed:
            wanted.insert(0, (0, 0.0))  # where it stands it does not start at full rate, as a path does
        horizon = last + round(path_time.RATE_MAX * stop) + (math.ceil(way / rate) if rate > 0.0 else 0)
        self._periods, path = path_time.curve(wanted, horizon, stop)
        path += streamed.passed * KNOT_S * control_hz
        self._path, self._way = path, way
        ends = float(np.interp(way, path, self._periods))  # there, or where it stands
        self.periods = round(ends) if path[-1] >= way else last + stop
        self.end_s = self.periods / control_hz

    def path_time(self, time_s: Floats) -> Floats:
        """Path time (n,) in s."""
        path = np.interp(time_s * self.control_hz, self._periods, self._path)
        return np.asarray(np.minimum(path, self._way) / self.control_hz)

    def of_ticks(self, tick: NDArray[np.int64], by_device_time: bool) -> Floats:
        """Time (n,) in s of telemetry rows. The row of tick i was taken in control period `i ms - 1`, counted from 0.

        The control period in which the path started is known where the host's clock is the drive's (simulated drives);
        else the first row that came after the command to start is taken for the start, which is right to 1 ms and the
        time on the bus.
        """
        if not by_device_time or not len(tick):
            return np.asarray((tick - tick[:1]) * wire.TICK_PERIOD_S)
        periods = round(wire.TICK_PERIOD_S * self.control_hz)
        first = self.start_period // periods + 1
        since = (tick[0] - first + 0x8000) % 0x10000 - 0x8000 + (tick - tick[0])
        return np.asarray(((first + since) * periods - 1 - self.start_period) / self.control_hz)


def _columns(telemetry: wire.Telemetry, time_s: Floats, trajectory: Trajectory, clock: _PathClock) -> dict[str, Floats]:
    rows = (time_s >= 0.0) & (time_s <= clock.end_s)
    time_s = time_s[rows]
    knot = clock.path_time(time_s) / KNOT_S
    number = np.arange(len(trajectory.position_m))
    path_s_m = np.interp(knot, number, trajectory.path_s_m)
    columns: dict[str, Floats] = {
        "tick": telemetry.tick[rows].astype(np.float64),
        "time_s": time_s,
        "rapid": scoring.on_rapid(trajectory.program, path_s_m).astype(np.float64),
        "energy_J": telemetry.energy_J[rows],
    }
    for i, axis in enumerate("xy"):
        columns |= {
            f"e_n{i + 1}_um": telemetry.contour_m[rows, i] * 1e6,
            f"{axis}_mm": telemetry.position_m[rows, i] * 1e3,
            f"reference_{axis}_mm": np.interp(knot, number, trajectory.position_m[:, i]) * 1e3,
            f"force_{axis}_N": telemetry.force_N[rows, i],
            f"k_{i + 1}_per_s": telemetry.gain_per_s[rows, i],
            f"mu_{i + 1}_mps2": telemetry.uncertainty_gain_mps2[rows, i],
        }
    return columns


def _cut(truth: Truth, start: int, periods: int) -> Truth:
    """The rows of the path alone, from row `start`, both ends included."""
    return Truth(*(getattr(truth, f.name)[start : start + periods + 1] for f in dataclasses.fields(truth)))


def _score(
    columns: dict[str, Floats], truth: Truth, trajectory: Trajectory, clock: _PathClock, from_s: float
) -> dict[str, Any]:
    """Score the truth at the control rate; adds its columns and returns what the log's head says of it."""
    time_s = np.arange(len(truth.pos_m)) / clock.control_hz
    knot = clock.path_time(time_s) / KNOT_S
    path_s_m = np.interp(knot, np.arange(len(trajectory.path_s_m)), trajectory.path_s_m)
    error = scoring.contour_error(trajectory.program, truth.pos_m, path_s_m)
    if from_s > time_s[-1]:
        from_s = 0.0  # stopped before: better the whole than nothing
    force_max_N, force_step_N = scoring.force_effort(truth.force_N[time_s >= from_s])
    at = np.rint(columns["time_s"] * clock.control_hz).astype(np.int64)
    columns |= {
        "true_x_mm": truth.pos_m[at, 0] * 1e3,
        "true_y_mm": truth.pos_m[at, 1] * 1e3,
        "contour_um": error.normal_m[at] * 1e6,
        "tangential_um": error.tangential_m[at] * 1e6,
    }
    return {
        "score": dataclasses.asdict(scoring.score(error, time_s, truth.pos_m, from_s)),
        "force_max_N": force_max_N,
        "force_step_N": force_step_N,
    }


def _mm(position_m: tuple[float, float]) -> str:
    return f"({position_m[0] * 1e3:.3f}, {position_m[1] * 1e3:.3f})"
