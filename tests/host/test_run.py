# SPDX-License-Identifier: Apache-2.0
"""Whole runs on the simulated drive: what is logged is what happened, and happens again the same way."""

import dataclasses
import time

import can
import numpy as np
import pytest

from kontur import machine
from kontur.drive.stream import Operator
from kontur.drive.target import Target
from kontur.errors import DeviceError, NoAnswerError, ParameterError
from kontur.path import shapes
from kontur.planning.bounds import limits
from kontur.planning.planner import Trajectory, plan
from kontur.runs import log
from kontur.runs.runner import RunOptions, RunResult, run
from kontur.runs.summary import summarise, summary
from kontur.sim.bus import KonturBus

TARGET = Target(machine=machine.load())


@pytest.fixture(scope="module")
def trajectory() -> Trajectory:
    return plan(shapes.circle(0.02, 0.1), limits(TARGET.machine))


@pytest.fixture(scope="module")
def result(trajectory: Trajectory) -> RunResult:
    return run(trajectory, "ccu", TARGET)


def test_log_covers_the_path_row_by_row(trajectory: Trajectory, result: RunResult) -> None:
    columns = result.log.columns
    assert len(result.log) == len(trajectory.knots_nm) - 1
    assert (np.diff(columns["tick"]) == 1).all()
    assert result.log.meta["frames_lost"] == 0
    assert result.log.meta["status"] == "complete"
    assert result.log.meta["accepted"] == len(trajectory.knots_nm)


def test_position_in_the_log_is_the_true_position_of_the_same_instant(result: RunResult) -> None:
    """At 100 mm/s a control period more or less would be 10 um."""
    columns = result.log.columns
    off_nm = (
        np.hypot(
            columns["position_x_mm"] - columns["true_position_x_mm"],
            columns["position_y_mm"] - columns["true_position_y_mm"],
        )
        * 1e6
    )
    assert off_nm.max() < 200.0


def test_reference_in_the_log_is_the_circle_at_that_time(result: RunResult) -> None:
    columns = result.log.columns
    reference = columns["reference_x_mm"] + 1j * columns["reference_y_mm"]
    np.testing.assert_allclose(np.abs(reference), 20.0, atol=1e-4)
    cruise = (columns["time_s"] > 0.4) & (columns["time_s"] < 0.9)
    angle = np.unwrap(np.angle(reference[cruise]))
    speed = np.diff(angle) * 20.0 / np.diff(columns["time_s"][cruise])
    np.testing.assert_allclose(speed, 100.0, rtol=1e-3)


def test_score_is_the_distance_of_the_truth_to_the_circle(result: RunResult) -> None:
    assert result.truth is not None
    distance_um = np.abs(np.hypot(*result.truth.pos_m.T) - 0.02) * 1e6
    score = result.log.meta["score"]
    assert score["mean_um"] == pytest.approx(distance_um.mean(), rel=1e-6)
    assert score["max_um"] == pytest.approx(distance_um.max(), rel=1e-6)
    assert summary(result.log)["mean_um"] == score["mean_um"]


def test_estimate_of_the_drive_is_near_the_true_error_while_it_moves(result: RunResult) -> None:
    columns = result.log.columns
    moving = (columns["time_s"] > 0.1) & (columns["time_s"] < 1.2)
    difference = (columns["contour_error_um"] - columns["true_contour_error_um"])[moving]
    assert np.abs(difference).max() < 0.2  # the encoder's count is 0.076


def test_same_seed_gives_equal_bytes_and_another_seed_does_not(trajectory: Trajectory, result: RunResult) -> None:
    again = run(trajectory, "ccu", TARGET)
    other = run(trajectory, "ccu", dataclasses.replace(TARGET, seed=2))
    assert log.csv_text(again.log) == log.csv_text(result.log)
    assert not np.array_equal(other.log.columns["true_contour_error_um"], result.log.columns["true_contour_error_um"])


def test_time_to_speed_up_can_be_left_out_of_the_score(trajectory: Trajectory) -> None:
    result = run(trajectory, "track", TARGET, RunOptions(score_from_s=0.3))
    assert result.truth is not None
    distance_um = np.abs(np.hypot(*result.truth.pos_m[3000:].T) - 0.02) * 1e6
    assert result.log.meta["score"]["mean_um"] == pytest.approx(distance_um.mean(), rel=1e-6)


def test_run_that_never_moved_says_so_and_has_no_score(trajectory: Trajectory) -> None:
    weak = {"plant_x.force_limit": 30.0, "plant_y.force_limit": 30.0}
    result = run(trajectory, "ccu", TARGET, RunOptions(parameters=weak, raise_fault=False))
    assert result.fault is not None
    found = summary(result.log)
    assert (found["path_percent"], found["mean_um"], found["rms_um"], found["max_um"]) == (0.0, None, None, None)
    assert found["force_max_N"] == 30.0


def test_summary_says_what_part_of_the_path_it_covers(trajectory: Trajectory, result: RunResult) -> None:
    assert summary(result.log)["path_percent"] == pytest.approx(100.0, abs=0.01)
    late = summarise(run(trajectory, "ccu", TARGET, RunOptions(score_from_s=0.4)).log)
    before = trajectory.path_s_m[400] / trajectory.path_s_m[-1] * 100.0
    assert late.path_from_percent == pytest.approx(before, abs=0.1)
    assert late.path_to_percent == pytest.approx(100.0, abs=0.01)
    assert late.path_percent == pytest.approx(100.0 - before, abs=0.1)
    shares = [0.0]
    asked = Operator(shares.append, lambda: shares[-1] > 0.5)
    part = summarise(run(trajectory, "ccu", TARGET, operator=asked).log)
    assert part.path_percent is not None
    assert 1.0 < part.path_percent < 99.0
    assert part.path_from_percent == pytest.approx(0.0, abs=0.01)


