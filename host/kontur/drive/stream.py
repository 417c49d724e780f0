# SPDX-License-Identifier: Apache-2.0
"""Stream a trajectory to an enabled drive, and let the drive follow it until it stands again.

kontur.drive.knot_sender keeps the drive's queue filled; here the motion is started, followed and stopped.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kontur.can import outputs as switched
from kontur.can.link import RESEND_S
from kontur.can.outputs import Outputs
from kontur.drive.device import Device
from kontur.drive.knot_sender import DONE, RELEASE, RUNNING, STOPPED, STOPPING, AllKnots, Knots, KnotSender
from kontur.drive.pdos import OUTPUTS
from kontur.drive.state_machine import BIT_PATH_RUNS, BIT_TARGET_REACHED, ENABLE, RUN_PATH
from kontur.errors import EmcyError, StreamError

_START_TIMEOUT_S, _STOP_TIMEOUT_S = 0.5, 5.0


@dataclass(frozen=True)
class Operator:
    """Who attends a path while it runs. Each function is called again and again until the axes stand.

    `progress` gets the share of the knots that the drive has executed, 0 to 1. When `stop_requested` returns True the
    drive stops on the path. `feed_override` returns the wanted rate, 0 to 1.2 of the programmed feed, 0 to hold.
    `release` is called while the path is held at a knot (M0), with the number of this hold, -1 for the last one; it
    returns True to go on. Only `notice` is called once: it gets a sentence on a motion that is not the path's.
    """

    progress: Callable[[float], None] = lambda share: None
    stop_requested: Callable[[], bool] = lambda: False
    feed_override: Callable[[], float] = lambda: 1.0
    release: Callable[[int], bool] = lambda hold: True
    notice: Callable[[str], None] = lambda text: None


UNATTENDED = Operator()
"""The path runs to its end at the programmed feed."""


@dataclass(frozen=True)
class StreamResult:
    """How a stream ended. `completed`: the drive went all the way; else it stopped on the path, on request or, with
    `fault`, by itself.

    `start_s`, `stop_s`: time of the target when the motion was started, and when the stop was requested or the fault
    reported. `accepted`: knots that the drive accepted; `executed`: knots passed; `retransmitted`: knot frames sent
    again; `rejected`: knot frames that the drive rejected, by reason. `rates`: from which time on which feed override
    was commanded, the first one from the start. `passed`: knots passed before, of a path that is resumed.
    """

    completed: bool
    start_s: float
    stop_s: float | None
    accepted: int
    executed: int
    retransmitted: int
    rejected: dict[str, int]
    rates: tuple[tuple[float, float], ...] = ()
    fault: EmcyError | None = None
    passed: int = 0


@dataclass
class Motion:
    """What was commanded so far of a path that has been started; all as in StreamResult.

    `holds`: knots at which the path is held, as far as they are known; `released`: when it was let go on from the first
    of them that are not `passed`.
    """

    start_s: float
    rates: list[tuple[float, float]]
    stop_s: float | None = None
    passed: int = 0
    holds: Sequence[int] = ()
    released: list[float] = field(default_factory=list)


def stream(
    device: Device,
    knots_nm: NDArray[np.int32] | Knots,
    operator: Operator = UNATTENDED,
    *,
    outputs: Outputs = switched.NONE,
    before_start: Callable[[], None] = lambda: None,
    started: Callable[[Motion], None] = lambda motion: None,
    resume: bool = False,
    raise_fault: bool = True,
) -> StreamResult:
    """Send `knots_nm` (N, 2) and let the drive follow them and switch `outputs`; returns when it stands still again.
    Where more knots come while it moves, these have their outputs themselves.

    The drive must be enabled and stand at the first knot. `before_start` is called when the queue has a second of
    knots and motion is about to start, `started` when it has; what it gets is kept up to date.

    `resume`: go on with these knots, all of them as they were, where the drive stopped on the path before it was
    switched off, by a fault or by its master; the axes must not have been moved since.

    Raises StreamError, NoAnswerError, and EmcyError when the drive reports a fault; one during the motion is returned
    instead where `raise_fault` is False. KeyboardInterrupt: a stop was requested where a path that is to go on is
    held, and stays so.
    """
    knots = AllKnots(knots_nm, outputs) if isinstance(knots_nm, np.ndarray) else knots_nm
    if knots.switches:
        device.pdos.require(*OUTPUTS)
    sender = KnotSender(device, knots, resume)
    passed = int(device.read_stable("stream.executed")) if resume else 0
    sender.fill()
    rate = _first_rate(sender, operator)
    device.override_feed(rate)
    if resume:  # it may have been stopped at a hold
        _release(sender, knots, operator)
        if _hold(device, knots):
            raise KeyboardInterrupt
    before_start()
    start_s = _start(device)
    motion = Motion(start_s, [(start_s, rate)], passed=passed, holds=sender.holds)
    started(motion)
    fault = None
    try:
        _follow(sender, knots, operator, motion)
    except EmcyError as error:
        if raise_fault:
            raise
        fault = error
        motion.stop_s = device.link.time_s if motion.stop_s is None else motion.stop_s
        device.link.wait(lambda: device.axes.both(BIT_PATH_RUNS, False), _STOP_TIMEOUT_S)
    device.axes.stop_path()
    rejected = ("sequence", "crc", "full")
    result = StreamResult(
        completed=motion.stop_s is None,
        start_s=start_s,
        stop_s=motion.stop_s,
        accepted=int(device.read_stable("stream.accepted")),
        executed=int(device.read_stable("stream.executed")),
        retransmitted=sender.retransmitted,
        rejected={reason: int(device.read_stable(f"stream.rejected_{reason}")) for reason in rejected},
        rates=tuple(motion.rates),
        fault=fault,
        passed=passed,
    )
    if result.completed:
        _check_end(device, knots)
        operator.progress(1.0)
    return result


def _first_rate(sender: KnotSender, operator: Operator) -> float:
    """The feed override to start with; while the operator holds the feed, the motion does not start."""
    while (rate := operator.feed_override()) == 0.0 and not operator.stop_requested():
        sender.advance()
    return rate or 1.0


def _follow(sender: KnotSender, knots: Knots, operator: Operator, motion: Motion) -> None:
    """Send knots while the path runs, and do what the operator commands; returns when the axes stand."""
    device, rate = sender.device, motion.rates[-1][1]
    while rate == 0.0 or device.axes.both(BIT_PATH_RUNS) or _runs(device) or _hold(device, knots):
        if not device.axes.both(BIT_PATH_RUNS) and _release(sender, knots, operator):
            motion.released.append(device.link.time_s)
            device.link.wait(lambda: _started(device), _START_TIMEOUT_S)
        if (wanted := operator.feed_override()) != rate:
            motion.rates.append((device.link.time_s, wanted))
            device.override_feed(wanted)
            if rate == 0.0:
                device.link.wait(lambda: _started(device), _START_TIMEOUT_S)
            rate = wanted
        if operator.stop_requested():
            motion.stop_s = device.link.time_s
            if not device.axes.command_until(ENABLE, lambda: _stands(device), _STOP_TIMEOUT_S):
                raise StreamError(f"the drive does not stop on the path, {_STOP_TIMEOUT_S:g} s waited")
            return
        sender.advance()
        operator.progress(sender.share)


def _hold(device: Device, knots: Knots) -> int:
    """The knot, plus 1, at which the path is held; 0: it is not."""
    return int(device.read_stable("outputs.hold")) if knots.holds else 0


def _release(sender: KnotSender, knots: Knots, operator: Operator) -> bool:
    """Wait until the operator lets a path go on that is held. Returns whether it goes on."""
    device = sender.device
    if not (hold := _hold(device, knots)):
        return False
    number = sender.holds.index(hold - 1) - knots.holds
    while not operator.stop_requested():
        if operator.release(number) and device.read_stable("stream.state") == STOPPED:
            device.write("stream.command", RELEASE)
            return True
        sender.advance()
    return False


def _start(device: Device) -> float:
    """Let path time run; returns the time of the command that had an effect."""
    begin_s = start_s = device.link.time_s
    while start_s - begin_s < _START_TIMEOUT_S:
        if device.axes.command_until(RUN_PATH, lambda: _started(device), RESEND_S):
            return start_s
        start_s = device.link.time_s
    raise StreamError(f"the drive does not start the path, {_START_TIMEOUT_S:g} s waited")


def _started(device: Device) -> bool:
    device.faults.check()
    return device.axes.both(BIT_PATH_RUNS) or (
        # the bit may be that of the path before
        device.axes.both(BIT_TARGET_REACHED) and device.read_stable("stream.state") == DONE
    )


def _runs(device: Device) -> bool:
    """Whether the path runs, read by SDO: one statusword that denies it may be corrupted."""
    device.faults.check()
    return device.read_stable("stream.state") in (RUNNING, STOPPING)


def _stands(device: Device) -> bool:
    device.faults.check()
    return device.axes.both(BIT_PATH_RUNS, False)


def _check_end(device: Device, knots: Knots) -> None:
    """Every knot and its outputs were executed once and in order, or StreamError says what happened instead."""
    device.faults.check()
    executed = device.read_stable("stream.executed")
    if device.read_stable("stream.state") != DONE:
        underruns = device.read_stable("stream.underruns")
        why = "it ran out of knots (the host or the bus was too slow)" if underruns else "it was halted"
        raise StreamError(f"the drive stopped on the path before its end: {why}; {executed} knots done")
    knots_nm, outputs = knots.knots_nm, knots.outputs_from(0)
    want = zlib.crc32(np.ascontiguousarray(knots_nm, dtype="<i4").tobytes())
    got = device.read_stable("stream.checksum")
    if got != want or executed != len(knots_nm):
        raise StreamError(
            f"the drive went through other knots than were sent: {executed} of {len(knots_nm)}, "
            f"checksum {got:08X}h, not {want:08X}h"
        )
    changes, checksum = (int(device.read_stable(f"outputs.{name}")) for name in ("changes", "checksum"))
    if changes != len(outputs) or checksum != outputs.checksum:
        raise StreamError(
            f"the drive has switched other outputs than were sent: {changes} changes of {len(outputs)}, "
            f"checksum {checksum:08X}h, not {outputs.checksum:08X}h"
        )
