# SPDX-License-Identifier: Apache-2.0
"""Gains for a machine: the least error within margins and a limit of the force step.

The linear loop is searched for the least error of a friction reversal, globally, since the contouring law has two
basins at least: one with a fast observer, and one with a slow observer and high gains. The best of each basin, without
and with a filter, and with more damping, then drive the simulated machine, and of those that are quiet there the least
true error decides. Every controller is searched for with the same effort. A search of the same machine gives the same
gains.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import Bounds, differential_evolution, minimize
from scipy.stats import qmc

from kontur.design import loop
from kontur.design.laws import BASINS, KNOWN, LAWS, OBSERVER, Gains, Searched
from kontur.design.trial import STOPPED, Trial
from kontur.drive import parameter_file
from kontur.drive.controllers import CONTROLLERS
from kontur.drive.objects import Objects
from kontur.drive.target import Target, open_drive
from kontur.errors import MachineError
from kontur.machine import FULL, Axis, Machine

_POPULATION, _GENERATIONS = 40, 60
_DAMPED = (0.9, 0.8)  # shares of the limit of Ms for which there are candidates besides
_NEAR = 0.7  # logarithm of the factor on gains within which a filter is searched for
_SEED = 1
_UNSTABLE = 1e4  # above every logarithm of an error with
_EXCESS = 10.0  # times the logarithm of what exceeds a limit, which keeps the search within it
_WATCHED = 0.5  # share of the limit of the watch for oscillation, as a longer path meets more than the trial
_INSIDE = 0.995  # share of a limit that a candidate beyond it is brought to
_DIGITS = 5


# While the response of the law is taken: no adaptation, no limits, and no reaction to the impulse. Nothing is cancelled
# by the angle of the screw, which the drive does for an axis in every second period: an impulse would make a spring of
# it, of either sign. docs/adr/0077.
_FROZEN = {
    "smc.xi": 0.0,
    "compensator.rho": 0.0,
    "plant_x.force_limit": 3000.0,
    "plant_y.force_limit": 3000.0,
    "force_continuous_x.force": 0.0,
    "force_continuous_y.force": 0.0,
    "oscillation.limit": 0.0,
    "screw_x.lead": 0.0,
    "screw_y.lead": 0.0,
}
# A section of the force filter, which may be a notch: frequencies of zeros and poles, times that of the first mode.
_FILTER = (
    Searched("zero", 0.3, 4.0),
    Searched("zero damping", 0.05, 3.0),
    Searched("pole", 0.3, 8.0),
    Searched("pole damping", 0.2, 3.0),
)
_NO_FILTER = (1.0, 0.6, 1.0, 0.6)  # zeros and poles cancel each other
_CROSSOVER = Searched("crossover of the encoders", 3.0, 300.0)  # Hz
_CROSSOVER_HZ = 25.0  # where a search begins besides
_RIGID_HZ = 200.0  # in place of the first mode of a rigid axis


@dataclass(frozen=True, eq=False)
class AxisDesign:
    """What is predicted for one axis. `largest`: loop.largest_sensitivity(), in its gap too. `force_change_N`:
    loop.force_change(). `reversal_m`: error of a friction reversal, root mean square over loop.REVERSAL_S. `loops`
    (v, f): L at the frequencies `hz`, for each of loop.VARIANTS."""

    margins: loop.Margins
    largest: float
    force_change_N: float
    reversal_m: float
    hz: loop.Floats
    loops: loop.Complex


@dataclass(frozen=True, eq=False)
class Design:
    """Gains of a controller for a machine, and what is predicted of x and y.

    `parameters`: all for the drive, by name, and `text` these as a file. `force_step_N`: mean change of the force from
    period to period, which the encoder's counts make. `limit`: what keeps the loop from being faster, in a sentence.
    """

    machine: str
    controller: str
    gains: Gains
    parameters: dict[str, float]
    text: str
    force_step_N: float
    axes: tuple[AxisDesign, AxisDesign]
    limit: str


@dataclass(frozen=True)
class _Place:
    """An axis as a loop: its number in the machine, and in the response of the law."""

    axis: Axis
    number: int
    swapped: bool


class Problem:
    """A machine and a controller, with limits of Ms and of the force step in N. Raises MachineError."""

    def __init__(self, machine: Machine, controller: str, compensation: str, ms: float, force_step_N: float) -> None:
        self.machine, self.controller, self.ms, self.force_step_N = machine, controller, ms, force_step_N
        self.number = CONTROLLERS.index(controller)
        self.searched, self._gains = LAWS[controller]
        if machine.model != "full":
            raise MachineError(f"machine {machine.name!r}: a design needs a machine with the model 'full'")
        with open_drive(Target(machine=machine)) as device:
            self.objects: Objects = device
            self.control_hz = int(device.read("clock.control_hz"))
            self.oscillation_N = float(device.read("oscillation.limit"))
        self.told = machine.parameters(compensation=compensation)
        self._told = [self._on_wire(self.told), self._on_wire(_swapped(self.told))]
        self._frozen = self._on_wire(_FROZEN)
        second_m = [self.told.get(f"second_encoder_{axis}.length", 0.0) * 1e-6 for axis in "xy"]
        self.counts_m = tuple((axis.encoder_m, m) for axis, m in zip(machine.axes, second_m, strict=True))
        self.at = 1 if min(second_m) > 0.0 else 0  # where the error counts: 1 at the table
        self.second = (_CROSSOVER,) if max(second_m) > 0.0 else ()
        self.searched = (*self.searched, *self.second, OBSERVER, *_FILTER)
        # Under ccc the loop along the normal differs from the one along the path: each axis has its turn.
        turns = (False, True) if controller == "ccc" else (False,)
        self.places = [
            _Place(axis, 1 - i if swapped else i, swapped) for swapped in turns for i, axis in enumerate(machine.axes)
        ]
        self._plants: dict[tuple[int, int], tuple[loop.Grid, list[loop.Plant]]] = {}

    def _on_wire(self, values: Mapping[str, float]) -> list[tuple[int, int, int]]:
        return [self.objects.on_wire(name, value) for name, value in values.items()]

    def plants(self, points: int, near: int) -> tuple[loop.Grid, list[loop.Plant]]:
        """A grid of frequencies (loop.Grid.around), and on it the axis at each of `places`; computed once."""
        if (points, near) not in self._plants:
            grid = loop.Grid.around(self.machine.axes, self.control_hz, points, near)
            delay = self.machine.delay_periods
            axes = [loop.plant(grid, one.axis, delay, loop.variants_of(one.axis)) for one in self.places]
            self._plants[points, near] = grid, axes
        return self._plants[points, near]

    def gains(self, vector: loop.Floats) -> Gains:
        """Parameters of the drive for logarithms of the searched quantities, the filter's left out or with them."""
        values = [float(x) for x in np.exp(vector)]
        law = len(self.searched) - len(_FILTER)
        gains = self._gains(values[: law - 1 - len(self.second)]) | {OBSERVER.name: values[law - 1]}
        if self.second:
            gains |= dict.fromkeys(("second_encoder_x.crossover", "second_encoder_y.crossover"), values[law - 2])
        for name, axis in zip("xy", self.machine.axes, strict=True):
            gains |= {f"force_filter_{name}.{key}_1": 0.0 for key in ("zero", "pole")}  # off, where a drive has one
            for key, value in zip(("zero", "zero_damping", "pole", "pole_damping"), values[law:], strict=False):
                scale = 1.0 if "damping" in key else axis.resonance_Hz or _RIGID_HZ
                gains[f"force_filter_{name}.{key}_1"] = value * scale
        return {name: float(f"{value:.{_DIGITS}g}") for name, value in gains.items()}

    @cached_property
    def bounds(self) -> list[tuple[float, float]]:
        return [(math.log(s.least), math.log(s.greatest)) for s in self.searched]

    def loops(self, grid: loop.Grid, values: Mapping[str, float]) -> list[loop.Law]:
        """The law at each of `places`. Raises loop.UnstableLawError, and ValueError where the firmware refuses."""
        first_m, second_m = zip(*self.counts_m, strict=True)
        found = {
            swapped: loop.laws(
                grid,
                [*self._told[swapped], *self._on_wire(_swapped(values) if swapped else values), *self._frozen],
                self.number,
                first_m[:: -1 if swapped else 1],
                second_m[:: -1 if swapped else 1],
            )
            for swapped in {place.swapped for place in self.places}
        }
        return [found[place.swapped][place.number] for place in self.places]


