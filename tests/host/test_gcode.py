# SPDX-License-Identifier: Apache-2.0
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kontur.errors import FileError, KonturError
from kontur.path import gcode
from kontur.path.geometry import Arc, Dwell, Line, Move

PART = Path(__file__).parents[2] / "examples" / "part.ngc"


def parse(text):
    return gcode.parse(text, "p.ngc")


def ends(program):
    return [tuple(m.segment.point(np.array([m.segment.length_m]))[0]) for m in program.moves]


def test_lines_and_rapids_carry_position_feed_and_line():
    program = parse("G0 X10\nG1 Y5 F600\nX0")
    assert program.items == (
        Move(Line((0.0, 0.0), (0.01, 0.0)), math.inf, True, 1),
        Move(Line((0.01, 0.0), (0.01, 0.005)), 0.01, False, 2),
        Move(Line((0.01, 0.005), (0.0, 0.005)), 0.01, False, 3),
    )


@pytest.mark.parametrize(
    "text",
    [
        "N10 G1 X10 Y5 F600",
        "n10g01x10.y5.0f600.",
        "g 1 x 1 0 y+5 f 6 0 0",
        "%\nG1 (to the end) X10 (half) Y5 F600 ; done (really\n%\nG1 X99",
        "F600 Y5 X10 G1",
        "G21\nG17 G61 G90\nG1 F600\nX10 Y5\nM2\nG1 X99",
        "G1 X10 Y5 F600 M30\nrubbish",
        "\ufeffG1 X10 Y5 F600\r\n",
        "G1 X9 F600\nX10 Y5".replace("X9 ", "").replace("\n", " "),
    ],
)
def test_spelling_comments_and_order_do_not_matter(text):
    (move,) = parse(text).moves
    assert (move.segment, move.feed_mps) == (Line((0.0, 0.0), (0.01, 0.005)), 0.01)


def test_inches_scale_positions_centres_and_feed():
    line, arc = parse("G20\nG1 X1 F60\nG3 X2 I0.5").moves
    assert line.segment.end_m == pytest.approx((0.0254, 0.0))
    assert line.feed_mps == pytest.approx(0.0254)
    assert arc.segment.radius_m == pytest.approx(0.0127)


def test_units_may_change_on_the_way_without_moving_the_position_or_the_feed():
    moves = parse("G1 X25.4 F600\nG20 Y1").moves
    assert ends(parse("G1 X25.4 F600\nG20 Y1"))[-1] == pytest.approx((0.0254, 0.0254))
    assert moves[1].feed_mps == 0.01


def test_relative_distances_add_up():
    assert ends(parse("G91 G1 X1 F100\nX2 Y1\nG90 X0"))[-2:] == [
        pytest.approx((0.003, 0.001)),
        pytest.approx((0.0, 0.001)),
    ]


@pytest.mark.parametrize(
    ("word", "sweep"), [("G2 X10 Y10 I0 J10", -1.5), ("G3 X10 Y10 I0 J10", 0.5), ("G2 X10 Y10 I10", -0.5)]
)
def test_arcs_turn_clockwise_for_g2_and_counter_clockwise_for_g3(word, sweep):
    program = parse(f"G17 G90 {word} F100")
    (move,) = program.moves
    assert move.segment.sweep_rad == pytest.approx(sweep * math.pi)
    assert move.segment.radius_m == pytest.approx(0.010)
    assert ends(program) == [pytest.approx((0.010, 0.010))]


def test_arc_centres_may_be_absolute():
    relative, absolute = parse("G1 X10 F100\nG3 X20 I5"), parse("G1 X10 F100\nG90.1 G3 X20 I15 J0")
    assert relative.moves[1].segment == absolute.moves[1].segment


@pytest.mark.parametrize("code", ["G2", "G3"])
def test_an_arc_that_ends_where_it_starts_is_a_full_circle(code):
    for words in ("X0 Y0 I5", "I5 J0", "X0 I5"):
        (move,) = parse(f"{code} {words} F100").moves
        assert abs(move.segment.sweep_rad) == 2.0 * math.pi
        assert move.segment.center_m == (0.005, 0.0)


