# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kontur.errors import FileError, KonturError
from kontur.path import csv


def table(header, rows):
    return header + "\n" + "\n".join(",".join(f"{value:.9f}" for value in row) for row in rows)


def test_points_of_a_circle_give_a_curve_that_is_the_circle_between_them_too():
    u = np.linspace(0.0, np.pi, 41)
    program = csv.parse(table("x,y", zip(20 * np.cos(u), 20 * np.sin(u), strict=True)), "p.csv", 0.05)
    (move,) = program.moves
    assert (move.feed_mps, move.schedule, program.start_m) == (0.05, None, (0.020, 0.0))
    radius = np.hypot(*move.segment.point(np.linspace(0.0, move.segment.length_m, 1000)).T)
    assert np.max(np.abs(radius - 0.020)) < 0.2e-6  # the polygon is 15 um off
    assert move.segment.length_m == pytest.approx(0.020 * np.pi, abs=1e-8)


def test_the_curve_passes_through_every_point():
    points = np.array([[0, 0], [10, 3], [12, 9], [7, 15], [-4, 11]])
    (move,) = csv.parse(table("x,y", points), "p.csv", 0.05).moves
    s = np.linspace(0.0, move.segment.length_m, 200_001)
    path = move.segment.point(s)
    for point in points * 1e-3:
        assert np.min(np.hypot(*(path - point).T)) < 0.2e-6


def test_a_timed_table_is_sampled_each_millisecond_with_the_line_that_rules():
    rows = [(t, 5 * (1 - math.cos(math.pi * t / 0.4)), 0.0) for t in np.arange(0, 0.401, 0.05)]
    (move,) = csv.parse("# a comment\n" + table("t,x,y", rows), "t.csv").moves
    schedule = move.schedule
    assert len(schedule.distance_m) == 401
    expected = 0.005 * (1 - np.cos(np.pi * np.arange(401) / 400))
    assert np.max(np.abs(schedule.distance_m - expected)) < 6e-6  # spline of nine rows
    np.testing.assert_allclose(schedule.distance_m[::50], expected[::50], atol=1e-9)  # the file has nine digits
    assert schedule.line[[0, 49, 50, 399, 400]].tolist() == [3, 3, 4, 10, 11]


def test_a_timed_table_rests_at_its_ends_and_may_pause_within():
    rows = [(0, 0, 0), (0.1, 1, 0), (0.2, 4, 0), (0.3, 5, 0), (0.4, 5, 0), (0.5, 5, 0), (0.6, 9, 2)]
    (move,) = csv.parse(table("t,x,y", rows), "t.csv").moves
    step = np.diff(move.schedule.distance_m)
    assert np.all(step >= 0.0)
    assert step[0] < step[10] / 5
    assert step[-1] < step[-10] / 5


@pytest.mark.parametrize(
    ("text", "feed", "message"),
    [
        ("", None, "e.csv: the file is empty"),
        ("# nothing\n\n", None, "e.csv: the file is empty"),
        ("1,2\n3,4", 0.1, "e.csv:1: 1,2: the first line must be t,x,y"),
        ("x,y\n1,2", 0.1, "e.csv: a path needs at least two rows"),
        ("x,y\n1,2\n3", 0.1, "e.csv:3: 3: expected 2 numbers, x,y"),
        ("x,y\n1,2\n3,4,5", 0.1, "e.csv:3: 3,4,5: expected 2 numbers"),
        ("x,y\n1,2\n3,nan", 0.1, "e.csv:3: nan: not a finite number"),
        ("x,y\n1,2\n3,", 0.1, "e.csv:3: (nothing): not a finite number"),
        ("x,y\n1,2\n1_0,2", 0.1, "e.csv:3: 1_0: not a finite number"),
        ("x,y\n1,2\n3,1e999", 0.1, "e.csv:3: 1e999: not a finite number"),
        ("x,y\n1,2\n3,4\n3,4", 0.1, "e.csv:4: the point is the same as the one before it"),
        ("x,y\n1,2\n3,4", None, "e.csv: a path of x,y needs a feed"),
        ("x,y\n1,2\n3,4", -0.1, "e.csv: the feed is -0.1 m/s"),
        ("t,x,y\n0,1,2\n1,2,3", 0.1, "e.csv: the column t fixes the speed already"),
        ("t,x,y\n0,1,2\n1,2,3\n1,3,3", None, "e.csv:4: 1: the time must rise"),
        ("t,x,y\n0,1,2\n1,2,3\n0.5,3,3", None, "e.csv:4: 0.5: the time must rise"),
        ("x,y\n1,2\n3,4e300", 0.1, "e.csv:3: 4e300: not a finite number below 1e+09"),
        ("t,x,y\n0,1,2\n1e-300,1,3", None, "e.csv:3: 1e-300: the time must rise"),
        ("t,x,y\n0,1,2\n1,1,2", None, "e.csv:2: all points are the same"),
        ("t,x,y\n0,1,2\n1e8,2,2", None, "e.csv:3: the path takes 100000000 s"),
    ],
)
def test_a_table_that_makes_no_path_is_refused_with_its_line(text, feed, message):
    with pytest.raises(FileError) as caught:
        csv.parse(text, "e.csv", feed)
    assert message in str(caught.value)


@given(st.text(alphabet="txy,.0123456789e-+nai#\n _", max_size=60), st.sampled_from(["", "x,y\n", "t,x,y\n"]))
def test_garbage_raises_nothing_but_errors_that_a_user_can_read(text, header):
    message = "g.csv:"
    try:
        csv.parse(header + text, "g.csv", 0.1 if header == "x,y\n" else None)
    except KonturError as error:
        message = str(error)
    assert message.startswith("g.csv:")
