# SPDX-License-Identifier: Apache-2.0
"""The simulated machine against SciPy's stiff solvers and against closed forms.

The plant is compiled from sim/plant.c and driven period by period. The equations below are written from the keys of a
machine file (docs/machines.md), not from the C code.
"""

from __future__ import annotations

import dataclasses
import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cffi
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from kontur import machine as machines
from kontur.machine import Machine

ROOT = Path(__file__).resolve().parents[2]
PERIOD_S = 1e-4
ELEMENTS = 10

Floats = NDArray[np.float64]


@pytest.fixture(scope="module")
def plants(tmp_path_factory: pytest.TempPathFactory) -> Any:
    ffi = cffi.FFI()
    for header in ("sim/kontur_sim.h", "sim/plant.h"):
        ffi.cdef((ROOT / header).read_text().split("/* CDEF-BEGIN */")[1].split("/* CDEF-END */")[0])
    library = tmp_path_factory.mktemp("plant") / "libplant.so"
    flags = ["-std=c11", "-O2", "-ffp-contract=off", "-fPIC", "-shared", f"-I{ROOT}", f"-I{ROOT / 'firmware'}"]
    compiler = os.environ.get("CC", "gcc")
    subprocess.run([compiler, *flags, str(ROOT / "sim/plant.c"), "-o", str(library), "-lm"], check=True)
    return ffi, ffi.dlopen(str(library))


class Plant:
    """A plant whose x axis differs from a frictionless 100 kg by `keys`."""

    def __init__(self, plants: Any, **keys: Any) -> None:
        self.ffi, self.lib = plants
        plain = machines.load()
        zero = {"viscous_Nspm": 0.0, "coulomb_N": 0.0, "force_noise_N": 0.0, "mass_kg": 100.0, "index_m": 0.0}
        substeps = keys.pop("substeps", 10)
        axis = dataclasses.replace(plain.x, **(zero | keys))
        still = dataclasses.replace(plain.y, **zero)
        self.machine: Machine = dataclasses.replace(plain, x=axis, y=still, friction_schedule=(), substeps=substeps)
        c = self.ffi.new("struct ks_machine *")
        for name, values in self.machine.simulated().items():
            if isinstance(getattr(c, name), (int, float)):
                setattr(c, name, values[0])
            else:
                for i, value in enumerate(values):
                    getattr(c, name)[i] = value
        self.problem = self.lib.plant_check(c)
        self.p = self.ffi.new("struct plant *")
        self.lib.plant_init(self.p, c, 1, PERIOD_S)

    def step(self, force_N: float, other_N: float = 0.0) -> None:
        self.lib.plant_step(self.p, [force_N, other_N])

    def run(self, force_N: Callable[[float], float], periods: int) -> Floats:
        """(periods, 4): table and motor position, table and motor velocity after each period."""
        rows = []
        for k in range(periods):
            self.step(force_N(k * PERIOD_S))
            rows.append((self.p.pos_m[0], self.p.motor_pos_m[0], self.p.vel_mps[0], self.p.motor_vel_mps[0]))
        return np.array(rows)

    def two(self, function: str) -> list[Any]:
        kind = "double[2]" if function == "plant_tool" else "int32_t[2]"
        out = self.ffi.new(kind)
        getattr(self.lib, function)(self.p, out)
        return list(out)


def spring_of(axis: Any) -> tuple[float, float, float, float]:
    """Masses of motor and table, stiffness and damper of the first mode with both ends free."""
    motor, table = axis.motor_share * axis.mass_kg, (1 - axis.motor_share) * axis.mass_kg
    reduced = 1 / (1 / motor + 1 / table)
    omega = 2 * np.pi * axis.resonance_Hz
    return motor, table, reduced * omega**2, 2 * axis.resonance_damping * reduced * omega