def test_parameters_are_set_and_logged(trajectory: Trajectory) -> None:
    result = run(trajectory, "ccu", TARGET, RunOptions(parameters={"compensator.alpha": 40.0}))
    assert result.log.meta["parameters"]["compensator.alpha"] == 40.0


def test_unknown_parameter_is_refused_before_any_motion(trajectory: Trajectory) -> None:
    with pytest.raises(ParameterError, match="no such parameter"):
        run(trajectory, "ccu", TARGET, RunOptions(parameters={"compensator.alhpa": 40.0}))


def test_stopped_run_has_a_complete_log_up_to_standstill(trajectory: Trajectory) -> None:
    asked = 0

    def stop_requested() -> bool:
        nonlocal asked
        asked += 1
        return asked > 2000

    result = run(trajectory, "ccu", TARGET, operator=Operator(stop_requested=stop_requested))
    columns = result.log.columns
    assert not result.completed
    assert result.log.meta["status"] == "interrupted"
    assert result.log.meta["accepted"] <= len(trajectory.knots_nm)
    assert (np.diff(columns["tick"]) == 1).all()
    assert 0.1 < columns["time_s"][-1] < 1.2
    last_mm = np.hypot(np.diff(columns["position_x_mm"])[-1], np.diff(columns["position_y_mm"])[-1])
    assert last_mm < 2e-3  # in a ms; 0.1 at speed
    np.testing.assert_allclose(np.hypot(columns["true_position_x_mm"], columns["true_position_y_mm"]), 20.0, atol=0.01)
    assert np.abs(columns["true_tangential_error_um"]).max() < 30.0  # the log knows where path time was


def test_real_drive_that_stands_elsewhere_is_not_moved(trajectory: Trajectory) -> None:
    """`bus` given: nobody has put the axes to the start of the path."""
    at_origin = dataclasses.replace(TARGET, machine=TARGET.machine.starting_at((0.0, 0.0)))
    with pytest.raises(DeviceError, match=r"stand at \(0\.000, 0\.000\) mm, the program starts at \(20\.000, 0\.000\)"):
        run(trajectory, "ccu", dataclasses.replace(at_origin, place_at_start=False))


def test_real_drive_that_stands_elsewhere_goes_to_the_start_when_allowed(trajectory: Trajectory) -> None:
    at_origin = dataclasses.replace(TARGET, machine=TARGET.machine.starting_at((0.019, 0.0)), place_at_start=False)
    result = run(trajectory, "ccu", at_origin, RunOptions(approach=limits(TARGET.machine)))
    assert result.completed
    assert result.log.meta["score"]["max_um"] < 10.0


def test_stop_on_the_way_to_the_start_ends_the_run(trajectory: Trajectory) -> None:
    elsewhere = dataclasses.replace(TARGET, machine=TARGET.machine.starting_at((0.019, 0.0)), place_at_start=False)
    with pytest.raises(KeyboardInterrupt):
        run(
            trajectory,
            "ccu",
            elsewhere,
            RunOptions(approach=limits(TARGET.machine)),
            Operator(stop_requested=lambda: True),
        )


class BusInWallTime(can.BusABC):
    """To the host, a bus like any other: it has no time of its own. The drive behind it lets a millisecond pass in each
    that the host waits for a frame, so it is never late for a drive, however busy the machine is."""

    channel_info = "wall time"

    def __init__(self, machine: machine.Machine) -> None:
        self._drive = KonturBus(machine=machine)
        super().__init__(channel=None)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._drive.send(msg)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if (message := self._drive.recv(0.0)) is None and timeout:
            time.sleep(1e-3)
            message = self._drive.recv(1e-3)
        return message, False

    def shutdown(self) -> None:
        super().shutdown()
        self._drive.shutdown()


def test_run_over_a_bus_in_wall_time_is_complete_and_has_no_truth(monkeypatch: pytest.MonkeyPatch) -> None:
    trajectory = plan(shapes.circle(0.005, 0.05), limits(TARGET.machine))
    bus = BusInWallTime(TARGET.machine.starting_at((0.005, 0.0)))
    monkeypatch.setattr("kontur.drive.target.open_bus", lambda options: bus)
    result = run(trajectory, "ccu", TARGET)
    assert result.completed
    assert result.truth is None
    columns = result.log.columns
    assert result.log.meta["frames_lost"] == 0
    assert len(result.log) == pytest.approx(len(trajectory.knots_nm), abs=20)
    assert "true_contour_error_um" not in columns
    # The start is known to 0.5 ms, at 0.05 mm/ms.
    late_mm = np.hypot(
        columns["position_x_mm"] - columns["reference_x_mm"], columns["position_y_mm"] - columns["reference_y_mm"]
    )
    assert late_mm.max() < 0.03
    assert summary(result.log)["mean_um"] < 5.0


def test_drive_that_does_not_answer_is_an_error(trajectory: Trajectory) -> None:
    target = dataclasses.replace(TARGET, bus={"interface": "virtual", "channel": "nobody"})
    with pytest.raises(NoAnswerError, match="does not answer"):
        run(trajectory, "ccu", target)
