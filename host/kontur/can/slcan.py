# SPDX-License-Identifier: Apache-2.0
"""python-can's slcan bus, read as fast as the drive sends: `can.Bus(interface="kontur-slcan", ...)`, as slcan.

python-can reads a byte at a time, which takes about 100 us a frame. A host that has fallen behind a drive with 2,700
frames a second then hardly catches up, and acts on old statuswords. Here all bytes that have arrived are read together,
and recv(0) returns a frame that has arrived.
"""

from __future__ import annotations

import os
import select
import socket
import time
from collections import deque
from contextlib import suppress
from typing import Any

import can
from can.interfaces.slcan import slcanBus

_READ = 65536


class SlcanBus(slcanBus):
    """python-can's slcan, but fast. Raises what slcanBus raises; CanOperationError when the other end closes."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self._lines: deque[str] = deque()
        self._rest = b""
        super().__init__(*arguments, **options)
        with suppress(OSError), socket.socket(fileno=os.dup(self.serialPortOrig.fileno())) as connection:
            # so that TCP does not delay a frame by some 40 ms until the one before is acknowledged; serial ports do not
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def _write(self, string: str) -> None:
        """Send a line, the first one only if no other program uses the port: it would end what that one does."""
        port = self.serialPortOrig
        if port.is_open and not port.exclusive:
            try:
                port.exclusive = True
            except OSError:
                port.close()
                raise
        try:
            super()._write(string)
        except can.CanOperationError as error:
            raise can.CanOperationError(f"{self._closed()} ({error.__cause__})") from error

    def _closed(self) -> str:
        port = str(self.serialPortOrig.port)
        if "://" not in port:
            return f"{port}: the other end has closed the connection, or is unplugged"
        return f"{port}: the other end has closed the connection; it has ended, or serves another program at present"

    def _read(self, timeout: float | None) -> str | None:
        end_s = None if timeout is None else time.monotonic() + timeout
        while not self._lines:
            left_s = None if end_s is None else max(0.0, end_s - time.monotonic())
            try:
                descriptor = self.serialPortOrig.fileno()
                if not select.select([descriptor], [], [], left_s)[0]:
                    return None
                data = os.read(descriptor, _READ)
            except (OSError, ValueError) as error:
                raise can.CanOperationError(f"{self.serialPortOrig.port}: cannot be read: {error}") from error
            if not data:
                raise can.CanOperationError(self._closed())
            # An answer ends in CR, a refusal is a BEL.
            *lines, self._rest = (self._rest + data).replace(b"\a", b"\a\r").split(b"\r")
            self._lines += [line.decode(errors="replace") + "\r" for line in lines]
        return self._lines.popleft()

    def close(self) -> None:
        """Close the channel, if the other end is still there."""
        with suppress(can.CanOperationError):
            super().close()

    def flush(self) -> None:
        """Discard what has arrived and was not received."""
        self._lines.clear()
        self._rest = b""
        super().flush()
