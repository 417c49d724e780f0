# SPDX-License-Identifier: Apache-2.0
"""The frequency response of an axis, measured by its drive: machine, loop and sensitivity at each line.

The drive adds sines to the force of the axis and correlates (objects 2150h to 2154h, docs/bode.md). Here the lines are
chosen, put into sets of eight, and measured while the axis moves at a constant speed to and fro, so that friction is
constant. The scatter of the windows says how sure each point is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from kontur.commissioning.bias import Mover
from kontur.commissioning.encoder import count_m
from kontur.drive.device import Device
from kontur.errors import DeviceError, ParameterError

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]

LINES = 8
_SIGNALS = ("excitation_force", "excitation_first", "excitation_second")
_RUNS, _DONE = 1, 2
_REASONS = {
    3: "a stop, a halt or a fault ended it",
    4: "the force of the axis came to its limit: excite it with less force",
}
_POLL_S = 0.02
_READING_S = 0.3  # of the last window
_ROOM_M = 5e-3  # more than a movement needs
WINDOW_MAX_S, WHOLE_MAX_S = 5.0, 20.0  # of the drive


@dataclass(frozen=True)
class Setup:
    """How an axis is measured. `force_N`: sum of the amplitudes of all lines that act together. `speed_mps`: of the
    movement meanwhile, 0: at rest. `windows`: of each line in each direction, at least two. `settle_s`: before them."""

    hz: tuple[float, ...]
    force_N: float
    speed_mps: float = 0.03
    window_s: float = 1.0
    windows: int = 2
    settle_s: float = 0.4


@dataclass(frozen=True, eq=False)
class Response:
    """What was measured at the frequencies `hz` (f,).

    `plant` (2, f), m/N: from force to both encoders, 0 where there is no second one. `sensitivity` (f,): S. Their
    standard deviations are `plant_sigma` (2, f), `sensitivity_sigma` (f,). `coherence` (f,): share of what the first
    encoder saw that repeats from window to window.
    """

    hz: Floats
    plant: Complex
    plant_sigma: Floats
    sensitivity: Complex
    sensitivity_sigma: Floats
    coherence: Floats

    @property
    def open_loop(self) -> Complex:
        """L (f,): S = 1 / (1 + L)."""
        return np.asarray(1.0 / self.sensitivity - 1.0)

    @property
    def open_loop_sigma(self) -> Floats:
        """Its standard deviation (f,): dL = -dS / S^2."""
        return np.asarray(self.sensitivity_sigma / np.abs(self.sensitivity) ** 2)


def joined(parts: Sequence[Response]) -> Response:
    """All points of several measurements, in the order of their frequencies."""
    whole = {f.name: np.concatenate([getattr(part, f.name) for part in parts], axis=-1) for f in fields(Response)}
    order = np.argsort(whole["hz"], kind="stable")
    return Response(**{name: values[..., order] for name, values in whole.items()})


def lines(low_hz: float, high_hz: float, points: int, window_s: float) -> tuple[float, ...]:
    """Frequencies on a logarithmic scale with whole periods in a window, no two alike."""
    periods = np.unique(np.round(np.geomspace(low_hz, high_hz, points) * window_s))
    return tuple(float(n / window_s) for n in periods if n >= 1)


def measure(
    device: Device,
    axis: str,
    setup: Setup,
    progress: Callable[[float], None] = lambda share: None,
    stop_requested: Callable[[], bool] = lambda: False,
) -> Response:
    """Measure one axis of an enabled drive, which moves to and fro within its soft limits.

    Raises ParameterError for what the drive or the travel cannot do; DeviceError where the drive ends it;
    KeyboardInterrupt at a requested stop.
    """
    control_hz = int(device.read("clock.control_hz"))
    _check(setup, control_hz, float(device.read(f"plant_{axis}.force_limit")))
    first_m = count_m(device, axis)
    second_m = float(device.read(f"second_encoder_{axis}.length")) * 1e-6
    mover = Mover(device, axis, stop_requested)
    sets = math.ceil(len(setup.hz) / LINES)
    parts = []
    for i in range(sets):
        chosen = setup.hz[i::sets]  # far apart, so that they disturb each other least
        amplitude_N = setup.force_N / len(chosen)

        def done(share: float, i: int = i) -> None:
            progress((i + share) / sets)

        windows = _windows(mover, chosen, amplitude_N, setup, second_m > 0.0, done)
        parts.append(_response(np.array(chosen), windows, amplitude_N, (first_m, second_m), control_hz))
    return joined(parts)


def _check(setup: Setup, control_hz: int, limit_N: float) -> None:
    if not setup.hz:
        raise ParameterError("no frequency to measure at; widen the band")
    if not max(setup.hz) < 0.5 * control_hz:
        raise ParameterError(
            f"{max(setup.hz):g} Hz: the band must stay below {control_hz / 2:g} Hz, half the control rate"
        )
    if setup.force_N > 0.5 * limit_N:
        raise ParameterError(
            f"{setup.force_N:g} N: the excitation must stay within {0.5 * limit_N:g} N, half of the force limit"
        )
    if setup.window_s > WINDOW_MAX_S or setup.settle_s + setup.windows * setup.window_s > WHOLE_MAX_S:
        raise ParameterError(f"a window lasts {WINDOW_MAX_S:g} s at most, and all windows {WHOLE_MAX_S:g} s")


def _windows(
    mover: Mover,
    hz: Sequence[float],
    amplitude_N: float,
    setup: Setup,
    second: bool,
    progress: Callable[[float], None],
) -> Complex:
    """The windows (w, 3, lines), half of them in each direction, in as many movements as the travel needs."""
    if setup.speed_mps == 0.0:
        return excite(mover, hz, amplitude_N, setup, setup.windows, second)
    found: list[Complex] = []
    left = {1.0: setup.windows, -1.0: setup.windows}
    while any(left.values()):
        fit = {sign: min(count, _windows_that_fit(mover, sign, setup)) for sign, count in left.items()}
        if max(fit.values()) < 1:  # make room first
            sign = max(left, key=lambda one: left[one])
            way_m = mover.way_m(setup.speed_mps, _beside_s(setup) + left[sign] * setup.window_s) + _ROOM_M
            mover.go(mover.high_m - way_m if sign > 0.0 else mover.low_m + way_m, setup.speed_mps)
            fit = {sign: min(left[sign], _windows_that_fit(mover, sign, setup))}
        sign = max(fit, key=lambda one: fit[one])
        if fit[sign] < 1:
            raise ParameterError(
                f"axis {mover.axis} has {(mover.high_m - mover.low_m) * 1e3:.1f} mm to move, too little for a window "
                f"of {setup.window_s:g} s at {setup.speed_mps * 1e3:g} mm/s; measure with less speed, or widen "
                f"position_limit_{mover.axis}"
            )
        with mover.moving(sign * setup.speed_mps):
            windows = excite(mover, hz, amplitude_N, setup, fit[sign], second)
        if mover.held_back:
            mover.late()
            continue
        found.append(windows)
        left[sign] -= fit[sign]
        progress(1.0 - sum(left.values()) / (2.0 * setup.windows))
    return np.concatenate(found)


def _windows_that_fit(mover: Mover, sign: float, setup: Setup) -> int:
    return max(0, int((mover.longest_s(setup.speed_mps, sign) - _beside_s(setup)) / setup.window_s))


def _beside_s(setup: Setup) -> float:
    """How long a movement lasts beside its windows."""
    return setup.settle_s + _READING_S


def excite(mover: Mover, hz: Sequence[float], amplitude_N: float, setup: Setup, windows: int, second: bool) -> Complex:
    """The windows (w, 3, lines) of one excitation: force in N, counts a period of both encoders."""
    device = mover.device
    window_ms = round(setup.window_s * 1e3)
    for name, value in (
        ("axis", "xy".index(mover.axis)),
        ("amplitude", round(amplitude_N, 3)),
        ("window", window_ms),
        ("settle", round(setup.settle_s * 1e3)),
        ("windows", windows),
    ):
        device.write(f"excitation.{name}", value)
    for k in range(LINES):
        device.write(f"excitation_periods.entry_{k + 1}", round(hz[k] * window_ms * 1e-3) if k < len(hz) else 0)
    device.write("excitation.command", 1)
    found: list[Complex] = []
    try:
        end_s = device.link.time_s + setup.settle_s + windows * setup.window_s + 2.0
        while len(found) < windows:
            state, done = int(device.read("excitation.state")), int(device.read("excitation.done"))
            if done > len(found):
                if done != len(found) + 1:
                    raise DeviceError(f"the bus is too slow to read a window in {setup.window_s:g} s; use a longer one")
                found.append(_window(device, len(hz), second))
                continue
            if state != _RUNS:
                device.axes.refresh()
                mover.check()
                raise DeviceError(
                    f"the excitation of axis {mover.axis} ended after {done} of {windows} windows: "
                    f"{_REASONS.get(state, 'it was never begun')}"
                )
            if device.link.time_s > end_s:
                raise DeviceError(f"the excitation of axis {mover.axis} does not end")
            mover.pause(_POLL_S)
    finally:
        device.write("excitation.command", 0)
    return np.array(found)


def _window(device: Device, count: int, second: bool) -> Complex:
    values = np.zeros((len(_SIGNALS), count), dtype=np.complex128)
    for i, name in enumerate(_SIGNALS if second else _SIGNALS[:2]):
        for k in range(count):
            real, imaginary = (float(device.read(f"{name}.entry_{2 * k + n}")) for n in (1, 2))
            values[i, k] = complex(real, imaginary)
    return values


def _response(
    hz: Floats, windows: Complex, amplitude_N: float, lengths_m: Sequence[float], control_hz: int
) -> Response:
    """Of windows (w, 3, f), each of the same excitation."""
    count = len(windows)
    mean = np.mean(windows, axis=0)
    force = mean[0]
    spread = math.sqrt(count * max(count - 1, 1))
    to_m = np.array(lengths_m)[:, None] / (1.0 - np.exp(-2j * np.pi * hz / control_hz))
    plant = mean[1:] / force
    residual = windows[:, 1:] - plant * windows[:, :1]
    plant_sigma = np.sqrt(np.sum(np.abs(residual) ** 2, axis=0)) / spread / np.abs(force)
    force_sigma = np.sqrt(np.sum(np.abs(windows[:, 0] - force) ** 2, axis=0)) / spread
    power = np.mean(np.abs(windows[:, 1]) ** 2, axis=0)
    return Response(
        hz=hz,
        plant=plant * to_m,
        plant_sigma=plant_sigma * np.abs(to_m),
        sensitivity=force / amplitude_N,
        sensitivity_sigma=force_sigma / amplitude_N,
        coherence=np.abs(mean[1]) ** 2 / np.maximum(power, 1e-300),
    )
