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

import numpy as np
from numpy.typing import NDArray

from kontur.can.outputs import BY_RATE, FULL_POWER, HOLD, Outputs
from kontur.path.events import Event
from kontur.path.geometry import KNOT_S, FloatArray, Move, MoveTable, Program
from kontur.path.moves import dwells_in, lengths_m
from kontur.planning.ahead import Ahead
from kontur.planning.planner import Trajectory
from kontur.planning.rest import EQUAL, Rest

ON, LEFT, MIST, FLOOD, P0, PEN = 1, 2, 4, 8, 16, 256
_TOGETHER_M = 1e-9
_SPEED_STEPS = 200  # in which the power of M4 follows the speed
_END = 2  # knots from the end: the last three are equal
_NEVER = np.iinfo(np.int64).max
_OFF = np.zeros(1, dtype=np.uint32)

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


class Words:
    """The words of the knots of a path as these are planned: digital outputs, and 65536 times the power.

    `known`: those (n,) that stay as they are, whatever is still to be planned. `complete`: these are all.
    """

    def __init__(self, program: Program, tool: Tool) -> None:
        self.known = np.empty(0, dtype=np.uint32)
        self.complete = False
        self.holds = np.array([event.before for event in held(program)], dtype=np.int64)
        self._program, self._tool = program, tool
        self._places = _Places(program)
        self._events = 0  # that happen before the knots to come
        self._state, self._power = _State(), 0.0
        self._feed_mps = _feeds_mps(program) if tool.laser else np.empty(0)

    def take(self, path_m: FloatArray, position_m: FloatArray, complete: bool) -> None:
        """Take in the distances (n,) and points (n, 2) of all knots so far; `complete`: there are no more."""
        begin, end = len(self.known), len(path_m) - (0 if complete else _END)
        self.complete = complete
        if end <= begin:
            return
        self._places.take(path_m, complete)
        arrives = self._places.arrives
        events = self._program.events
        known = int(np.searchsorted(events.before, len(arrives)))
        knot = arrives[events.before[self._events : known]]
        happen = int(np.searchsorted(knot, end))
        digital, power = self._after(happen)
        knots = np.diff([begin, *knot[:happen], end])
        of_knots, power = np.repeat(digital, knots), np.repeat(power, knots)
        if self._tool.laser:
            speed_mps = _speed_mps(position_m, begin, end)
            of_knots = self._of_laser(np.arange(begin, end), of_knots, power, speed_mps)
        word: NDArray[np.uint32] = of_knots | np.rint(power * FULL_POWER).astype(np.uint32) << np.uint32(16)
        if complete:
            word[max(len(path_m) - _END - begin, 0) :] = 0
        holds = arrives[self.holds[self.holds < len(arrives)]]
        word[holds[(holds >= begin) & (holds < end)] - begin] |= np.uint32(HOLD)
        self.known = np.append(self.known, word)

    def _after(self, count: int) -> tuple[NDArray[np.uint32], FloatArray]:
        """Digital outputs and power, before and after each of the next events (count + 1,)."""
        events = self._program.events
        digital, power = [self._state.digital], [self._power]
        for code in events.code[self._events : self._events + count].tolist():
            self._state.take(events.words[code])
            digital.append(self._state.digital)
            power.append(self._state.power(self._tool.full_s))
        self._events += count
        self._power = power[-1]
        return np.array(digital, dtype=np.uint32), np.array(power)

    def _of_laser(
        self, knot: _Index, digital: NDArray[np.uint32], power: FloatArray, speed_mps: FloatArray
    ) -> NDArray[np.uint32]:
        """Make `power` (n,) a laser's at these knots; returns its digital outputs (n,)."""
        arrives, departs = self._places.arrives, self._places.departs
        item = np.searchsorted(departs, knot, side="right") - 1
        rests = (item < 0) | (knot >= np.append(arrives[1:], _NEVER)[item])
        feed_mps = self._feed_mps[np.clip(item, 0, len(self._feed_mps) - 1)]
        power[rests | (feed_mps < 0.0)] = 0.0
        by_speed = digital & LEFT != 0
        share = np.rint(np.minimum(speed_mps / feed_mps, 1.0) * _SPEED_STEPS) / _SPEED_STEPS
        power[by_speed] *= share[by_speed]
        return np.where(by_speed, digital & ~np.uint32(LEFT) | np.uint32(BY_RATE), digital).astype(np.uint32)


class Switching:
    """A path that is planned while it is driven, with what it switches (kontur.drive.knot_sender.Knots). Where it
    switches anything, it has the knots whose words are known."""

    def __init__(self, path: Ahead, tool: Tool) -> None:
        self.switches = len(path.program.events) > 0
        self._path, self._words = path, Words(path.program, tool)
        self.holds = len(self._words.holds)

    def _taken(self) -> Words:
        complete = self._path.complete  # before its rows
        if not self._words.complete:
            path_m = self._path.path_s_m
            self._words.take(path_m, self._path.position_m[: len(path_m)], complete)
        return self._words

    @property
    def complete(self) -> bool:
        return self._taken().complete if self.switches else self._path.complete

    @property
    def word(self) -> NDArray[np.uint32]:
        """Those of the knots (n,), as far as they are known."""
        return self._taken().known if self.switches else _OFF

    @property
    def knots_nm(self) -> NDArray[np.int32]:
        return self._path.knots_nm[: len(self.word)] if self.switches else self._path.knots_nm

    def outputs_from(self, knot: int) -> Outputs:
        return of_words(self._words.known).since(knot)

    def done(self, knots: int) -> float:
        return self._path.done(knots)


