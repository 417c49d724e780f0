# SPDX-License-Identifier: Apache-2.0
"""The simulated drive as a process on a bus: `kontur-sim` (firmware/port/linux), made by `make lib`.

    with start(slcan_tcp="0") as sim, can.Bus(**sim.options()) as bus:
        ...

The process ends with the block, and with this program, however that ends.
"""

from __future__ import annotations

import os
import selectors
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from kontur import machine as machines
from kontur.can.simulated import Truth
from kontur.errors import FileError, LibraryError, SimulatorError
from kontur.files import check_folder
from kontur.machine import Machine
from kontur.sim.library import LIBRARIES, truth_of

PROGRAM = LIBRARIES / "kontur-sim"
_READY = b"kontur-sim: ready on "
_START_S = 30.0
_END_S = 30.0


@dataclass
class SimProcess:
    """A simulated drive that is ready; `interface` and `channel` are python-can's."""

    process: subprocess.Popen[bytes]
    interface: str
    channel: str
    _stderr: IO[bytes]

    def options(self) -> dict[str, Any]:
        """python-can's options to open the bus with."""
        options: dict[str, Any] = {"interface": self.interface, "channel": self.channel}
        return options | ({"sleep_after_open": 0} if self.interface == "slcan" else {})

    def messages(self) -> str:
        """The messages of the process so far."""
        return text_of(self._stderr)

    def end(self) -> None:
        """Power the drive off. Raises SimulatorError when the process has failed, with its message."""
        self.process.terminate()
        try:
            status = self.process.wait(_END_S)
        except subprocess.TimeoutExpired as error:
            self.process.kill()
            raise SimulatorError(f"{PROGRAM.name} did not end within {_END_S:g} s and was killed") from error
        if status != 0:
            raise SimulatorError(self.messages().strip() or f"{PROGRAM.name} has ended with status {status}")


@contextmanager
def start(
    *,
    can: str | None = None,
    slcan_tcp: str | None = None,
    slcan_pty: bool = False,
    pace: str = "clock",
    machine: Machine | str | Path = machines.DEFAULT,
    seed: int = 1,
    node_id: int = 1,
    num: str = "f32",
    record: Path | None = None,
    store: Path | None = None,
) -> Iterator[SimProcess]:
    """Power on a drive on one bus: `can` interface, `slcan_tcp` "[HOST:]PORT" (0: any free port), or `slcan_pty`.

    `pace`: "clock" (the wall clock's) or "sync" (1006h at each SYNC). `machine`: a Machine or the name of a file.
    `record`: gets the truth at power-off, see read_record(). `store`: the flash that parameters are stored in (1010h),
    read at power-on if there is one, written at power-off. Raises LibraryError when the program is not built,
    MachineError, FileError where there is no folder for `record` or `store`, SimulatorError with the message of a
    process that failed, or where this is not Linux.
    """
    if sys.platform != "linux":
        raise SimulatorError(
            f"{PROGRAM.name} runs on Linux only; without bus options a command simulates the drive in its own process"
        )
    for file in filter(None, (record, store)):
        check_folder(file)
    arguments = [str(PROGRAM), "--seed", str(seed), "--node", str(node_id), "--num", num, "--pace", pace]
    arguments += ["--with-parent"]
    arguments += ["--can", can] if can is not None else []
    arguments += ["--slcan-tcp", slcan_tcp] if slcan_tcp is not None else []
    arguments += ["--slcan-pty"] if slcan_pty else []
    arguments += ["--store", str(store)] if store is not None else []
    arguments += ["--record", str(record)] if record is not None else []
    plant = machine if isinstance(machine, Machine) else machines.load(machine)
    with tempfile.TemporaryFile() as stderr:
        try:
            process = subprocess.Popen(
                [*arguments, "--machine", "-"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=stderr
            )
        except OSError as error:
            raise LibraryError(f"{PROGRAM} cannot be run ({error.strerror}); run `make lib`") from error
        with process:
            try:
                assert process.stdin is not None
                with suppress(BrokenPipeError), process.stdin as stdin:  # it has ended; its message says why
                    stdin.write(plain_machine(plant).encode())
                interface, channel = _ready(process, stderr)
                sim = SimProcess(process, interface, channel, stderr)
                yield sim
                sim.end()
            finally:
                process.kill()


def plain_machine(machine: Machine) -> str:
    """The machine as kontur-sim reads it (firmware/port/linux/machine_file.h)."""
    lines = (
        [name, *(repr(+value) for value in values)] for name, values in machine.simulated().items()
    )  # +: False is 0
    return "".join(" ".join(line) + "\n" for line in lines)


def read_record(file: Path) -> Truth:
    """The truth that `record` wrote: row i is of control period i since power-on. Raises FileError."""
    try:
        return truth_of(file.read_bytes())
    except (OSError, ValueError) as error:
        raise FileError(file, f"is no record of kontur-sim ({error}); it is written when the process ends") from error


def _ready(process: subprocess.Popen[bytes], stderr: IO[bytes]) -> tuple[str, str]:
    """Interface and channel on which the process is ready, as it prints them."""
    assert process.stdout is not None
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)
        if not selector.select(_START_S):
            raise SimulatorError(f"{PROGRAM.name} does not answer, {_START_S:g} s waited; is the machine overloaded?")
    line = process.stdout.readline()
    if not line.startswith(_READY):
        process.wait()
        raise SimulatorError(text_of(stderr).strip() or f"{PROGRAM.name} does not start: status {process.returncode}")
    interface, channel = line.removeprefix(_READY).decode().split()
    return interface, channel


def text_of(file: IO[bytes]) -> str:
    """What a process has written to `file` so far."""
    # The process writes through the same file description, whose position must not move.
    return os.pread(file.fileno(), os.fstat(file.fileno()).st_size, 0).decode(errors="replace")
