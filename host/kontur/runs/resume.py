# SPDX-License-Identifier: Apache-2.0
"""Going on with a path on which a drive was stopped: what it has left, and the way back to it.

A drive whose axes have stayed where they were goes on by itself with the knots that it has. The path behind these may
still be planned. Axes without power creep, and beyond limits.start_window the drive drops the path when they are
enabled. Then they go back to it in a straight line, and get the rest of the path as a new stream, which starts from
standstill. That depends on all of the path.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kontur.can import emcy
from kontur.can.outputs import Outputs
from kontur.drive.device import Device
from kontur.drive.knot_sender import STOPPED, check_stopped, executed_of, stopped_after
from kontur.drive.stream import UNATTENDED, Operator, stream
from kontur.errors import DeviceError, StreamError
from kontur.path.geometry import KNOT_S, Line, Move, Program
from kontur.planning.ahead import FIRST_S, Ahead, Planned
from kontur.planning.bounds import Limits
from kontur.planning.planner import Trajectory, plan
from kontur.planning.rest import Rest, rest, rest_of_length, whole
from kontur.runs import RETURN_MAX_M as RETURN_MAX_M

LINE_FEED_MPS = 0.02
_LOOK_S = 0.05  # how often the planning is looked at


@dataclass(frozen=True)
class Left:
    """Where a drive has left `trajectory`: `executed` knots of `driven`, at path time `at_ms` of the trajectory, where
    the path is at `at_m`. `total`: knots of the drive's stream; 0: it does not know."""

    trajectory: Planned
    driven: Rest
    executed: int
    at_ms: int
    at_m: tuple[float, float]
    total: int

    @property
    def ends_otherwise(self) -> bool:
        """Whether the trajectory, which may have been planned on the way, is found to have another end than the drive's
        path."""
        if isinstance(self.trajectory, Trajectory) or not self.total:
            return False  # it was compared before, or cannot be
        complete, count = self.trajectory.complete, len(self.trajectory.knots_nm)
        return count > self.total or (complete and count < self.total)


def passed_by(device: Device) -> int:
    """How many knots a drive has that stopped on its path. Raises StreamError: it did not."""
    check_stopped(device)
    return int(device.read_stable("stream.accepted"))


def left_by(device: Device, trajectory: Planned, reach_m: float) -> Left:
    """Where the drive has left `trajectory`; to be read before the axes are enabled. Waits for its planning, for all of
    it where the drive will not go on by itself.

    Raises StreamError: it did not stop on a path, or on another one; DeviceError: the axes are further than `reach_m`
    from there; what the planning raised.
    """
    total = int(device.read_stable("stream.total"))
    if isinstance(trajectory, Ahead) and not _goes_on(device, trajectory):
        trajectory = _all_of(device, trajectory)
    driven = whole(trajectory)
    if isinstance(trajectory, Trajectory) and total not in (0, len(trajectory.knots_nm)):
        driven = rest_of_length(trajectory, total, _stop_time_ms(device)) or driven
    executed = stopped_after(device, driven.trajectory.knots_nm, isinstance(trajectory, Trajectory))
    for axis in "xy":
        fault = emcy.faults().get(int(device.read_stable(f"error_code_{axis}")))
        if fault is not None and fault.reaction == "disable":
            raise StreamError(
                f"the drive cannot go on with the path: {fault.fault}, and the axes lost their power on the way; plan "
                "anew from where they stand"
            )
    at_ms = min(int(driven.path_ms[max(executed - 1, 0)]), len(trajectory.knots_nm) - 2)
    x, y = trajectory.position_m[at_ms]
    left = Left(trajectory, driven, executed, at_ms, (float(x), float(y)), total)
    off_m = math.dist(device.position_m(), left.at_m)
    if off_m > reach_m:
        raise DeviceError(
            f"the axes stand {off_m * 1e3:.3f} mm from where they left the path: without power they creep, or somebody "
            f"has moved them. --resume goes back at most {reach_m * 1e3:g} mm by itself; add --approach to let it go "
            "back in a straight line from where they stand"
        )
    return left


def _goes_on(device: Device, path: Ahead) -> bool:
    """Whether the drive goes on by itself with a path that is still planned: it has executed the first knots of it, and
    its axes are where it left them."""
    enough = passed_by(device) + round(FIRST_S / KNOT_S)
    _wait(device, lambda: len(path.knots_nm) >= enough or path.ended(0.0))
    knots_nm = path.knots_nm
    executed = executed_of(device, knots_nm)
    if path.ended(0.0) or executed is None:
        return False
    window_nm = device.read("limits.start_window") * 1e3
    around_nm = knots_nm[max(executed - 2, 0) : executed + 2]  # it may stop between two knots
    at_nm = np.array(device.position_nm())
    off_nm = np.maximum(np.min(around_nm, axis=0) - at_nm, at_nm - np.max(around_nm, axis=0))
    return bool(np.max(off_nm) <= window_nm)


def _all_of(device: Device, path: Planned) -> Trajectory:
    """The trajectory, when all of it is planned. Raises what the planning raised."""
    if isinstance(path, Trajectory):
        return path
    _wait(device, lambda: path.ended(0.0))
    return path.trajectory()


def _wait(device: Device, until: Callable[[], bool]) -> None:
    """Wait for the planning; the drive hears from the host meanwhile. Where time passes with SYNC, it does not."""
    while not device.link.wait_for_answer(until, _LOOK_S):
        pass


def check_outputs(device: Device, outputs: Outputs) -> None:
    """Raises StreamError where the drive has switched other outputs than these up to where it stopped."""
    changes, checksum = (int(device.read_stable(f"outputs.{name}")) for name in ("changes", "checksum"))
    if changes > len(outputs) or checksum != outputs[:changes].checksum:
        raise StreamError(
            "the drive has switched other outputs so far than this program does; give the file and the options of the "
            "run that was stopped, such as --laser and --full-s"
        )


def return_to(device: Device, left: Left, limits: Limits, operator: Operator) -> tuple[Rest, bool]:
    """Bring the enabled axes back to the path. Returns what to stream, and whether the drive has its knots still.

    Raises KeyboardInterrupt when the operator requested the stop on a long way back: nothing is left to go on with.
    """
    if device.read_stable("stream.state") == STOPPED:
        return left.driven, True
    off_m = math.dist(device.position_m(), left.at_m)
    operator.notice(
        f"The axes stand {off_m * 1e6:.0f} µm from where they left the path, since axes without power creep. They go "
        "back in a straight line first."
    )
    trajectory = _all_of(device, left.trajectory)
    short = off_m <= RETURN_MAX_M  # not stopped on its way, so that the path can still go on afterwards
    go_straight(device, left.at_m, limits, UNATTENDED if short else operator)
    return rest(trajectory, left.at_ms, _stop_time_ms(device)), False


def go_straight(device: Device, to_m: tuple[float, float], limits: Limits, operator: Operator) -> None:
    """Let the enabled axes go to `to_m` in a straight line. Raises KeyboardInterrupt: the operator requested a stop."""
    here_m = device.demand_m()
    line = Program("approach", (Move(Line(here_m, to_m), LINE_FEED_MPS),), here_m)
    only_stop = Operator(stop_requested=operator.stop_requested)
    if not stream(device, plan(line, limits).knots_nm, only_stop).completed:
        raise KeyboardInterrupt


def _stop_time_ms(device: Device) -> float:
    return float(device.read("limits.path_stop_time"))
