# SPDX-License-Identifier: Apache-2.0
"""What a program switches beside the axes (its events), as outputs of the knots of its trajectory.

Digital outputs (2180h) by bit: 0 spindle or laser (M3, M4), 1 the spindle turns left (M4), 2 mist (M7), 3 flood (M8), 4
to 7 the outputs P0 to P3 of M62 to M65, 8 the pen is down (z at 0 or below). Power is S while the spindle or the laser
is on, or Q of M67 and M68 with E0.

An event happens at the knot that is nearest to its place. Where the path rests there, it happens at the beginning of
the rest, and in a rest with dwells at its turn among them. At the end of the program all goes off.

The power of a laser is that of its moves: none in rapid ones (G0) and where the path only stops between two moves. With
M4 it goes with the speed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from kontur.can.outputs import BY_RATE, FULL_POWER, HOLD, Outputs
from kontur.path.events import Event
from kontur.path.geometry import KNOT_S, FloatArray, Move, Program
from kontur.path.moves import dwells_in, lengths_m
from kontur.planning.planner import Trajectory
from kontur.planning.rest import EQUAL, Rest

ON, LEFT, MIST, FLOOD, P0, PEN = 1, 2, 4, 8, 16, 256
_TOGETHER_M = 1e-9
_SPEED_STEPS = 200  # in which the power of M4 follows the speed
_END = 2  # knots from the end: the last three are equal

HOLDS = ("M0", "M1", "M6", "M60")
"""Words at which the path is held, but for those before its first move."""

_Index = NDArray[np.int64]
_PORT = re.compile(r"M6([2-5]) P([0-3])")
_ANALOG = re.compile(r"M6[78] E0 Q(.+)")


@dataclass(frozen=True)
class Tool:
    """What S belongs to: `full_s` is its value at full power, `laser` says that it is a laser, not a spindle."""

    full_s: float = 1000.0
    laser: bool = False


SPINDLE = Tool()


@dataclass
class _State:
    """What is on after the events so far. `value` is that of S, or with `analog` that of M67, which needs no M3."""

    digital: int = 0
    value: float = 0.0
    analog: bool = False
    switches: dict[str, tuple[int, int]] = field(  # bits that go off, and bits that go on then
        default_factory=lambda: {
            "M3": (LEFT, ON),
            "M4": (0, ON | LEFT),
            "M5": (ON | LEFT, 0),
            "M7": (0, MIST),
            "M8": (0, FLOOD),
            "M9": (MIST | FLOOD, 0),
        }
    )

    def take(self, word: str) -> None:
        off, on = self.switches.get(word, (0, 0))
        if word[0] == "Z":
            off, on = (0, PEN) if float(word[1:]) <= 0.0 else (PEN, 0)
        elif word[0] == "S":
            self.value, self.analog = float(word[1:]), False
        elif word == "M5" and self.analog:
            self.value = 0.0
        elif port := _PORT.fullmatch(word):
            bit = P0 << int(port[2])
            off, on = (0, bit) if port[1] in "24" else (bit, 0)
        elif analog := _ANALOG.fullmatch(word):
            self.value, self.analog = float(analog[1]), True
        self.digital = self.digital & ~off | on

    def power(self, full_s: float) -> float:
        return min(max(self.value / full_s, 0.0), 1.0) if self.analog or self.digital & ON else 0.0


def words(trajectory: Trajectory, tool: Tool) -> NDArray[np.uint32]:
    """Digital outputs, and 65536 times the power, of each knot of `trajectory` (n,)."""
    count = len(trajectory.knots_nm)
    events = trajectory.program.events
    if not events:
        return np.zeros(count, dtype=np.uint32)
    arrives, departs = boundaries(trajectory)
    state = _State()
    after = [(state.digital, 0.0)]
    for event in events:
        state.take(event.word)
        after.append((state.digital, state.power(tool.full_s)))
    knots = np.diff([0, *(arrives[event.before] for event in events), count])
    digital = np.repeat(np.array([bits for bits, _ in after], dtype=np.uint32), knots)
    power = np.repeat([share for _, share in after], knots)
    if tool.laser:
        digital = _of_laser(trajectory, arrives, departs, digital, power)
    word: NDArray[np.uint32] = digital | np.rint(power * FULL_POWER).astype(np.uint32) << np.uint32(16)
    word[count - _END :] = 0
    word[[int(arrives[event.before]) for event in held(trajectory.program)]] |= np.uint32(HOLD)
    return word


def passed_over(trajectory: Trajectory) -> list[str]:
    """A sentence on places of events that share a knot with a later place, so that what they switch is never seen."""
    events = trajectory.program.events
    arrives, _ = boundaries(trajectory)
    lost = [
        event.line
        for event, later in pairwise(events)
        if event.before != later.before and arrives[event.before] == arrives[later.before]
    ]
    if not lost:
        return []
    return [
        f"Outputs change at {len(lost)} places less than a millisecond before the next one, first in line {lost[0]}: "
        "the drive takes the last change of each millisecond. A lower feed parts them."
    ]


def held(program: Program) -> list[Event]:
    """The events at which the path is held, one for each place."""
    items = program.items
    first = next(i for i, item in enumerate(items) if isinstance(item, Move))
    return [event for event in program.events if event.word in HOLDS and event.before > first]


def of_words(word: NDArray[np.uint32]) -> Outputs:
    """The changes from knot to knot; a hold is not inherited."""
    inherited = np.append(np.uint32(0), word[:-1] & ~np.uint32(HOLD))
    knot = np.flatnonzero(word != inherited)
    return Outputs(knot, (word[knot] & 0xFFFF).astype(np.uint16), (word[knot] >> np.uint32(16)).astype(np.uint16))


def of_rest(word: NDArray[np.uint32], rest: Rest) -> NDArray[np.uint32]:
    """Each knot's `word` of a trajectory, for the `rest` that is left of it: off until it moves."""
    at = np.floor(np.asarray(rest.path_ms) + 1e-9).astype(np.int64)
    left: NDArray[np.uint32] = word[at]
    if len(left) < len(word):
        left[: EQUAL + 1] = 0
        left[1:][np.diff(at) == 0] &= ~np.uint32(HOLD)
    return left


