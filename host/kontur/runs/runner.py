# SPDX-License-Identifier: Apache-2.0
"""One run: a planned trajectory, streamed to a drive under one controller, logged, and scored where the truth is known.

A simulated drive is treated like a real one, over CAN frames. The differences: it starts where the program starts, its
parameters are set to those of the machine that it moves, and its true position is known.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from kontur.can import emcy
from kontur.can.simulated import SimulatedBus, Truth, simulated
from kontur.can.wire import Telemetry
from kontur.drive import scope as scopes
from kontur.drive.controllers import named
from kontur.drive.device import Device
from kontur.drive.pdos import TELEMETRY
from kontur.drive.stream import UNATTENDED, Operator, StreamResult, stream
from kontur.drive.target import Target, open_drive
from kontur.errors import DeviceError, EmcyError
from kontur.path.geometry import KNOT_S
from kontur.planning.bounds import Limits, limits
from kontur.planning.planner import Trajectory
from kontur.planning.rest import Rest, whole
from kontur.runs import resume
from kontur.runs.clock import RunClock
from kontur.runs.columns import add_truth, columns, of_the_path
from kontur.runs.coverage import covered
from kontur.runs.log import RunLog


@dataclass(frozen=True)
class RunOptions:
    """How a trajectory is run.

    `parameters` are set before, by name, in their units. `approach`: a real drive that does not stand at the start goes
    there first, in a straight line within these limits; without them the run is refused. `resume`: go on with this same
    trajectory where the drive stopped on it; the log has the rest of the path. Axes that have crept go back to it, at
    most resume.RETURN_MAX_M, or with `approach` as far as it is. `scope` is armed just before the start.

    `score_from_s`: the error is scored from this time on. `raise_fault`: a fault during the motion is raised; else the
    log ends there. `command` is kept in the log: the command that makes the run again.
    """

    parameters: Mapping[str, float] = field(default_factory=dict)
    approach: Limits | None = None
    resume: bool = False
    scope: scopes.Setup | None = None
    score_from_s: float = 0.0
    raise_fault: bool = True
    command: str = ""


DEFAULTS = RunOptions()


@dataclass(frozen=True)
class RunResult:
    """`log` of the run; `truth` at the control rate from the start of the path to its end, None on a real drive.

    `completed`: the drive went all the way. `fault`: what the drive reported, where a fault ended the run. `capture`:
    what the scope recorded, if it was asked for and triggered, or if a fault ended the run, or if a warning came that
    is captured. `warnings`: EMCY codes of the drive's warnings.
    """

    log: RunLog
    truth: Truth | None
    completed: bool
    fault: EmcyError | None = None
    capture: scopes.Capture | None = None
    warnings: tuple[int, ...] = ()


@dataclass(frozen=True)
class _Recorded:
    """What a motion left: the stream's result, telemetry, and the truth from control period `first` on. `driven`: what
    was streamed."""

    driven: Rest
    streamed: StreamResult
    telemetry: Telemetry
    truth: Truth | None
    first: int


def run(
    trajectory: Trajectory,
    controller: str,
    target: Target,
    options: RunOptions = DEFAULTS,
    operator: Operator = UNATTENDED,
) -> RunResult:
    """Run `trajectory` under `controller` (either of its names) on the drive of `target`.

    The log ends where the drive stopped: at the end, on the operator's request, or at a fault.

    Raises BusError, DeviceError (NoAnswerError, StreamError, EmcyError), ParameterError; KeyboardInterrupt when the
    operator requested the stop on the way to the start, where there is no log yet.
    """
    controller = named(controller)
    if target.place_at_start:
        target = dataclasses.replace(target, machine=target.machine.starting_at(trajectory.program.start_m))
    with open_drive(target) as device, device.master.held():
        sim = simulated(device.link.bus)
        device.parameters.set(options.parameters)
        device.select_controller(controller)
        left = None
        if options.resume:
            left = resume.left_by(device, trajectory, resume.RETURN_MAX_M if options.approach is None else math.inf)
        with device.axes.enabled(also=TELEMETRY):
            recorded = _move(device, sim, trajectory, left, options, operator, limits(target.machine))
        driven = recorded.driven.trajectory
        streamed = recorded.streamed
        warnings = device.faults.warnings()
        capture = _capture(device, streamed, warnings, options, operator)
        meta: dict[str, Any] = {"program": trajectory.program.name, "controller": controller}
        meta |= _outcome(device, trajectory, target, streamed, warnings, options)
        meta |= _drive(device, recorded, options)
        clock = RunClock(driven, streamed, meta["control_hz"], device.read("limits.path_stop_time") * 1e-3)
    time_s = clock.of_ticks(recorded.telemetry.tick, by_device_time=device.link.by_device_time)
    found = columns(recorded.telemetry, time_s, driven, clock)
    truth = None
    if recorded.truth is not None:
        truth = of_the_path(recorded.truth, recorded.first, clock)
        meta |= add_truth(found, truth, driven, clock, options.score_from_s)
    meta["path"] = covered(driven, clock, found, options.score_from_s)
    return RunResult(RunLog(meta, found), truth, streamed.completed, streamed.fault, capture, warnings)


def _move(
    device: Device,
    sim: SimulatedBus | None,
    trajectory: Trajectory,
    left: resume.Left | None,
    options: RunOptions,
    operator: Operator,
    bounds: Limits,
) -> _Recorded:
    """Go to the start, or back to where the path was `left`, within `bounds`; stream the trajectory or the rest of it,
    and record telemetry and truth from the start of the motion on."""
    driven, has_knots = whole(trajectory), False
    if left is None:
        _go_to_start(device, trajectory.program.start_m, options.approach, operator)
    else:
        driven, has_knots = resume.return_to(device, left, bounds, operator)
    device.write("energy.reset", 1)
    start_nm = device.position_nm()
    first = 0

    def before_start() -> None:
        nonlocal first
        if options.scope is not None:
            scopes.arm(device, options.scope)
        device.link.record_telemetry()
        if sim is not None:
            first = sim.start_recording()

    streamed = stream(
        device,
        driven.trajectory.knots_nm,
        operator,
        before_start=before_start,
        resume=has_knots,
        raise_fault=options.raise_fault,
    )
    truth = sim.truth() if sim is not None else None
    return _Recorded(driven, streamed, device.link.recorded_telemetry(start_nm), truth, first)


def _go_to_start(device: Device, start_m: tuple[float, float], approach: Limits | None, operator: Operator) -> None:
    here_m = device.position_m()
    window_m = device.read("limits.start_window") * 1e-6
    if max(abs(a - b) for a, b in zip(here_m, start_m, strict=True)) <= window_m:
        return
    if approach is None:
        raise DeviceError(
            f"the axes stand at {_mm(here_m)} mm, the program starts at {_mm(start_m)} mm; "
            f"jog there, or let --approach go there in a straight line at {resume.LINE_FEED_MPS * 1e3:g} mm/s"
        )
    resume.go_straight(device, start_m, approach, operator)


def _capture(
    device: Device, streamed: StreamResult, warnings: tuple[int, ...], options: RunOptions, operator: Operator
) -> scopes.Capture | None:
    """What the drive's scope recorded: as it was asked for, or by a fault or a warning that is captured."""
    captured = streamed.fault is not None or any(emcy.faults()[code].captured for code in warnings)
    capture = scopes.held(device, operator.progress) if options.scope is not None or captured else None
    if options.scope is not None and streamed.fault is None:
        scopes.release(device)
    return capture