class _Search:
    """The cost of a trial on a grid of frequencies, with these limits."""

    def __init__(
        self, problem: Problem, ms: float, points: int = 160, near: int = 25, force_step_N: float | None = None
    ) -> None:
        self.problem, self.ms = problem, ms
        self.force_step_N = problem.force_step_N if force_step_N is None else force_step_N
        self.grid, self.plants = problem.plants(points, near)

    def __call__(self, vector: loop.Floats) -> float:
        problem, grid = self.problem, self.grid
        aggressive = float(np.mean([(x - a) / (b - a) for x, (a, b) in zip(vector, problem.bounds, strict=False)]))
        if any(not low <= x <= high for x, (low, high) in zip(vector, problem.bounds, strict=False)):
            return 3.0 * _UNSTABLE  # the simplex may leave the box
        try:
            laws = problem.loops(grid, problem.gains(vector))
        except (loop.UnstableLawError, ValueError):
            return 2.0 * _UNSTABLE + aggressive
        excess, energy, change_N = 0.0, 0.0, [0.0, 0.0]
        for place, law, plant in zip(problem.places, laws, self.plants, strict=True):
            open_loop = loop.transfer(law, plant)
            if not loop.stable(grid, place.axis, law, open_loop):
                return _UNSTABLE + aggressive
            s = 1.0 / (1.0 + open_loop[0])
            excess += max(0.0, math.log(loop.largest_sensitivity(open_loop) / self.ms))
            i = problem.machine.axes.index(place.axis)
            change_N[i] = max(change_N[i], loop.force_change(grid, problem.counts_m[i], law, s))
            if place.number == 1 or not any(p.swapped for p in problem.places):  # the contour error is along the normal
                energy += loop.reversal_error(grid, place.axis, problem.at, law, plant, s) ** 2
                energy += loop.screw_error(grid, place.axis, law, plant, s) ** 2 if problem.at == 1 else 0.0
        excess += max(0.0, math.log(loop.force_step(*change_N) / self.force_step_N))
        return 0.5 * math.log(energy / 2.0) + _EXCESS * excess


