# SPDX-License-Identifier: Apache-2.0
"""The STM32F405 image in QEMU: machine `netduinoplus2`, the same ELF that a board gets, slcan on its serial port.

    with start(IMAGE) as emulator, open_bus(emulator.options()) as bus:
        ...

QEMU ends with the block. It has no CAN controller, no DAC and no watchdog, and its timers read no encoders. So the
axes stand at zero, unless the machine is simulated on the drive (`onchip_plant`).
"""

from __future__ import annotations

import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from kontur.errors import SimulatorError
from kontur.sim.process import text_of

PROGRAM = "qemu-system-arm"
_START_S, _END_S = 30.0, 10.0
_ANSWER_S = 0.1


@dataclass
class Emulator:
    """A running image: `port` of 127.0.0.1 is its serial line, `gdb_port` QEMU's debugger, which halts it."""

    process: subprocess.Popen[bytes]
    port: int
    gdb_port: int
    _stderr: IO[bytes]

    def options(self) -> dict[str, Any]:
        """python-can's options to open the bus with."""
        return {"interface": "slcan", "channel": f"socket://127.0.0.1:{self.port}", "sleep_after_open": 0}

    def messages(self) -> str:
        """The messages of QEMU so far."""
        return text_of(self._stderr)


def _listening(stack: ExitStack) -> socket.socket:
    """A socket that already listens: whoever connects before QEMU is up waits in its queue."""
    listener = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
    listener.set_inheritable(True)
    return listener


def _wait_for(port: int, process: subprocess.Popen[bytes], image: Path, stderr: IO[bytes]) -> None:
    """Wait until the image answers an empty line. Bytes before its serial port is set up are lost."""
    end_s = time.monotonic() + _START_S
    with socket.create_connection(("127.0.0.1", port), _START_S) as serial:
        serial.settimeout(_ANSWER_S)
        while time.monotonic() < end_s and process.poll() is None:
            with suppress(OSError):  # it is silent, or QEMU has ended
                serial.sendall(b"\r")
                if serial.recv(1):
                    return
    said = text_of(stderr).strip().splitlines() or [f"it does not answer on its serial port, {_START_S:g} s waited"]
    raise SimulatorError(f"{image} does not run in QEMU: {said[0]}. Is it the ELF file of `make firmware`?")


@contextmanager
def start(image: Path, usart: int = 1) -> Iterator[Emulator]:
    """Power on a board with `image`, an ELF file, whose slcan is on `usart`.

    Raises SimulatorError when QEMU or the image is not there.
    """
    program = shutil.which(PROGRAM)
    if program is None:
        raise SimulatorError(f"{PROGRAM} is not installed; on Debian: sudo apt-get install qemu-system-arm")
    if not image.is_file():
        raise SimulatorError(f"{image} is not there; make it by `make firmware`")
    with ExitStack() as stack:
        serial, debugger = _listening(stack), _listening(stack)
        stderr = stack.enter_context(tempfile.TemporaryFile())
        arguments = [program, "-M", "netduinoplus2", "-display", "none", "-monitor", "none", "-kernel", str(image)]
        for name, listener in (("serial", serial), ("debugger", debugger)):
            arguments += ["-chardev", f"socket,id={name},fd={listener.fileno()},server=on,wait=off,nodelay=on"]
        arguments += ["-serial", "null"] * (usart - 1) + ["-serial", "chardev:serial", "-gdb", "chardev:debugger"]
        process = stack.enter_context(
            subprocess.Popen(
                arguments, pass_fds=(serial.fileno(), debugger.fileno()), stdin=subprocess.DEVNULL, stderr=stderr
            )
        )
        stack.callback(process.kill)
        _wait_for(serial.getsockname()[1], process, image, stderr)
        yield Emulator(process, serial.getsockname()[1], debugger.getsockname()[1], stderr)
        if process.poll() is not None:
            raise SimulatorError(f"{PROGRAM} has ended by itself, status {process.returncode}")
        process.terminate()
        process.wait(_END_S)
