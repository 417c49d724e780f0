# SPDX-License-Identifier: Apache-2.0
"""Commissioning over a drive's connection: parameters that come back afterwards, and identification of several axes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass

from kontur.commissioning.first_moves import Agreed
from kontur.commissioning.identify import Identified, identify
from kontur.drive.device import Device
from kontur.drive.target import Target, open_drive
from kontur.errors import KonturError

_NOT_RESTORED = "The drive has not got its parameters back. What is stored in it has not changed: switch it off and on."


@contextmanager
def parameters_kept(device: Device) -> Iterator[None]:
    """All parameters and the controller are afterwards as they were, whatever happened."""
    before, controller = device.parameters.dump(), device.read("controller.select")
    try:
        yield
    except BaseException as error:  # it is the one to report
        try:
            _restore(device, before, controller)
        except KonturError:
            error.args = (f"{error}\n{_NOT_RESTORED}",)
        raise
    _restore(device, before, controller)


@dataclass
class Session:
    """A drive that is being commissioned. `before`: its parameters, empty of a drive in this process, which is new each
    time. `keep`: whether it keeps the new ones."""

    before: Mapping[str, float]
    keep: bool = False


@contextmanager
def commissioned(target: Target, before: Mapping[str, float], warn: Callable[[str], None]) -> Iterator[Session]:
    """A drive on a bus has the parameters that it had, or those in `before`, afterwards, unless Session.keep is set.

    That holds after an error and after Ctrl-C, too. Where the drive cannot be reached any more, `warn` is told.
    """
    if target.in_process:
        yield Session({})
        return
    with open_drive(target) as device:
        controller = device.read("controller.select")
        session = Session(before or device.parameters.dump())
    try:
        yield session
    except KonturError as error:  # what parameters_kept() could not do may be done below
        error.args = (str(error).removesuffix(f"\n{_NOT_RESTORED}"),)
        raise
    finally:
        if not session.keep:
            try:
                with open_drive(target) as device:
                    _restore(device, session.before, controller)
            except KonturError as error:
                warn(f"{_NOT_RESTORED} ({error})")


def identify_axes(
    device: Device,
    agreed: Mapping[str, Agreed],
    ratings: Mapping[str, float],
    say: Callable[[str], None],
    stop_requested: Callable[[], bool],
) -> dict[str, Identified]:
    """Identify each axis in `agreed`. `ratings`: parameters that are set before. The drive gets all parameters back."""
    with parameters_kept(device):
        device.parameters.set(ratings)
        return {axis: identify(device, axis, one, say, stop_requested) for axis, one in agreed.items()}


def force_limits(device: Device, axes: Sequence[str], ratings: Mapping[str, float]) -> dict[str, float]:
    """The force limit of each axis, N: that of `ratings`, else that of the drive."""
    names = {axis: f"plant_{axis}.force_limit" for axis in axes}
    return {axis: float(ratings[name] if name in ratings else device.read(name)) for axis, name in names.items()}


def _restore(device: Device, before: Mapping[str, float], controller: float) -> None:
    with suppress(KonturError):  # then the parameters are refused
        device.axes.disable()
    now = device.parameters.dump()
    device.parameters.set({name: value for name, value in before.items() if now[name] != value})
    device.write("controller.select", controller)
