# SPDX-License-Identifier: Apache-2.0
"""The first moves of an axis whose encoder is dead, is another axis's, or does not fit its scale."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from kontur.commissioning.first_moves import Agreed, Diagnosis
from kontur.commissioning.identify import identify
from kontur.commissioning.machine_file import scales
from kontur.drive.target import Target, open_drive
from kontur.machine import LENGTHS, MACHINES, Machine, load

BALL_SCREW, STIFF_SCALE, LEAD_SCREW, LONG_AXIS = (
    load(MACHINES / f"{name}.toml") for name in ("ball_screw", "stiff_scale", "lead_screw", "long_axis")
)
FRICTION_N = 10.0
Pair = tuple[float, float]


class Masses:
    """Two light masses with friction, whose encoders show what `shown` makes of their positions."""

    shown: Callable[[Pair], Pair]
    moved_m: np.ndarray
    fastest_mps: float

    def __init__(self, start_m: Pair, period_s: float) -> None:
        self.start_m, self.at_m, self.period_s = start_m, list(start_m), period_s
        self.speed = [0.0, 0.0]
        Masses.moved_m, Masses.fastest_mps = np.zeros(2), 0.0

    def step(self, force_N: Pair) -> Pair:
        for i, push_N in enumerate(force_N):
            speed = self.speed[i]
            if speed == 0.0 and abs(push_N) <= FRICTION_N:
                continue
            against_N = float(np.copysign(FRICTION_N, speed or push_N))
            faster = speed + (push_N - against_N - 60.0 * speed) / 10.0 * self.period_s
            self.speed[i] = 0.0 if faster * speed < 0.0 else faster
            self.at_m[i] += self.speed[i] * self.period_s
        Masses.moved_m = np.maximum(Masses.moved_m, np.abs(np.subtract(self.at_m, self.start_m)))
        Masses.fastest_mps = max(Masses.fastest_mps, *(abs(speed) for speed in self.speed))
        return type(self).shown((self.at_m[0], self.at_m[1]))


@pytest.mark.parametrize(
    ("shown", "kind", "moved_m", "speed_mps"),
    [
        (lambda at_m: (0.0, at_m[1]), "jammed", 0.01, 0.2),
        (lambda at_m: (at_m[1], at_m[0]), "swapped", 1e-3, 0.1),
    ],
    ids=["dead", "swapped"],
)
def test_axis_with_a_wrong_encoder_moves_little(
    shown: Callable[[Pair], Pair], kind: str, moved_m: float, speed_mps: float
) -> None:
    plant = type("Shown", (Masses,), {"shown": staticmethod(shown)})
    with (
        open_drive(Target(machine=BALL_SCREW, told=LENGTHS, plant=plant)) as device,
        pytest.raises(Diagnosis) as caught,
    ):
        identify(device, "x", Agreed(100.0))
    assert caught.value.kind == kind
    assert np.max(Masses.moved_m) < moved_m
    assert Masses.fastest_mps < speed_mps


@pytest.mark.parametrize("factor", [2.0, 6.5])
def test_length_that_does_not_fit_the_scale_is_told_as_that(factor: float) -> None:
    with open_drive(Target(machine=STIFF_SCALE, told=LENGTHS)) as device:
        count_um = device.read("plant_x.encoder")
        device.parameters.set(scales(STIFF_SCALE) | {"plant_x.encoder": round(factor * count_um, 8)})
        with pytest.raises(Diagnosis, match="encoder and its scale do not agree: the length of a count") as caught:
            identify(device, "x", Agreed(300.0))
    assert caught.value.kind == "encoder"


@pytest.mark.parametrize("axis", ["x", "y"])
def test_scale_that_counts_the_other_way_is_told_as_that(axis: str) -> None:
    with open_drive(Target(machine=STIFF_SCALE, told=LENGTHS)) as device:
        device.parameters.set(scales(STIFF_SCALE) | {f"second_encoder_{axis}.invert": 1})
        with pytest.raises(Diagnosis, match=r"encoder and its scale do not agree.*one counts the other way") as caught:
            identify(device, axis, Agreed(300.0))
    assert caught.value.kind == "encoder"


@pytest.mark.parametrize("machine", [BALL_SCREW, LONG_AXIS], ids=["ball_screw", "long_axis"])
def test_count_that_is_too_long_is_no_loose_coupling(machine: Machine) -> None:
    """Millimetres of such counts are less, and presliding is more of them."""
    with open_drive(Target(machine=machine, told=LENGTHS)) as device:
        device.parameters.set({"plant_x.encoder": round(6.5e6 * machine.x.encoder_m, 8)})
        with pytest.raises(Diagnosis, match=r"wrong by a factor of 0\.1538") as caught:
            identify(device, "x", Agreed(300.0, index_m=machine.x.index_m))
    assert caught.value.kind == "encoder"


def test_light_axis_that_only_stands_by_does_not_swing() -> None:
    """The observer of both axes slows down with the longest count; the drive takes the other axis for 98 kg."""
    with open_drive(Target(machine=LEAD_SCREW, told=LENGTHS)) as device:
        device.parameters.set({"plant_x.encoder": round(6.5e6 * LEAD_SCREW.x.encoder_m, 8)})
        with pytest.raises(Diagnosis) as caught:
            identify(device, "x", Agreed(150.0, index_m=LEAD_SCREW.x.index_m))
    assert "FF1Fh" not in str(caught.value)
    assert "length of an encoder count" in str(caught.value)