def design(
    machine: Machine,
    controller: str,
    compensation: str = FULL,
    ms: float = 2.0,
    force_step_N: float = 2.0,
    progress: Callable[[float], None] = lambda share: None,
) -> Design:
    """Search for the gains of `controller`. `compensation`: what the drive is told besides, one of
    kontur.machine.COMPENSATIONS. `ms`: largest sensitivity; `force_step_N`: limit of the mean force step.

    Raises MachineError where no gains keep the limits.
    """
    problem = Problem(machine, controller, compensation, ms, force_step_N)
    gains = problem.gains(_searched(problem, progress))
    axes = predicted(problem, gains)
    step_N = _force_step_N(axes)
    parameters = {**problem.told, **gains}
    return Design(
        machine=machine.name,
        controller=controller,
        gains=gains,
        parameters=parameters,
        text=f"# Of kontur design for {machine.name!r}: --controller {controller}\n"
        + parameter_file.text(parameters, problem.objects.declared),
        force_step_N=step_N,
        axes=axes,
        limit=_limit(problem, axes, step_N),
    )


def _searched(problem: Problem, progress: Callable[[float], None]) -> loop.Floats:
    """The logarithms of the gains that have the least error on the machine, of all candidates within the limits."""
    trial = Trial(problem.machine, problem.controller)
    found: list[tuple[float, loop.Floats]] = []
    excess = [(math.inf, math.inf, math.inf)]
    for candidate in _candidates(problem, progress):
        worst, step_N = _used(problem, candidate)
        excess.append((max(worst / problem.ms, step_N / problem.force_step_N), worst, step_N))
        if excess[-1][0] <= 1.0:
            found.append((trial({**problem.told, **problem.gains(candidate)}), candidate))
    if not found:
        _, worst, step_N = min(excess)
        raise MachineError(
            f"machine {problem.machine.name!r}: no gains of {problem.controller} keep Ms <= {problem.ms:g} and a force "
            f"step of {problem.force_step_N:g} N; the nearest have {worst:.4g} and {step_N:.4g} N. Allow more: --ms, "
            "--force-step"
        )
    found.sort(key=lambda result: result[0])
    if found[0][0] == STOPPED:
        raise MachineError(
            f"machine {problem.machine.name!r}: all gains of {problem.controller} that keep the limits stop the drive "
            "on the simulated machine; ask for more margin: a lower --ms or --force-step"
        )
    watched = {"oscillation.limit": _WATCHED * problem.oscillation_N}
    for error, candidate in found:
        if error < STOPPED and trial.quiet({**problem.told, **problem.gains(candidate), **watched}):
            return candidate
    return found[0][1]