@pytest.mark.parametrize(
    ("code", "radius", "center", "sweep"),
    [
        ("G3", "R10", (0.0, 0.01), 0.5),
        ("G2", "R10", (0.01, 0.0), -0.5),
        ("G3", "R-10", (0.01, 0.0), 1.5),
        ("G2", "R-10", (0.0, 0.01), -1.5),
    ],
)
def test_a_radius_chooses_the_short_way_and_a_negative_one_the_long_way(code, radius, center, sweep):
    (move,) = parse(f"{code} X10 Y10 {radius} F100").moves
    assert move.segment.center_m == pytest.approx(center)
    assert move.segment.sweep_rad == pytest.approx(sweep * math.pi)


def test_a_radius_of_half_the_chord_up_to_rounding_is_a_half_circle():
    (move,) = parse("G3 X20.003 R10.001 F100").moves
    assert abs(move.segment.sweep_rad) == pytest.approx(math.pi)
    assert ends(parse("G3 X20.003 R10.001 F100")) == [pytest.approx((0.020003, 0.0))]


@pytest.mark.parametrize("text", ["G3 X7.072 Y2.930 J10 F100", "G2 X0.5 Y0.013 J10 F100", "G3 X-1.735 Y0.152 J10 F100"])
def test_a_rounded_arc_ends_exactly_where_it_is_programmed_and_stays_near_its_centre(text):
    (move,) = parse(text).moves
    x, y = (float(word[1:]) * 1e-3 for word in text.split()[1:3])
    assert ends(parse(text)) == [pytest.approx((x, y), abs=1e-15)]
    points = move.segment.point(np.linspace(0.0, move.segment.length_m, 200))
    end_error = abs(math.hypot(x, y - 0.010) - 0.010)
    radius_error = np.abs(np.hypot(points[:, 0], points[:, 1] - 0.010) - 0.010)
    assert np.max(radius_error) <= 1.01 * end_error + 1e-9
    gap = np.hypot(*np.diff(points, axis=0).T)
    np.testing.assert_allclose(gap, move.segment.length_m / 199, rtol=1e-3)


def test_the_radii_of_an_arc_may_differ_by_a_tenth_of_a_percent_but_not_more():
    assert parse("G3 X99.95 Y100 J100 F100").moves
    with pytest.raises(FileError, match=r"radius is 100\.0000 at its start and 99\.8000 at its end"):
        parse("G3 X99.8 Y100 J100 F100")
    assert parse("G3 X1.028 Y1 J1 F100").moves
    with pytest.raises(FileError, match=r"radius is 1\.0000 at its start and 1\.0290"):
        parse("G3 X1.029 Y1 J1 F100")


def test_a_dwell_is_in_seconds_and_a_move_to_the_same_place_is_none():
    program = parse("G4 P0.5\nG1 X1 F100\nX1\nG4 P0\nX0")
    assert [type(item) for item in program.items] == [Dwell, Move, Move]
    assert program.items[0] == Dwell(0.5, 1)


