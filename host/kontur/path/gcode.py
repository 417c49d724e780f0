# SPDX-License-Identifier: Apache-2.0
"""G-code to a program: RS-274 as LinuxCNC reads it, for a machine of two axes. docs/paths.md has the words.

kontur.path.gcode_words has the lines and their words, kontur.path.arcs the arcs; here are the modes, the offsets and
what each block does. Every other word is refused, since a program with a word skipped would cut another part. Words
that switch something beside the axes become events of the program.

At the start: G17 G21 G54 G90 G91.1 G94, no motion mode, no feed, no offsets, and no tolerance of the path (G61, G64). F
is in units (mm or inch) per minute; with G93 a move takes 1/F minutes. G0 goes on a straight line as fast as the
machine may.
"""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from kontur.path import arcs, events, gcode_words, plain_lines
from kontur.path.arcs import INCH_M, SAME
from kontur.path.gcode_words import Block, Refusals
from kontur.path.geometry import Dwell, Line, Move, Point, Program, Segment
from kontur.path.moves import Builder
from kontur.path.notes import notes
from kontur.path.offsets import AXES, SYSTEMS, Offsets, zeros
from kontur.path.plain_lines import Lines, carried

Z_MODES = ("pen", "ignore", "refuse")
"""What becomes of axes beside x and y. pen: z goes up and down where x and y stand or go rapidly, at rest, as an event;
ignore: whatever they do, x and y go as programmed; refuse: no word of them is taken."""

Source = Callable[[str, Refusals], Iterator[Block]]

_END = (2, 30)
_TURNS_MAX = 1000
_FEW, _SPAN = 4, 64  # lines: fewer are quicker one by one; so many are tried at once behind one that was not taken
HOLD_REST_S = 0.7
"""Time for which a path rests at a hold: what a drive needs to stop path time, at most (docs/protocol.md)."""
_PORTS, _ANALOG = (62, 63, 64, 65), (67, 68)
_BELONGS = {  # words that have a meaning beside certain codes only: G codes as ten times their number, and M codes
    "P": ((20, 30, 40, 100, 640, *_PORTS), "P belongs to G2, G3, G4, G10, G64 or M62 to M65"),
    "Q": ((640, *_ANALOG), "Q belongs to G64, M67 or M68"),
    "E": (_ANALOG, "E belongs to M67 and M68"),
    "L": ((100,), "L belongs to G10"),
    "H": ((430, 490), "H belongs to G43"),
    "D": ((), "D belongs to G41 and G42, and there is no cutter compensation"),
}


def parse(text: str, name: str, start_m: Point = (0.0, 0.0), z: str = "pen", source: Source | None = None) -> Program:
    """The program of the G-code `text`, for a machine that stands at `start_m`. `name` is the file's, for messages; `z`
    is one of Z_MODES. `source` reads the blocks, such as that of kontur.path.interpreter; None: Kontur's own.

    Raises FileError: anything that is not understood, with line and word; a file without motion.
    """
    program, refusals = read(text, name, start_m, z, source)
    if refusals:
        raise refusals.error()
    return program


def read(
    text: str, name: str, start_m: Point = (0.0, 0.0), z: str = "pen", source: Source | None = None
) -> tuple[Program, Refusals]:
    """The same, and all that the file is refused for; the program lacks what is refused."""
    refusals = Refusals(name)
    reader = _Reader(refusals, start_m, z)
    with _without_collection():
        for block in source(text, refusals) if source else _others(text, reader):
            reader.run(block)
            if any(m in _END for m in block.m):
                break
    if not refusals and not reader.items.moves:
        refusals.add("there is no motion in this file; it needs a line like G1 X10 Y5 F1000")
    items, switched = reader.items.table(), reader.events.events()
    return Program(name, items, start_m, notes(items, switched), switched), refusals


def _others(text: str, reader: _Reader) -> Iterator[Block]:
    """The blocks of a program, but for the lines that `reader` takes many at a time."""
    words = gcode_words.Words(reader.refusals)
    for part in plain_lines.lines(text):
        row = 0
        while row < len(part):
            taken = reader.take(part, row)
            if taken > row:
                row = taken
                continue
            block = words.block(part.text(row), part.number + row)
            if block is not None:
                yield block
            if words.ended:
                return
            row += 1


