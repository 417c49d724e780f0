# SPDX-License-Identifier: Apache-2.0
"""The table of the moves of a long program is what a tuple of them is, and takes less memory."""

import math
import random
from dataclasses import replace

import numpy as np
import pytest

from kontur.path import gcode, moves
from kontur.path.geometry import Arc, Dwell, Line, Move, MoveTable, Program
from kontur.path.polyline import Polyline
from kontur.path.smoothing import toleranced
from kontur.planning.bounds import Limits
from kontur.planning.checks import extent_m
from kontur.planning.planner import plan

TEXT = """F600
G4 P0.5
G1 X1
X2 Y1
X2.5 Y1
X3 Y2
X3 Y2.5
G64 P0.01
G0 X9
G2 X11 R1
G4 P1
G4 P2
G61
G3 X13 R4
G1 X14
X15
X16
X17 Y0
M0
"""


def table() -> MoveTable[Move | Dwell]:
    items = gcode.parse(TEXT, "p.ngc").items
    assert isinstance(items, MoveTable)
    return items


def test_table_gives_the_items_of_the_program() -> None:
    items = tuple(table())
    assert [type(item) for item in items].count(Dwell) == 4
    assert items[1] == Move(Line((0.0, 0.0), (0.001, 0.0)), 0.01, False, 3)
    assert items[6] == Move(Line((0.003, 0.0025), (9 * 1e-3, 0.0025)), math.inf, True, 9, None, 1e-5)
    assert isinstance(items[7], Move)
    assert isinstance(items[7].segment, Arc)
    assert len(items) == len(table()) == 16


def test_table_is_cut_and_asked_like_a_tuple(monkeypatch: pytest.MonkeyPatch) -> None:
    items = tuple(table())
    monkeypatch.setattr("kontur.path.geometry._ROWS", 3)
    assert tuple(table()) == items
    assert table() == items
    assert items == table()
    assert table() != items[1:]
    assert table() != 5
    for i in range(-16, 16):
        assert table()[i] == items[i]
        for j in range(-17, 18):
            assert table()[i:j] == items[i:j]
            assert table()[i:j][1:3] == items[i:j][1:3]
    with pytest.raises(IndexError):
        table()[16]
    with pytest.raises(ValueError, match="neighbouring"):
        table()[::2]


def test_columns_are_those_of_the_moves() -> None:
    program = gcode.parse(TEXT, "p.ngc")
    one, other = program.moves, tuple(program.moves)
    assert isinstance(one, MoveTable)
    assert one == tuple(item for item in program.items if isinstance(item, Move))
    for column in (moves.feeds_mps, moves.straight, moves.ends_m, moves.is_scheduled):
        assert np.array_equal(column(one), column(other))
    assert np.array_equal(moves.tolerances_m(one, 5.0), moves.tolerances_m(other, 5.0))
    assert moves.lengths_m(one) == pytest.approx(moves.lengths_m(other), rel=1e-15, abs=0.0)
    assert program.length_m == pytest.approx(math.fsum(moves.lengths_m(other)), rel=1e-15)
    assert moves.dwells_in(program.items) == moves.dwells_in(tuple(program.items))
    assert moves.tolerances_m(toleranced(program, 3e-6).moves, 5.0).tolist() == [3e-6] * 12
    assert [move.tolerance_m for move in toleranced(program, 3e-6).moves] == [3e-6] * 12


def test_table_and_tuple_are_planned_alike() -> None:
    rng = random.Random(1)
    steps = "".join(f"X{0.02 * i:.4f} Y{math.sin(0.02 * i) + rng.random() * 1e-3:.4f}\n" for i in range(400))
    program = gcode.parse(TEXT + "G64 P0.01\nG1 X0\n" + steps, "p.ngc")
    other = replace(program, items=tuple(program.items))
    one, two = (plan(p, Limits(), tolerance_m=1e-5) for p in (program, other))
    assert one.digest == two.digest
    assert one.feed == two.feed
    assert np.array_equal(extent_m(program), extent_m(other))


def test_line_of_a_program_takes_forty_bytes() -> None:
    text = "F600 G1\n" + "".join(f"X{i % 100}Y{i}\n" for i in range(5000))
    items = gcode.parse(text, "p.ngc").items
    assert isinstance(items, MoveTable)
    assert not items.others
    columns = (items.x_m, items.y_m, items.feed_mps, items.line, items.tolerance_m)
    assert sum(column.nbytes for column in columns) < 40 * 5001
    assert Polyline(Program("p", items, (0.0, 0.0)).moves).edge_m[-1] > 5.0
