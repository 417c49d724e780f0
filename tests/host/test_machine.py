# SPDX-License-Identifier: Apache-2.0
"""Machine files: the paper's table as shipped, and one clear message for each mistake."""

import dataclasses
from pathlib import Path

import pytest

from kontur import machine
from kontur.errors import MachineError
from kontur.machine import reader

TABLE1 = machine.DEFAULT.read_text()


def load_changed(tmp_path: Path, old: str, new: str) -> machine.Machine:
    assert old in TABLE1
    file = tmp_path / "mine.toml"
    file.write_text(TABLE1.replace(old, new, 1))
    return machine.load(file)


def test_default_machine_is_table_1_of_the_paper() -> None:
    table1 = machine.load()
    assert (table1.x.mass_kg, table1.y.mass_kg) == (88.08, 97.90)
    assert (table1.x.viscous_Nspm, table1.y.viscous_Nspm) == (467.2, 631.0)
    assert (table1.x.coulomb_N, table1.y.coulomb_N) == (45.5, 54.8)
    assert table1.friction_schedule == ((0.0, 1.0), (1.6, 0.0), (3.0, 0.5), (4.4, 1.5))
    assert table1.friction_repeat_s == 5.6


def test_machine_tells_the_drive_its_plant_in_the_units_of_the_drive() -> None:
    values = machine.load().parameters()
    assert values["plant_x.mass"] == 88.08
    assert values["plant_y.encoder"] == pytest.approx(0.07629, rel=1e-12)
    assert values["position_limit_x.min"] == pytest.approx(-145e6, rel=1e-12)


def test_start_moves_without_changing_anything_else() -> None:
    table1 = machine.load()
    moved = table1.starting_at((0.01, -0.02))
    assert (moved.x.start_m, moved.y.start_m) == (0.01, -0.02)
    assert moved.starting_at((0.0, 0.0)) == table1