def _outcome(
    device: Device,
    trajectory: Trajectory,
    target: Target,
    streamed: StreamResult,
    warnings: tuple[int, ...],
    options: RunOptions,
) -> dict[str, Any]:
    """What the log says of the run: how it ended, on which machine."""
    bus = device.link.bus
    is_simulated = simulated(bus) is not None
    meta: dict[str, Any] = {
        "status": "complete" if streamed.completed else "fault" if streamed.fault else "interrupted",
        "trajectory": trajectory.digest,
        "machine": target.machine.name if is_simulated else str(bus.channel_info),
    }
    if streamed.fault is not None:
        meta["fault"] = str(streamed.fault)
    if warnings:
        meta["warnings"] = [emcy.describe_emcy(code) for code in warnings]
    if is_simulated:
        meta |= {"plant": dataclasses.asdict(target.machine), "seed": target.seed}
    return meta


def _drive(device: Device, recorded: _Recorded, options: RunOptions) -> dict[str, Any]:
    """What the log says of the drive and of the transmission."""
    at_ms = recorded.driven.path_ms[recorded.streamed.passed]
    resumed = {"resumed_at_s": float(at_ms) * KNOT_S} if options.resume else {}
    return resumed | {
        "firmware": device.read("build_id"),
        "num": device.read("num_backend"),
        "control_hz": device.read("clock.control_hz"),
        "parameters": device.parameters.dump(),
        "frames_lost": recorded.telemetry.frames_lost,
        "accepted": recorded.streamed.accepted,
        "rejected": recorded.streamed.rejected,
        "dropped": device.link.dropped,
        "command": options.command,
    }


def _mm(position_m: tuple[float, float]) -> str:
    return f"({position_m[0] * 1e3:.3f}, {position_m[1] * 1e3:.3f})"
