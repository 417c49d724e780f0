# SPDX-License-Identifier: Apache-2.0
"""The machine as it was identified: a machine file that run, sim and design take, and parameters of the drive."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from kontur.commissioning.fit import Value
from kontur.commissioning.identify import Identified, screw_parameters
from kontur.machine import Axis, Machine

_NOT_SEEN = ("squareness_rad", "crosstalk_s2", "friction_wave", "encoder_once_m", "interpolation_m")
"""What no sensor sees, and what is not measured yet."""


def axis(known: Axis, found: Identified) -> Axis:
    """`known` with what was found: lengths, limits and motion limits stay."""
    d, f = found.dynamics, found.friction
    values: dict[str, Any] = {
        "mass_kg": d.mass_kg.value,
        "viscous_Nspm": f.viscous_Nspm.value,
        "coulomb_N": f.coulomb_N.value,
        "breakaway": max(1.0, f.breakaway.value),
        "stribeck_mps": max(1e-4, f.stribeck_mps.value),
        "current_lag_s": d.current_lag_s,
        "force_noise_N": 0.0,
        "encoder_at": d.encoder_at,
        "encoder_m": found.encoder_m,
    }
    if d.resonance_Hz.value > 0.0:
        values |= {
            "resonance_Hz": d.resonance_Hz.value,
            "resonance_damping": d.resonance_damping.value,
            "motor_share": min(0.99, max(0.01, d.motor_share.value)),
            "friction_share": 0.5,
        }
    if found.presliding is not None:
        values["presliding_m"] = found.presliding.distance_m.value
    if found.screw is not None:
        values["screw_m"] = found.screw.lead_m
        for key, one in (("cogging_N", found.screw.cogging), ("ripple", found.screw.ripple)):
            if one is not None:
                values[key] = one.peak.value
    if found.transmission is not None:
        values["lead_error"] = found.transmission.lead_error.value
        if found.transmission.lead_once is not None:
            values["lead_once_m"] = found.transmission.lead_once.peak.value
    backlash_m, share = _behind_the_motor(found)
    if backlash_m is not None:
        values["backlash_m"] = backlash_m.value
    if share is not None:
        values["friction_share"] = min(1.0, max(0.0, share.value))
    return dataclasses.replace(known, **values)


def _behind_the_motor(found: Identified) -> tuple[Value | None, Value | None]:
    """Backlash, and the table's share of the friction: a scale shows them better than reversals."""
    best = found.transmission or found.presliding
    return (None, None) if best is None else (best.backlash_m, best.friction_share)


def known(of: Axis) -> Axis:
    """What a user knows of an axis without measuring: lengths, limits, and ratings of its amplifier. All else is as if
    it were not there."""
    names = (
        "force_limit_N", "encoder_m", "travel_m", "soft_limit_m", "velocity_mps", "acceleration_mps2", "jerk_mps3",
        "limit_switch_m", "index_m", "start_m", "scale_m", "continuous_force_N", "thermal_s", "force_bits",
    )  # fmt: skip
    return Axis(mass_kg=1.0, viscous_Nspm=0.0, coulomb_N=0.0, **{name: getattr(of, name) for name in names})


def scales(of: Machine) -> dict[str, float]:
    """Parameters of the drive for the scales that the machine has."""
    return {
        f"second_encoder_{name}.length": getattr(of, name).scale_m * 1e6
        for name in "xy"
        if getattr(of, name).scale_m > 0.0
    }


def machine(of: Machine, found: Mapping[str, Identified]) -> Machine:
    """The identified machine; `of`: what is known of it."""
    axes = {name: axis(known(getattr(of, name)), found[name]) for name in "xy"}
    delay = max(one.dynamics.delay_periods for one in found.values())
    for name, one in found.items():  # both axes have one delay: the lag takes the rest
        lag_s = one.dynamics.current_lag_s + (one.dynamics.delay_periods - delay) * 1e-4
        axes[name] = dataclasses.replace(axes[name], current_lag_s=max(0.0, lag_s))
    return Machine(
        name=f"{of.name}, identified",
        x=axes["x"],
        y=axes["y"],
        delay_periods=delay,
        substeps=20,
        centripetal_step_mps2=of.centripetal_step_mps2,
    )


