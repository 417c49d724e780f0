# SPDX-License-Identifier: Apache-2.0
"""The paper, run again: its Table 2 and figures, its laws as printed beside ours, what hangs on values it leaves out.

Defines and runs the experiments, on all processors; paper_page.py and paper_figures.py show them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kontur.drive.controllers import CONTROLLERS
from kontur.drive.target import Target, open_drive
from kontur.errors import DeviceError, ParameterError
from kontur.experiments import estimator
from kontur.experiments.circles import CASES, trajectory
from kontur.experiments.engine import results
from kontur.experiments.estimator import Cell
from kontur.machine import Machine
from kontur.runs.log import RunLog
from kontur.runs.runner import RunOptions, run
from kontur.runs.summary import NOT_MOVED, summarise

NUMS = ("f32", "fix")

PAPER_TABLE_2 = {
    "track": (0.1602, 0.0634, 0.0947, 0.0306, 1.3362),
    "cc": (0.0701, 0.0515, 0.0556, 0.0112, 1.3281),
    "ccu": (0.0521, 0.0110, 0.0457, 0.0016, 1.3568),
}
"""As printed, at 4.5 mm/s: max e_n1, max e_n2, mean e_n1, mean e_n2 in mm, energy in "µJ"."""
PAPER_CHANGE = {"low": (-85.71, -78.64), "high": (-4.48, -10.13)}
"""As printed: change of mean and max e_n2 from CC to CCU, %."""

Parameters = tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Variant:
    """A law as the paper prints it: what is set, under which controller, what it is compared with, and why it is so."""

    name: str
    why: str
    parameters: Parameters
    controller: str = "ccu"
    base: Parameters = ()


_STEEP: Parameters = (("smc.e_max", 40.0), ("smc.k_bar", 1e5))
_PSI: Parameters = (("smc.psi_printed", 1.0),)
_MU: Parameters = (("compensator.mu_0", 0.0), ("compensator.law_printed", 1.0), ("compensator.rho", 0.5))
_SIGN: Parameters = (("compensator.phi", 1e-6),)
_WHOLE: Parameters = (("compensator.input_printed", 1.0),)
_PLAIN: Parameters = (("contour.newton", 0.0),)
MU_FROM_0 = "µ from 0, ρ = 0.5 1/s² (25)"

VARIANTS = (
    Variant(
        "ψ = β cosh, growing (11)",
        "k̄ times the error is far below one with our k̄, and cosh is one either way",
        _PSI,
    ),
    Variant("ψ = β cosh, growing (11)", "as above, with the larger errors of cc", _PSI, "cc"),
    Variant(
        "ψ = β cosh, k̄ = 0.1 1/µm (11)",
        "beside β/cosh with the same k̄: a k̄ so large that ψ changes; γ is so small that A hardly does",
        (*_STEEP, *_PSI),
        "cc",
        _STEEP,
    ),
    Variant(
        MU_FROM_0,
        "at this rate µ does not come near the friction within the run, and v is little more than −α ż_n",
        _MU,
    ),
    Variant(
        "sign(s), µ_0 as ours (24)",
        "one period of µ moves s through far more than a φ of 1 µm/s, so that the force flips all the time",
        _SIGN,
    ),
    Variant(
        "sign(s), µ_0 = 1 m/s² (24)",
        "the same with a µ just above the friction: what the sign costs is in force step and energy",
        (("compensator.mu_0", 1.0), *_SIGN),
    ),
    Variant(
        "sign(s) and µ from 0 (24), (25)", "the compensator as printed: µ stays too small to chatter", (*_SIGN, *_MU)
    ),
    Variant(
        "model driven by the whole ū (2)",
        "z then holds the friction that the feedforward has cancelled already, and v cancels it again",
        _WHOLE,
    ),
    Variant(
        "no Newton step (6)",
        "the lag of the axes is a small part of the radius on these circles; where it is not, see the last table",
        _PLAIN,
    ),
    Variant("no Newton step (6)", "as above, with the larger lag of cc", _PLAIN, "cc"),
    Variant("all as printed", "all of the above but k̄", (*_PSI, *_MU, *_SIGN, *_WHOLE, *_PLAIN)),
)

_NO_LEARNING: Parameters = (("feedforward.friction_rate", 0.0), ("feedforward.mass_rate", 0.0))

NOISE = "force noise σ"
SENSITIVITIES = (
    "smc.epsilon",
    "smc.zeta",
    "smc.xi",
    "smc.k_bar",
    "smc.e_max",
    "smc.k_0",
    "compensator.phi",
    "compensator.mu_0",
    "compensator.dead_zone",
    "observer.bandwidth",
    "contour.friction_speed",
    NOISE,
)
"""Parameters for which the paper gives no value, and the plant's noise."""
_TOGETHER = {"smc.k_bar": ("smc.e_max", -1), "compensator.mu_0": ("compensator.mu_max", 1)}
"""What the drive wants changed along (k̄ e_max <= 4, µ_0 <= µ_max), and by which power of the factor."""
FACTORS = (0.5, 2.0)


@dataclass(frozen=True)
class Job:
    """One run: a circle of CASES, a controller, parameters that differ from the defaults, times the force noise, and
    whether ccu learns a feedforward, which is not in the paper."""

    case: str
    controller: str = "ccu"
    parameters: Parameters = ()
    noise: float = 1.0
    learning: bool = False


