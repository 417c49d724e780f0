# SPDX-License-Identifier: Apache-2.0
"""Opens a bus by python-can's options. A simulated drive is a python-can plugin like any other interface.

Everyone who talks to a drive comes through `open_bus`; nothing here imports a simulator.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import can

from kontur.errors import BusError, KonturError

_READY_AT_ONCE = ("socket://", "/dev/pts/")


def open_bus(options: Mapping[str, Any]) -> can.BusABC:
    """Open a bus by python-can's options. Raises BusError; of the simulated drive, the reason why it does not start."""
    named = f"{options.get('inner', options.get('interface', '?'))}:{options.get('channel', '?')}"
    for name in ("interface", "inner"):  # inner: of a bad bus
        if options.get(name) == "slcan":
            ready = str(options.get("channel")).startswith(_READY_AT_ONCE)
            # python-can waits for adapters that start when they are opened
            options = {**({"sleep_after_open": 0} if ready else {}), **options, name: "kontur-slcan"}
    try:
        return can.Bus(**options)
    except (can.CanError, OSError, ValueError, TypeError, ImportError) as error:
        if isinstance(error.__cause__, KonturError):
            raise error.__cause__ from error
        raise BusError(
            f"bus {named} cannot be opened: {error}. Check -i, -c and -b (python-can's interface, channel, bitrate), "
            "or leave them out to use the simulated drive"
        ) from error
