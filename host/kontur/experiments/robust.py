# SPDX-License-Identifier: Apache-2.0
"""The robustness experiment: random curves, and random machines that the drive does not know.

Each seed draws a machine around the nominal one, a curve, a feed and an acceleration; every controller drives the same
draw. The drive believes the nominal masses and frictions, and has the nominal gains. It knows what any commissioning
knows: the length of an encoder count and the force limit of its amplifier.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from kontur.drive.target import Target
from kontur.errors import DeviceError
from kontur.experiments import COMPARED, REFERENCE
from kontur.experiments.engine import Workers, carry_out
from kontur.machine import LENGTHS, Axis, Machine
from kontur.path import shapes
from kontur.path.geometry import Program
from kontur.planning.bounds import limits
from kontur.planning.planner import Limits, Trajectory, plan
from kontur.runs.runner import RunOptions, run
from kontur.runs.summary import summarise as summarise_run

DURATION_S = 2.0
"""About how long a draw drives; in this time the friction schedule is gone through once."""
_FIGURES = ("mean_um", "rms_um", "max_um", "force_step_N")
UNSTABLE_MAX_UM = 1000.0
UNSTABLE_STEP_SHARE = 0.1
VELOCITY_TRIP_MPS = 0.8


@dataclass(frozen=True)
class Draw:
    """One draw: what moves, along what, how fast. `shape` is for the reader of the result."""

    seed: int
    shape: str
    size_m: float
    feed_mps: float
    acceleration_mps2: float
    machine: Machine
    program: Program


def draw(seed: int, nominal: Machine) -> Draw:
    """What `seed` draws around `nominal`.

    Mass within 30 %, viscous and Coulomb friction within 50 %, each axis by itself; breakaway 1 to 1.5 times Coulomb
    with a Stribeck velocity of 0.3 to 10 mm/s; 1 to 3 times the force noise; one or two periods of delay; a current
    loop of up to 0.5 ms; encoder counts of 10 to 1000 nm. Circle, figure eight, square with round corners or spiral of
    3 to 25 mm at 5 to 250 mm/s and 2 to 35 m/s² (sizes, speeds and lengths evenly on a logarithmic scale).
    """
    rng = np.random.default_rng(seed)

    def log_uniform(low: float, high: float) -> float:
        return float(low * (high / low) ** rng.uniform())

    def within(share: float) -> float:
        return float(rng.uniform(1.0 - share, 1.0 + share))

    encoder_m = round(log_uniform(10e-9, 1000e-9), 14)  # what the parameter can say
    lag_s = float(rng.uniform(0.0, 0.5e-3))

    def axis(a: Axis) -> Axis:
        return replace(
            a,
            mass_kg=a.mass_kg * within(0.3),
            viscous_Nspm=a.viscous_Nspm * within(0.5),
            coulomb_N=a.coulomb_N * within(0.5),
            breakaway=float(rng.uniform(1.0, 1.5)),
            stribeck_mps=log_uniform(0.3e-3, 10e-3),
            force_noise_N=a.force_noise_N * float(rng.uniform(1.0, 3.0)),
            current_lag_s=lag_s,
            encoder_m=encoder_m,
        )

    machine = replace(
        nominal,
        name=f"{nominal.name}, draw {seed}",
        x=axis(nominal.x),
        y=axis(nominal.y),
        delay_periods=int(rng.integers(1, 3)),
    )
    feed_mps = log_uniform(5e-3, 250e-3)
    acceleration_mps2 = log_uniform(2.0, 35.0)
    size_m = log_uniform(3e-3, 25e-3)
    laps = max(1.0, math.ceil(DURATION_S * feed_mps / (2.0 * math.pi * size_m)))
    makers: dict[str, Callable[[], Program]] = {
        "circle": lambda: shapes.circle(size_m, feed_mps, laps=laps),
        "eight": lambda: shapes.eight(2.0 * size_m, feed_mps, laps=laps),
        "square": lambda: shapes.square(2.0 * size_m, size_m * float(rng.uniform(0.1, 0.8)), feed_mps),
        "spiral": lambda: shapes.spiral(0.2 * size_m, size_m, 0.4 * size_m, feed_mps),
    }
    shape = str(rng.choice(list(makers)))
    return Draw(seed, shape, size_m, feed_mps, acceleration_mps2, machine, makers[shape]())


def robust(
    nominal: Machine,
    seeds: Sequence[int],
    num: str = "f32",
    parameters: Mapping[str, float] | None = None,
    controllers: Sequence[str] = COMPARED,
    rows_file: Path | None = None,
    workers: Workers = None,
    progress: Callable[[float], None] = lambda share: None,
) -> list[dict[str, Any]]:
    """One row a seed: the draw, and for each controller mean_um, rms_um, max_um, force_step_N and why it is unstable,
    if it is.

    Unstable: the drive trips, the axes do not go all the way, the true contour error exceeds 1 mm, or the force jumps
    by a tenth of its limit a period.

    `parameters` are set besides the nominal ones. REFERENCE is always among the controllers. `rows_file` and `workers`
    are those of engine.carry_out(), which may raise; the rows do not depend on them.
    """
    names = tuple(dict.fromkeys((REFERENCE, *controllers)))
    jobs = [(seed, nominal, num, dict(parameters or {}), names) for seed in seeds]
    return carry_out(_one, jobs, rows_file=rows_file, workers=workers, progress=progress)


def summarise(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """`unstable`: runs that were, of all controllers. For each controller: its unstable runs; median and worst mean
    contour error of the stable ones, and the worst one's seed; median and least ratio of its mean error to that of ccu
    on the same draw, and the least ratios of rms and max. A ratio below 1: ccu was not the best there.
    """
    controllers = {name: _summarise(rows, name) for name in rows[0]["controllers"]}
    return {
        "unstable": sum(found["unstable"] for found in controllers.values()),
        "seeds": len(rows),
        "controllers": controllers,
    }


def _summarise(rows: Sequence[dict[str, Any]], name: str) -> dict[str, Any]:
    stable = [row for row in rows if row["controllers"][name]["unstable"] is None]
    errors = {row["seed"]: float(row["controllers"][name]["mean_um"]) for row in stable}
    worst_seed = max(errors, key=errors.__getitem__, default=None)
    ratios = {
        measure: [
            row["controllers"][name][f"{measure}_um"] / row["controllers"][REFERENCE][f"{measure}_um"]
            for row in stable
            if row["controllers"][REFERENCE]["unstable"] is None
        ]
        for measure in ("mean", "rms", "max")
    }
    return {
        "unstable": len(rows) - len(stable),
        "median_um": float(np.median(list(errors.values()))) if errors else None,
        "worst_um": errors[worst_seed] if worst_seed is not None else None,
        "worst_seed": worst_seed,
        "over_ccu_median": float(np.median(ratios["mean"])) if ratios["mean"] else None,
        "over_ccu_worst": min(ratios["mean"], default=None),
        "over_ccu_rms_worst": min(ratios["rms"], default=None),
        "over_ccu_max_worst": min(ratios["max"], default=None),
    }


def _one(job: tuple[int, Machine, str, dict[str, float], tuple[str, ...]]) -> dict[str, Any]:
    seed, nominal, num, parameters, controllers = job
    drawn = draw(seed, nominal)
    trajectory = plan(drawn.program, _limits(drawn))
    machine = _with_force_limits(drawn.machine, trajectory)
    believed = nominal.parameters() | {
        f"plant_{name}.{key}": value
        for name, axis in zip("xy", machine.axes, strict=True)
        for key, value in (("encoder", axis.encoder_m * 1e6), ("force_limit", axis.force_limit_N))
    }
    believed |= {"limits.velocity": VELOCITY_TRIP_MPS} | parameters
    target = Target(machine=machine, seed=seed, num=num, told=LENGTHS)
    return {
        "seed": seed,
        "shape": drawn.shape,
        "size_mm": drawn.size_m * 1e3,
        "feed_mmps": drawn.feed_mps * 1e3,
        "acceleration_mps2": drawn.acceleration_mps2,
        "delay_periods": machine.delay_periods,
        "x": asdict(machine.x),
        "y": asdict(machine.y),
        "controllers": {name: _score(trajectory, name, target, believed) for name in controllers},
    }


def _limits(drawn: Draw) -> Limits:
    """Jerk reaches the acceleration in 25 ms; steps of a quarter of it are allowed where the curvature jumps."""
    a = drawn.acceleration_mps2
    return replace(limits(drawn.machine, a, 40.0 * a), centripetal_step_mps2=0.25 * a, force=None)


def _with_force_limits(machine: Machine, trajectory: Trajectory) -> Machine:
    """An amplifier that gives 1.2 times what the motion needs, and no less than what breaks the axis loose."""
    velocity = np.diff(trajectory.position_m, axis=0)[1:] / 1e-3
    acceleration = np.diff(trajectory.position_m, 2, axis=0) / 1e-6
    friction_scale = max((scale for _, scale in machine.friction_schedule), default=1.0)
    axes = []
    for i, axis in enumerate(machine.axes):
        coulomb = axis.coulomb_N * axis.breakaway * friction_scale
        force = axis.mass_kg * acceleration[:, i] + axis.viscous_Nspm * velocity[:, i]
        needed = float(np.max(np.abs(force + coulomb * np.sign(velocity[:, i]))))
        axes.append(replace(axis, force_limit_N=round(1.2 * max(needed, coulomb), 3)))
    shrink = DURATION_S / machine.friction_repeat_s if machine.friction_repeat_s > 0.0 else 1.0
    return replace(
        machine,
        x=axes[0],
        y=axes[1],
        friction_schedule=tuple((time_s * shrink, scale) for time_s, scale in machine.friction_schedule),
        friction_repeat_s=machine.friction_repeat_s * shrink,
    )


def _score(trajectory: Trajectory, controller: str, target: Target, parameters: dict[str, float]) -> dict[str, Any]:
    try:
        log = run(trajectory, controller, target, RunOptions(parameters=parameters)).log
    except DeviceError as error:  # the drive tripped
        return dict.fromkeys(_FIGURES) | {"unstable": str(error)}
    found, step_N = summarise_run(log), float(log.meta["force_step_N"])
    limit_N = min(axis.force_limit_N for axis in target.machine.axes)
    unstable = None
    if found.max_um is None or found.part is not None:
        unstable = f"the axes went only {found.path_percent:.3g} % of the path"
    elif found.max_um > UNSTABLE_MAX_UM:
        unstable = f"contour error of {found.max_um:.0f} µm"
    elif step_N > UNSTABLE_STEP_SHARE * limit_N:
        unstable = f"force jumps by {step_N:.0f} N a period, of {limit_N:.0f} N that there are"
    return {name: getattr(found, name) for name in _FIGURES} | {"unstable": unstable}