def _candidates(problem: Problem, progress: Callable[[float], None]) -> Iterator[loop.Floats]:
    """For each basin the best gains without and with a filter, each with less and more damping."""
    cost = _Search(problem, problem.ms)
    basins = BASINS[problem.controller]

    def stage(done: int) -> Callable[[float], None]:
        return lambda share: progress((done + share) / (2 * len(basins)))

    for i, basin in enumerate(basins):
        law = _in_basin(problem, cost, basin, stage(2 * i))
        yield from _with_damping(problem, cost, law)
        yield from _with_damping(problem, cost, _with_filter(problem, cost, law, stage(2 * i + 1)))


def _with_damping(problem: Problem, cost: _Search, best: loop.Floats) -> Iterator[loop.Floats]:
    """`best`, and the best near it with less of the limit of Ms, without those that are not stable."""
    damped = (_polished(_Search(problem, share * problem.ms), best, 0.05) for share in _DAMPED)
    yield from (_within(problem, vector) for vector in (best, *damped) if cost(vector) < _UNSTABLE)


def _used(problem: Problem, vector: loop.Floats) -> tuple[float, float]:
    """Ms and the force step in N, on the fine grid."""
    axes = predicted(problem, problem.gains(vector))
    return max(axis.largest for axis in axes), _force_step_N(axes)


def _within(problem: Problem, vector: loop.Floats) -> loop.Floats:
    """Near `vector`, within the limits: what the coarse grid does not see tightens the limit that it exceeds."""
    ms, force_step_N = problem.ms, problem.force_step_N
    for _ in range(4):
        worst, step_N = _used(problem, vector)
        if worst <= problem.ms and step_N <= problem.force_step_N:
            break
        ms *= _INSIDE * problem.ms / worst if worst > problem.ms else 1.0
        force_step_N *= _INSIDE * problem.force_step_N / step_N if step_N > problem.force_step_N else 1.0
        vector = _polished(_Search(problem, ms, 400, 51, force_step_N), vector, 0.01, 20)
    return vector


def _in_basin(
    problem: Problem, cost: _Search, basin: Mapping[str, tuple[float, float]], progress: Callable[[float], None]
) -> loop.Floats:
    """The logarithms with the least cost without a filter, and with the quantities of `basin` within its ranges."""
    law = problem.searched[: -len(_FILTER)]
    low, high = np.log([basin.get(one.name, (one.least, one.greatest)) for one in law]).T
    population = _population(low, high)
    for known in KNOWN.get(problem.controller, ()):
        start = np.log([*known[:-1], *(_CROSSOVER_HZ for _ in problem.second), known[-1]])
        if np.all((low <= start) & (start <= high)):
            population[::4] = np.clip(start + (population[::4] - population.mean(axis=0)) / 4.0, low, high)
    return _evolved(cost, low, high, population, _GENERATIONS, progress)