def solve(axis: Any, force_N: Callable[[float], float], periods: int) -> Floats:
    """The same with SciPy's Radau: two masses, spring, gap, lag, delay of a period, Stribeck curve, slip elements."""
    motor, table, stiffness, damper = spring_of(axis)
    distance = axis.presliding_m * np.arange(1, ELEMENTS + 1) / ELEMENTS

    def level(v: float, share: float) -> float:
        return share * axis.coulomb_N * (1 + (axis.breakaway - 1) * np.exp(-abs(v) / axis.stribeck_mps))

    def slipping(z: Floats, v: float) -> Floats:
        """Rate of the elements, each of which holds at +-1."""
        rate = 2 * v / distance
        return np.where(((z >= 1) & (rate > 0)) | ((z <= -1) & (rate < 0)), 0, rate)

    def rates(_: float, y: Floats, demand: float) -> Floats:
        qt, qm, vt, vm, f = y[:5]
        zt, zm = y[5 : 5 + ELEMENTS], y[5 + ELEMENTS :]
        gap = axis.backlash_m / 2
        apart = qm - qt
        stretch = np.sign(apart) * max(abs(apart) - gap, 0)
        spring = stiffness * stretch + damper * (vm - vt) * (gap == 0 or stretch != 0)
        if gap > 0 and spring * stretch < 0:
            spring = 0.0
        share = axis.friction_share
        friction_t = level(vt, share) * np.mean(np.clip(zt, -1, 1)) + share * axis.viscous_Nspm * vt
        friction_m = level(vm, 1 - share) * np.mean(np.clip(zm, -1, 1)) + (1 - share) * axis.viscous_Nspm * vm
        lag = (demand - f) / axis.current_lag_s
        head = [vt, vm, (spring - friction_t) / table, (f - spring - friction_m) / motor, lag]
        return np.concatenate([head, slipping(zt, vt), slipping(zm, vm)])

    y = np.zeros(5 + 2 * ELEMENTS)
    rows = []
    for k in range(periods):
        demand = force_N((k - 1) * PERIOD_S) if k else 0.0
        found = solve_ivp(rates, (0, PERIOD_S), y, "Radau", args=(demand,), rtol=1e-7, atol=1e-12)
        y = found.y[:, -1]
        y[5:] = np.clip(y[5:], -1, 1)
        rows.append(y[:4])
    return np.array(rows)


ELASTIC = {
    "soft": dict(resonance_Hz=45.0, resonance_damping=0.03, motor_share=0.7),
    "stiff": dict(resonance_Hz=300.0, resonance_damping=0.01, motor_share=0.25),
    "gap": dict(resonance_Hz=120.0, resonance_damping=0.05, motor_share=0.5, backlash_m=10e-6),
}


@pytest.mark.parametrize("name", ELASTIC)
def test_two_masses_move_as_the_stiff_solver_says(plants: Any, name: str) -> None:
    keys = ELASTIC[name] | dict(
        viscous_Nspm=400.0,
        coulomb_N=40.0,
        breakaway=1.3,
        stribeck_mps=0.004,
        presliding_m=20e-6,
        friction_share=0.6,
        current_lag_s=4e-4,
    )
    plant = Plant(plants, **keys)

    def force_N(t: float) -> float:
        return 150.0 * np.sin(2 * np.pi * 53.0 * t) + 60.0 * np.sin(2 * np.pi * 17.0 * t)

    periods = 400
    mine, theirs = plant.run(force_N, periods), solve(plant.machine.x, force_N, periods)
    travel = np.ptp(theirs[:, :2], axis=0)
    assert travel.min() > 100e-6
    assert np.max(np.abs(mine - theirs)[:, :2] / travel) < 2e-3
    stretch = theirs[:, 1] - theirs[:, 0]
    assert np.max(np.abs(mine[:, 1] - mine[:, 0] - stretch)) < 0.02 * np.ptp(stretch)