def words(trajectory: Trajectory, tool: Tool) -> NDArray[np.uint32]:
    """The word of each knot of `trajectory` (n,); see Words."""
    if not trajectory.program.events:
        return np.zeros(len(trajectory.knots_nm), dtype=np.uint32)
    found = Words(trajectory.program, tool)
    found.take(trajectory.path_s_m, trajectory.position_m, complete=True)
    return found.known


def passed_over(trajectory: Trajectory) -> list[str]:
    """A sentence on places of events that share a knot with a later place, so that what they switch is never seen."""
    events = trajectory.program.events
    if not events:
        return []
    arrives, _ = boundaries(trajectory)
    place, knot = events.before, arrives[events.before]
    lost = events.line[:-1][(place[:-1] != place[1:]) & (knot[:-1] == knot[1:])]
    if not lost.size:
        return []
    return [
        f"Outputs change at {len(lost)} places less than a millisecond before the next one, first in line {lost[0]}: "
        "the drive takes the last change of each millisecond. A lower feed parts them."
    ]


def held(program: Program) -> list[Event]:
    """The events at which the path is held, one for each place."""
    items = program.items
    first = next(i for i, item in enumerate(items) if isinstance(item, Move))
    events = program.events
    found = (events[int(row)] for row in events.rows(HOLDS))
    return [event for event in found if event.before > first]


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
    places = _Places(trajectory.program)
    places.take(trajectory.path_s_m, complete=True)
    return places.arrives, places.departs


class _Places:
    """The places before each item of a program, and its end; `arrives` and `departs` (n,) are the knots at which the
    path comes to the first of them, and leaves them. Those of the last knot so far may still become later."""

    def __init__(self, program: Program) -> None:
        items = program.items
        length_m, dwell = lengths_m(items), np.zeros(len(items))
        for row, item in dwells_in(items):
            dwell[row] = item.duration_s / KNOT_S
        place_m = np.append(0.0, np.cumsum(length_m))
        self._from_m, self._to_m = place_m - _TOGETHER_M, place_m + _TOGETHER_M
        # The dwells of the same rest before a place, and after it
        waited = np.append(0.0, np.cumsum(dwell))
        moves = np.append(True, length_m > 0.0)  # the item before is a move, or it is the start
        group = np.cumsum(moves) - 1
        self._before = waited - waited[np.flatnonzero(moves)][group]
        last_of_group = np.append(np.flatnonzero(moves)[1:] - 1, len(items))[group]
        self._after = waited[last_of_group] - waited
        self._place_m = place_m
        self._arrives, self._departs = np.empty(len(place_m), np.int64), np.empty(len(place_m), np.int64)
        self._left = self._come = 0  # places that the path has left, and to which it has come

    @property
    def arrives(self) -> _Index:
        return self._arrives[: self._come]

    @property
    def departs(self) -> _Index:
        return self._departs[: self._come]

    def take(self, path_m: FloatArray, complete: bool) -> None:
        """Take in the distances (n,) of all knots so far; `complete`: there are no more."""
        self._come = len(self._place_m) if complete else int(np.searchsorted(self._from_m, path_m[-1], side="right"))
        rows = slice(self._left, self._come)
        place_m, before, after = self._place_m[rows], self._before[rows], self._after[rows]
        first = np.searchsorted(path_m, self._from_m[rows], side="left")
        last = np.searchsorted(path_m, self._to_m[rows], side="right") - 1
        passing = last < first  # the place lies between two knots
        nearest = np.where(place_m - path_m[last] < path_m[np.minimum(first, len(path_m) - 1)] - place_m, last, first)
        arrives = np.where(before > 0.0, np.where(after > 0.0, first + np.rint(before), last), first)
        arrives = np.clip(np.where(passing, nearest, arrives), 0, len(path_m) - 1).astype(np.int64)
        departs = np.where(passing, nearest, np.where(after > 0.0, arrives, last)).astype(np.int64)
        self._arrives[rows], self._departs[rows] = arrives, np.maximum(arrives, departs)
        self._left = int(np.searchsorted(self._to_m, path_m[-1], side="left"))


def _feeds_mps(program: Program) -> FloatArray:
    """The feeds of the items (n,): infinite for a dwell, and below zero for a rapid move."""
    items = program.items
    if isinstance(items, MoveTable):
        feed_mps = items.feed_mps.copy()
    else:
        feed_mps = np.array([item.feed_mps if isinstance(item, Move) else np.inf for item in items])
    feed_mps[np.isinf(feed_mps)] = -1.0
    feed_mps[[row for row, _ in dwells_in(items)]] = np.inf
    return feed_mps


def _speed_mps(position_m: FloatArray, begin: int, end: int) -> FloatArray:
    """Speeds (end - begin,) at knots of a path."""
    low = max(begin - 1, 0)
    return np.asarray(np.hypot(*np.gradient(position_m[low : end + 1], KNOT_S, axis=0).T)[begin - low : end - low])
