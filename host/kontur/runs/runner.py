# SPDX-License-Identifier: Apache-2.0
"""One run: a planned trajectory, streamed to a drive under one controller, logged, and scored where the truth is known.

A simulated drive is treated like a real one, over CAN frames. The differences: it starts where the program starts, it
is told of the machine that it moves what the target says, and its true position is known.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kontur.can import emcy
from kontur.can.simulated import Truth, simulated
from kontur.drive import scope as scopes
from kontur.drive.controllers import named
from kontur.drive.device import Device
from kontur.drive.pdos import RANGE, TELEMETRY
from kontur.drive.stream import UNATTENDED, Operator, StreamResult, stream
from kontur.drive.target import Target, open_drive
from kontur.errors import DeviceError, EmcyError, FileError, KonturError, StreamError
from kontur.machine import ALL
from kontur.path.geometry import KNOT_S
from kontur.planning.ahead import Ahead, Planned
from kontur.planning.bounds import Limits, limits
from kontur.planning.outputs import SPINDLE, Switching, Tool, of_rest, of_words, words
from kontur.planning.planner import Trajectory
from kontur.planning.rest import Rest, whole
from kontur.runs import resume
from kontur.runs.log import RunLog
from kontur.runs.recorder import Recorder, Watcher


@dataclass(frozen=True)
class RunOptions:
    """How a trajectory is run.

    `parameters` are set before, by name, in their units. `tool` is what S of the program belongs to. `approach`: a real
    drive that does not stand at the start goes there first, in a straight line within these limits; without them the
    run is refused. `resume`: go on with this same trajectory where the drive stopped on it; the log has the rest of the
    path. Axes that have crept go back to it, at most resume.RETURN_MAX_M, or with `approach` as far as it is. `scope`
    is armed just before the start.

    `score_from_s`: the error is scored from this time on. `raise_fault`: a fault during the motion, or an error, is
    raised; else the log ends there. `command` is kept in the log: the command that makes the run again.

    `log`: write the log to this .csv or .mf4 file while the run goes. `whole`: the result has all rows of the log, and
    the truth, in memory (0.9 MB a second); else the rows of a long run are thinned (RunLog.even), and no truth is kept.
    `watch` gets the rows of the log as they come. `error_range`: the log has the least and the greatest contour
    error of each millisecond, too, by the drive.
    """

    parameters: Mapping[str, float] = field(default_factory=dict)
    tool: Tool = SPINDLE
    approach: Limits | None = None
    resume: bool = False
    scope: scopes.Setup | None = None
    score_from_s: float = 0.0
    raise_fault: bool = True
    command: str = ""
    log: Path | None = None
    whole: bool = True
    watch: Watcher | None = None
    error_range: bool = False


DEFAULTS = RunOptions()
_OTHER_END = (
    "the drive has left another path than this one, whose end is different; give the file and the options of the run "
    "that was stopped"
)
_AT_START_M = 1e-6  # where the axes are held so near the start, the path begins there


@dataclass(frozen=True)
class RunResult:
    """`log` of the run; `truth` at the control rate from the start of the path to its end, None on a real drive, or
    where RunOptions.whole is False.

    `completed`: the drive went all the way. `fault`: what the drive reported, where a fault ended the run. `error`:
    what broke the run off where RunOptions.raise_fault is False, of the bus or in an answer of the drive. `capture`:
    what the scope recorded, if it was asked for and triggered, or if a fault ended the run, or if a warning came that
    is captured. `warnings`: EMCY codes of the drive's warnings. `log_problem`: why the file of the log could not be
    written, which stopped the run on the path.
    """

    log: RunLog
    truth: Truth | None
    completed: bool
    fault: EmcyError | None = None
    capture: scopes.Capture | None = None
    warnings: tuple[int, ...] = ()
    log_problem: FileError | None = None
    error: KonturError | None = None


def run(
    trajectory: Planned,
    controller: str,
    target: Target,
    options: RunOptions = DEFAULTS,
    operator: Operator = UNATTENDED,
) -> RunResult:
    """Run `trajectory` under `controller` (either of its names) on the drive of `target`, while it is planned or after
    that. If its planning fails meanwhile, the drive stops on the path, and what failed is raised.

    The log ends where the drive stopped: at the end, on the operator's request, at a fault, or because the log could
    not be written any more.

    Raises BusError, DeviceError (NoAnswerError, StreamError, EmcyError), ParameterError; FileError when the log cannot
    be begun; KeyboardInterrupt when the operator requested the stop before the path moved: there is no log yet.
    After an error while the path runs, `options.log` has what was received before, and the message says so. It is in
    the result where `options.raise_fault` is False.
    """
    broken_off: list[RunResult] = []
    try:
        return _run(trajectory, named(controller), target, options, operator, broken_off)
    except KonturError:
        if options.raise_fault or not broken_off:
            raise
        return broken_off[0]


def _run(
    trajectory: Planned,
    controller: str,
    target: Target,
    options: RunOptions,
    operator: Operator,
    broken_off: list[RunResult],
) -> RunResult:
    """run(); after an error while the path runs, the result up to then is in `broken_off`."""
    if target.place_at_start:
        target = dataclasses.replace(target, machine=target.machine.starting_at(trajectory.program.start_m))
    with open_drive(target) as device, device.master.held():
        sim = simulated(device.link.bus)
        device.parameters.set(options.parameters)
        device.select_controller(controller)
        meta: dict[str, Any] = {"program": trajectory.program.name, "controller": controller}
        planned_before = isinstance(trajectory, Trajectory)
        meta |= _of_path(trajectory) if isinstance(trajectory, Trajectory) else {}
        meta |= {"switched": _switched(trajectory)} if trajectory.program.events else {}
        meta |= _what(device, target, options)
        recorder = Recorder(
            device.link,
            sim,
            meta,
            stop_time_s=device.read("limits.path_stop_time") * 1e-3,
            score_from_s=options.score_from_s,
            file=options.log,
            whole=options.whole,
            watch=options.watch,
            switches=bool(trajectory.program.events),
            error_range=options.error_range,
        )
        try:
            left = None
            if options.resume:
                left = resume.left_by(device, trajectory, resume.RETURN_MAX_M if options.approach is None else math.inf)
                trajectory = left.trajectory
                resume.check_outputs(device, of_words(_words(trajectory, options.tool, left.driven)))
            with device.axes.enabled(also=TELEMETRY + (RANGE if options.error_range else ())):
                if left is None:
                    placed = target.in_process and target.place_at_start
                    _go_to_start(device, trajectory.program.start_m, options.approach, operator,
                                 limits(target.machine), placed)  # fmt: skip
                driven, streamed = _move(device, trajectory, left, recorder, options, operator, limits(target.machine))
            if isinstance(trajectory, Ahead) and trajectory.error is not None:
                raise trajectory.error
            if left is not None and left.ends_otherwise:
                raise StreamError(_OTHER_END)
            warnings = device.faults.warnings()
            oscillation = device.faults.oscillation(warnings)
            capture = _capture(device, streamed, warnings, options, operator)
        except KonturError as error:
            if (log := recorder.fail(str(error))) is not None:
                if recorder.growing is not None:
                    error.args = (f"{error}\nThe log up to then is in {recorder.growing.file}.",)
                broken_off.append(RunResult(log, None, completed=False, error=error))
            raise
        except BaseException:
            recorder.abandon({"status": "interrupted"})
            raise
        outcome = _outcome(streamed, warnings, recorder.problem)
        if oscillation:
            outcome["oscillation"] = oscillation
        if options.resume:
            outcome["resumed_at_s"] = float(driven.path_ms[streamed.passed]) * KNOT_S
        if isinstance(trajectory, Ahead) and trajectory.complete:
            trajectory = trajectory.trajectory()
        if isinstance(trajectory, Trajectory) and not planned_before:
            outcome |= _of_path(trajectory)
        log = recorder.end(outcome | {"dropped": device.link.dropped})
    return RunResult(log, recorder.truth(), streamed.completed, streamed.fault, capture, warnings, recorder.problem)


def _move(
    device: Device,
    trajectory: Planned,
    left: resume.Left | None,
    recorder: Recorder,
    options: RunOptions,
    operator: Operator,
    bounds: Limits,
) -> tuple[Rest, StreamResult]:
    """Go back to where the path was `left`, within `bounds`; stream the trajectory or the rest of it, and record from
    the start of the motion on. Returns what was streamed, too."""
    driven, has_knots = whole(trajectory), False
    if left is not None:
        driven, has_knots = resume.return_to(device, left, bounds, operator)
        if isinstance(trajectory, Ahead) and not has_knots:
            trajectory = trajectory.trajectory()  # all of it is planned
    word = np.zeros(1, dtype=np.uint32)
    if isinstance(trajectory, Trajectory) and trajectory.program.events:
        word = _words(trajectory, options.tool, driven)
    switching = Switching(trajectory, options.tool) if isinstance(trajectory, Ahead) else None
    device.write("energy.reset", 1)
    start_nm = device.position_nm()

    def before_start() -> None:
        if left is not None and left.ends_otherwise:
            raise StreamError(_OTHER_END)
        if options.scope is not None:
            scopes.arm(device, options.scope)
        recorder.begin(driven.trajectory, start_nm, lambda: word if switching is None else switching.word)

    def stop_requested() -> bool:
        planning_failed = isinstance(trajectory, Ahead) and trajectory.error is not None
        other_end = left is not None and left.ends_otherwise
        return planning_failed or other_end or recorder.problem is not None or operator.stop_requested()

    streamed = stream(
        device,
        switching or driven.trajectory.knots_nm,
        dataclasses.replace(operator, stop_requested=stop_requested),
        outputs=of_words(word),
        before_start=before_start,
        started=recorder.started,
        resume=has_knots,
        raise_fault=options.raise_fault,
    )
    recorder.stop()
    return driven, streamed


def _go_to_start(
    device: Device,
    start_m: tuple[float, float],
    approach: Limits | None,
    operator: Operator,
    bounds: Limits,
    placed: bool,
) -> None:
    """Go to the start within the limits `approach`. The last bit, within which the drive would begin the path with a
    step, it goes without them, too, within `bounds`; so do axes that the simulator has `placed` there: their encoders
    may see them elsewhere, and they may have crept."""
    here_m = device.demand_m()
    near_m = resume.RETURN_MAX_M if placed else device.read("limits.start_window") * 1e-6
    away_m = max(abs(a - b) for a, b in zip(here_m, start_m, strict=True))
    if away_m <= _AT_START_M:
        return
    if away_m <= near_m:
        resume.go_straight(device, start_m, bounds, operator)
        return
    if approach is None and placed:
        raise DeviceError(
            f"the axes stand at the start, {_mm(start_m)} mm, and the drive takes it for {_mm(here_m)} mm: its lengths "
            "of an encoder count are not the machine's; --untold tells it lengths and limits, --set plant_x.encoder "
            "and plant_y.encoder the lengths alone"
        )
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


def _of_path(trajectory: Trajectory) -> dict[str, Any]:
    """What the log says of the path."""
    meta = {"feed": str(trajectory.feed)} if trajectory.feed is not None else {}
    meta |= {"smoothing": trajectory.smoothed} if trajectory.smoothed else {}
    return meta | {"trajectory": trajectory.digest}


def _words(trajectory: Planned, tool: Tool, driven: Rest) -> NDArray[np.uint32]:
    """The words of the knots that are `driven` of a trajectory, as far as it is planned."""
    if isinstance(trajectory, Ahead):
        return Switching(trajectory, tool).word
    return of_rest(words(trajectory, tool), driven)


def _what(device: Device, target: Target, options: RunOptions) -> dict[str, Any]:
    """What the log says before the run: on which drive and machine, how set."""
    bus = device.link.bus
    is_simulated = simulated(bus) is not None
    meta: dict[str, Any] = {
        "machine": target.machine.name if is_simulated else str(bus.channel_info),
    }
    if is_simulated:
        meta |= {"plant": target.machine.described(), "seed": target.seed, "told": target.told}
        meta |= {"compensation": target.compensation} if target.told == ALL else {}
    return meta | {
        "firmware": device.read("build_id"),
        "num": device.read("num_backend"),
        "control_hz": device.read("clock.control_hz"),
        "parameters": device.parameters.dump(),
        "command": options.command,
    }


def _switched(trajectory: Planned) -> str:
    """The words that switch something, and how often each."""
    kinds = trajectory.program.events.kinds()
    return ", ".join(word if count == 1 else f"{word} ×{count}" for word, (count, _) in kinds.items())


def _outcome(streamed: StreamResult, warnings: tuple[int, ...], log_problem: FileError | None) -> dict[str, Any]:
    """What the log says of how the run ended, and of the transmission."""
    meta: dict[str, Any] = {
        "status": "complete" if streamed.completed else "fault" if streamed.fault else "interrupted"
    }
    if streamed.fault is not None:
        meta["fault"] = str(streamed.fault)
    elif log_problem is not None:
        meta["fault"] = str(log_problem)
    if warnings:
        meta["warnings"] = [emcy.describe_emcy(code) for code in warnings]
    return meta | {"accepted": streamed.accepted, "rejected": streamed.rejected}


def _mm(position_m: tuple[float, float]) -> str:
    return f"({position_m[0] * 1e3:.3f}, {position_m[1] * 1e3:.3f})"