@pytest.mark.parametrize("hz", [30.0, 300.0])
def test_a_free_mode_rings_at_its_frequency_and_with_its_damping(plants: Any, hz: float) -> None:
    plant = Plant(plants, resonance_Hz=hz, resonance_damping=0.01, motor_share=0.3)
    plant.p.motor_vel_mps[0] = 0.01
    rows = plant.run(lambda t: 0.0, round(20 / hz / PERIOD_S))
    stretch = rows[:, 1] - rows[:, 0]
    t = PERIOD_S * np.arange(1, len(rows) + 1)
    omega = 2 * np.pi * hz
    damped = omega * np.sqrt(1 - 0.01**2)
    expected = 0.01 / damped * np.exp(-0.01 * omega * t) * np.sin(damped * t)
    assert np.max(np.abs(stretch - expected)) < 2e-3 * np.max(expected)


def test_the_spring_yields_by_what_the_table_needs_to_accelerate(plants: Any) -> None:
    plant = Plant(plants, resonance_Hz=90.0, resonance_damping=0.5, motor_share=0.4)
    rows = plant.run(lambda t: 200.0, 3000)
    _, table, stiffness, _ = spring_of(plant.machine.x)
    assert rows[-1, 1] - rows[-1, 0] == pytest.approx(table * (200.0 / 100.0) / stiffness, rel=1e-4)


def test_the_table_rests_until_the_motor_has_crossed_the_gap(plants: Any) -> None:
    for keys in (dict(resonance_Hz=150.0, resonance_damping=0.05), {}):
        plant = Plant(plants, backlash_m=15e-6, coulomb_N=20.0, friction_share=1.0, substeps=1000, **keys)
        plant.p.motor_pos_m[0] = 7.5e-6
        while plant.p.pos_m[0] == 0.0:
            plant.step(-60.0)
        _, _, stiffness, _ = spring_of(plant.machine.x)
        yields = 20.0 / stiffness if keys else 0.0  # the spring breaks the table's friction first
        last = abs(plant.p.motor_vel_mps[0]) * PERIOD_S
        assert -plant.p.motor_pos_m[0] == pytest.approx(7.5e-6 + yields, abs=last)
        assert last < 1e-6


def test_friction_builds_up_over_the_presliding_distance_after_a_reversal(plants: Any) -> None:
    plant = Plant(plants, coulomb_N=50.0, presliding_m=20e-6)
    plant.p.vel_mps[0] = 0.01
    for _ in range(100):
        plant.step(50.0)
    while plant.p.vel_mps[0] > 0:
        plant.step(-100.0)
    turned, low = plant.p.pos_m[0], plant.p.friction_N[0]
    loop = []
    while plant.p.pos_m[0] > turned - 25e-6:
        plant.step(-100.0)
        loop.append((turned - plant.p.pos_m[0], plant.p.friction_N[0]))
    moved, friction = np.array(loop).T
    assert low > 40.0
    assert friction[moved > 20.2e-6] == pytest.approx(-50.0)
    assert np.all(friction[(moved > 0) & (moved < 17e-6)] > -50.0)
    # half of the way of element k is from +1 to 0
    expected = 50.0 * np.mean([np.clip(1 - 2 * moved / (20e-6 * k / ELEMENTS), -1, 1) for k in range(1, 11)], axis=0)
    assert np.max(np.abs(friction - expected)) < 5.0


def test_slip_elements_give_the_friction_loop_its_width(plants: Any) -> None:
    """An element of limit w that slips after d takes 4 w (a - d / 2) from a motion of amplitude a."""
    plant = Plant(plants, coulomb_N=50.0, presliding_m=20e-6, mass_kg=1.0, substeps=100)
    amplitude, work, before = 100e-6, 0.0, 0.0
    reached: list[float] = []
    for k in range(30_000):  # the position is led; the plant's mass follows a stiff servo
        goal = amplitude * np.sin(2 * np.pi * k * PERIOD_S)
        force = 2e6 * (goal - plant.p.pos_m[0]) - 2000.0 * plant.p.vel_mps[0]
        plant.step(force)
        if k >= 10_000:
            reached.append(plant.p.pos_m[0])
            work += plant.p.friction_N[0] * (plant.p.pos_m[0] - before)
        before = plant.p.pos_m[0]
    distance = 20e-6 * np.arange(1, ELEMENTS + 1) / ELEMENTS
    expected = 2 * 50.0 * np.mean(2 * np.ptp(reached) - 2 * distance)
    assert work == pytest.approx(expected, rel=5e-3)


