# SPDX-License-Identifier: Apache-2.0
"""Force and position of an axis while it moves, from the telemetry of its drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kontur.commissioning.bias import Mover
from kontur.commissioning.response import Floats

_FORCE_EACH = 10  # ms from one sample of the force to the next


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