def test_the_example_is_a_closed_part_with_arcs_of_several_radii_and_corners_in_its_travel():
    program = gcode.parse(PART.read_text(), "part.ngc")
    radii = {round(m.segment.radius_m * 1e3, 3) for m in program.moves if isinstance(m.segment, Arc)}
    assert radii == {2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 12.0, 15.0}
    assert np.max(np.abs(ends(program))) < 0.060
    assert ends(program)[-1] == (0.0, 0.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "p.ngc: there is no motion in this file"),
        ("G21\nM2", "p.ngc: there is no motion in this file"),
        ("G1 X1", "p.ngc:1: X1: no feed yet"),
        ("X1", "p.ngc:1: X1: no motion mode yet"),
        ("\nG1 X1 F0", "p.ngc:2: F0: the feed must be above zero"),
        ("G1 X1 F-5", "p.ngc:1: F-5: the feed must be above zero"),
        ("G41", "p.ngc:1: G41: there is no cutter compensation"),
        ("G1.5", "p.ngc:1: G1.5: this G code is not understood"),
        ("G0 G1 X1", "p.ngc:1: G1: a second motion word"),
        ("G1 X1 X2 F100", "p.ngc:1: X2: a second X word"),
        ("G1 I1 F100", "p.ngc:1: I1: I belongs to an arc, but the motion mode is G1"),
        ("G0 X1 R5", "p.ngc:1: R5: R belongs to an arc"),
        ("G2 X1 F100", "p.ngc:1: X1: an arc needs R, or I and J"),
        ("G90.1 G2 X1 I5 F100", "p.ngc:1: X1 I5: an arc needs R, or I and J (with G90.1 both"),
        ("G2 X1 R1 I1 F100", "p.ngc:1: X1 R1 I1: an arc has R or I and J"),
        ("G2 X10 R4 F100", "p.ngc:1: X10 R4: the radius is less than half the distance to the end, 5.0000"),
        ("G2 X10 R0 F100", "p.ngc:1: X10 R0: the radius is less than"),
        ("G2 R5 F100", "p.ngc:1: R5: an arc with R must end elsewhere"),
        ("G2 X5 I0 J0 F100", "p.ngc:1: X5 I0 J0: the centre of the arc is one of its ends"),
        ("G2 X10 I4 F100", "p.ngc:1: X10 I4: the end is not on the arc"),
        ("G2 X5 K1 F100", "p.ngc:1: K1: arcs lie in the plane of x and y"),
        ("G4", "p.ngc:1: G4 needs the time"),
        ("G4 P-1", "p.ngc:1: P-1: G4 needs the time"),
        ("G4 P1 X5", "p.ngc:1: X5: a dwell and a move without its G code on one line"),
        ("G1 X1 P1 F100", "p.ngc:1: P1: P belongs to G2, G3, G4"),
        ("G1 X F100", "p.ngc:1: XF100: not a word"),
        ("G1 X1e5 F100", "p.ngc:1: X1e5: a number with an exponent"),
        ("G1 X#1 F100", "p.ngc:1: X#1F100: variables and expressions"),
        ("#1=5", "p.ngc:1: #1=5: variables and expressions are not understood"),
        ("G1 (open X1", "p.ngc:1: G1 (open X1: a comment in parentheses must end on its line"),
        ("G1 X" + "9" * 400 + " F1", "the number is too large"),
        ("G1 X\uff11 F100", "not a word"),
    ],
)
def test_what_is_not_understood_is_refused_with_file_line_and_word(text, message):
    with pytest.raises(FileError) as caught:
        parse(text)
    assert message in str(caught.value)


LETTERS = "GGGGXYXYXYIJRFFPNMSZ%(;)/#"
NUMBERS = "0", "1", "2", "3", "4", "5", "10", "-7.5", ".5", "17", "20", "21", "61", "90", "91", "90.1"
WORDS = st.lists(st.tuples(st.sampled_from(LETTERS), st.sampled_from(NUMBERS)), max_size=6)


def program_or_message(text):
    try:
        return parse(text)
    except KonturError as error:
        return str(error)


@given(st.lists(WORDS, max_size=5))
def test_random_words_give_a_connected_program_or_an_error_with_file_and_line(lines):
    result = program_or_message("\n".join(" ".join(letter + number for letter, number in words) for words in lines))
    if isinstance(result, str):
        file, line, *_ = result.split(":")
        assert file == "p.ngc"
        assert "no motion in this file" in line or line.isdigit()
        return
    here = np.array(result.start_m)
    for move in result.moves:
        first, last = move.segment.point(np.array([0.0, move.segment.length_m]))
        np.testing.assert_allclose(first, here, atol=1e-12)
        here = last


@given(st.text(max_size=40))
def test_any_text_gives_a_program_or_an_error_that_a_user_can_read(text):
    result = program_or_message(text)
    assert not isinstance(result, str) or result.startswith("p.ngc:")