def test_the_encoder_counts_down_and_the_force_acts_backwards_when_inverted(plants: Any) -> None:
    for encoder in (False, True):
        for force in (False, True):
            plant = Plant(plants, encoder_inverted=encoder, force_inverted=force)
            plant.run(lambda t: 100.0, 100)
            assert np.sign(plant.p.pos_m[0]) == (-1 if force else 1)
            assert np.sign(plant.two("plant_encoders")[0]) == (-1 if encoder != force else 1)


def test_encoder_and_scale_see_what_they_are_mounted_to(plants: Any) -> None:
    common = dict(resonance_Hz=50.0, scale_m=10e-9, encoder_m=100e-9, lead_error=200e-6, start_m=0.05)
    for at in ("motor", "table"):
        plant = Plant(plants, encoder_at=at, **common)
        plant.run(lambda t: 200.0, 80)
        table, motor = plant.p.pos_m[0], plant.p.motor_pos_m[0]
        assert motor - table > 2e-6
        with_error = table + 200e-6 * (table - 0.05 if at == "motor" else table)
        seen = motor if at == "motor" else with_error
        assert plant.two("plant_encoders")[0] == round(seen / 100e-9)
        assert plant.two("plant_scales")[0] == round(with_error / 10e-9)
        assert plant.two("plant_tool")[0] == pytest.approx(with_error, abs=1e-12)


def test_a_scale_begins_at_what_the_first_encoder_says(plants: Any) -> None:
    """Both count from where an axis was homed. Else a constant error would be left that no sensor sees."""
    keys = dict(lead_error=200e-6, lead_once_m=5e-6, encoder_once_m=1e-6, screw_m=0.01, encoder_m=0.7e-6)
    for start_m in (-0.0213, 0.0, 0.0501):
        plant = Plant(plants, start_m=start_m, scale_m=10e-9, **keys)
        first_m = plant.two("plant_encoders")[0] * 0.7e-6
        assert plant.two("plant_scales")[0] * 10e-9 == pytest.approx(first_m, abs=5.1e-9)
        assert plant.two("plant_tool")[0] == pytest.approx(first_m, abs=1e-12)
        without = Plant(plants, start_m=start_m, **keys)
        gone_m = [one.two("plant_tool")[0] for one in (plant, without)]
        for one in (plant, without):
            one.p.pos_m[0] += 0.0037
        gone_m = [one.two("plant_tool")[0] - before for one, before in zip((plant, without), gone_m, strict=True)]
        assert gone_m[0] == pytest.approx(gone_m[1], abs=1e-12)


def test_periodic_errors_have_their_amplitude_and_period(plants: Any) -> None:
    at = np.linspace(0.0, 0.02, 4001)
    errors: dict[str, Floats] = {}
    for key, more in (
        ("encoder_once_m", {}),
        ("interpolation_m", {"interpolation_period_m": 20e-6}),
        ("lead_once_m", {}),
    ):
        plant = Plant(plants, encoder_m=1e-9, screw_m=0.01, **{key: 2e-6}, **more)
        found = []
        for position in at:
            plant.p.pos_m[0] = position
            tool = key == "lead_once_m"
            found.append(plant.two("plant_tool")[0] if tool else plant.two("plant_encoders")[0] * 1e-9)
        errors[key] = np.array(found) - at
    for key in ("encoder_once_m", "lead_once_m"):
        assert errors[key] == pytest.approx(2e-6 * np.sin(2 * np.pi * at / 0.01), abs=1e-9)
    assert errors["interpolation_m"] == pytest.approx(2e-6 * np.sin(2 * np.pi * at / 20e-6), abs=1e-9)


