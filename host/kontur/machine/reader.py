# SPDX-License-Identifier: Apache-2.0
"""Reading the file of a machine; what cannot be is refused."""

from __future__ import annotations

import dataclasses
import math
import reprlib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from kontur.errors import FileError, MachineError
from kontur.files import read_toml
from kontur.machine.model import ENCODER_AT, MODELS, NOT_ON_CHIP, ON_CHIP, Axis, Machine

MACHINES = Path(__file__).parent.with_name("machines")
DEFAULT = MACHINES / "table1.toml"
SCHEDULE_ROWS_MAX = 16
COUNTS_MAX = 2**31 - 1  # of an encoder's counter

# Accepted range of every number of an axis: (least, greatest, whether the least itself is accepted).
_RANGE = {
    "mass_kg": (0.1, 1e5, True),
    "viscous_Nspm": (0.0, 1e6, True),
    "coulomb_N": (0.0, 3000.0, True),
    "force_limit_N": (1.0, 3000.0, True),
    "encoder_m": (1e-12, 1e-5, True),
    "velocity_mps": (0.0, 10.0, False),
    "acceleration_mps2": (0.0, 1e3, False),
    "jerk_mps3": (0.0, 1e6, False),
    "breakaway": (1.0, 10.0, True),
    "stribeck_mps": (0.0, 1.0, False),
    "force_noise_N": (0.0, 1e4, True),
    "current_lag_s": (0.0, 1.0, True),
    "limit_switch_m": (0.0, 1.0, True),
    "index_m": (0.0, 1.0, True),
    "start_m": (-2.0, 2.0, True),
    "resonance_Hz": (0.0, 2000.0, True),
    "resonance_damping": (0.0, 1.0, True),
    "motor_share": (0.01, 0.99, True),  # a lighter mass would be unstable at the simulator's step
    "scale_m": (0.0, 1e-5, True),
    "backlash_m": (0.0, 0.01, True),
    "presliding_m": (0.0, 0.01, True),
    "friction_share": (0.0, 1.0, True),
    "friction_wave": (0.0, 1.0, True),
    "screw_m": (0.0, 1.0, True),
    "cogging_N": (0.0, 3000.0, True),
    "ripple": (0.0, 1.0, True),
    "encoder_once_m": (0.0, 0.01, True),
    "interpolation_m": (0.0, 0.01, True),
    "interpolation_period_m": (0.0, 0.01, True),
    "continuous_force_N": (0.0, 3000.0, True),
    "thermal_s": (0.0, 1e5, True),
    "lead_error": (-0.1, 0.1, True),
    "lead_once_m": (0.0, 0.01, True),
    "squareness_rad": (-0.1, 0.1, True),
    "crosstalk_s2": (-1e-3, 1e-3, True),
    "cutting_force_N": (0.0, 3000.0, True),
    "cutting_Hz": (0.0, 5000.0, True),
}
GAINS = (
    "smc",
    "compensator",
    "observer",
    "cascade",
    "feedforward",
    *(f"{name}_{axis}" for name in ("force_filter", "second_encoder") for axis in "xy"),
)
"""Objects of the drive whose parameters a machine file may have in `[gains.OBJECT]`."""
_OF_PARAMETERS = {"plant_x", "plant_y", "limits", "smc", "controller"}  # objects that `kontur param dump` writes
_FLAGS = ("encoder_inverted", "force_inverted")
# What a key needs to be there, too: (key, other, what it is).
_NEEDS = (
    ("cogging_N", "screw_m", "the lead of the screw"),
    ("ripple", "screw_m", "the lead of the screw"),
    ("encoder_once_m", "screw_m", "the lead of the screw"),
    ("lead_once_m", "screw_m", "the lead of the screw"),
    ("interpolation_m", "interpolation_period_m", "the signal period"),
    ("continuous_force_N", "thermal_s", "its time constant"),
)
_PAIRS = ("travel_m", "soft_limit_m")


def load(file: str | Path = DEFAULT, changes: Mapping[str, Mapping[str, float]] | None = None) -> Machine:
    """Read a machine file. `changes`: values of the axes "x" and "y" that are other ones than in the file, by key.

    Raises MachineError, which names file, key and what is wrong with it.
    """
    try:
        table = read_toml(Path(file))
    except FileError as error:
        raise MachineError(f"{error}; the machines of the package are in {MACHINES}") from error
    if _OF_PARAMETERS & table.keys() and "name" not in table:
        raise MachineError(
            f"{file}: is a file of parameters, not of a machine. `kontur param load {file}` gives them to a drive on a "
            f"bus, and --set NAME=VALUE to a simulated one. A machine file is a copy of {DEFAULT}, without its "
            "[gains]"
        )
    for name, values in (changes or {}).items():
        if isinstance(table.get(name), dict):
            table[name] |= values
    return _Reader(str(file)).machine(table)


