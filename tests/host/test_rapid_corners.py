# SPDX-License-Identifier: Apache-2.0
"""The larger tolerance of rapid moves, where nothing but these meets."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from kontur.cli import main
from kontur.path import gcode
from kontur.path.events import Event
from kontur.path.smoothing import TOLERANCE_M, parts
from kontur.planning.planner import Limits, plan

RAPIDS = "G0 X5\nY5\nX10\nY8\nG1 F3000 X15\nY10"


def planned(text, tolerance_m=TOLERANCE_M):
    return plan(gcode.parse(text, "p.ngc"), Limits(), tolerance_m=tolerance_m)


def off_m(trajectory, at_mm):
    """How far the motion is from a point at least."""
    return float(np.min(np.hypot(*(trajectory.position_m - 1e-3 * np.array(at_mm)).T)))


def test_a_rapid_move_that_meets_a_cut_is_as_near_as_that():
    trajectory = planned("G0 X5 Y3\nG1 F3000 Y10\nG0 X10 Y5\nX20\nG1 Y10")
    assert max(trajectory.rapid_deviation_m, trajectory.deviation_m) <= 10e-6


def test_corners_between_rapid_moves_have_ten_times_the_tolerance_and_all_others_their_own():
    trajectory = planned(RAPIDS)
    assert 70e-6 < trajectory.rapid_deviation_m <= 100e-6
    assert 7e-6 < trajectory.deviation_m <= 10e-6
    assert off_m(trajectory, (5, 0)) > 40e-6
    assert off_m(trajectory, (5, 5)) > 40e-6
    assert off_m(trajectory, (10, 5)) < 10e-6
    assert off_m(trajectory, (10, 8)) < 10e-6
    assert off_m(trajectory, (15, 8)) < 10e-6
    assert trajectory.duration_s < planned(RAPIDS.replace("G0", "G1 F60000")).duration_s - 0.01
    assert "rapid moves" in trajectory.smoothed


@pytest.mark.parametrize("event", ["M62 P0", "M3 S500", "Z1"])
def test_where_something_is_switched_a_rapid_move_is_as_near_as_a_cut(event):
    trajectory = planned(f"G0 X5\n{event}\nY5\nX10\nY10\nX15\nG1 F3000 Y10")
    assert off_m(trajectory, (5, 0)) < 10e-6
    assert off_m(trajectory, (5, 5)) < 10e-6


def test_events_of_a_raster_are_no_objects_when_its_first_part_is_made(monkeypatch):
    def made(*_, **__):
        raise AssertionError("an Event is made")

    text = "S1\nG0 X1\nS2\nG0 X2 Y1\n" + "".join(f"G1 F600 X{i}.5 S{i % 3}\n" for i in range(100)) + "G4 P1\nM62 P0\n"
    program = gcode.parse(text, "p.ngc")
    monkeypatch.setattr(Event, "__init__", made)
    assert next(parts(program, TOLERANCE_M)).moves[0].rapid
    with pytest.raises(AssertionError, match="is made"):
        program.events[0]


def test_a_hole_that_an_ignored_z_drills_is_where_the_file_says():
    program = gcode.parse("G0 X5\nG1 Z-1 F100\nG0 Z1\nY5\nG1 Z-1\nG0 Z1\nX10", "p.ngc", z="ignore")
    trajectory = plan(program, Limits(), tolerance_m=TOLERANCE_M)
    assert off_m(trajectory, (5, 0)) < 10e-6
    assert off_m(trajectory, (5, 5)) < 10e-6


@pytest.mark.parametrize(
    ("first", "most_m"), [("G61", 0.0), ("G64 P0", 0.0), ("G64 P0.005", 50e-6), ("G64 P0.2", 2e-4)]
)
def test_the_file_s_tolerance_is_that_of_its_rapid_moves_too(first, most_m):
    trajectory = planned(f"{first}\n{RAPIDS}")
    assert 0.7 * most_m <= trajectory.rapid_deviation_m <= most_m


def test_check_tells_how_far_rapid_moves_are_off(tmp_path):
    file = tmp_path / "rapids.ngc"
    file.write_text(RAPIDS)

    def checked(*more):
        return json.loads(CliRunner().invoke(main, ["check", str(file), "--json", *more]).stdout)

    assert 70.0 < checked()["rapid_deviation_um"] <= 100.0
    assert 0.0 < checked()["path_deviation_um"] <= 10.0
    assert checked("--tolerance", "0")["rapid_deviation_um"] == 0.0