@dataclass(frozen=True)
class Outcome:
    """What came of a job: `fault` says why it did not reach the end, else `figures` has mean_um, max_um, force_step_N,
    energy_J, and mean and max of |e_n1| and |e_n2| in mm. `log` and `friction_N` (rows of the log, 2) where asked for.
    """

    figures: Mapping[str, float] = dataclasses.field(default_factory=dict)
    fault: str | None = None
    log: RunLog | None = None
    friction_N: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class Results:
    """All outcomes by job, the estimator's table by numeric back end, and what was run on."""

    target: Target
    cases: Sequence[str]
    variants: Sequence[Variant]
    sensitivities: Sequence[str]
    outcomes: Mapping[Job, Outcome]
    cells: Mapping[str, Sequence[Cell]]
    spline_nm: Mapping[str, float]
    defaults: Mapping[str, Any]
    build: str
    num: str


def measure(
    target: Target,
    cases: Sequence[str] = tuple(CASES),
    variants: Sequence[Variant] = VARIANTS,
    sensitivities: Sequence[str] = SENSITIVITIES,
    stretches: int = 100,
    progress: Callable[[float], None] = lambda share: None,
) -> Results:
    """Run everything; the result does not depend on the number of processors. Raises what plan() and run() raise, but
    for runs that end in a fault: their outcome says so.
    """
    with open_drive(target) as device:
        defaults, build, num = device.parameters.dump(), str(device.read("build_id")), str(device.read("num_backend"))
    logged = {Job(case, name) for case in cases for name in CONTROLLERS}
    logged |= {Job(case, v.controller, v.parameters) for case in cases for v in variants if v.name == MU_FROM_0}
    work: list[tuple[Target, str | Job, int | bool]] = [(target, name, stretches) for name in NUMS]
    jobs = dict.fromkeys(_jobs(cases, variants, sensitivities, defaults))
    work += [(target, job, job in logged) for job in jobs]
    done: dict[int, Any] = {}
    for number, found in results(_work, list(enumerate(work))):
        done[number] = found
        progress(len(done) / len(work))
    heads, cells = ({name: done[i][part] for i, name in enumerate(NUMS)} for part in (0, 1))
    outcomes = {job: done[i] for i, job in enumerate(jobs, len(NUMS))}
    spline_nm = heads[NUMS[0]]["spline_nm"]
    return Results(target, cases, variants, sensitivities, outcomes, cells, spline_nm, defaults, build, num)


def varied(name: str, factor: float, defaults: Mapping[str, Any]) -> Parameters:
    """The parameters that make `name` differ by `factor` from its default, with those that have to go along."""
    changed = [(name, float(defaults[name]) * factor)]
    if name in _TOGETHER:
        other, power = _TOGETHER[name]
        changed.append((other, float(defaults[other]) * factor**power))
    return tuple(sorted(changed))


def sensitivity_job(case: str, name: str, factor: float, defaults: Mapping[str, Any]) -> Job:
    """The run of `case` with `name` (of SENSITIVITIES) times `factor`."""
    return Job(case, noise=factor) if name == NOISE else Job(case, parameters=varied(name, factor, defaults))


def _jobs(
    cases: Collection[str], variants: Collection[Variant], names: Collection[str], defaults: Mapping[str, Any]
) -> Iterator[Job]:
    for case in cases:
        yield from (Job(case, name) for name in CONTROLLERS)
        yield Job(case, learning=True)
        for variant in variants:
            yield Job(case, variant.controller, variant.base)
            yield Job(case, variant.controller, variant.parameters)
        for name in names:
            yield from (sensitivity_job(case, name, factor, defaults) for factor in FACTORS)


def _work(work: tuple[Target, str | Job, int | bool]) -> Any:
    """The estimator's table (numeric back end, number of stretches), or the outcome of a run (Job, whether to log)."""
    target, what, how = work
    if isinstance(what, Job):
        return _outcome(what, target, bool(how))
    return estimator.experiment(target.machine, what, seed=target.seed, stretches=how)


def _outcome(job: Job, target: Target, keep_log: bool) -> Outcome:
    machine = _noisier(target.machine, job.noise)
    from_s = CASES[job.case].score_from_s
    try:
        result = run(
            trajectory(job.case, machine),
            job.controller,
            dataclasses.replace(target, machine=machine),
            RunOptions(
                parameters=dict(job.parameters if job.learning else (*_NO_LEARNING, *job.parameters)),
                score_from_s=from_s,
            ),
        )
    except (DeviceError, ParameterError) as error:
        return Outcome(fault=str(error))
    log, truth = result.log, result.truth
    if not summarise(log).scored:
        return Outcome(fault=NOT_MOVED)
    assert truth is not None  # the drive is simulated
    columns = log.columns
    rows = columns["time_s"] >= from_s
    figures = {name: float(log.meta["score"][name]) for name in ("mean_um", "max_um")}
    figures |= {"force_step_N": log.meta["force_step_N"], "energy_J": float(columns["energy_J"][-1])}
    for name, column in (("e_n1", "tangential_error_um"), ("e_n2", "contour_error_um")):
        error_mm = np.abs(columns[column][rows]) * 1e-3
        figures |= {f"{name}_max_mm": float(np.max(error_mm)), f"{name}_mean_mm": float(np.mean(error_mm))}
    for i in (1, 2):
        gain = columns[f"switching_gain_{i}_mps2"]
        known = gain[np.isfinite(gain)]
        figures[f"mu_{i}_mps2_end"] = float(known[-1]) if known.size else float("nan")
    if not keep_log:
        return Outcome(figures)
    at = np.rint(columns["time_s"] * log.meta["control_hz"]).astype(np.int64)
    return Outcome(figures, log=log, friction_N=truth.friction_N[at])


def _noisier(machine: Machine, factor: float) -> Machine:
    x, y = (dataclasses.replace(axis, force_noise_N=axis.force_noise_N * factor) for axis in machine.axes)
    return dataclasses.replace(machine, x=x, y=y)
