# SPDX-License-Identifier: Apache-2.0
"""Identification: the fits against what made the data, and a drive against the simulated machine."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from kontur.can.simulated import simulated
from kontur.cli import main
from kontur.commissioning import encoder, fit
from kontur.commissioning.first_moves import Agreed, Diagnosis
from kontur.commissioning.identify import identify
from kontur.commissioning.response import Response
from kontur.design import loop
from kontur.drive.axes import METHODS
from kontur.drive.target import Target, open_drive
from kontur.machine import LENGTHS, MACHINES, Axis, Machine, load

BALL_SCREW = load(MACHINES / "ball_screw.toml")
HZ = np.unique(np.round(np.geomspace(8.0, 900.0, 48)))


def response_of(axis: Axis, delay: int, noise: float, seed: int = 1) -> Response:
    """What the equations of the axis give, with so much relative noise."""
    plant = loop.plant(loop.Grid.at(HZ, 10_000), axis, delay, ((1.0, 1.0),)).force[0]
    rng = np.random.default_rng(seed)
    plant = plant * (1.0 + noise * (rng.standard_normal(plant.shape) + 1j * rng.standard_normal(plant.shape)))
    sigma = noise * np.abs(plant)
    if axis.scale_m == 0.0:
        plant[1] = 0.0
    ones = np.ones(len(HZ))
    return Response(HZ, plant, sigma, ones.astype(complex), 0.01 * ones, ones)


def inside(value: fit.Value, true: float) -> bool:
    return abs(value.value - true) <= value.uncertainty


@pytest.mark.parametrize("machine", ["stiff_scale", "ball_screw", "lead_screw", "long_axis"])
def test_machine_is_found_in_its_frequency_response(machine: str) -> None:
    whole = load(MACHINES / f"{machine}.toml")
    for axis in whole.axes:
        measured = response_of(axis, whole.delay_periods, 0.02)
        base = replace(axis, mass_kg=1.0, resonance_Hz=0.0, resonance_damping=0.1, motor_share=0.5, current_lag_s=0.0)
        found = fit.dynamics(measured, 10_000, base)
        assert found.mass_kg.value == pytest.approx(axis.mass_kg, rel=0.02)
        assert found.resonance_Hz.value == pytest.approx(axis.resonance_Hz, rel=0.01)
        assert found.motor_share.value == pytest.approx(axis.motor_share, abs=0.05)
        true_s = axis.current_lag_s + 1e-4 * whole.delay_periods
        assert found.lag_delay_s.value == pytest.approx(true_s, abs=5e-5)
        assert inside(found.mass_kg, axis.mass_kg)
        assert inside(found.resonance_Hz, axis.resonance_Hz)
        assert inside(found.lag_delay_s, true_s)
        assert found.encoder_at == axis.encoder_at


def test_rigid_machine_is_found_to_be_rigid() -> None:
    axis = replace(BALL_SCREW.x, resonance_Hz=0.0)
    found = fit.dynamics(response_of(axis, 1, 0.02), 10_000, axis)
    assert found.resonance_Hz.value == 0.0
    assert found.mass_kg.value == pytest.approx(axis.mass_kg, rel=0.02)


def test_encoder_at_the_table_is_told_from_one_at_the_motor() -> None:
    axis = replace(BALL_SCREW.x, encoder_at="table")
    found = fit.dynamics(response_of(axis, 1, 0.02), 10_000, axis)
    assert found.encoder_at == "table"
    assert found.resonance_Hz.value == pytest.approx(axis.resonance_Hz, rel=0.01)


def test_friction_curve_is_found_with_its_uncertainty() -> None:
    v = np.array([0.0015, 0.003, 0.006, 0.012, 0.025, 0.05, 0.1, 0.2])
    force = 60.0 * (1.0 + 0.25 * np.exp(-v / 0.004)) + 600.0 * v
    rng = np.random.default_rng(1)
    for _ in range(5):
        noisy = force + 0.5 * rng.standard_normal(len(v))
        found = fit.friction(list(v), list(noisy), [0.5] * len(v))
        assert inside(found.coulomb_N, 60.0)
        assert inside(found.viscous_Nspm, 600.0)
        assert found.coulomb_N.uncertainty < 9.0
        assert found.viscous_Nspm.uncertainty < 90.0
        assert inside(found.breakaway, 1.25)


def moved_m(machine: Machine, axis: str) -> float:
    """How far an identification of a drive that knows nothing, which must fail, moves the axis."""
    with open_drive(Target(machine=machine, told=LENGTHS)) as device:
        drive = simulated(device.link.bus)
        assert drive is not None
        drive.take_truth()
        with pytest.raises(Diagnosis) as caught:
            identify(device, axis, Agreed(300.0))
        moved_m.kind = caught.value.kind  # type: ignore[attr-defined]
        position_m = drive.take_truth().pos_m[:, "xy".index(axis)]
        return float(np.ptp(position_m))


@pytest.mark.parametrize("what", ["force_inverted", "encoder_inverted"])
def test_wrong_direction_is_found_within_a_millimetre(what: str) -> None:
    machine = replace(BALL_SCREW, x=replace(BALL_SCREW.x, **{what: True}))  # type: ignore[arg-type]
    assert moved_m(machine, "x") < 1e-3
    assert moved_m.kind == "polarity"  # type: ignore[attr-defined]


def test_jammed_axis_is_said_to_be_jammed() -> None:
    machine = replace(BALL_SCREW, y=replace(BALL_SCREW.y, coulomb_N=2000.0))
    assert moved_m(machine, "y") < 1e-3
    assert moved_m.kind == "jammed"  # type: ignore[attr-defined]


def test_axis_that_takes_most_of_the_force_to_move_is_not_jammed() -> None:
    machine = replace(BALL_SCREW, y=replace(BALL_SCREW.y, coulomb_N=180.0, breakaway=1.0))
    said: list[str] = []
    with (
        open_drive(Target(machine=machine, told=LENGTHS)) as device,
        pytest.raises(KeyboardInterrupt),
    ):
        identify(device, "y", Agreed(300.0), said.append, lambda: len(said) > 2)
    assert "mass, roughly" in said[2]


def test_command_finds_the_machine_and_leaves_the_drive_as_it_was(tmp_path: Path) -> None:
    """One axis with a scale and a gap; tools/identified.py looks at others."""
    text = (MACHINES / "stiff_scale.toml").read_text().replace("[x]\n", "[x]\nbacklash_m = 6e-6\n")
    machine = tmp_path / "machine.toml"
    machine.write_text(text.replace("ripple = 0.005", "ripple = 0.02"))
    result = CliRunner().invoke(main, ["identify", "--axis", "x", "--machine", str(machine), "--untold", "--json"])
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)["axes"]["x"]
    true = load(machine).x
    for name, expected, share in (
        ("mass_kg", true.mass_kg, 0.05),
        ("viscous_Nspm", true.viscous_Nspm, 0.15),
        ("coulomb_N", true.coulomb_N, 0.15),
        ("resonance_Hz", true.resonance_Hz, 0.05),
        ("lag_delay_s", true.current_lag_s + 1e-4, 0.25),
        ("cogging_N", true.cogging_N, 0.2),
        ("ripple", true.ripple, 0.3),
        ("backlash_m", true.backlash_m, 0.1),
        ("friction_share", true.friction_share, 0.1),
        ("lead_error", true.lead_error, 0.05),
        ("lead_once_m", true.lead_once_m, 0.1),
    ):
        assert found[name]["value"] == pytest.approx(expected, rel=share), name
        assert abs(found[name]["value"] - expected) <= found[name]["uncertainty"], name
    assert found["screw_m"] == true.screw_m
    assert found["presliding_m"]["value"] == pytest.approx(true.presliding_m, rel=0.1)
    assert sum(found["steps_s"].values()) == pytest.approx(found["drive_s"], abs=1.0)
    assert found["drive_s"] < 110.0
    assert 0.0 < found["encoder_noise_m"]["value"] < 2.0 * true.encoder_m  # the simulated force noise shakes the motor
    assert found["scale_noise_m"] == {"value": 0.0, "uncertainty": pytest.approx(true.scale_m / 12**0.5)}


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_length_of_a_count_is_found_by_index_pulses(direction: float) -> None:
    with open_drive(Target(machine=BALL_SCREW, told=LENGTHS)) as device:
        device.parameters.set(
            {"plant_x.encoder": 0.02, "homing_method_x": METHODS["index+" if direction > 0.0 else "index-"]}
            | {"cascade.position_gain": 20.0, "cascade.velocity_gain": 30.0, "cascade.integral_gain": 5.0}
            | {"observer.bandwidth": 2000.0}
        )
        device.select_controller("cascade")
        with device.axes.enabled():
            found_m = encoder.length_m(device, "x", BALL_SCREW.x.index_m)
            zero_m = encoder._zero(device, "x", 0.02e-6) * 0.02e-6
            assert zero_m == pytest.approx(0.0, abs=1e-6)  # where it was
            assert abs(device.position_m()[0]) > 1e-3
    assert found_m == pytest.approx(BALL_SCREW.x.encoder_m, rel=1e-4)


def test_wrong_length_of_a_count_is_said_with_its_factor() -> None:
    with open_drive(Target(machine=BALL_SCREW, told=LENGTHS)) as device:
        device.parameters.set({"plant_x.encoder": round(BALL_SCREW.x.encoder_m * 1e6 / 2.0, 8)})
        with pytest.raises(Diagnosis, match=r"wrong by a factor of 2.*plant_x.encoder=0.0762") as caught:
            identify(device, "x", Agreed(300.0, index_m=0.01))
    assert caught.value.kind == "encoder"