def _with_filter(problem: Problem, cost: _Search, law: loop.Floats, progress: Callable[[float], None]) -> loop.Floats:
    """The same with a filter, near the best law without one. It begins with filters that do little."""
    low, high = np.array(problem.bounds).T
    low[: len(law)] = np.maximum(low[: len(law)], law - _NEAR)
    high[: len(law)] = np.minimum(high[: len(law)], law + _NEAR)
    population = _population(low, high, 3 * _POPULATION // 2)
    middle = (low + high) / 2.0
    population[:, : len(law)] = law + (population - middle)[:, : len(law)] / 4.0
    population[:, -2:] = population[:, -4:-2] + (population - middle)[:, -2:] / 6.0  # poles near the zeros
    population = np.clip(population, low, high)
    population[0] = [*law, *np.log(_NO_FILTER)]
    return _evolved(cost, low, high, population, _GENERATIONS, progress)


def _population(low: loop.Floats, high: loop.Floats, size: int = _POPULATION) -> loop.Floats:
    return np.asarray(qmc.scale(qmc.LatinHypercube(len(low), rng=_SEED).random(size), low, high))


def _evolved(
    cost: _Search,
    low: loop.Floats,
    high: loop.Floats,
    population: loop.Floats,
    generations: int,
    progress: Callable[[float], None],
) -> loop.Floats:
    """Where evolution from `population` and then a simplex find the least cost."""
    generation = itertools.count(1)
    best = differential_evolution(
        cost, Bounds(low, high), init=population, strategy="randtobest1bin", maxiter=generations, tol=1e-4,
        polish=False, rng=_SEED,
        callback=lambda intermediate_result: progress(min(1.0, next(generation) / generations)),
    )  # fmt: skip
    return _polished(cost, best.x, 0.05)


def _polished(cost: _Search, start: loop.Floats, size: float, effort: int = 60) -> loop.Floats:
    """Where a simplex of this size finds the least cost, in `effort` trials for each quantity."""
    simplex = start + np.vstack([np.zeros(len(start)), size * np.eye(len(start))])
    found = minimize(
        cost, start, method="Nelder-Mead",
        options={"maxfev": effort * len(start), "xatol": 1e-4, "fatol": 1e-5, "initial_simplex": simplex},
    )  # fmt: skip
    return np.asarray(found.x)


def predicted(problem: Problem, values: Mapping[str, float]) -> tuple[AxisDesign, AxisDesign]:
    """Margins and errors of x and y with these parameters, on a fine grid; of two directions the worse."""
    grid, plants = problem.plants(points=900, near=101)
    found: dict[int, AxisDesign] = {}
    for place, law, plant in zip(problem.places, problem.loops(grid, values), plants, strict=True):
        open_loop = loop.transfer(law, plant)
        s = 1.0 / (1.0 + open_loop[0])
        i = problem.machine.axes.index(place.axis)
        axis = AxisDesign(
            loop.margins(grid, open_loop),
            loop.largest_sensitivity(open_loop),
            loop.force_change(grid, problem.counts_m[i], law, s),
            loop.reversal_error(grid, place.axis, problem.at, law, plant, s),
            grid.hz,
            open_loop[: len(loop.VARIANTS)],
        )
        if i not in found or axis.largest > found[i].largest:
            found[i] = axis
    return found[0], found[1]


def _force_step_N(axes: tuple[AxisDesign, AxisDesign]) -> float:
    return loop.force_step(axes[0].force_change_N, axes[1].force_change_N)


def _limit(problem: Problem, axes: tuple[AxisDesign, AxisDesign], step_N: float) -> str:
    """What keeps the loop from being faster, in a sentence."""
    name, axis, result = max(zip("xy", problem.machine.axes, axes, strict=True), key=lambda item: item[2].largest)
    m = result.margins
    if result.largest > max(m.ms, 0.97 * problem.ms):
        return (
            f"The gap of {axis.backlash_m * 1e6:.3g} µm of {name} limits it: in it is only the mass of the motor. "
            f"Under {problem.controller} disturbances are halved up to {m.bandwidth_Hz:.3g} Hz."
        )
    if m.ms > 0.97 * problem.ms:
        what = f"the lag of the force and the delay of {problem.machine.delay_periods} control period"
        if axis.resonance_Hz > 0.0:
            what = f"the resonance of {axis.resonance_Hz:g} Hz"
        return (
            f"{what[0].upper()}{what[1:]} of {name} limits it: Ms is {m.ms:.2f} at {m.ms_at_Hz:.0f} Hz"
            f"{_varied(m)}. Under {problem.controller} it is as fast as this at most: disturbances are halved up to "
            f"{m.bandwidth_Hz:.3g} Hz."
        )
    if step_N > 0.97 * problem.force_step_N:
        return f"The count of the encoder limits it: the force step is {step_N:.2f} N."
    return "The range of the parameters limits it."


def _varied(m: loop.Margins) -> str:
    parts = [f"{factor:g} times the {what}" for factor, what in ((m.resonance, "resonance"), (m.mass, "mass"))
             if factor != 1.0]  # fmt: skip
    return f" with {' and '.join(parts)}" if parts else ""


def _swapped(values: Mapping[str, float]) -> dict[str, float]:
    """The parameters of x given to y, and those of y to x."""
    other = {"x": "y", "y": "x"}
    return {re.sub(r"(?<=_)[xy](?=\.|$)", lambda axis: other[axis[0]], name): value for name, value in values.items()}
