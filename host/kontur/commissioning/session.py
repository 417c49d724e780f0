# SPDX-License-Identifier: Apache-2.0
"""Identification of several axes by one drive, which gets its parameters back afterwards."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress

from kontur.commissioning.first_moves import Agreed
from kontur.commissioning.identify import Identified, identify
from kontur.drive.device import Device
from kontur.errors import KonturError


@contextmanager
def parameters_kept(device: Device) -> Iterator[None]:
    """All parameters and the controller are afterwards as they were, whatever happened."""
    before, controller = device.parameters.dump(), device.read("controller.select")
    try:
        yield
    finally:
        with suppress(KonturError):  # the first error is the one to report
            device.axes.disable()
        now = device.parameters.dump()
        device.parameters.set({name: value for name, value in before.items() if now[name] != value})
        device.write("controller.select", controller)


def identify_axes(
    device: Device,
    axes: Sequence[str],
    force_N: float | None,
    share: float,
    speed_mps: float,
    index_m: float,
    encoder_known: bool,
    say: Callable[[str], None],
    stop_requested: Callable[[], bool],
) -> dict[str, Identified]:
    """Identify each of `axes`. `force_N`: the largest force; without it `share` of the force limit.
    `index_m`, `encoder_known`: as in Agreed."""
    found: dict[str, Identified] = {}
    with parameters_kept(device):
        for axis in axes:
            limit_N = float(device.read(f"plant_{axis}.force_limit"))
            agreed = Agreed(min(force_N or share * limit_N, limit_N), speed_mps, index_m, encoder_known)
            found[axis] = identify(device, axis, agreed, say, stop_requested)
    return found
