# SPDX-License-Identifier: Apache-2.0
"""Jogging (profile velocity mode) and homing of an enabled drive, as CiA 402 defines them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from kontur.drive.device import Device
from kontur.drive.state_machine import ENABLE, RUN_PATH
from kontur.errors import DeviceError

VELOCITY_MODE, _HOMING = 3, 6
_STANDS = _ATTAINED = 1 << 12  # of the statusword: in profile velocity mode, and in homing mode
_FAILED = 1 << 13
_LIMITED = 1 << 11
_MODE_TIMEOUT_S = 2.0
_POLL_S = 0.005


def jog(
    device: Device,
    velocity_mps: Mapping[str, float],
    duration_s: float,
    stop_requested: Callable[[], bool] = lambda: False,
) -> bool:
    """Move the axes named in `velocity_mps` for `duration_s`, then let them slow down; returns when they stand.

    Returns False when they stopped before: at a soft limit or limit switch, or since `stop_requested` returned True.
    The drive must be enabled. Raises DeviceError (NoAnswerError, EmcyError), ParameterError.
    """
    targets = {f"target_velocity_{axis}": value * 1e6 for axis, value in velocity_mps.items()}
    change_mode(device, velocity_mps, VELOCITY_MODE)
    try:
        for name, value in targets.items():
            device.write(name, value)
        end_s = device.link.time_s + duration_s
        written = device.link.status_count
        moving_freely = True
        while moving_freely and device.link.time_s < end_s:
            device.link.wait(lambda: False, min(_POLL_S, end_s - device.link.time_s))
            device.faults.check()
            blocked = device.link.statuswords_since(written) and all(
                device.axes.status(axis) & (_LIMITED | _STANDS) == _LIMITED | _STANDS for axis in velocity_mps
            )
            moving_freely = not stop_requested() and not blocked
    finally:
        for name in targets:
            device.write(name, 0)
    device.axes.refresh()
    slowest_s = max(_deceleration_time_s(device, axis, abs(value)) for axis, value in velocity_mps.items())
    device.wait(
        lambda: all(device.axes.status(axis) & _STANDS for axis in velocity_mps),
        slowest_s + 2.0,
        "does not stop jogging",
    )
    return moving_freely


def home(device: Device, axis: str, stop_requested: Callable[[], bool] = lambda: False) -> bool:
    """Home `axis` by the drive's parameters (homing_method, homing_speed, home_offset); returns when it stands.

    False when `stop_requested` returned True before the end. The drive must be enabled. Raises DeviceError when the
    home point is not found (NoAnswerError, EmcyError).
    """
    limit = {end: device.read(f"position_limit_{axis}.{end}") for end in ("min", "max")}
    speed = {which: device.read(f"homing_speed_{axis}.{which}") * 1e3 for which in ("search", "zero")}  # nm/s
    reach_nm = limit["max"] - limit["min"]
    longest_s = 10.0 + reach_nm / speed["search"] + 2.0 * reach_nm / speed["zero"]
    change_mode(device, (axis,), _HOMING)
    device.write(f"controlword_{axis}", RUN_PATH)
    end_s = device.link.time_s + longest_s
    try:
        device.axes.refresh()  # the result of a homing before is gone
        while True:
            device.link.wait(lambda: False, _POLL_S)
            device.faults.check()
            status = device.axes.status(axis)
            if status & _FAILED:
                raise DeviceError(
                    f"axis {axis} has found no home point within its travel; check the limit switches and the index "
                    f"pulse (digital_inputs_{axis}), homing_method_{axis} and homing_speed_{axis}"
                )
            if status & _ATTAINED:
                return True
            if stop_requested():
                return False
            if device.link.time_s > end_s:
                raise DeviceError(f"axis {axis} has not found its home point within {longest_s:.0f} s")
    finally:
        device.write(f"controlword_{axis}", ENABLE)


def change_mode(device: Device, axes: Mapping[str, float] | tuple[str, ...], mode: int) -> None:
    """Bring these axes, which stand, to a mode of operation (6060h). Raises DeviceError when they do not change."""
    for axis in axes:
        device.write(f"mode_{axis}", mode)
    end_s = device.link.time_s + _MODE_TIMEOUT_S
    while any(device.read(f"mode_display_{axis}") != mode for axis in axes):
        if device.link.time_s > end_s:
            raise DeviceError(f"the drive does not change to mode {mode}; it changes at standstill only")
        device.link.wait(lambda: False, _POLL_S)
    device.axes.refresh()  # the statuswords are those of the mode


def _deceleration_time_s(device: Device, axis: str, speed_mps: float) -> float:
    deceleration_mps2: float = device.read(f"profile_deceleration_{axis}") * 1e-6
    return speed_mps / deceleration_mps2