def test_optional_keys_may_be_left_out(tmp_path: Path) -> None:
    mine = load_changed(
        tmp_path, "force_noise_N = 2.0            # standard deviation, one draw a control period\n", ""
    )
    assert mine.x.force_noise_N == 0.0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass_kg = 88.08", "mass_kg = -1", r"x\.mass_kg: must be at least 0\.1"),
        ("mass_kg = 88.08", "mass_kg = nan", r"x\.mass_kg: must be a number"),
        ("mass_kg = 88.08", "mass_kg = true", r"x\.mass_kg: must be a number"),
        ("mass_kg = 88.08", "mas_kg = 88.08", r"x\.mas_kg: unknown key; known are .*mass_kg"),
        ("mass_kg = 88.08", "", r"x\.mass_kg: is missing"),
        ("velocity_mps = 0.3", "velocity_mps = 0", r"x\.velocity_mps: must be greater than 0"),
        ("travel_m = [-0.15, 0.15]", "travel_m = [0.15, -0.15]", r"x\.travel_m: the least must be below"),
        ("travel_m = [-0.15, 0.15]", "travel_m = [-0.1, 0.1]", r"x\.soft_limit_m: must lie within travel_m"),
        ("encoder_m = 76.29e-9", "encoder_m = 1e-12", r"x\.encoder_m: must be above .* the counter is full"),
        ("limit_switch_m = 0.002", "limit_switch_m = 0.15", r"x\.limit_switch_m: must be below half of travel_m"),
        ("travel_m = [-0.15, 0.15]", "travel_m = 0.15", r"x\.travel_m: must be \[least, greatest\]"),
        ("start_m = 0.0", "start_m = 0.149", r"x\.start_m: must lie within soft_limit_m"),
        ("delay_periods = 1", "delay_periods = 0", r"delay_periods: must be a whole number 1\.\.4"),
        ("substeps = 10", "substeps = 9", r"substeps: must be a whole number 10\.\."),
        ("[1.6, 0.0]", "[0.0, 0.0]", r"friction_schedule\.rows\[1\]: times must increase"),
        ("[1.6, 0.0]", "[1.6]", r"friction_schedule\.rows\[1\]: must be \[time_s, scale\]"),
        ("repeat_s = 5.6", "repeat_s = 4.4", r"friction_schedule\.repeat_s: must be 0 or later"),
        ("name = ", "name : ", r"is not a TOML file"),
    ],
)
def test_mistake_is_named_with_file_and_key(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(MachineError, match=rf"mine\.toml: {message}"):
        load_changed(tmp_path, old, new)


def test_missing_file_is_named() -> None:
    with pytest.raises(MachineError, match=r"nowhere\.toml: cannot be read"):
        machine.load("nowhere.toml")


def test_the_page_of_machines_has_every_key_and_every_file() -> None:
    page = (Path(__file__).parents[2] / "docs/machines.md").read_text()
    for field in dataclasses.fields(machine.Axis):
        assert f"`{field.name}`" in page, field.name
    for file in machine.MACHINES.glob("*.toml"):
        assert f"[{file.name}]" in page
        machine.load(file)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("motor_share = 1.0", r"motor_share: must be at least 0\.01 and at most 0\.99"),
        ("motor_share = 1e-9", r"motor_share: must be at least 0\.01 and at most 0\.99"),
        ("motor_share = 0.0", r"motor_share: must be at least 0\.01 and at most 0\.99, is 0"),
        ("motor_share = -0.5", r"motor_share: must be at least 0\.01"),
        ("motor_share = 1.5", r"motor_share: must be at least 0\.01"),
        ("motor_share = nan", "motor_share: must be a number"),
        ('motor_share = "half"', "motor_share: must be a number"),
        ("friction_share = 1.5", "friction_share: must be at least 0 and at most 1"),
        ("resonance_damping = 1.5", "resonance_damping: must be at least 0 and at most 1"),
        ("resonance_Hz = 1e9", "resonance_Hz: must be at least 0 and at most 2000"),
        ("presliding_m = -1e-5", "presliding_m: must be at least 0"),
        ("backlash_m = 1.0", r"backlash_m: must be at least 0 and at most 0\.01"),
        ("scale_m = 1e-12", "scale_m: must be above .* the counter is full before travel_m"),
        ("lead_once_m = 2e-3\nscrew_m = 0.01", "lead_once_m: must be below 0.00159 with this screw_m"),
        ("encoder_once_m = 2e-3\nscrew_m = 0.01", "encoder_once_m: must be below 0.00159 with this screw_m"),
        ("interpolation_m = 1e-6\ninterpolation_period_m = 4e-6", "interpolation_m: must be below 6.37e-07"),
        ("resonance_Hz = -5.0", "resonance_Hz: must be at least 0"),
        ("cogging_N = 2.0", "cogging_N: needs screw_m"),
        ("interpolation_m = 1e-7", "interpolation_m: needs interpolation_period_m"),
        ("continuous_force_N = 50.0", "continuous_force_N: needs thermal_s"),
        ('encoder_at = "screw"', "encoder_at: must be one of motor, table"),
        ("force_inverted = 1", "force_inverted: must be true or false"),
        ("force_bits = 12.5", "force_bits: must be a whole number"),
    ],
)
def test_a_key_of_a_real_machine_that_cannot_be_is_named(tmp_path: Path, line: str, message: str) -> None:
    with pytest.raises(MachineError, match=f"x.{message}"):
        load_changed(tmp_path, "[x]\n", f"[x]\n{line}\n")


def test_the_drives_own_model_refuses_every_key_that_it_does_not_have(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    text = (machine.MACHINES / "table1_on_chip.toml").read_text()
    assert len(machine.NOT_ON_CHIP) >= 15
    for key in machine.NOT_ON_CHIP:
        value = {"encoder_inverted": "true", "force_inverted": "true", "force_bits": "8"}
        more = "".join(f"{other} = 0.005\n" for needs, other, _ in reader._NEEDS if needs == key)
        file.write_text(text.replace("[x]\n", f"[x]\n{key} = {value.get(key, '1e-6')}\n{more}", 1))
        with pytest.raises(MachineError, match="must be left out with model"):
            machine.load(file)
