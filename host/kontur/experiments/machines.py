# SPDX-License-Identifier: Apache-2.0
"""The experiment on real machines: the four of the package, and machines drawn from the ranges of practice.

`kontur design`, told the truth, gives each machine its gains: `ccu` and `cascade` with all compensations (`full`), and
`cascade` with feedforward of a rigid machine only (`rigid`), which is what a careful user of an ordinary drive has. All
drive the same paths, and the true error of the tool is scored. With factory gains every controller drives them, too,
told all of the machine but gains.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from kontur.design.search import design
from kontur.drive.controllers import CONTROLLERS
from kontur.drive.target import Target
from kontur.errors import DeviceError, MachineError
from kontur.experiments import REFERENCE
from kontur.experiments.demo import part
from kontur.experiments.engine import Workers, carry_out
from kontur.machine import MACHINES, NOTHING, Axis, Machine, load
from kontur.path import programs, shapes
from kontur.path.geometry import Program
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.runs import summary
from kontur.runs.runner import RunOptions, run

PACKAGED = ("stiff_scale", "ball_screw", "lead_screw", "long_axis")
DESIGNS = ((REFERENCE, "full"), ("cascade", "full"), ("cascade", "rigid"))
"""Controller and compensation of each design that is compared."""
_ACCELERATION_MPS2, _JERK_MPS3, _VELOCITY_MPS = 5.0, 100.0, 0.3
_HALF_TRAVEL_M = 0.2
_UNSTABLE_UM = 1000.0
_WHOLE_PERCENT = 99.0


@dataclass(frozen=True)
class Case:
    """A path; the time until `score_from_s`, in which a circle speeds up, is not scored."""

    program: Program
    score_from_s: float = 0.0


def cases() -> dict[str, Case]:
    """The four paths, by name."""
    return {
        "r4@100": Case(shapes.circle(0.004, 0.1, duration_s=2.0), 0.3),
        "r20@100": Case(shapes.circle(0.020, 0.1, duration_s=3.0), 0.3),
        "r4@4.5": Case(shapes.circle(0.004, 0.0045, laps=1), 0.3),
        "part": Case(programs.load(part())),
    }


def draw(seed: int) -> Machine:
    """The machine that `seed` draws, each axis by itself but for what both share.

    Evenly on a logarithmic scale: mass 20 to 200 kg, first mode 30 to 300 Hz, presliding 5 to 50 µm, Stribeck velocity
    1 to 10 mm/s, encoder counts 10 nm to 1 µm. Evenly: damping 0.01 to 0.05, motor share 0.25 to 0.75, lag of the force
    up to 1 ms, 1 or 2 periods of delay, breakaway 1 to 1.5 times Coulomb, viscous friction 2 to 8 N s/m and Coulomb
    friction 0.2 to 0.7 N for each kg, share of the friction at the table 0.3 to 0.7, backlash up to 20 µm, cogging up
    to 10 N, ripple up to 3 %, lead error up to 300 µm/m and 10 µm a turn, squareness up to 0.3 mrad. Encoders are at
    the motors; two of five machines have scales of 10 nm to 0.1 µm at the table, too. The amplifier gives half more
    than the planned motion needs at most.
    """
    rng = np.random.default_rng(seed)

    def log_uniform(low: float, high: float) -> float:
        return float(low * (high / low) ** rng.uniform())

    def uniform(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    lag_s, scaled = uniform(0.0, 1e-3), rng.uniform() < 0.4
    encoder_m, scale_m = (round(log_uniform(10e-9, high), 14) for high in (1e-6, 1e-7))

    def axis() -> Axis:
        mass_kg = log_uniform(20.0, 200.0)
        viscous_Nspm, coulomb_N = mass_kg * uniform(2.0, 8.0), mass_kg * uniform(0.2, 0.7)
        breakaway = uniform(1.0, 1.5)
        force_N = mass_kg * _ACCELERATION_MPS2 + viscous_Nspm * _VELOCITY_MPS + coulomb_N * breakaway
        return Axis(
            mass_kg=mass_kg,
            viscous_Nspm=viscous_Nspm,
            coulomb_N=coulomb_N,
            force_limit_N=round(1.5 * force_N, 3),
            encoder_m=encoder_m,
            travel_m=(-_HALF_TRAVEL_M, _HALF_TRAVEL_M),
            soft_limit_m=(-0.95 * _HALF_TRAVEL_M, 0.95 * _HALF_TRAVEL_M),
            velocity_mps=_VELOCITY_MPS,
            acceleration_mps2=_ACCELERATION_MPS2,
            jerk_mps3=_JERK_MPS3,
            breakaway=breakaway,
            stribeck_mps=log_uniform(1e-3, 10e-3),
            force_noise_N=0.5,
            current_lag_s=lag_s,
            resonance_Hz=log_uniform(30.0, 300.0),
            resonance_damping=uniform(0.01, 0.05),
            motor_share=uniform(0.25, 0.75),
            scale_m=scale_m if scaled else 0.0,
            backlash_m=uniform(0.0, 20e-6),
            presliding_m=log_uniform(5e-6, 50e-6),
            friction_share=uniform(0.3, 0.7),
            screw_m=float(rng.choice([0.005, 0.01, 0.02])),
            cogging_N=uniform(0.0, 10.0),
            ripple=uniform(0.0, 0.03),
            lead_error=uniform(-300e-6, 300e-6),
            lead_once_m=uniform(0.0, 10e-6),
            squareness_rad=uniform(-0.3e-3, 0.3e-3),
        )

    return Machine(
        name=f"draw {seed}",
        x=axis(),
        y=replace(axis(), squareness_rad=0.0),
        delay_periods=int(rng.integers(1, 3)),
        substeps=20,
        centripetal_step_mps2=1.0,
    )


def packaged() -> list[Machine]:
    """The real machines of the package."""
    return [load(MACHINES / f"{name}.toml") for name in PACKAGED]


def compare(
    work: Sequence[Machine],
    factory: bool = False,
    num: str = "f32",
    rows_file: Path | None = None,
    workers: Workers = None,
    progress: Callable[[float], None] = lambda share: None,
) -> list[dict[str, Any]]:
    """One row a machine: what it is, the designs with their Ms, and what each did on each case.

    `factory`: every controller with factory gains, in place of the designs. `rows_file` and `workers` are those of
    engine.carry_out(), which may raise; the rows do not depend on them.
    """
    kinds = [(name, None) for name in CONTROLLERS] if factory else DESIGNS
    jobs = [(machine, name, compensation, num) for machine in work for name, compensation in kinds]
    files = [os.path.abspath(part())]
    done = carry_out(_driven, jobs, files, rows_file, workers, progress)
    found = []
    for i, machine in enumerate(work):
        ran = {one["name"]: one for one in done[i * len(kinds) : (i + 1) * len(kinds)]}
        row: dict[str, Any] = {"name": machine.name, "x": asdict(machine.x), "y": asdict(machine.y)}
        if not factory:
            row["designs"] = {name: one["design"] for name, one in ran.items()}
        row["runs"] = {case: {name: one["runs"][case] for name, one in ran.items()} for case in done[0]["runs"]}
        found.append(row)
    return found


def summarise(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Counts over all runs, and of each machine and case the ratios of mean errors: `ratio_rigid` of cascade with rigid
    feedforward, `ratio_law` of cascade with all compensations, to ccu with all. Above 1: ccu is better."""
    runs = [one for row in rows for made in row["runs"].values() for one in made.values()]
    found: dict[str, Any] = {"machines": list(rows)}
    for what in ("unstable", "oscillating", "tripped", "no design"):
        found[what.replace(" ", "_")] = sum(one["ended"] == what for one in runs)
    for name, other in (("ratio_rigid", "cascade rigid"), ("ratio_law", "cascade full")):
        ratios = [
            made[other]["mean_um"] / made[f"{REFERENCE} full"]["mean_um"]
            for row in rows
            for made in row["runs"].values()
            if other in made and made[other]["mean_um"] and made[f"{REFERENCE} full"]["mean_um"]
        ]
        found[f"{name}_median"] = float(np.median(ratios)) if ratios else None
        found[f"{name}_worst"] = min(ratios, default=None)
    return found


