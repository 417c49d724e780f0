# SPDX-License-Identifier: Apache-2.0
"""What the drive is told of a real machine is what the simulated machine does: against the plant, and closed forms."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from test_plant import Plant, plants, spring_of  # noqa: F401

from kontur import machine as machines
from kontur.cli.options import parameter_names
from kontur.drive.target import Target, open_drive
from kontur.machine import model
from kontur.path import shapes
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.runs.runner import run

TABLE1 = machines.load()
REAL = dict(
    resonance_Hz=90.0, motor_share=0.3, friction_share=0.4, backlash_m=5e-6, presliding_m=20e-6, breakaway=1.3,
    stribeck_mps=0.004, screw_m=0.01, cogging_N=8.0, ripple=0.03, lead_error=-200e-6, squareness_rad=2e-4,
    continuous_force_N=300.0, thermal_s=20.0, encoder_inverted=True, force_inverted=True,
)  # fmt: skip


def told(compensation: str = machines.FULL, **keys: Any) -> dict[str, float]:
    """What a drive is told of Table 1 with an x axis that differs by `keys`."""
    return dataclasses.replace(TABLE1, x=dataclasses.replace(TABLE1.x, **keys)).parameters(compensation=compensation)


def harmonics(values: dict[str, float], what: str, angle: np.ndarray) -> np.ndarray:
    """The sum of the harmonics of `what` (firmware/core/screw.h) with the drive's default orders."""
    return np.sum([values[f"screw_x.{what}_cos_{n}"] * np.cos(order * angle)
                   + values[f"screw_x.{what}_sin_{n}"] * np.sin(order * angle)
                   for n, order in ((1, 1), (2, 2), (3, 6))], axis=0)  # fmt: skip


def test_every_parameter_that_is_told_exists_and_takes_its_value() -> None:
    both = dataclasses.replace(TABLE1.y, **(REAL | dict(scale_m=1e-8, resonance_Hz=0.0)))
    real = dataclasses.replace(TABLE1, x=dataclasses.replace(TABLE1.x, **REAL), y=both)
    values = real.parameters()
    assert {p.format(a) for p, *_ in model._PARAMETERS for a in "xy"} <= set(parameter_names())
    with open_drive(Target(real)) as device:
        for name, value in values.items():
            assert device.read(name) == pytest.approx(value, abs=1e-3 * abs(value) + 5e-9), name


def test_a_plain_machine_is_told_as_a_rigid_axis() -> None:
    assert TABLE1.parameters() == TABLE1.parameters(compensation=machines.RIGID)
    assert list(TABLE1.parameters()) == [
        f"{name}_{axis}.{sub}" for axis in "xy"
        for name, sub in (("plant", "mass"), ("plant", "viscous"), ("plant", "coulomb"), ("plant", "force_limit"),
                          ("plant", "encoder"), ("position_limit", "min"), ("position_limit", "max"))
    ] + list(TABLE1.gains)  # fmt: skip


def test_a_force_that_is_late_is_told_up_to_what_the_drive_takes() -> None:
    late = told(current_lag_s=4e-4)
    assert (late["plant_x.force_delay"], late.get("plant_y.force_delay")) == (4e-4, None)
    assert told(current_lag_s=0.5)["plant_x.force_delay"] == 0.01
    assert "plant_x.force_delay" not in told(machines.RIGID, current_lag_s=4e-4)


def test_rigid_leaves_out_what_a_rigid_axis_does_not_have() -> None:
    rigid = told(machines.RIGID, **REAL)
    assert rigid.keys() == TABLE1.parameters().keys()
    assert rigid.keys() < told(**REAL).keys()


def test_stiffness_and_mass_of_the_table_are_those_of_its_deflection(plants: Any) -> None:  # noqa: F811
    values = told(resonance_Hz=90.0, motor_share=0.3, mass_kg=100.0)
    plant = Plant(plants, resonance_Hz=90.0, motor_share=0.3, resonance_damping=0.5)
    rows = plant.run(lambda t: 200.0, 1000)
    deflection_um = (rows[-100:, 1] - rows[-100:, 0]).mean() * 1e6
    acceleration = 200.0 / 100.0
    assert values["transmission_x.table_mass"] * acceleration / values["transmission_x.stiffness"] == pytest.approx(
        deflection_um, rel=1e-4
    )
    assert values["transmission_x.stiffness"] == pytest.approx(spring_of(plant.machine.x)[2] * 1e-6, rel=1e-12)


@pytest.mark.parametrize("keys", [dict(encoder_at="table"), dict(scale_m=1e-8)])
def test_what_a_sensor_at_the_table_sees_is_not_told_again(keys: dict[str, Any]) -> None:
    values = told(**(REAL | keys))
    assert not [name for name in values if name.startswith(("lead_map_x", "lead_error_x", "transmission_x.backlash"))]
    assert ("transmission_x.stiffness" in values) == ("scale_m" in keys)  # of the encoder at the motor
    assert values.get("second_encoder_x.length") == (0.01 if "scale_m" in keys else None)


def test_cogging_and_ripple_are_those_of_the_machine_at_every_angle(plants: Any) -> None:  # noqa: F811
    screw = dict(screw_m=0.01, mass_kg=100.0)
    at_m = np.linspace(-0.012, 0.012, 49)
    cogging_N, rippled_N = [], []
    for start_m in at_m:
        for keys, out, force_N in ((dict(cogging_N=8.0), cogging_N, 0.0), (dict(ripple=0.03), rippled_N, 50.0)):
            plant = Plant(plants, start_m=float(start_m), **screw, **keys)
            for _ in range(2):  # the first period is the delay
                before_mps = plant.p.vel_mps[0]
                plant.step(force_N)
            out.append(100.0 * (plant.p.vel_mps[0] - before_mps) / 1e-4)
    angle = 2 * np.pi * at_m / 0.01
    np.testing.assert_allclose(harmonics(told(cogging_N=8.0, **screw), "cogging", angle), cogging_N, atol=2e-3)
    ripple = harmonics(told(ripple=0.03, **screw), "ripple", angle)
    np.testing.assert_allclose(50.0 * (1.0 + ripple), rippled_N, atol=2e-3)


