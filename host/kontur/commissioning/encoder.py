# SPDX-License-Identifier: Apache-2.0
"""The length of an encoder count, by two index pulses whose distance is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from kontur.can import wire
from kontur.drive import scope
from kontur.drive.axes import METHODS
from kontur.drive.device import Device
from kontur.drive.single_axis import home, jog
from kontur.errors import DeviceError

_OFF_PULSE, _OFF_PULSE_MPS = 0.05, 5e-3  # share of the distance of two pulses, and speed


def count_m(device: Device, axis: str) -> float:
    """The length of a count of the first encoder, as the drive has it."""
    return float(device.read(f"plant_{axis}.encoder")) * 1e-6


def length_m(
    device: Device, axis: str, index_m: float, stop_requested: Callable[[], bool] = lambda: False
) -> float | None:
    """The length of a count, where index pulses are `index_m` apart; None where there are none.

    Homes the axis to one pulse and then to the next one, by its homing method, one of method_of(). The drive, which
    must be enabled, has its zero where it was, afterwards.
    """
    each_m = count_m(device, axis)
    zero = _zero(device, axis, each_m)
    method = int(device.read(f"homing_method_{axis}"))
    pulses = []
    for k in range(2):
        if k > 0:  # off the pulse, which an axis that sticks would find again
            way_mps = _OFF_PULSE_MPS if method == METHODS["index+"] else -_OFF_PULSE_MPS
            jog(device, {axis: way_mps}, _OFF_PULSE * index_m / _OFF_PULSE_MPS, stop_requested)
        try:
            if not home(device, axis, stop_requested):
                raise KeyboardInterrupt
        except DeviceError:
            device.faults.check()
            return None
        pulses.append(_zero(device, axis, each_m))
    here_nm = float(device.read(f"position_actual_{axis}"))
    device.write(f"home_offset_{axis}", round(here_nm + (pulses[1] - zero) * each_m / wire.M_PER_NM))
    device.write(f"homing_method_{axis}", METHODS["here"])
    home(device, axis)
    return index_m / abs(pulses[1] - pulses[0])


def _zero(device: Device, axis: str, each_m: float) -> float:
    """What the encoder counts at the user's position 0. Both are of the same instants, so the axis may still settle."""
    count, position = f"encoder_count_{axis}", f"position_{axis}"
    scope.arm(device, scope.Setup((count, position), scope.trigger("now"), 0.0))
    if not scope.wait(device, 5.0):
        raise DeviceError("the scope of the drive records nothing")
    found = scope.read(device)
    return float(np.mean(found[count] - found[position] * 1e-3 / each_m))


def method_of(device: Device, axis: str) -> int:
    """The homing method (6098h) that goes where there is more room."""
    at_m = float(device.read(f"position_actual_{axis}")) * wire.M_PER_NM
    low, high = (float(device.read(f"position_limit_{axis}.{end}")) * wire.M_PER_NM for end in ("min", "max"))
    return METHODS["index+" if at_m - low < high - at_m else "index-"]