@contextmanager
def _without_collection() -> Iterator[None]:
    """Millions of moves are made, none in a circle. To search them for circles again and again takes a third of the
    time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


class _Reader:
    """The modal state, and the program so far. Positions are the machine's, in m (A, B, C in degrees)."""

    def __init__(self, refusals: Refusals, start_m: Point, z: str) -> None:
        self.refusals = refusals
        self.z = z
        self.at = zeros() | {"X": start_m[0], "Y": start_m[1]}
        self.here = start_m  # x and y of `at`
        self.span = _SPAN  # of lines that are tried at once
        self.plain = True  # whether x and y of a line are where it ends, but for the origin, and i and j its centre
        self.origin = (0.0, 0.0)
        self.items = Builder(start_m)
        self.events = events.Builder()
        self.offsets = Offsets()
        self.homes = {280: zeros(), 300: zeros()}
        self.unit_m = 1e-3
        self.motion: int | None = None
        self.plane = 170
        self.feed: float | None = None  # m/s, or with G93 moves per s
        self.inverse_time = False
        self.tolerance_m: float | None = None
        self.stops = False
        self.relative = False
        self.center_absolute = False

    def take(self, part: Lines, first: int) -> int:
        """Carry out plain lines from row `first` of `part` on as run() would, but many at a time. Returns the first one
        that is for run()."""
        end = min(part.plain_until(first), first + self.span)
        if end - first < _FEW or not self.plain:
            return first
        g, x, y, f, s, i, j, wait = part.values[:, first:end]
        motion = carried(10.0 * g, -1.0 if self.motion is None else self.motion)
        feed = carried(f / 60.0 * self.unit_m, self.feed or 0.0)
        if motion[0] < 0.0 or feed[0] == 0.0:
            return first
        place = np.stack([carried(self.origin[0] + x * self.unit_m, self.here[0]),
                          carried(self.origin[1] + y * self.unit_m, self.here[1])])  # fmt: skip
        step = np.abs(np.diff(place, axis=1, prepend=np.array(self.here)[:, None]))
        centred = ~(np.isnan(i) & np.isnan(j))
        turns = (motion >= 20.0) & (centred | ~(np.isnan(x) & np.isnan(y)))
        other = np.any((step > 0.0) & (step < SAME), axis=0)  # run() takes this line as one that goes nowhere
        other |= centred != turns  # I or J beside a line, or an arc without them
        stop = int(np.argmax(other)) if np.any(other) else end - first
        bends = np.flatnonzero(turns[:stop])
        if bends.size:
            here = np.concatenate([np.array(self.here)[:, None], place[:, :-1]], axis=1)[:, bends]
            centre = np.nan_to_num(np.stack([i, j])[:, bends]) * self.unit_m + here
            bent, curved = arcs.columns(here, place[:, bends], centre, motion[bends] == 30.0, self.unit_m)
            if bent.shape[1] < len(bends):
                stop = int(bends[bent.shape[1]])
        self.span = _SPAN if stop < end - first else 2 * self.span
        if stop == 0:
            return first
        rows = slice(0, stop)
        moved = np.any(step[:, rows] > 0.0, axis=0) | turns[rows]
        waits = wait[rows] > 0.0
        feeds = np.where(waits | (motion[rows] == 0.0), math.inf, feed[rows])
        put = moved | waits
        place = place[:, rows]
        line = np.arange(stop) + (part.number + first)
        before = len(self.items) + np.cumsum(put) - put  # the item of each line, or the next one's
        power = ~np.isnan(s[rows])
        if np.any(power):
            self.events.powers(s[rows][power], before[power], line[power])
        self.items.lines(place[0, put], place[1, put], feeds[put], line[put], self.tolerance_m)
        if np.any(waits):
            self.items.wait(before[waits], wait[rows][waits])
        if bends.size:
            self.items.bend(before[bends[: bent.shape[1]]], bent, curved)
        self.here = float(place[0, -1]), float(place[1, -1])
        self.at |= {"X": self.here[0], "Y": self.here[1]}
        self.motion, self.feed = int(motion[rows][-1]), float(feed[rows][-1])
        return first + stop

    def run(self, block: Block) -> None:
        """Carry out one block, in the order of RS274NGC: feed, events, dwell, modes, offsets, the move, a hold."""
        codes, values = block.codes, block.values
        for letter, (owners, what) in _BELONGS.items():
            if letter in values and not any(code in owners for code in (*codes.values(), *block.m)):
                self._refuse(block, letter, f"{what}; remove it")
        if values.pop("K", 0.0) != 0.0 and codes.get("plane", self.plane) == 170:
            self._refuse(block, "K", "arcs lie in the plane of x and y: their centre is given by I and J")
        if self.z == "refuse":
            for letter in "ZABC":
                if values.pop(letter, None) is not None:
                    self._refuse(block, letter, "the machine has two axes, x and y; remove the word, or see --z")
        self._set_feed(block)
        self._switch(block)
        non_modal = codes.get("non-modal")
        if non_modal == 40:
            self._dwell(block)
        self._set_modes(block)
        if non_modal in (100, 920):
            self._set_offset(block, non_modal)
        elif non_modal in (280, 300):
            self._go_home(block, self.homes[non_modal])
        elif non_modal in (281, 301):
            self.homes[non_modal - 1] = dict(self.at)
        elif non_modal in (921, 922, 923):
            self.offsets.g92_holds = non_modal == 923
            if non_modal == 921:
                self.offsets.g92 = zeros()
        elif non_modal != 40 or "motion" in codes:
            self._go(block)
        for m in block.m:
            if m in (0, 1, 60):
                self._hold(block, m)
        flat = self.plane == 170 and not self.center_absolute
        self.plain = flat and not (self.relative or self.inverse_time or self.stops or self.offsets.turned)
        self.origin = self.offsets.of("X"), self.offsets.of("Y")

    def _refuse(self, block: Block, letter: str, what: str) -> None:
        self.refusals.add(what, block.line, block.texts.get(letter))

    def _set_feed(self, block: Block) -> None:
        codes, values = block.codes, block.values
        if "feed mode" in codes and (codes["feed mode"] == 930) != self.inverse_time:
            self.inverse_time, self.feed = not self.inverse_time, None
        unit_m = {200: INCH_M, 210: 1e-3}.get(codes.get("units", 0), self.unit_m)
        changed, self.unit_m = unit_m != self.unit_m, unit_m
        if "F" in values:
            if not values["F"] > 0.0:
                self._refuse(block, "F", "the feed must be above zero")
            elif changed and not self.inverse_time:
                what = "a feed on the line that changes the unit; controls differ about its unit"
                self._refuse(block, "F", f"{what}, so put it on the next line")
            self.feed = abs(values["F"]) / 60.0 * (1.0 if self.inverse_time else unit_m) or None

    def _switch(self, block: Block) -> None:
        """The events that come before the motion of the block."""
        for letter in "ST":
            if letter in block.values:
                self._event(block, f"{letter}{block.values[letter]:g}")
        for m in block.m:
            if m == 6:
                self._hold(block, m)
            elif m in (3, 4, 5, 7, 8, 9):
                self._event(block, f"M{m}")
            elif m in _PORTS:
                if block.values.get("P", -1.0) not in (0.0, 1.0, 2.0, 3.0):
                    self._refuse(block, "P", f"M{m} needs the number of an output, P0 to P3")
                else:
                    self._event(block, f"M{m} P{block.values['P']:g}")
            elif m in _ANALOG:
                if block.values.get("E", -1.0) != 0.0 or "Q" not in block.values:
                    self._refuse(block, "E", f"M{m} needs the analog output and its value, like M{m} E0 Q500")
                else:
                    self._event(block, f"M{m} E0 Q{block.values['Q']:g}")

    def _event(self, block: Block, word: str) -> None:
        self.events.add(word, len(self.items), block.line)

    def _hold(self, block: Block, m: int) -> None:
        """An event, at which the path is held once it has begun: it rests for as long as the drive needs to stop it."""
        self._event(block, f"M{m}")
        if self.items.moves:
            self.items.add(Dwell(HOLD_REST_S, block.line), self.here)

    def _dwell(self, block: Block) -> None:
        values = block.values
        if not values.get("P", -1.0) >= 0.0:
            self._refuse(block, "P", "G4 needs the time to wait in seconds, not negative, like G4 P0.5")
        elif "motion" not in block.codes and any(letter in values for letter in "XYZABCIJR"):
            letter = next(letter for letter in "XYZABCIJR" if letter in values)
            self._refuse(block, letter, "a dwell and a move without its G code on one line; put them on two lines")
        elif values["P"] > 0.0:
            self.items.add(Dwell(values["P"], block.line), self.here)

    def _set_modes(self, block: Block) -> None:
        codes = block.codes
        self.plane = codes.get("plane", self.plane)
        if "motion" in codes or "cycle" in codes:
            self.motion = codes.get("motion")
        if "coordinate system" in codes:
            self.offsets.chosen = SYSTEMS.index(codes["coordinate system"])
        if "distance" in codes:
            self.relative = codes["distance"] == 910
        if "path control" in codes:
            self._set_tolerance(block)
        if "arc centre" in codes:
            self.center_absolute = codes["arc centre"] == 901

    def _set_tolerance(self, block: Block) -> None:
        """G61: the exact path; G61.1: with a stop after each move; G64 P: within P of it, whatever Q is; G64: within
        what the host is told."""
        self.stops = block.codes["path control"] == 611
        if block.codes["path control"] != 640:
            self.tolerance_m = 0.0
            return
        tolerance = block.values.get("P")
        if tolerance is not None and not tolerance >= 0.0:
            self._refuse(block, "P", "the tolerance of G64 must not be negative")
        if not block.values.get("Q", 0.0) >= 0.0:
            self._refuse(block, "Q", "the tolerance of G64 must not be negative")
        self.tolerance_m = None if tolerance is None else abs(tolerance) * self.unit_m

    def _set_offset(self, block: Block, code: int) -> None:
        """G92, and G10 with L2 or L20: where the origin of the program is."""
        values, offsets = block.values, self.offsets
        axes = [axis for axis in AXES if axis in values]
        if "motion" in block.codes and axes:
            self._refuse(block, axes[0], "G10 or G92 and a motion on one line; put them on two lines")
        elif code == 920:
            if not axes:
                self._refuse(block, "", "G92 needs the coordinates of where the machine is, like G92 X0 Y0")
            offsets.set_here(self.at, {axis: self._length(block, axis) for axis in axes})
        else:
            kind, system = values.get("L"), values.get("P", -1.0)
            if kind not in (2.0, 20.0) or system not in range(10):
                self._refuse(
                    block, "L", "of G10, L2 and L20 with P0 to P9 set an origin; the others are not understood"
                )
            elif kind == 20.0 and "R" in values:
                self._refuse(block, "R", "G10 L20 turns no coordinate system; use L2")
            else:
                number = int(system) - 1 if system else offsets.chosen
                if "R" in values:
                    offsets.turn(number, values["R"])
                places = {axis: self._length(block, axis) for axis in axes}
                offsets.set_origin(number, None if kind == 2.0 else self.at, places)

    def _length(self, block: Block, axis: str) -> float:
        """The value of a word in m, or degrees."""
        return block.values[axis] * (1.0 if axis in "ABC" else self.unit_m)

    def _target(self, block: Block) -> dict[str, float]:
        """Where the block goes, for each axis that it names."""
        machine = block.codes.get("non-modal") == 530
        if self.offsets.turned and not machine:
            return self._turned_target(block)
        target = {}
        for axis in AXES:
            if axis in block.values:
                base = 0.0 if machine else self.at[axis] if self.relative else self.offsets.of(axis)
                to = base + self._length(block, axis)
                target[axis] = self.at[axis] if abs(to - self.at[axis]) < SAME else to
        return target

    def _turned_target(self, block: Block) -> dict[str, float]:
        """The same in a coordinate system that is turned: x and y of the machine depend on both."""
        offsets = self.offsets
        place = offsets.local(self.at)
        for axis in AXES:
            if axis in block.values:
                base = place[axis] if self.relative else offsets.shift(axis)
                place[axis] = base + self._length(block, axis)
        named = {axis for axis in AXES if axis in block.values}
        xy = offsets.in_machine(place["X"] - offsets.shift("X"), place["Y"] - offsets.shift("Y"))
        target = {axis: place[axis] + offsets.systems[offsets.chosen][axis] for axis in named}
        return target | ({"X": xy.real, "Y": xy.imag} if named & {"X", "Y"} else {})

    def _go_home(self, block: Block, home: dict[str, float]) -> None:
        """G28, G30: by way of the point that is named to the place kept for each axis that is named, or for all."""
        if "motion" in block.codes:
            self.refusals.add("G28 or G30 and a motion on one line; put them on two lines", block.line)
            return
        target = self._target(block)
        self._move(block, 0, target)
        self._move(block, 0, {axis: home[axis] for axis in target or AXES})

    def _go(self, block: Block) -> None:
        """The move of a block, if it has one."""
        codes, values = block.codes, block.values
        arc_word = next((letter for letter in "IJR" if letter in values), None)
        word = next((letter for letter in AXES if letter in values), arc_word)
        if word is None:
            return
        motion = self.motion
        if codes.get("non-modal") == 530 and (self.relative or motion not in (0, 10)):
            self._refuse(block, word, "G53 goes to a place of the machine: it needs G0 or G1, and G90")
        if motion is None:
            self._refuse(block, word, "no motion mode yet; write G0, G1, G2 or G3 before it")
            motion = 0
        elif arc_word is not None and motion < 20:
            self._refuse(block, arc_word, f"{arc_word} belongs to an arc, but the motion mode is G{motion // 10}")
        elif motion > 0 and (self.feed is None or (self.inverse_time and "F" not in values)):
            what = (
                "with G93 each move needs its F"
                if self.inverse_time
                else "no feed yet; give one on this line or before"
            )
            self._refuse(block, word, f"{what}, like F1000")
        self._move(block, motion, self._target(block))

    def _move(self, block: Block, motion: int, target: dict[str, float]) -> None:
        """Go to `target`, with all axes at once."""
        here = self.here
        end = (target.get("X", here[0]), target.get("Y", here[1]))
        end = here if math.dist(here, end) < SAME else end
        moves = end != here or motion >= 20
        rises = self._lift(block, motion > 0 and moves, target)
        if rises is True:
            self._put_pen(block, target["Z"])
        if moves:
            self._add(block, motion, here, end)
        if rises is False:
            self._put_pen(block, target["Z"])
        self.here = end
        self.at |= target | {"X": end[0], "Y": end[1]}

    def _lift(self, block: Block, cuts: bool, target: dict[str, float]) -> bool | None:
        """Whether z rises or falls on the way to `target`; None: neither. Other axes and z are refused where `z` says
        so."""
        changed = [axis for axis in "ZABC" if abs(target.get(axis, self.at[axis]) - self.at[axis]) >= SAME]
        if not changed:
            return None
        if self.z == "ignore":
            for axis in changed:
                self._event(block, block.texts.get(axis, axis))
            return None
        if changed != ["Z"]:
            self._refuse(block, changed[-1], "a rotary axis moves, and the machine has none; see --z ignore")
            return None
        if cuts:
            self._refuse(block, "Z", "z changes while x and y cut, and the machine has no z; see --z ignore")
            return None
        return target["Z"] > self.at["Z"]

    def _put_pen(self, block: Block, to_m: float) -> None:
        self._event(block, f"Z{(to_m - self.offsets.of('Z')) / self.unit_m:g}")
        self.items.add(Dwell(0.0, block.line), self.here)

    def _add(self, block: Block, motion: int, here: Point, end: Point) -> None:
        segment: Segment | None = Line(here, end) if motion < 20 else self._arc(block, here, end)
        if segment is None:
            return
        feed_mps = math.inf if motion == 0 or self.feed is None else self.feed
        if self.inverse_time:
            feed_mps *= segment.length_m
        self.items.add(Move(segment, feed_mps, motion == 0, block.line, tolerance_m=self.tolerance_m), end)
        if self.stops:
            self.items.add(Dwell(0.0, block.line), end)

    def _arc(self, block: Block, start: Point, end: Point) -> Segment | None:
        values, left = block.values, self.motion == 30
        here, to = complex(*start), complex(*end)

        def refuse(what: str) -> None:
            words = " ".join(text for letter, text in block.texts.items() if letter in "XYIJR")
            self.refusals.add(what, block.line, words or None)

        if self.plane != 170:
            refuse("arcs lie in the plane of x and y, G17")
            return None
        if "R" in values:
            if "I" in values or "J" in values:
                refuse("an arc has R or I and J, not both")
                return None
            if to == here:
                refuse("an arc with R must end elsewhere than it starts; for a full circle use I and J")
                return None
            center = arcs.center_from_radius(here, to, values["R"] * self.unit_m, left)
            if center is None:
                half = abs(to - here) / 2.0 / self.unit_m
                refuse(f"the radius is less than half the distance to the end, {half:.4f}")
                return None
        else:
            if not ("I" in values or "J" in values) or (self.center_absolute and not ("I" in values and "J" in values)):
                refuse("an arc needs R, or I and J (with G90.1 both of them)")
                return None
            center = complex(values.get("I", 0.0), values.get("J", 0.0)) * self.unit_m
            if self.center_absolute:
                center = self.offsets.in_machine(center.real, center.imag)
            else:
                center = center * self.offsets.turns[self.offsets.chosen] + here
        turns = values.get("P", 1.0) if block.codes.keys().isdisjoint(("non-modal", "path control")) else 1.0
        if turns not in range(1, _TURNS_MAX + 1):
            self._refuse(block, "P", f"P of an arc is the number of its turns, 1 to {_TURNS_MAX}")
            return None
        problem = arcs.problem(here, to, center, self.unit_m)
        if problem is not None:
            refuse(problem)
            return None
        return arcs.segment(here, to, center, left, int(turns))