def _driven(job: tuple[Machine, str, str | None, str]) -> dict[str, Any]:
    """What a controller did on each case: with the design for this compensation, or with factory gains (None)."""
    machine, controller, compensation, num = job
    if compensation is None:
        name, about, values = controller, None, replace(machine, gains={}).parameters()
    else:
        name = f"{controller} {compensation}"
        try:
            found = design(machine, controller, compensation)
        except MachineError as error:
            none = {"mean_um": None, "max_um": None, "ended": "no design", "why": str(error)}
            return {"name": name, "design": None, "runs": dict.fromkeys(cases(), none)}
        values = found.parameters
        about = {"ms": max(axis.margins.ms for axis in found.axes), "gains": found.gains}
    runs = {case: _drive(machine, path, controller, values, num) for case, path in cases().items()}
    return {"name": name, "design": about, "runs": runs}


def _drive(machine: Machine, case: Case, controller: str, values: dict[str, float], num: str) -> dict[str, Any]:
    """What a run did. `ended`: "" when all is well, else "tripped", "oscillating" or "unstable"; `why` in words."""
    trajectory = plan(case.program, limits(machine))
    target = Target(machine=machine, seed=1, num=num, told=NOTHING)
    try:
        log = run(trajectory, controller, target, RunOptions(parameters=values, score_from_s=case.score_from_s)).log
    except DeviceError as error:  # a fault
        oscillating = "oscillat" in str(error).lower()
        return {
            "mean_um": None,
            "max_um": None,
            "ended": "oscillating" if oscillating else "tripped",
            "why": str(error),
        }
    found = summary.summarise(log)
    mean_um, max_um = found.mean_um, found.max_um
    result = {"mean_um": mean_um, "max_um": max_um, "ended": "", "why": ""}
    path_to = found.path_to_percent
    if mean_um is None or max_um is None or path_to is None or path_to < _WHOLE_PERCENT:
        return result | {"ended": "tripped", "why": f"the axes went only {found.path_percent} % of the path"}
    if not math.isfinite(max_um) or max_um > _UNSTABLE_UM:
        return result | {"ended": "unstable", "why": f"contour error of {max_um:.0f} µm"}
    return result
