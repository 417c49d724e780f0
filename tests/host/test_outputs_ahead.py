# SPDX-License-Identifier: Apache-2.0
"""What a program switches is known as its knots are planned: the same at the same knots, however these come."""

import random

import numpy as np
import pytest
from gated_planning import LIMITS, MACHINE, Gate, opened_on_the_way

from kontur.can.outputs import BY_RATE, FULL_POWER, HOLD
from kontur.drive.stream import Operator
from kontur.drive.target import Target
from kontur.path import gcode, smoothing
from kontur.path.geometry import KNOT_S, Move
from kontur.path.smoothing import TOLERANCE_M
from kontur.planning.outputs import LEFT, SPINDLE, Tool, Words, _State, boundaries, held, of_words, words
from kontur.planning.planner import plan
from kontur.runs.runner import run

LASER = Tool(1000.0, laser=True)
SWITCHES = ("M3", "M4", "M5", "M7", "M9", "M62 P1", "M63 P1", "M67 E0 Q300", "M0", "G4 P0.02", "G4 P0.3", "Z-1", "Z1")


def drawn(seed):
    """Short and long lines, powers, switches, dwells and holds in any order."""
    rng = random.Random(seed)
    out = ["G1 F1200 X0.5 Y0 M3 S100"]
    x = 0.5
    for _ in range(60):
        x += rng.choice((1e-3, 0.01, 0.1, 2.0))
        kind = rng.random()
        power = rng.choice(("", f" S{rng.randrange(1000)}"))
        out += [f"{rng.choice(('G0', 'G1', 'G1'))} X{x:.4f} Y{rng.choice((0.0, 0.0, 0.5))}{power}"]
        out += [rng.choice(SWITCHES) for _ in range(rng.randrange(1, 4))] if kind < 0.25 else []
    return gcode.parse("\n".join([*out, "G1 X0 Y1", *rng.choice(([], ["M5"], ["G4 P0.1", "M62 P2"]))]), "drawn.ngc")


def one_by_one(t, tool):
    """Words of the knots, event by event and item by item."""
    arrives, departs = boundaries(t)
    count, state = len(t.knots_nm), _State()
    digital, power = np.zeros(count, np.uint32), np.zeros(count)
    for event in t.program.events:
        state.take(event.word)
        digital[arrives[event.before] :], power[arrives[event.before] :] = state.digital, state.power(tool.full_s)
    if tool.laser:
        feed_mps = np.full(count, np.inf)
        for i, item in enumerate(t.program.items):
            power[arrives[i] : departs[i]] = 0.0
            rows = slice(departs[i], arrives[i + 1])
            if isinstance(item, Move):
                feed_mps[rows] = item.feed_mps
                power[rows] *= not item.rapid
        power[arrives[-1] :] = 0.0
        by_speed = digital & LEFT != 0
        speed_mps = np.hypot(*np.gradient(t.position_m, KNOT_S, axis=0).T)
        power[by_speed] *= (np.rint(np.minimum(speed_mps / feed_mps, 1.0) * 200) / 200)[by_speed]
        digital = np.where(by_speed, digital & ~np.uint32(LEFT) | BY_RATE, digital)
    word = digital | np.rint(power * FULL_POWER).astype(np.uint32) << np.uint32(16)
    word[-2:] = 0
    for event in held(t.program):
        word[arrives[event.before]] |= np.uint32(HOLD)
    return word


@pytest.mark.parametrize("tool", [SPINDLE, LASER], ids=["spindle", "laser"])
@pytest.mark.parametrize("seed", range(4))
def test_any_split_of_the_knots_gives_the_same_words(seed, tool):
    t = plan(drawn(seed), LIMITS, tolerance_m=TOLERANCE_M)
    whole = words(t, tool)
    np.testing.assert_array_equal(whole, one_by_one(t, tool))
    rng = random.Random(seed)
    for _ in range(4):
        found, end = Words(t.program, tool), 0
        while end < len(whole):
            end = min(end + rng.choice((1, 2, 30, 3000)), len(whole))
            found.take(t.path_s_m[:end], t.position_m[:end], complete=False)
            assert len(found.known) == max(end - 2, 0)
            np.testing.assert_array_equal(found.known, whole[: len(found.known)])
        found.take(t.path_s_m, t.position_m, complete=True)
        np.testing.assert_array_equal(found.known, whole)


def test_a_raster_is_begun_when_its_first_window_is_planned(monkeypatch):
    """A hold and most powers are still to be planned then."""
    monkeypatch.setattr(smoothing, "_WINDOWS_S", (0.5,))
    rows = [f"Y{row / 10} S0\n" + "".join(f"X{x if row % 2 == 0 else 10 - x} S{97 * x % 1000}\n" for x in range(11))
            for row in range(8)]  # fmt: skip
    program = gcode.parse("G1 F6000 M3 S0\n" + "".join(rows[:6]) + "M0\n" + "".join(rows[6:]) + "M5\n", "raster.ngc")
    whole = plan(program, LIMITS, tolerance_m=TOLERANCE_M)
    ahead, total_before = opened_on_the_way(Gate(program), monkeypatch)
    assert 200 < len(ahead.knots_nm) < 0.6 * len(whole.knots_nm)
    asked = []
    result = run(ahead, "ccu", Target(MACHINE), operator=Operator(release=lambda hold: not asked.append(hold)))
    assert total_before == [0]
    assert result.completed  # the drive has counted each change once: kontur.drive.stream compares
    assert set(asked) == {-1}
    assert result.log.meta["trajectory"] == whole.digest
    at_once = run(whole, "ccu", Target(MACHINE)).log
    assert len(of_words(words(whole, SPINDLE))) > 70
    for name in ("digital", "power"):
        np.testing.assert_array_equal(result.log.columns[name], at_once.columns[name])
