# SPDX-License-Identifier: Apache-2.0
"""As much of gdb's remote protocol as a test needs to bring a running image into trouble (GDB manual, appendix E)."""

from __future__ import annotations

import socket
from collections.abc import Mapping

SP, PC = 13, 15
_TIMEOUT_S = 60.0


def set_registers(port: int, registers: Mapping[int, int]) -> None:
    """Stop the processor behind `port` where it is, set core registers, let it go on."""
    with socket.create_connection(("127.0.0.1", port), _TIMEOUT_S) as server:
        server.settimeout(_TIMEOUT_S)
        _command(server, "qXfer:features:read:target.xml:0,800")  # QEMU sets no single register before
        for number, value in registers.items():
            assert _command(server, f"P{number:x}={value.to_bytes(4, 'little').hex()}") == "OK"
        assert _command(server, "D") == "OK"


def _command(server: socket.socket, text: str) -> str:
    server.sendall(f"${text}#{sum(text.encode()) & 0xFF:02x}".encode())
    received = b""
    while True:
        _, _, packet = received.partition(b"$")
        answer, end, rest = packet.partition(b"#")
        if not end or len(rest) < 2:
            received += server.recv(4096)
            continue
        server.sendall(b"+")
        if not answer.startswith(b"T"):  # that it has stopped, which it says unasked
            return answer.decode()
        received = rest[2:]