def text(machine: Machine) -> str:
    """The machine file (docs/machines.md)."""
    lines = [
        "# SPDX-License-Identifier: Apache-2.0",
        "# Made by kontur identify: a model of this table. Lengths, limits and motion limits are as they were given.",
        "",
        f"name = {_toml(machine.name)}",
        f"delay_periods = {machine.delay_periods}",
        f"substeps = {machine.substeps}",
        f"centripetal_step_mps2 = {machine.centripetal_step_mps2!r}",
    ]
    described = machine.described()
    for name in "xy":
        lines += ["", f"[{name}]"]
        lines += [f"{key} = {_toml(value)}" for key, value in described[name].items()]
    return "\n".join(lines) + "\n"


def parameters(found: Mapping[str, Identified]) -> dict[str, float]:
    """Parameters of the drive that a machine file cannot say: phases of what goes by the angle of the screw."""
    values = {key: value for name, one in found.items() for key, value in screw_parameters(name, one.screw).items()}
    for name, one in found.items():
        if one.screw is not None and one.transmission is not None and one.transmission.lead_once is not None:
            once = one.transmission.lead_once
            values[f"screw_{name}.error_cos"] = round(once.cos[0] * 1e6, 3)
            values[f"screw_{name}.error_sin"] = round(once.sin[0] * 1e6, 3)
    return values


def quantities(found: Identified) -> dict[str, Value | None]:
    """What was found of an axis, each with its uncertainty; None: not seen."""
    d, f = found.dynamics, found.friction
    elastic = d.resonance_Hz.value > 0.0
    cogging, ripple = (found.screw.cogging, found.screw.ripple) if found.screw else (None, None)
    shown = found.transmission
    backlash_m, share = _behind_the_motor(found)
    return {
        "mass_kg": d.mass_kg,
        "viscous_Nspm": f.viscous_Nspm,
        "coulomb_N": f.coulomb_N,
        "breakaway": f.breakaway,
        "stribeck_mps": f.stribeck_mps,
        "lag_delay_s": d.lag_delay_s,
        "resonance_Hz": d.resonance_Hz if elastic else None,
        "resonance_damping": d.resonance_damping if elastic else None,
        "motor_share": d.motor_share if elastic else None,
        "presliding_m": found.presliding.distance_m if found.presliding else None,
        "cogging_N": cogging.peak if cogging else None,
        "ripple": ripple.peak if ripple else None,
        "backlash_m": backlash_m,
        "friction_share": share,
        "lead_error": shown.lead_error if shown else None,
        "lead_once_m": shown.lead_once.peak if shown and shown.lead_once else None,
        "encoder_noise_m": found.encoder_noise_m[0],
        "scale_noise_m": found.encoder_noise_m[1],
    }


def as_json(found: Identified) -> dict[str, Any]:
    """All that was found of an axis, each with its uncertainty (half width of a 95 % interval); None: not seen."""
    values = quantities(found)
    shown = found.transmission
    result: dict[str, Any] = {
        name: None if value is None else {"value": value.value, "uncertainty": value.uncertainty}
        for name, value in values.items()
    }
    return result | {
        "encoder_at": found.dynamics.encoder_at,
        "encoder_m": found.encoder_m,
        "screw_m": found.screw.lead_m if found.screw else None,
        "lead_map_m": [list(row) for row in shown.lead_map] if shown else None,
        "breakaway_N": found.breakaway_N,
        "force_noise_N": found.noise_N,
        "misfit": found.dynamics.misfit,
        "drive_s": found.drive_s,
        "steps_s": dict(found.steps_s),
        "not_seen": [name for name, value in values.items() if value is None] + list(_NOT_SEEN),
    }


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, (tuple, list)):
        return "[" + ", ".join(_toml(one) for one in value) + "]"
    return repr(value)
