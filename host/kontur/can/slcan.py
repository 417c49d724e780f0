# SPDX-License-Identifier: Apache-2.0
"""python-can's slcan bus, for a drive that sends 2,700 frames a second: `can.Bus(interface="kontur-slcan", ...)`.

python-can reads a byte at a time, which takes about 100 us a frame. A host that has fallen behind then hardly catches
up, and acts on old statuswords. Here all bytes that have arrived are read together, and recv(0) returns a frame that
has arrived. A line that is damaged is dropped and counted; python-can raises ValueError, or takes it for another frame.
Sending does not block: while the serial port takes no more, send() raises ENOBUFS, like SocketCAN.
"""

from __future__ import annotations

import errno
import os
import re
import select
import socket
import threading
import time
from collections import deque
from contextlib import suppress
from typing import Any

import can
from can.interfaces.slcan import slcanBus
from can.util import dlc2len

_READ = 65536
_LINE = 256  # bytes; a frame of CAN FD has 142 at most
_STAMP = 4  # digits behind the data, if the other end sends time stamps
_FRAME = re.compile(rb"([trdb][0-7][0-9A-Fa-f]{2}|[TRDBx][01][0-9A-Fa-f]{7})([0-9A-Fa-f])([0-9A-Fa-f]*)")
_REMOTE, _FD = b"rR", b"dDbB"
_ANSWER = re.compile(rb"[VNF][0-9A-Fa-f]*")
_NO_FRAME = (b"", b"\a", b"z", b"Z", b"z\a", b"Z\a")  # accepted, refused, a frame was accepted


class SlcanBus(slcanBus):
    """python-can's slcan, but fast. Raises what slcanBus raises; CanOperationError when the other end closes.

    `garbled`: lines received that were no frame.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self.garbled = 0
        self._lines: deque[str] = deque()
        self._rest = b""  # of the line that is being received
        self._out = b""  # of the line that is being sent
        self._lock = threading.Lock()  # of _out: a thread may send while another one receives
        super().__init__(*arguments, **options)
        if str(self.serialPortOrig.port).startswith("socket://"):
            # so that TCP does not delay a frame by some 40 ms until the one before is acknowledged
            with suppress(OSError), socket.socket(fileno=os.dup(self.serialPortOrig.fileno())) as connection:
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def _read(self, timeout: float | None) -> str | None:
        end_s = None if timeout is None else time.monotonic() + timeout
        while not self._lines:
            left_s = None if end_s is None else max(0.0, end_s - time.monotonic())
            self._send_out()
            try:
                descriptor = self.serialPortOrig.fileno()
                readable, writable, _ = select.select([descriptor], [descriptor] if self._out else [], [], left_s)
                if writable and not readable:
                    continue
                if not readable:
                    return None
                data = os.read(descriptor, _READ)
            except (OSError, ValueError) as error:
                raise can.CanOperationError(f"{self.serialPortOrig.port}: cannot be read: {error}") from error
            if not data:
                raise can.CanOperationError(self._closed())
            self._split(data)
        return self._lines.popleft()

    def _split(self, data: bytes) -> None:
        # A line ends in CR, LF, or both; a refusal is a BEL.
        *lines, rest = (self._rest + data).replace(b"\n", b"\r").replace(b"\a", b"\a\r").split(b"\r")
        self._rest = rest[:_LINE]
        for line in lines:
            if _is_frame(line) or _ANSWER.fullmatch(line):
                self._lines.append(line.decode() + "\r")
            elif line not in _NO_FRAME:
                self.garbled += 1

    def _write(self, string: str) -> None:
        """Send a line, the first one only if no other program uses the port: it would end what that one does."""
        port = self.serialPortOrig
        if port.is_open and not port.exclusive:
            try:
                port.exclusive = True
            except OSError:
                port.close()
                raise
        if not self._send_out(string.encode() + self.LINE_TERMINATOR):
            raise can.CanOperationError(f"{port.port}: the transmit buffer is full", errno.ENOBUFS)

    def _send_out(self, line: bytes = b"") -> bool:
        """Send the rest of the line before, and this one if that was possible. False: it was not."""
        with self._lock:
            try:
                while self._out or line:
                    if not self._out:
                        self._out, line = line, b""
                    self._out = self._out[os.write(self.serialPortOrig.fileno(), self._out) :]
            except BlockingIOError:
                return not line
            except (OSError, ValueError) as error:
                raise can.CanOperationError(f"{self._closed()} ({error})") from error
            return True

    def _closed(self) -> str:
        port = str(self.serialPortOrig.port)
        if "://" not in port:
            return f"{port}: the other end has closed the connection, or is unplugged"
        return f"{port}: the other end has closed the connection; it has ended, or serves another program at present"

    def close(self) -> None:
        """Close the channel, if the other end is still there."""
        with suppress(can.CanOperationError):
            super().close()

    def flush(self) -> None:
        """Discard what has arrived and was not received."""
        self._lines.clear()
        self._rest = b""
        super().flush()


def _is_frame(line: bytes) -> bool:
    match = _FRAME.fullmatch(line)
    if match is None:
        return False
    kind, code = match[1][:1], int(match[2], 16)
    if kind not in _FD and code > 8:
        return False
    digits = 0 if kind in _REMOTE else 2 * dlc2len(code)
    return len(match[3]) in (digits, digits + _STAMP)