@pytest.mark.parametrize(
    ("keys", "within_m"),
    [
        (dict(lead_error=-200e-6), 1e-9),
        (dict(lead_error=300e-6, travel_m=(-1.9, 1.9), soft_limit_m=(-1.8, 1.8)), 1e-9),
        (dict(lead_once_m=5e-6, screw_m=0.01), 2e-9),
        (dict(lead_once_m=5e-6, lead_error=100e-6, screw_m=0.01), 2e-9),
        (dict(lead_once_m=5e-6, encoder_once_m=2e-6, screw_m=0.01), 6e-9),  # angle of the encoder with its error
        (dict(encoder_once_m=5e-6, lead_once_m=3e-6, screw_m=0.01, encoder_at="table"), 20e-9),
    ],
)
def test_map_and_error_once_a_turn_lead_from_the_encoder_to_the_tool(plants: Any, keys: Any, within_m: float) -> None:  # noqa: F811
    values = told(**keys)
    points, start, step = (int(values.get(f"lead_map_x.{name}", 0)) for name in ("points", "start", "step"))
    assert (points > 0) == ("lead_error" in keys)
    errors_m = [values[f"lead_error_x.entry_{i + 1}"] * 1e-9 for i in range(points)]
    assert f"lead_error_x.entry_{points + 1}" not in values
    map_m = (start + step * np.arange(points)) * 1e-9
    low, high = keys.get("soft_limit_m", TABLE1.x.soft_limit_m)
    if points > 0:
        assert map_m[0] == pytest.approx(low)
        assert high <= map_m[-1] <= high + 1e-7
    per_m = 2e6 * np.pi / values.get("screw_x.lead", np.inf)
    once_m = values.get("screw_x.error_sin", 0.0) * 1e-6
    worst_m = 0.0
    for at_m in np.linspace(low, high, 997):
        plant = Plant(plants, start_m=float(at_m), encoder_m=1e-9, **keys)
        encoder_m = plant.two("plant_encoders")[0] * 1e-9
        lead_m = np.interp(encoder_m, map_m, errors_m) if points > 0 else 0.0
        tool_m = encoder_m + lead_m + once_m * np.sin(per_m * encoder_m)
        worst_m = max(worst_m, abs(tool_m - plant.two("plant_tool")[0]))
    assert worst_m <= within_m


def test_second_encoder_leaves_the_error_once_a_turn_of_the_first_one(plants: Any) -> None:  # noqa: F811
    """Between both encoders it is taken off, so that nothing of it passes above the crossover."""
    keys = dict(lead_once_m=5e-6, encoder_once_m=2e-6, screw_m=0.01, scale_m=1e-9)
    values = told(**keys)
    for at_m in np.linspace(-0.012, 0.012, 49):
        plant = Plant(plants, encoder_m=1e-9, **keys)
        plant.p.pos_m[0] = at_m
        first_m, second_m = plant.two("plant_encoders")[0] * 1e-9, plant.two("plant_scales")[0] * 1e-9
        once_m = values["screw_x.error_sin"] * 1e-6 * np.sin(2e6 * np.pi * first_m / values["screw_x.lead"])
        assert first_m + once_m == pytest.approx(second_m, abs=6e-9)


def test_squareness_is_the_share_of_the_travel_that_the_other_axis_sees(plants: Any) -> None:  # noqa: F811
    plant = Plant(plants, squareness_rad=2e-4, start_m=0.1)
    seen_m = plant.two("plant_tool")[1] - plant.machine.y.start_m
    assert told(squareness_rad=2e-4)["geometry.squareness_x"] * 0.1 == pytest.approx(seen_m, rel=1e-9)


def test_friction_at_reversal_and_limits_are_told_in_the_units_of_the_drive() -> None:
    values = told(**REAL)
    expected = {
        "friction_x.presliding": 20.0,
        "friction_x.breakaway": 1.3,
        "friction_x.stribeck": 0.004,
        "screw_x.lead": 10_000.0,
        "transmission_x.table_friction": 0.4,
        "transmission_x.backlash": 5.0,
        "force_continuous_x.force": 300.0,
        "force_continuous_x.time": 20.0,
    }
    assert {name: values[name] for name in expected} == pytest.approx(expected)


@pytest.mark.parametrize("name", ["ball_screw", "lead_screw", "long_axis", "stiff_scale"])
def test_the_drive_takes_all_of_each_example_machine(name: str) -> None:
    real = machines.load(machines.MACHINES / f"{name}.toml")
    with open_drive(Target(real)) as device:
        assert device.read("plant_x.mass") == pytest.approx(real.x.mass_kg)


@pytest.mark.parametrize("lead_error", [-1e-3, -1e-4])  # 20 um off at 20 mm, of 10 um allowed; and 2 um
def test_a_simulated_axis_goes_to_the_start_where_its_sensor_sees_it_elsewhere(lead_error: float) -> None:
    axis = dataclasses.replace(TABLE1.x, encoder_at="table", lead_error=lead_error)
    far = dataclasses.replace(TABLE1, x=axis)
    found = run(plan(shapes.circle(0.02, 0.1), limits(far)), "cascade", Target(far))
    assert found.completed
    assert found.log.columns["true_position_x_mm"][0] == pytest.approx(20.0, abs=5e-4)