def boundaries(trajectory: Trajectory) -> tuple[_Index, _Index]:
    """The knots (items + 1,) at which the path comes to the place before each item, and the end, and leaves it."""
    items = trajectory.program.items
    length_m, dwell = lengths_m(items), np.zeros(len(items))
    for row, item in dwells_in(items):
        dwell[row] = item.duration_s / KNOT_S
    place_m = np.append(0.0, np.cumsum(length_m))
    path_m = trajectory.path_s_m
    first = np.searchsorted(path_m, place_m - _TOGETHER_M, side="left")
    last = np.searchsorted(path_m, place_m + _TOGETHER_M, side="right") - 1
    passing = last < first  # the place lies between two knots
    nearest = np.where(place_m - path_m[last] < path_m[np.minimum(first, len(path_m) - 1)] - place_m, last, first)
    # The dwells of the same rest before a place, and after it
    waited = np.append(0.0, np.cumsum(dwell))
    moves = np.append(True, length_m > 0.0)  # the item before is a move, or it is the start
    group = np.cumsum(moves) - 1
    before = waited - waited[np.flatnonzero(moves)][group]
    last_of_group = np.append(np.flatnonzero(moves)[1:] - 1, len(items))[group]
    after = waited[last_of_group] - waited
    arrives = np.where(before > 0.0, np.where(after > 0.0, first + np.rint(before), last), first)
    arrives = np.clip(np.where(passing, nearest, arrives), 0, len(path_m) - 1).astype(np.int64)
    departs = np.where(passing, nearest, np.where(after > 0.0, arrives, last)).astype(np.int64)
    return arrives, np.maximum(arrives, departs)


def _of_laser(
    trajectory: Trajectory, arrives: _Index, departs: _Index, digital: NDArray[np.uint32], power: FloatArray
) -> NDArray[np.uint32]:
    """Make `power` (n,) a laser's; returns its digital outputs (n,)."""
    feed_mps = np.full(len(power), np.inf)
    for i, item in enumerate(trajectory.program.items):
        power[arrives[i] : departs[i]] = 0.0
        if isinstance(item, Move):
            rows = slice(int(departs[i]), int(arrives[i + 1]))
            feed_mps[rows] = item.feed_mps
            if item.rapid:
                power[rows] = 0.0
    by_speed = digital & LEFT != 0
    speed_mps = np.hypot(*np.gradient(trajectory.position_m, KNOT_S, axis=0).T)
    share = np.rint(np.minimum(speed_mps / feed_mps, 1.0) * _SPEED_STEPS) / _SPEED_STEPS
    power[by_speed] *= share[by_speed]
    return np.where(by_speed, digital & ~np.uint32(LEFT) | np.uint32(BY_RATE), digital).astype(np.uint32)
