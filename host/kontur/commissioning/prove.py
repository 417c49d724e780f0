# SPDX-License-Identifier: Apache-2.0
"""The proof of gains on the drive: circles both ways before and after, and the sensitivity against the predicted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from kontur.commissioning import response
from kontur.commissioning.first_moves import HOST_FAULTS
from kontur.commissioning.response import Response, Setup
from kontur.design.search import AxisDesign, Problem, predicted
from kontur.drive.device import Device
from kontur.drive.target import Target, open_drive
from kontur.errors import DeviceError, HeldError, NoAnswerError, StreamError
from kontur.experiments.circle_test import Setup as Circles
from kontur.experiments.circle_test import circle_test
from kontur.machine import FULL, Machine
from kontur.planning.bounds import limits
from kontur.runs import summary
from kontur.runs.circle_record import CircleTest
from kontur.runs.recorder import Watcher

MS_MAX = 2.2
"""Largest measured sensitivity of gains that are kept."""
_CIRCLES = ((0.020, 0.1), (0.004, 0.02))  # radius, feed
_SENSES = ("ccw", "cw")
_LEAD = 0.25  # turns to speed up, and to slow down: less of the drive's time than a half
_UNSCORED_S = 0.3
_TRIES = 3
_BAND_HZ, _POINTS, _WINDOW_S = (10.0, 500.0), 16, 0.5
_FORCE_PER_KG, _LEAST_N = 0.3, 10.0
_QUIETER = "ask for a quieter design: --for quiet"


@dataclass(frozen=True)
class Proof:
    """A circle under a controller. Errors are means in µm: the true ones of a simulation, the drive's own estimates on
    a bus; None: the drive stopped, `*_stopped` says in which sense and why. `ms_*`: of both axes the larger. `iso_*`:
    circularity of both senses together, G(b) of ISO 230-4, of the same circles, by the true position where it is known.
    """

    case: str
    controller: str
    before_um: float | None
    after_um: float | None
    ms_predicted: float
    ms_measured: float
    iso_before_um: float | None = None
    iso_after_um: float | None = None
    before_stopped: str | None = None
    after_stopped: str | None = None

    def as_json(self) -> dict[str, object]:
        return asdict(self)


@dataclass(frozen=True, eq=False)
class Candidate:
    """Parameters of a controller, and what is predicted of x and y with them."""

    controller: str
    parameters: Mapping[str, float]
    axes: tuple[AxisDesign, AxisDesign]


@dataclass(frozen=True, eq=False)
class Evidence:
    """All that was measured: the proof, the sensitivity of each axis by controller, and both circular tests of each
    circle by controller and case. None: the drive stopped."""

    proof: list[Proof] = field(default_factory=list)
    sensitivity: dict[str, tuple[Response, Response]] = field(default_factory=dict)
    circles: dict[tuple[str, str], tuple[CircleTest | None, CircleTest | None]] = field(default_factory=dict)


def candidate(model: Machine, controller: str, parameters: Mapping[str, float]) -> Candidate:
    """What is predicted on `model` for a controller with these parameters. Raises MachineError."""
    problem = Problem(model, controller, FULL, MS_MAX, 1.0)
    return Candidate(controller, parameters, predicted(problem, parameters))


def prove(
    target: Target,
    candidates: Sequence[Candidate],
    before: Mapping[str, float],
    say: Callable[[str], None],
    stop_requested: Callable[[], bool] = lambda: False,
    opened: Callable[[Target], AbstractContextManager[Device]] = open_drive,
    watch: Watcher | None = None,
) -> Evidence:
    """Measure the sensitivity with each candidate, and run all circles with the parameters `before` and with its own.

    `opened` opens the drive to measure its sensitivity; `watch` looks on at the circles.
    The drive keeps the last ones. Raises KeyboardInterrupt at a requested stop.
    """
    found = Evidence()
    for one in candidates:
        say(f"{one.controller}: the sensitivity of both axes is measured")
        found.sensitivity[one.controller] = _sensitivity(target, one, stop_requested, opened)
        measured = max(float(np.max(np.abs(axis.sensitivity))) for axis in found.sensitivity[one.controller])
        for radius_m, feed_mps in _CIRCLES:
            case, setup = _circles(target, one.controller, radius_m, feed_mps)
            say(f"{one.controller}: {case} in both senses, before and after")
            tests, errors_um, stopped = [], [], []
            for when, parameters in (("before", before), ("after", one.parameters)):
                test, error_um, why = _run(
                    target, replace(setup, parameters=parameters), feed_mps, say, stop_requested, watch
                )
                tests.append(test)
                errors_um.append(error_um)
                stopped.append(why)
                if why is not None:
                    say(f"{one.controller}: {case}, {when}: {why.removesuffix('.')}")
            found.circles[one.controller, case] = (tests[0], tests[1])
            iso_um = [None if test is None else test.circles[0].best.figures.g_both_um for test in tests]
            for i, sense in enumerate(_SENSES):
                found.proof.append(
                    Proof(
                        f"{case} {sense}", one.controller, errors_um[0][i], errors_um[1][i],
                        max(largest(one.axes)), measured, iso_um[0], iso_um[1], stopped[0], stopped[1],
                    )
                )  # fmt: skip
    return found


def stops(proof: Sequence[Proof]) -> list[str]:
    """Where and why the drive stopped, a line for each circle."""
    lines = [
        f"{one.controller}, {one.case.rsplit(maxsplit=1)[0]}, {when}: {why}"
        for one in proof
        for when, why in (("before", one.before_stopped), ("after", one.after_stopped))
        if why is not None
    ]
    return list(dict.fromkeys(lines))


def problem_of(proof: Sequence[Proof], controller: str) -> str:
    """Why the gains of `controller` are not to be kept; empty where they are."""
    kept = [one for one in proof if one.controller == controller]
    for one in kept:
        if one.ms_measured > MS_MAX:
            return f"the measured Ms of {one.ms_measured:.2f} exceeds {MS_MAX:g}; {_QUIETER}"
        if one.after_um is None:
            return f"on {one.case} with the new gains, {one.after_stopped}; if the gains are why, {_QUIETER}"
    before = [one.before_um for one in kept if one.before_um is not None]
    after = [one.after_um for one in kept if one.after_um is not None]
    if len(before) == len(after) and sum(after) > sum(before):
        return (
            f"the circles are no better: {sum(after) / len(after):.2f} µm after, {sum(before) / len(before):.2f} before"
        )
    return ""


def largest(axes: tuple[AxisDesign, AxisDesign]) -> tuple[float, float]:
    """Ms of x and y of the machine as it is, within the band in which it is measured."""
    found = []
    for axis in axes:
        band = (axis.hz >= _BAND_HZ[0]) & (axis.hz <= _BAND_HZ[1])
        found.append(float(np.max(1.0 / np.abs(1.0 + axis.loops[0][band]))))
    return found[0], found[1]


def _sensitivity(
    target: Target,
    of: Candidate,
    stop_requested: Callable[[], bool],
    opened: Callable[[Target], AbstractContextManager[Device]],
) -> tuple[Response, Response]:
    """Of both axes, at a band of lines and at those where it is predicted to be largest."""
    found = []
    with opened(target) as device:
        device.parameters.set(of.parameters)
        device.select_controller(of.controller)
        with device.axes.enabled():
            for name, axis in zip("xy", of.axes, strict=True):
                peak_hz = float(axis.hz[np.argmax(1.0 / np.abs(1.0 + axis.loops[0]))])
                near = [round(peak_hz * factor * _WINDOW_S) / _WINDOW_S for factor in (0.94, 1.0, 1.06)]
                hz = response.lines(*_BAND_HZ, _POINTS - len(near), _WINDOW_S)
                chosen = tuple(sorted({*hz, *(f for f in near if _BAND_HZ[0] <= f <= _BAND_HZ[1])}))
                force_N = max(_LEAST_N, _FORCE_PER_KG * float(device.read(f"plant_{name}.mass")))
                limit_N = float(device.read(f"plant_{name}.force_limit"))
                setup = Setup(chosen, min(force_N, 0.4 * limit_N), 0.0873, _WINDOW_S, 1, 0.3)
                found.append(response.measure(device, name, setup, stop_requested=stop_requested))
    return found[0], found[1]


def _circles(target: Target, controller: str, radius_m: float, feed_mps: float) -> tuple[str, Circles]:
    """The name of a circle about the middle of the travel, smaller where it is short, and the circle."""
    low, high = np.array(target.machine.soft_limits_m).T
    centre_m = (float(0.5 * (low[0] + high[0])), float(0.5 * (low[1] + high[1])))
    radius_m = min(radius_m, 0.4 * float(np.min(high - low)))
    bounds = limits(target.machine)
    setup = Circles(radius_m, centre_m, _LEAD, controller=controller, approach=bounds, score_from_s=_UNSCORED_S)
    return f"r{radius_m * 1e3:g}@{feed_mps * 1e3:g}", setup


def _run(
    target: Target,
    setup: Circles,
    feed_mps: float,
    say: Callable[[str], None],
    stop_requested: Callable[[], bool],
    watch: Watcher | None,
    tries: int = _TRIES,
) -> tuple[CircleTest | None, tuple[float | None, float | None], str | None]:
    """The circular test and the mean errors in µm of both senses; where the drive stopped by itself, in place of them
    in which sense and why. Where the host or the bus was too slow, the circles are run again."""
    bounds = limits(target.machine)
    on = _SENSES[0]

    def progress(what: str, share: float) -> None:
        nonlocal on
        on = what.rsplit(maxsplit=1)[1]

    try:
        ((circle, runs),) = circle_test(setup, [feed_mps], bounds, target, progress, stop_requested, watch)
    except (NoAnswerError, HeldError):
        raise
    except DeviceError as error:
        if tries > 1 and (isinstance(error, StreamError) or getattr(error, "code", 0) in HOST_FAULTS):
            say(f"{setup.controller}: once more, since the drive stopped in {on}: {str(error).removesuffix('.')}")
            return _run(target, setup, feed_mps, say, stop_requested, watch, tries - 1)
        return None, (None, None), f"the drive stopped in {on}: {error}"
    ccw_um, cw_um = (summary.summarise(run.log).mean_um for run in runs)
    return CircleTest(setup.radius_m * 1e3, {"controller": setup.controller}, (circle,)), (ccw_um, cw_um), None
