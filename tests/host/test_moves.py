# SPDX-License-Identifier: Apache-2.0
"""The table of the moves of a long program is what a tuple of them is, and takes less memory."""

import math
import random
from dataclasses import replace

import numpy as np
import pytest

from kontur.errors import PathError
from kontur.path import gcode, moves
from kontur.path.geometry import Arc, Dwell, Line, Move, MoveTable, Program
from kontur.path.polyline import Polyline
from kontur.path.smoothing import toleranced
from kontur.planning.bounds import Limits
from kontur.planning.checks import check_connected, check_travel, extent_m
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


def drawn_arcs(rng: random.Random, count: int) -> list[Arc]:
    def sweep() -> float:
        return rng.choice((1, -1)) * rng.choice((1e-5, 0.3, 3.0, 2.0 * math.pi, 20.0)) * rng.random()

    places = [(rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0)) for _ in range(count)]
    return [Arc(place, 10.0 ** rng.uniform(-5.0, 0.0), rng.uniform(-4.0, 4.0), sweep()) for place in places]


def test_columns_of_arcs_give_what_each_arc_gives_bit_for_bit() -> None:
    segments = drawn_arcs(random.Random(3), 300)
    program = [Move(segment, 0.1) for segment in segments]
    columns = moves.arcs(program)
    length = np.array([segment.length_m for segment in segments])
    assert np.array_equal(columns.length_m, length)
    everything = slice(None)
    for share in (0.0, 0.3, 1.0):
        at = [share * segment.length_m * np.ones(1) for segment in segments]
        point, tangent = (
            np.concatenate([getattr(segment, name)(s) for segment, s in zip(segments, at, strict=True)])
            for name in ("point", "tangent")
        )
        assert np.array_equal(columns.point(everything, share * length), point)
        assert np.array_equal(columns.tangent(everything, share * length), tangent)
        assert np.array_equal(columns.heading(everything, share * length), np.arctan2(tangent[:, 1], tangent[:, 0]))
    assert np.array_equal(columns.ends_m(), moves.ends_m(program))
    assert np.array_equal(columns.curvature, [segment.curvature(np.zeros(1))[0] for segment in segments])
    fine = [segment.point(np.linspace(0.0, segment.length_m, 20_001)) for segment in segments]
    for extremes, points, segment in zip(columns.extremes_m(), fine, segments, strict=True):
        for bound in (np.min, np.max):
            within = pytest.approx(bound(points, axis=0), abs=1e-6 * segment.radius_m)
            assert bound(extremes, axis=0) == within


def test_arcs_of_a_long_program_are_no_objects_until_they_are_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    def made(*_: object) -> None:
        raise AssertionError("an Arc is made")

    text = "F600 G1 X0\n" + "".join(
        f"G{2 + i % 2} X{i}.5 I0.25\nX{i + 1} I0.25 J0.0001\nG1 Y{i % 2}\n" for i in range(300)
    )
    with monkeypatch.context() as patched:
        patched.setattr(Arc, "__init__", made)
        program = gcode.parse(text, "p.ngc")
        polyline = Polyline(program.moves)
        check_connected(program, polyline)
        check_travel(program, polyline, ((-1.0, 1.0), (-1.0, 1.0)))
        extent_m(program)
        polyline.point(polyline.edge_m)
        polyline.features(0, len(program.moves) - 1)
        with pytest.raises(AssertionError, match="is made"):
            program.moves[1]
    items = program.items
    assert isinstance(items, MoveTable)
    assert len(items.arcs) == 600
    assert items.arcs.at.nbytes + items.arcs.values.nbytes == 48 * 600


def test_path_of_arcs_is_the_same_from_columns_and_from_a_tuple() -> None:
    rng = random.Random(5)
    rows = [f"G{rng.choice('23')} X{0.5 * i:.3f} Y{rng.random():.3f} R{rng.uniform(1.0, 9.0):.3f}" for i in range(60)]
    program = gcode.parse("\n".join(["F600", "G1 X-1", *rows, "G1 Y0", "G2 X31.503 I1", "G1 X40"]), "p.ngc")
    assert len(moves.others(program.moves)) == 1
    one, other = Polyline(program.moves), Polyline(tuple(program.moves))
    s = np.linspace(0.0, one.edge_m[-1], 5000)
    assert np.array_equal(one.edge_m, other.edge_m)
    assert np.array_equal(one.turn, other.turn)
    assert np.array_equal(one.point(s), other.point(s))
    for column, expected in zip(one.features(3, 40), other.features(3, 40), strict=True):
        assert np.array_equal(column, expected)
    place = np.concatenate([move.segment.point(s[:1] + 0.3 * move.segment.length_m) for move in program.moves])
    length = np.diff(one.edge_m)
    assert one.point(one.edge_m[:-1] + 0.3 * length) == pytest.approx(place, abs=1e-12)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("side", [-1, 1])
def test_arc_that_leaves_the_travel_between_its_ends_is_refused_with_its_line(axis: int, side: int) -> None:
    start = 0.5 * math.pi * (axis - 1)
    arc = Arc((0.0, 0.0), 0.01, start if side > 0 else start + math.pi, math.pi)
    first = arc.point(np.zeros(1))[0]
    moved = Program("p", (Move(arc, 0.1, line=7),), (float(first[0]), float(first[1])))
    wide, narrow = [(-0.011, 0.011)] * 2, [(-0.011, 0.011)] * 2
    narrow[axis] = (-0.0099, 0.011) if side < 0 else (-0.011, 0.0099)
    check_travel(moved, Polyline(moved.moves), (wide[0], wide[1]))
    with pytest.raises(PathError, match=f"p:7: the path reaches {'xy'[axis]} = {'-' if side < 0 else ''}10.000 mm"):
        check_travel(moved, Polyline(moved.moves), (narrow[0], narrow[1]))


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
