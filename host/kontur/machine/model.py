# SPDX-License-Identifier: Apache-2.0
"""What a machine is, and what its drive is told of it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from kontur.errors import ParameterError

LEAD_POINTS = 64  # of the drive's map of the screw (2109h)
ON_CHIP = "on_chip"
MODELS = ("full", ON_CHIP)
ENCODER_AT = ("motor", "table")
ALL, LENGTHS, NOTHING = "all", "lengths and limits", "nothing"
TOLD = (ALL, LENGTHS, NOTHING)
"""What of a machine file a simulated drive is told: all; what a drive from the factory needs to know where it is, its
encoder lengths and soft limits; nothing."""
FULL, RIGID = "full", "rigid"
COMPENSATIONS = (FULL, RIGID)
"""What "all" is: everything that the drive has a parameter for, or what a rigid axis has."""
_TOLD_TEXTS = {
    (ALL, FULL): "told all of its machine",
    (ALL, RIGID): "told of its machine what a rigid axis has",
    (LENGTHS, FULL): "told only encoder lengths and soft limits of its machine",
    (NOTHING, FULL): "told nothing of its machine",
}


def told_text(told: str, compensation: str = FULL) -> str:
    """What a drive is told, to go on with after "the drive is"; empty where `told` is none of TOLD."""
    return _TOLD_TEXTS.get((told, compensation), _TOLD_TEXTS.get((told, FULL), ""))


@dataclass(frozen=True)
class Axis:
    """One axis; units in the names. `travel_m` and `soft_limit_m` are (least, greatest) positions.

    `limit_switch_m`: distance from an end stop within which its limit switch is active. `index_m`: distance between
    index pulses; 0: none.
    """

    mass_kg: float
    viscous_Nspm: float
    coulomb_N: float
    force_limit_N: float
    encoder_m: float
    travel_m: tuple[float, float]
    soft_limit_m: tuple[float, float]
    velocity_mps: float
    acceleration_mps2: float
    jerk_mps3: float
    breakaway: float = 1.0
    stribeck_mps: float = 0.001
    force_noise_N: float = 0.0
    current_lag_s: float = 0.0
    limit_switch_m: float = 0.002
    index_m: float = 0.01
    start_m: float = 0.0
    # What a real axis has besides. With these defaults it is not there.
    resonance_Hz: float = 0.0
    resonance_damping: float = 0.02
    motor_share: float = 0.5
    encoder_at: str = "motor"
    encoder_inverted: bool = False
    force_inverted: bool = False
    scale_m: float = 0.0
    backlash_m: float = 0.0
    presliding_m: float = 0.0
    friction_share: float = 0.0
    friction_wave: float = 0.0
    screw_m: float = 0.0
    cogging_N: float = 0.0
    ripple: float = 0.0
    encoder_once_m: float = 0.0
    interpolation_m: float = 0.0
    interpolation_period_m: float = 0.0
    force_bits: int = 0
    continuous_force_N: float = 0.0
    thermal_s: float = 0.0
    lead_error: float = 0.0
    lead_once_m: float = 0.0
    squareness_rad: float = 0.0
    crosstalk_s2: float = 0.0
    cutting_force_N: float = 0.0
    cutting_Hz: float = 0.0


@dataclass(frozen=True)
class Machine:
    """Both axes and what they share. `friction_schedule` rows are (time_s, scale), see sim/kontur_sim.h."""

    name: str
    x: Axis
    y: Axis
    delay_periods: int
    substeps: int
    centripetal_step_mps2: float
    friction_schedule: tuple[tuple[float, float], ...] = ()
    friction_repeat_s: float = 0.0
    model: str = "full"
    """"full": the simulator's, in double precision; "on_chip": the one that the drive itself has (object 2103h)."""
    gains: Mapping[str, float] = field(default_factory=dict, hash=False)
    """Parameters of the drive, of the objects GAINS, that fit this machine; the others stay as they are."""

    @property
    def axes(self) -> tuple[Axis, Axis]:
        return (self.x, self.y)

    @property
    def soft_limits_m(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """The allowed positions of a path: ((x least, x greatest), (y least, y greatest))."""
        return (self.x.soft_limit_m, self.y.soft_limit_m)

    def starting_at(self, start_m: tuple[float, float]) -> Machine:
        """The same machine with its axes standing at `start_m` at power-on."""
        return dataclasses.replace(
            self,
            x=dataclasses.replace(self.x, start_m=start_m[0]),
            y=dataclasses.replace(self.y, start_m=start_m[1]),
        )

    def described(self) -> dict[str, Any]:
        """All values as plain types; of the keys of a real machine those that are there."""
        table = dataclasses.asdict(self)
        for axis in ("x", "y"):
            table[axis] = {k: v for k, v in table[axis].items() if k not in REAL or v != getattr(Axis, k)}
        return table

    def simulated(self) -> dict[str, list[float]]:
        """The fields of struct ks_machine (sim/kontur_sim.h) and their values, in SI units, for the simulator."""
        per_axis = (
            "mass_kg",
            "viscous_Nspm",
            "coulomb_N",
            "breakaway",
            "stribeck_mps",
            "force_limit_N",
            "force_noise_N",
            "current_lag_s",
            "encoder_m",
            "index_m",
            "start_m",
            *(name for name in REAL if name != "encoder_at"),
        )
        return {field: [getattr(axis, field) for axis in self.axes] for field in per_axis} | {
            "encoder_at_table": [int(axis.encoder_at == "table") for axis in self.axes],
            "switch_m": [axis.limit_switch_m for axis in self.axes],
            "travel_min_m": [axis.travel_m[0] for axis in self.axes],
            "travel_max_m": [axis.travel_m[1] for axis in self.axes],
            "delay_periods": [self.delay_periods],
            "substeps": [self.substeps],
            "schedule_count": [len(self.friction_schedule)],
            "schedule_time_s": [time_s for time_s, _ in self.friction_schedule],
            "schedule_scale": [scale for _, scale in self.friction_schedule],
            "schedule_repeat_s": [self.friction_repeat_s],
        }

    def parameters(self, seed: int = 1, told: str = ALL, compensation: str = FULL) -> dict[str, float]:
        """The drive's parameters that describe this machine, by their names and in their units (docs/objects.md).

        `told` is one of TOLD, `compensation` of COMPENSATIONS. With the model "on_chip" the drive simulates the
        machine, whatever it is told, from `start_m` and `seed` on. Raises ParameterError: another word.
        """
        for name, word, known in (("told", told, TOLD), ("compensation", compensation, COMPENSATIONS)):
            if word not in known:
                raise ParameterError(f"{name}: must be one of {', '.join(known)}, is {word!r}")
        level = {ALL: (LENGTHS, RIGID, compensation), LENGTHS: (LENGTHS,), NOTHING: ()}[told]
        values = {
            parameter.format(name): value
            for name, axis in (("x", self.x), ("y", self.y))
            for parameter, of, value_of in _PARAMETERS
            if of in level and (value := value_of(axis)) is not None
        }
        if told == ALL:
            values |= self.gains
        if self.model == ON_CHIP:
            for name, axis in (("x", self.x), ("y", self.y)):
                values |= self._on_chip(name, axis)
            values |= {
                "onchip_plant.seed": seed,
                "onchip_plant.simulated": 1,
            }  # last, since the simulation starts with the values set before
        return values

    def _on_chip(self, name: str, axis: Axis) -> dict[str, float]:
        """An axis of the machine that the drive simulates (objects 2103h, 210Eh)."""
        besides = {
            "encoder": axis.encoder_m * 1e6,
            "travel_min": axis.travel_m[0],
            "travel_max": axis.travel_m[1],
            "limit_switch": axis.limit_switch_m,
            "index": axis.index_m,
            "breakaway": axis.breakaway,
            "stribeck": axis.stribeck_mps,
            "presliding": axis.presliding_m * 1e6,
            "lag": axis.current_lag_s,
            "delay": self.delay_periods,
            "resonance": axis.resonance_Hz,
            "damping": axis.resonance_damping,
            "motor_share": axis.motor_share,
            "friction_share": axis.friction_share,
            "encoder_at_table": int(axis.encoder_at == "table"),
            "backlash": axis.backlash_m * 1e6,
        }
        return {
            f"onchip_plant.mass_{name}": axis.mass_kg,
            f"onchip_plant.viscous_{name}": axis.viscous_Nspm,
            f"onchip_plant.coulomb_{name}": axis.coulomb_N,
            f"onchip_plant.noise_{name}": axis.force_noise_N,
            f"onchip_plant.start_{name}": round(axis.start_m * 1e9) * 1e-9,
        } | {f"onchip_axis_{name}.{key}": value for key, value in besides.items()}


REAL = tuple(f.name for f in dataclasses.fields(Axis))[
    [f.name for f in dataclasses.fields(Axis)].index("resonance_Hz") :
]
"""Keys of an axis that are of a real machine."""
_ON_CHIP_HAS = ("resonance_Hz", "resonance_damping", "motor_share", "encoder_at", "backlash_m", "presliding_m")
NOT_ON_CHIP = tuple(key for key in REAL if key not in (*_ON_CHIP_HAS, "friction_share"))
"""Those that the drive's own model does not have."""


def _sensed(axis: Axis) -> bool:
    """Whether a sensor at the table sees what lies between motor and table."""
    return axis.encoder_at == "table" or axis.scale_m > 0.0


def _of_spring(axis: Axis, value: float) -> float | None:
    """Of an encoder at the motor. Beside a scale it is told, too, since the drive takes the speed from that encoder."""
    return value if axis.resonance_Hz > 0.0 and axis.encoder_at == "motor" else None


def _stiffness_Npum(axis: Axis) -> float:
    """Two free masses m_1, m_2 with a spring k: (2 pi f)^2 = k (1/m_1 + 1/m_2)."""
    reduced_kg = axis.mass_kg * axis.motor_share * (1.0 - axis.motor_share)
    return reduced_kg * (2.0 * math.pi * axis.resonance_Hz) ** 2 * 1e-6


# Share of the amplitude and phase of each harmonic of cogging and ripple, as sim/plant.c has them: order 1, 2, 6.
_HARMONICS = ((0.5, 0.0), (0.3, 2.0), (0.2, 1.0))
_COGGING_PHASE, _RIPPLE_PHASE = 0.0, 0.5  # of the first harmonic besides


def _harmonic(n: int, amplitude: float, first_phase: float, wave: Callable[[float], float]) -> float | None:
    """The sine with amplitude and phase of harmonic `n` as its part of a cosine (wave: sin) or of a sine (cos)."""
    share, phase = _HARMONICS[n]
    return amplitude * share * wave(phase + (first_phase if n == 0 else 0.0)) if amplitude > 0.0 else None


def _lead_map_nm(axis: Axis) -> tuple[int, int, list[int]]:
    """Start, step and errors of the map from the encoder's position to the table's; no errors where there is none."""
    if _sensed(axis) or axis.lead_error == 0.0:
        return 0, 0, []
    low_m, high_m = axis.soft_limit_m
    points = 1 + max(1, math.ceil(high_m - low_m))
    start_nm, step_nm = round(low_m * 1e9), math.ceil((high_m - low_m) * 1e9 / (points - 1))
    return start_nm, step_nm, [round(axis.lead_error * (start_nm + i * step_nm)) for i in range(points)]


def _once_um(axis: Axis) -> float:
    """What the table is ahead of the first encoder once a turn, a sine of the angle as in sim/plant.c.

    A second encoder sees it below the crossover; above it the position is that of the first one.
    """
    ahead_m = axis.lead_once_m if axis.encoder_at == "motor" else 0.0
    return (ahead_m - axis.encoder_once_m) * 1e6


def _screw_um(axis: Axis) -> float | None:
    """The lead, where something goes by it that the drive is told."""
    return axis.screw_m * 1e6 if axis.cogging_N > 0.0 or axis.ripple > 0.0 or _once_um(axis) != 0.0 else None


def _lead_map(i: int, axis: Axis) -> int | None:
    """Number of points, start or step of the map."""
    start_nm, step_nm, errors_nm = _lead_map_nm(axis)
    return (len(errors_nm), start_nm, step_nm)[i] if errors_nm else None


def _lead_error_nm(i: int, axis: Axis) -> int | None:
    errors_nm = _lead_map_nm(axis)[2]
    return errors_nm[i] if i < len(errors_nm) else None


_FORCE_DELAY_S = 0.01  # as much as the drive can be told

# What the drive is told of an axis: the parameter, from which level on, and its value; None: it stays as it is. What
# lies between motor and table is told where the position comes from the motor alone. Directions are not told, so that a
# wrong one can be rehearsed.
_PARAMETERS: tuple[tuple[str, str, Callable[[Axis], float | None]], ...] = (
    ("plant_{}.mass", RIGID, lambda axis: axis.mass_kg),
    ("plant_{}.viscous", RIGID, lambda axis: axis.viscous_Nspm),
    ("plant_{}.coulomb", RIGID, lambda axis: axis.coulomb_N),
    ("plant_{}.force_limit", RIGID, lambda axis: axis.force_limit_N),
    ("plant_{}.encoder", LENGTHS, lambda axis: axis.encoder_m * 1e6),
    ("position_limit_{}.min", LENGTHS, lambda axis: axis.soft_limit_m[0] * 1e9),
    ("position_limit_{}.max", LENGTHS, lambda axis: axis.soft_limit_m[1] * 1e9),
    ("plant_{}.force_delay", FULL, lambda axis: min(axis.current_lag_s, _FORCE_DELAY_S) or None),
    ("friction_{}.presliding", FULL, lambda axis: axis.presliding_m * 1e6 or None),
    ("friction_{}.breakaway", FULL, lambda axis: axis.breakaway if axis.breakaway > 1.0 else None),
    ("friction_{}.stribeck", FULL, lambda axis: axis.stribeck_mps if axis.breakaway > 1.0 else None),
    ("screw_{}.lead", FULL, _screw_um),
    *(
        (
            f"screw_{{}}.cogging_{name}_{n + 1}",
            FULL,
            lambda axis, n=n, wave=wave: _harmonic(n, axis.cogging_N, _COGGING_PHASE, wave),
        )
        for n in range(len(_HARMONICS))
        for name, wave in (("cos", math.sin), ("sin", math.cos))
    ),
    *(
        (
            f"screw_{{}}.ripple_{name}_{n + 1}",
            FULL,
            lambda axis, n=n, wave=wave: _harmonic(n, axis.ripple, _RIPPLE_PHASE, wave),
        )
        for n in range(len(_HARMONICS))
        for name, wave in (("cos", math.sin), ("sin", math.cos))
    ),
    ("screw_{}.error_sin", FULL, lambda axis: _once_um(axis) or None),
    ("transmission_{}.stiffness", FULL, lambda axis: _of_spring(axis, _stiffness_Npum(axis))),
    ("transmission_{}.table_mass", FULL, lambda axis: _of_spring(axis, axis.mass_kg * (1.0 - axis.motor_share))),
    ("transmission_{}.table_friction", FULL, lambda axis: _of_spring(axis, axis.friction_share)),
    ("transmission_{}.backlash", FULL, lambda axis: None if _sensed(axis) else axis.backlash_m * 1e6 or None),
    *((f"lead_map_{{}}.{name}", FULL, partial(_lead_map, i)) for i, name in enumerate(("points", "start", "step"))),
    *((f"lead_error_{{}}.entry_{i + 1}", FULL, partial(_lead_error_nm, i)) for i in range(LEAD_POINTS)),
    ("second_encoder_{}.length", FULL, lambda axis: axis.scale_m * 1e6 or None),
    ("geometry.squareness_{}", FULL, lambda axis: axis.squareness_rad or None),
    ("force_continuous_{}.force", FULL, lambda axis: axis.continuous_force_N or None),
    ("force_continuous_{}.time", FULL, lambda axis: axis.thermal_s if axis.continuous_force_N > 0.0 else None),
)
