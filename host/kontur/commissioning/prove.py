# SPDX-License-Identifier: Apache-2.0
"""The proof of a design on the drive: circles both ways before and after, and the sensitivity against the predicted."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass

import numpy as np

from kontur.commissioning import response
from kontur.commissioning.response import Setup
from kontur.design.search import Design
from kontur.drive.device import Device
from kontur.drive.target import Target, open_drive
from kontur.errors import DeviceError
from kontur.path.geometry import Arc, Move, Program
from kontur.planning.bounds import limits
from kontur.planning.planner import Trajectory, plan
from kontur.runs import summary
from kontur.runs.recorder import Watcher
from kontur.runs.runner import RunOptions, run

MS_MAX = 2.2
"""Largest measured sensitivity of a design that is kept."""
_CIRCLES = ((0.020, 0.1), (0.004, 0.02))  # radius, feed
_SENSES = {"ccw": 1.0, "cw": -1.0}
_TURNS, _UNSCORED_S = 1.3, 0.3
_BAND_HZ, _POINTS, _WINDOW_S = (10.0, 500.0), 16, 0.5
_FORCE_PER_KG, _LEAST_N = 0.3, 10.0


@dataclass(frozen=True)
class Proof:
    """A circle under a controller. Errors are means in µm: the true ones of a simulation, the drive's own estimates on
    a bus; None: the drive stopped. `ms_*`: of both axes the larger."""

    case: str
    controller: str
    before_um: float | None
    after_um: float | None
    ms_predicted: float
    ms_measured: float

    def as_json(self) -> dict[str, object]:
        return asdict(self)


def prove(
    target: Target,
    designs: Sequence[Design],
    before: Mapping[str, float],
    after: Mapping[str, Mapping[str, float]],
    say: Callable[[str], None],
    opened: Callable[[Target], AbstractContextManager[Device]] = open_drive,
    watch: Watcher | None = None,
) -> list[Proof]:
    """Run all circles with the parameters `before`, and with those `after` of each controller.

    `opened` opens the drive to measure its sensitivity; `watch` looks on at the circles.
    """
    found = []
    for design in designs:
        say(f"{design.controller}: the sensitivity of both axes is measured")
        measured = _sensitivity(target, design, after[design.controller], opened)
        for name, trajectory in _circles(target).items():
            say(f"{design.controller}: {name}, before and after")
            found.append(
                Proof(
                    name,
                    design.controller,
                    _error_um(target, trajectory, design.controller, before, watch),
                    _error_um(target, trajectory, design.controller, after[design.controller], watch),
                    max(predicted(design)),
                    measured,
                )
            )
    return found


def predicted(design: Design) -> tuple[float, float]:
    """Ms of x and y of the machine as it is, within the band in which it is measured."""
    found = []
    for axis in design.axes:
        band = (axis.hz >= _BAND_HZ[0]) & (axis.hz <= _BAND_HZ[1])
        found.append(float(np.max(1.0 / np.abs(1.0 + axis.loops[0][band]))))
    return found[0], found[1]


def _sensitivity(
    target: Target,
    design: Design,
    parameters: Mapping[str, float],
    opened: Callable[[Target], AbstractContextManager[Device]],
) -> float:
    """The largest of both axes, at a band of lines and at those where it is predicted to be largest."""
    worst = 0.0
    with opened(target) as device:
        device.parameters.set(parameters)
        device.select_controller(design.controller)
        with device.axes.enabled():
            for name, axis in zip("xy", design.axes, strict=True):
                peak_hz = float(axis.hz[np.argmax(1.0 / np.abs(1.0 + axis.loops[0]))])
                near = [round(peak_hz * factor * _WINDOW_S) / _WINDOW_S for factor in (0.94, 1.0, 1.06)]
                hz = response.lines(*_BAND_HZ, _POINTS - len(near), _WINDOW_S)
                chosen = tuple(sorted({*hz, *(f for f in near if _BAND_HZ[0] <= f <= _BAND_HZ[1])}))
                force_N = max(_LEAST_N, _FORCE_PER_KG * float(parameters[f"plant_{name}.mass"]))
                limit_N = float(device.read(f"plant_{name}.force_limit"))
                setup = Setup(chosen, min(force_N, 0.4 * limit_N), 0.0873, _WINDOW_S, 1, 0.3)
                measured = response.measure(device, name, setup)
                worst = max(worst, float(np.max(np.abs(measured.sensitivity))))
    return worst


def _circles(target: Target) -> dict[str, Trajectory]:
    """Circles in both senses about the middle of the travel, smaller where it is short."""
    low, high = np.array(target.machine.soft_limits_m).T
    centre = (float(0.5 * (low[0] + high[0])), float(0.5 * (low[1] + high[1])))
    room_m = 0.4 * float(np.min(high - low))
    found = {}
    for radius_m, feed_mps in _CIRCLES:
        radius_m = min(radius_m, room_m)
        for name, sign in _SENSES.items():
            arc = Arc(centre, radius_m, 0.0, sign * 2.0 * math.pi * _TURNS)
            program = Program("circle", (Move(arc, feed_mps),), (centre[0] + radius_m, centre[1]))
            found[f"r{radius_m * 1e3:g}@{feed_mps * 1e3:g} {name}"] = plan(program, limits(target.machine))
    return found


def _error_um(
    target: Target, trajectory: Trajectory, controller: str, parameters: Mapping[str, float], watch: Watcher | None
) -> float | None:
    options = RunOptions(parameters=parameters, approach=limits(target.machine), score_from_s=_UNSCORED_S, watch=watch)
    try:
        log = run(trajectory, controller, target, options).log
    except DeviceError:
        return None
    return summary.summarise(log).mean_um
