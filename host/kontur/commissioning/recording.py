# SPDX-License-Identifier: Apache-2.0
"""Force and position of an axis while it moves, from the telemetry of its drive, and from its scope."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from kontur.commissioning.bias import SETTLE_S, Mover
from kontur.commissioning.encoder import count_m
from kontur.commissioning.response import Floats
from kontur.drive import scope
from kontur.drive.device import Device
from kontur.errors import DeviceError

_FORCE_EACH = 10  # ms from one sample of the force to the next
_SAMPLES = 6144  # of the scope (docs/scope.md)
_ARMING_S = 0.3
_TIMEOUT_S = 2.0


@dataclass(frozen=True, eq=False)
class Recording:
    """One row each time the force was sent (10 ms): `time_s`, `position_m`, `force_N` of the axis, (n,) each, and
    `other_m`, the position of the other axis."""

    time_s: Floats
    position_m: Floats
    force_N: Floats
    other_m: Floats

    @property
    def velocity_mps(self) -> float:
        """The mean velocity."""
        return float(np.polyfit(self.time_s, self.position_m, 1)[0])


class Recorder:
    """Records between start() and stop()."""

    def __init__(self, mover: Mover) -> None:
        self._device, self._axis = mover.device, mover.axis

    def start(self) -> None:
        self._start_nm = self._device.position_nm()
        self._device.link.record_telemetry()

    def stop(self) -> Recording:
        found = self._device.link.recorded_telemetry(self._start_nm)
        force_N = np.asarray(found.values[f"force_{self._axis}"], dtype=np.float64)
        new = np.nonzero(np.isfinite(force_N) & (found.tick % _FORCE_EACH == _phase(found.tick, force_N)))[0]
        other = "y" if self._axis == "x" else "x"
        return Recording(
            np.asarray(found.tick[new] * 1e-3, dtype=np.float64),
            found.values[f"position_{self._axis}"][new],
            force_N[new],
            found.values[f"position_{other}"][new],
        )


def record(mover: Mover, duration_s: float) -> Recording:
    """What happens in this time."""
    recorder = Recorder(mover)
    recorder.start()
    mover.pause(duration_s)
    return recorder.stop()


def _phase(tick: np.ndarray[tuple[int, ...], np.dtype[np.int64]], force_N: Floats) -> int:
    """The tick modulo 10 at which the force changes: when it was sent."""
    changes = tick[1:][np.diff(force_N) != 0.0] % _FORCE_EACH
    return int(np.bincount(changes, minlength=_FORCE_EACH).argmax()) if len(changes) else 0


# --- by the scope -----------------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Scan:
    """An axis by the scope of its drive: `first_m` by its encoder and `second_m` by its scale, None where there is
    none; both are as counted. `force_N`: demand; (n,) each. `origin_m`: the user's position less `first_m`."""

    time_s: Floats
    first_m: Floats
    second_m: Floats | None
    force_N: Floats
    origin_m: float = 0.0

    @property
    def velocity_mps(self) -> float:
        """The mean velocity."""
        return float(np.polyfit(self.time_s, self.first_m, 1)[0])

    @property
    def user_m(self) -> Floats:
        return self.first_m + self.origin_m

    @property
    def ahead_m(self) -> Floats:
        """By how much the scale is ahead of the encoder."""
        assert self.second_m is not None
        return self.second_m - self.first_m


class ScopeRecorder:
    """Records an axis from start() on with the drive's scope, for `duration_s` at most."""

    def __init__(self, device: Device, axis: str, duration_s: float) -> None:
        self._device, self._axis = device, axis
        self.counts_m = [count_m(device, axis), float(device.read(f"second_encoder_{axis}.length")) * 1e-6]
        names = [f"encoder_count_{axis}", f"force_{axis}"]
        if self.counts_m[1] > 0.0:
            names += [f"second_count_{axis}", f"position_{axis}"]
        control_hz = int(device.read("clock.control_hz"))
        frames = _SAMPLES // len(names)
        divider = max(1, round(duration_s * control_hz) // frames)
        self.duration_s = frames * divider / control_hz
        """How long it records."""
        self._setup = scope.Setup(tuple(names), scope.trigger("now"), 0.0, divider)

    def start(self) -> None:
        with self._faults_first():
            scope.arm(self._device, self._setup)

    @contextmanager
    def _faults_first(self) -> Iterator[None]:
        """A scope that keeps the capture of a fault refuses: that fault is what to report."""
        try:
            yield
        except DeviceError:
            self._device.faults.check()
            raise

    def wait(self, mover: Mover) -> None:
        """Let it record to its end, by the time of the drive, which is not that of this program."""
        mover.pause(self.duration_s)
        self._complete()

    def _complete(self) -> None:
        if not scope.wait(self._device, _TIMEOUT_S):
            raise DeviceError("the scope of the drive does not end its recording; arm it no other way meanwhile")

    def read(self) -> Scan:
        """What was recorded. Takes a moment; the axis should be at rest."""
        self._complete()
        found = scope.read(self._device)
        with self._faults_first():
            scope.release(self._device)
        first_m = found[f"encoder_count_{self._axis}"] * self.counts_m[0]
        force_N = found[f"force_{self._axis}"]
        if self.counts_m[1] == 0.0:
            return Scan(found.time_s, first_m, None, force_N)
        second_m = found[f"second_count_{self._axis}"] * self.counts_m[1]
        user_m = found[f"position_{self._axis}"] * 1e-3
        return Scan(found.time_s, first_m, second_m, force_N, float(np.mean(user_m - second_m)))


def scan(mover: Mover, velocity_mps: float, longest_s: float, settle_s: float) -> Scan:
    """Move at constant speed for as long as the travel allows, `longest_s` at most."""
    speed_mps, sign = abs(velocity_mps), 1.0 if velocity_mps > 0.0 else -1.0

    def measure() -> Scan:
        room_s = mover.longest_s(speed_mps, sign) - max(0.0, settle_s - SETTLE_S) - _ARMING_S
        recorder = ScopeRecorder(mover.device, mover.axis, min(longest_s, room_s))
        with mover.moving(velocity_mps, settle_s):
            recorder.start()
            recorder.wait(mover)
        return recorder.read()

    return mover.steadily(measure)