def test_squareness_and_crosstalk_move_the_other_axis_of_the_tool_alone(plants: Any) -> None:
    plant = Plant(plants, squareness_rad=1e-4, crosstalk_s2=1e-6)
    plant.p.pos_m[0] = 0.1
    plant.run(lambda t: 200.0, 3)
    tool = plant.two("plant_tool")
    assert tool[0] == plant.p.pos_m[0]
    assert tool[1] == pytest.approx(1e-4 * plant.p.pos_m[0] + 1e-6 * 2.0, rel=1e-9)
    assert plant.two("plant_encoders")[1] == 0


def test_ripple_and_cogging_stay_within_their_limits_and_go_by_angle(plants: Any) -> None:
    for key, base in (("cogging_N", 0.0), ("ripple", 100.0)):
        plant = Plant(plants, screw_m=0.005, **{key: 8.0 if base == 0 else 0.08})
        extra = []
        for position in np.linspace(0, 0.01, 400, endpoint=False):
            plant.p.pos_m[0], plant.p.vel_mps[0] = position, 0.0
            plant.step(base)
            plant.p.pos_m[0], plant.p.vel_mps[0] = position, 0.0
            plant.step(base)
            extra.append(plant.p.vel_mps[0] / PERIOD_S * 100.0 - base)
        force = np.array(extra)
        assert np.max(np.abs(force)) <= 8.0
        assert np.max(np.abs(force)) > 5.0
        assert force[:200] == pytest.approx(force[200:], abs=0.02)


def test_the_amplifier_has_a_resolution_and_a_continuous_limit(plants: Any) -> None:
    plant = Plant(plants, force_bits=8, force_limit_N=640.0)
    for force, given in ((7.0, 5.0), (8.0, 10.0), (-13.0, -15.0)):
        for _ in range(2):
            plant.step(force)
        assert plant.p.lagged_N[0] == given

    plant = Plant(plants, continuous_force_N=100.0, thermal_s=0.5)
    forces = []
    for k in range(20_000):
        plant.p.pos_m[0] = 0.0
        plant.step(200.0 if k // 100 % 2 else -200.0)
        forces.append(abs(plant.p.lagged_N[0]))
    limited = int(np.argmax(np.array(forces[2:]) < 200.0))
    assert limited * PERIOD_S == pytest.approx(-0.5 * np.log(1 - 0.25), rel=0.01)
    assert np.sqrt(np.mean(np.square(forces[10_000:]))) == pytest.approx(100.0, rel=0.02)


def test_the_cutting_force_acts_while_the_path_runs(plants: Any) -> None:
    for hz, expected in ((0.0, 1.0), (500.0, 0.0)):
        plant = Plant(plants, cutting_force_N=50.0, cutting_Hz=hz)
        plant.run(lambda t: 0.0, 20)
        assert plant.p.pos_m[0] == 0.0
        plant.p.cutting = 1
        speed = plant.run(lambda t: 0.0, 100)[:, 2]
        assert speed[-1] == pytest.approx(expected * 50.0 / 100.0 * 0.01, abs=1e-5)
        assert np.max(speed) > 1e-4
    plant = Plant(plants, friction_wave=0.5, coulomb_N=40.0)
    travel = plant.machine.x.travel_m
    plant.p.pos_m[0] = travel[0] + 0.25 * (travel[1] - travel[0])
    plant.p.vel_mps[0] = 0.01
    plant.step(0.0)
    assert plant.p.friction_N[0] == pytest.approx(60.0, rel=1e-6)


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("motor_share", dict(resonance_Hz=50.0, motor_share=1.0)),
        ("resonance_Hz", dict(resonance_Hz=-1.0)),
        ("screw_m", dict(cogging_N=1.0)),
        ("interpolation_period_m", dict(interpolation_m=1e-6)),
        ("thermal_s", dict(continuous_force_N=100.0)),
        ("force_bits", dict(force_bits=40)),
    ],
)
def test_the_plant_names_the_key_that_cannot_be(plants: Any, key: str, values: dict[str, Any]) -> None:
    plant = Plant(plants, **values)
    assert plant.ffi.string(plant.problem).decode() == key