class _Reader:
    """Turns parsed TOML into a Machine; every problem is raised with the file's name and the key."""

    def __init__(self, file: str) -> None:
        self.file = file

    def problem(self, key: str, what: str) -> MachineError:
        return MachineError(f"{self.file}: {key}: {what}")

    def machine(self, table: dict[str, Any]) -> Machine:
        self.keys(
            "",
            table,
            {"name", "x", "y", "delay_periods", "substeps", "centripetal_step_mps2"},
            {"friction_schedule", "model", "gains"},
        )
        if not isinstance(table["name"], str):
            raise self.problem("name", "must be text")
        rows, repeat_s = self.schedule(table.get("friction_schedule", {"rows": []}))
        machine = Machine(
            name=table["name"],
            x=self.axis("x", table["x"]),
            y=self.axis("y", table["y"]),
            delay_periods=self.integer("delay_periods", table["delay_periods"], 1, 4),
            substeps=self.integer("substeps", table["substeps"], 10, 1000),
            centripetal_step_mps2=self.number("centripetal_step_mps2", table["centripetal_step_mps2"], 0.0, 1e3, False),
            friction_schedule=rows,
            friction_repeat_s=repeat_s,
            model=self.choice("model", table.get("model", "full"), MODELS),
            gains=self.gains(table.get("gains", {})),
        )
        if machine.model == ON_CHIP:
            self.check_on_chip(machine)
        return machine

    def choice(self, where: str, value: Any, known: tuple[str, ...]) -> str:
        if value not in known:
            raise self.problem(where, f"must be one of {', '.join(known)}, is {value!r}")
        return str(value)

    def flag(self, where: str, value: Any) -> bool:
        if not isinstance(value, bool):
            raise self.problem(where, f"must be true or false, is {value!r}")
        return value

    def check_on_chip(self, machine: Machine) -> None:
        """Refuse what the drive's own model does not have."""
        for name, axis in (("x", machine.x), ("y", machine.y)):
            for key in NOT_ON_CHIP:
                if getattr(axis, key) != getattr(Axis, key):
                    raise self.problem(f"{name}.{key}", f"must be left out with model {ON_CHIP!r}")
            if axis.backlash_m > 0.0 and axis.resonance_Hz == 0.0:
                raise self.problem(f"{name}.backlash_m", f"needs resonance_Hz with model {ON_CHIP!r}")
        if machine.friction_schedule:
            raise self.problem("friction_schedule", f"must be left out with model {ON_CHIP!r}")

    def axis(self, name: str, table: Any) -> Axis:
        fields = dataclasses.fields(Axis)
        required = {f.name for f in fields if f.default is dataclasses.MISSING}
        self.keys(name, table, required, {f.name for f in fields} - required)
        values: dict[str, Any] = {}
        for key, value in table.items():
            where = f"{name}.{key}"
            if key in _PAIRS:
                values[key] = self.pair(where, value)
            elif key in _FLAGS:
                values[key] = self.flag(where, value)
            elif key == "encoder_at":
                values[key] = self.choice(where, value, ENCODER_AT)
            elif key == "force_bits":
                values[key] = self.integer(where, value, 0, 32)
            else:
                values[key] = self.number(where, value, *_RANGE[key])
        axis = Axis(**values)
        if axis.soft_limit_m[0] < axis.travel_m[0] or axis.soft_limit_m[1] > axis.travel_m[1]:
            raise self.problem(f"{name}.soft_limit_m", f"must lie within travel_m {list(axis.travel_m)}")
        if not axis.soft_limit_m[0] <= axis.start_m <= axis.soft_limit_m[1]:
            raise self.problem(f"{name}.start_m", f"must lie within soft_limit_m {list(axis.soft_limit_m)}")
        for key, other, what in _NEEDS:
            if getattr(axis, key) != 0.0 and getattr(axis, other) == 0.0:
                raise self.problem(f"{name}.{key}", f"needs {other}, {what}")
        self.check_counts(name, axis)
        self.check_slopes(name, axis)
        return axis

    def check_counts(self, name: str, axis: Axis) -> None:
        """Refuse counters that overflow within the travel, and limit switches that overlap."""
        farthest_m = max(map(abs, axis.travel_m))
        for key in ("encoder_m", "scale_m"):
            count_m = getattr(axis, key)
            if count_m > 0.0 and farthest_m / count_m >= COUNTS_MAX:
                raise self.problem(
                    f"{name}.{key}", f"must be above {farthest_m / COUNTS_MAX:.3g}: the counter is full before travel_m"
                )
        half_m = 0.5 * (axis.travel_m[1] - axis.travel_m[0])
        if axis.limit_switch_m >= half_m:
            raise self.problem(f"{name}.limit_switch_m", f"must be below half of travel_m, {half_m:g}")

    def check_slopes(self, name: str, axis: Axis) -> None:
        """Refuse errors so steep that the table or the count would go back while the axis goes on."""
        for key, period, what in (
            ("lead_once_m", "screw_m", "the table"),
            ("encoder_once_m", "screw_m", "the encoder"),
            ("interpolation_m", "interpolation_period_m", "the encoder"),
        ):
            slope = 1.0 + (axis.lead_error if key == "lead_once_m" else 0.0)
            below_m = slope * getattr(axis, period) / (2.0 * math.pi)
            if getattr(axis, key) >= below_m > 0.0:
                raise self.problem(
                    f"{name}.{key}", f"must be below {below_m:.3g} with this {period}: {what} turns back"
                )

    def schedule(self, table: Any) -> tuple[tuple[tuple[float, float], ...], float]:
        name = "friction_schedule"
        self.keys(name, table, {"rows"}, {"repeat_s"})
        repeat_s = self.number(f"{name}.repeat_s", table.get("repeat_s", 0.0), 0.0, 1e6, True)
        rows = table["rows"]
        if not isinstance(rows, list) or len(rows) > SCHEDULE_ROWS_MAX:
            raise self.problem(f"{name}.rows", f"must be a list of at most {SCHEDULE_ROWS_MAX} [time_s, scale]")
        result: list[tuple[float, float]] = []
        for i, row in enumerate(rows):
            where = f"{name}.rows[{i}]"
            if not isinstance(row, list) or len(row) != 2:
                raise self.problem(where, "must be [time_s, scale]")
            time_s = self.number(where, row[0], 0.0, 1e6, True)
            scale = self.number(where, row[1], 0.0, 100.0, True)
            if result and time_s <= result[-1][0]:
                raise self.problem(where, "times must increase from row to row")
            result.append((time_s, scale))
        if result and repeat_s and repeat_s <= result[-1][0]:
            raise self.problem(f"{name}.repeat_s", "must be 0 or later than the last row")
        return tuple(result), repeat_s

    def gains(self, table: Any) -> dict[str, float]:
        """Parameters by name. Whether the drive has them, and takes the values, it says itself when it is told."""
        self.keys("gains", table, set(), set(GAINS))
        values: dict[str, float] = {}
        for name, entries in table.items():
            if not isinstance(entries, dict):
                raise self.problem(f"gains.{name}", f"must be a table [gains.{name}]")
            for key, value in entries.items():
                self.number(f"gains.{name}.{key}", value, -sys.float_info.max, sys.float_info.max, True)
                values[f"{name}.{key}"] = value
        return values

    def keys(self, name: str, table: Any, required: set[str], optional: set[str]) -> None:
        if not isinstance(table, dict):
            raise self.problem(name, f"must be a table [{name}]")
        prefix = f"{name}." if name else ""
        for key in table:
            if key not in required | optional:
                raise self.problem(prefix + key, f"unknown key; known are {', '.join(sorted(required | optional))}")
        for key in sorted(required):
            if key not in table:
                raise self.problem(prefix + key, "is missing")

    def number(self, where: str, value: Any, least: float, greatest: float, with_least: bool) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= sys.float_info.max:
            raise self.problem(where, f"must be a number, is {reprlib.repr(value)}")
        if not least <= value <= greatest or (value == least and not with_least):
            bound = f"at least {least:g}" if with_least else f"greater than {least:g}"
            raise self.problem(where, f"must be {bound} and at most {greatest:g}, is {value:g}")
        return float(value)

    def integer(self, where: str, value: Any, least: int, greatest: int) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= greatest:
            raise self.problem(where, f"must be a whole number {least}..{greatest}, is {value!r}")
        return value

    def pair(self, where: str, value: Any) -> tuple[float, float]:
        if not isinstance(value, list) or len(value) != 2:
            raise self.problem(where, f"must be [least, greatest], is {value!r}")
        low, high = (self.number(where, v, -2.0, 2.0, True) for v in value)
        if low >= high:
            raise self.problem(where, f"the least must be below the greatest, is {value!r}")
        return low, high
