# SPDX-License-Identifier: Apache-2.0
"""Firmware and simulated machine as a shared library, made by `make lib` (sim/kontur_sim.h).

kontur.sim.bus makes a python-can bus of it. Experiments that need no bus use it directly.
"""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from cffi import FFI
from numpy.typing import NDArray

from kontur.can.simulated import Plant, Truth
from kontur.errors import LibraryError, MachineError, SimulatorError
from kontur.machine import Machine

Floats = NDArray[np.float64]
LIBRARIES = Path(__file__).parents[1] / "lib"
_DOUBLES_PER_ROW = 10
_SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


def truth_of(rows: Any) -> Truth:
    """A copy of rows of struct ks_truth in memory (anything with the buffer protocol). Raises ValueError."""
    table = np.frombuffer(rows, dtype=np.float64).reshape(-1, _DOUBLES_PER_ROW).copy()
    pos_m, vel_mps, force_N, friction_N = (table[:, 2 * i : 2 * i + 2] for i in range(4))
    return Truth(pos_m, vel_mps, force_N, friction_N, digital=table[:, 8], power=table[:, 9])


@dataclass(frozen=True)
class Frame:
    """A frame that the drive sent at control period `tick` since power-on."""

    id: int
    data: bytes
    rtr: bool
    tick: int


@functools.cache
def _load(num: str) -> tuple[FFI, Any]:
    header = LIBRARIES / "kontur_sim.h"
    library = LIBRARIES / f"libkontur_{num}{_SUFFIX}"
    built = sorted(f.stem.removeprefix("libkontur_") for f in LIBRARIES.glob(f"libkontur_*{_SUFFIX}"))
    if not built or not header.exists():
        raise LibraryError(f"{LIBRARIES}: the simulator is not built; run `make lib` in the source folder")
    if num not in built:
        raise LibraryError(f"{library}: no such numeric back end; built are: {', '.join(built)}")
    ffi = FFI()
    try:
        ffi.cdef(header.read_text().split("/* CDEF-BEGIN */")[1].split("/* CDEF-END */")[0])
        return ffi, ffi.dlopen(str(library))
    except (OSError, IndexError) as error:
        raise LibraryError(
            f"{library}: cannot be loaded ({error}); run `make clean lib` in the source folder"
        ) from error


class Sim:
    """One simulated drive, freshly powered on. Time passes in step() and run() only. Not thread safe.

    Raises LibraryError when the library is missing, MachineError when it refuses the machine.
    """

    def __init__(self, machine: Machine, seed: int, node_id: int = 1, num: str = "f32") -> None:
        self._ffi, self._lib = _load(num)
        c_machine = self._c_machine(machine)
        field = self._lib.ks_check(c_machine)
        if field != self._ffi.NULL:
            raise MachineError(f"machine {machine.name!r}: {self._text(field)} is out of the simulator's range")
        self._ks = self._lib.ks_new(c_machine, seed, node_id)
        if self._ks == self._ffi.NULL:
            raise LibraryError(
                f"the simulator does not start: node id {node_id} must be 1..31, and there must be enough memory"
            )
        self._frame = self._ffi.new("struct ks_frame *")
        self._data = self._ffi.buffer(self._ffi.addressof(self._frame, "data"), 8)
        self.machine = machine
        self._plant: Any = None  # what C calls must live as long as the drive
        self._failed: BaseException | None = None
        self.control_hz: int = self._lib.ks_control_hz(self._ks)
        self.build: str = self._text(self._lib.ks_build(self._ks))
        self.num: str = self._text(self._lib.ks_num(self._ks))

    def close(self) -> None:
        """Power off and free the memory; the object cannot be used afterwards."""
        if self._ks is not None:
            self._lib.ks_free(self._ks)
            self._ks = None

    @property
    def tick(self) -> int:
        """Control periods since power-on."""
        tick: int = self._lib.ks_tick(self._ks)
        return tick

    def send(self, can_id: int, data: bytes | bytearray, rtr: bool = False) -> bool:
        """Send the drive a frame; False when it is not a classic frame with an 11-bit identifier."""
        accepted: bool = self._lib.ks_send(self._ks, can_id, rtr, len(data), bytes(data)) == 0
        return accepted

    def recv(self) -> Frame | None:
        """The oldest frame that the drive has sent, None when there is none."""
        frame = self._frame
        if not self._lib.ks_recv(self._ks, frame):
            return None
        return Frame(frame.id, self._data[: frame.len], bool(frame.rtr), frame.tick)

    def step(self, periods: int) -> int:
        """Let at most `periods` control periods pass, fewer when a frame comes; returns how many passed."""
        passed: int = self._lib.ks_step(self._ks, periods)
        self._check_plant()
        return passed

    def run(self, periods: int) -> None:
        """Let `periods` control periods pass."""
        self._lib.ks_run(self._ks, periods)
        self._check_plant()

    def set_plant(self, plant: Plant) -> None:
        """Let `plant` be the machine from now on. What it raises, step() and run() raise as SimulatorError."""

        def step(_ctx: Any, force_N: Any, pos_m: Any) -> None:
            if self._failed is None:
                x, y = (float(value) for value in plant.step((force_N[0], force_N[1])))
                if not (math.isfinite(x) and math.isfinite(y)):
                    raise ValueError(f"the position became {x:g}, {y:g} m; it must be two finite numbers")
                pos_m[0], pos_m[1] = x, y

        def failed(_kind: Any, error: BaseException, _traceback: Any) -> None:
            self._failed = self._failed or error

        self._plant = self._ffi.callback("void(void *, const double *, double *)", step, onerror=failed)
        self._lib.ks_set_plant(self._ks, self._plant, self._ffi.NULL)

    def _check_plant(self) -> None:
        if self._failed is not None:
            raise SimulatorError(
                f"the plant in Python failed: {type(self._failed).__name__}: {self._failed}"
            ) from self._failed

    def set_paced(self, by_sync: bool) -> None:
        """Set `clock.pace` of the drive: whether its time passes with SYNC. The caller then runs it at each SYNC."""
        self._lib.ks_set_paced(self._ks, by_sync)

    def set_entropy(self, noise: int) -> None:
        """What tickets are drawn with (32 bits), so that they are no other run's."""
        self._lib.ks_set_entropy(self._ks, noise)

    def periods_of(self, can_id: int) -> int:
        """Control periods that pass after a frame of this identifier, where time passes with SYNC."""
        if can_id != self._lib.ks_sync_id(self._ks):
            return 0
        return int(self._lib.ks_sync_us(self._ks)) * self.control_hz // 1_000_000

    def start_schedule(self) -> None:
        """Start the machine's friction schedule now."""
        self._lib.ks_start_schedule(self._ks)

    def record(self, on: bool) -> None:
        """Record the truth of each period from now on, discarding an older record; or stop recording."""
        self._lib.ks_record(self._ks, on)

    def truth(self) -> Truth:
        """A copy of what was recorded."""
        count = self._lib.ks_record_count(self._ks)
        data = self._lib.ks_record_data(self._ks)
        return truth_of(self._ffi.buffer(data, count * _DOUBLES_PER_ROW * 8) if count else b"")

    def push_knots(self, knots_nm: NDArray[np.int32]) -> int:
        """Put knots (n, 2) into the queue without the bus; returns how many were accepted."""
        knots = np.ascontiguousarray(knots_nm, dtype=np.int32)
        accepted: int = self._lib.ks_push_knots(self._ks, self._ffi.from_buffer("int32_t *", knots), len(knots))
        return accepted

    def _text(self, pointer: Any) -> str:
        return bytes(self._ffi.string(pointer)).decode()

    def _c_machine(self, machine: Machine) -> Any:
        c = self._ffi.new("struct ks_machine *")
        for field, values in machine.simulated().items():
            if isinstance(getattr(c, field), (int, float)):
                setattr(c, field, values[0])
            else:
                for i, value in enumerate(values):
                    getattr(c, field)[i] = value
        return c


def estimate(
    knots_nm: NDArray[np.int32],
    path_s: Floats,
    position_m: Floats,
    *,
    newton: bool = True,
    lag_max_ms: int,
    num: str = "f32",
) -> Floats:
    """The firmware's estimate (n, 2) in m of the error along the path and of the contour error, (3)-(9).

    The path is `knots_nm` (1..4096, 2); row i is for the reference at path time `path_s` (n,) and the axes at
    `position_m` (n, 2). Default parameters but for the Newton step and the longest lag, 1..1000 ms. Raises
    LibraryError; ValueError for arrays that do not fit or a lag out of range.
    """
    ffi, lib = _load(num)
    knots = np.ascontiguousarray(knots_nm, dtype=np.int32)
    time_s, position = (np.ascontiguousarray(a, dtype=np.float64) for a in (path_s, position_m))
    if position.shape != (time_s.size, 2):
        raise ValueError(f"path times {time_s.shape} and positions {position.shape} do not fit")
    e_n_m = np.empty_like(position)
    doubles = [ffi.from_buffer("double *", array) for array in (time_s, position, e_n_m)]
    if lib.ks_estimate(ffi.from_buffer("int32_t *", knots), len(knots), newton, lag_max_ms, time_s.size, *doubles):
        raise ValueError(
            f"{len(knots)} knots, lag up to {lag_max_ms} ms; there must be 1 to 4096 knots, and 1 to 1000 ms"
        )
    return e_n_m


def response(
    objects: Sequence[tuple[int, int, int]],
    controller: int,
    counts: int,
    periods: int,
    *,
    second: bool = False,
    num: str = "f32",
) -> Floats:
    """The firmware's force (`periods`, 2), N, on encoders that show `counts` in one control period and 0 else.

    The drive is at rest with power on (ks_response() in sim/kontur_sim.h). `objects`: (index, sub-index, value on the
    wire) in place of defaults. `controller`: as in `controller.select`. `second`: the second encoders show it. Raises
    LibraryError; ValueError for objects that the firmware refuses.
    """
    ffi, lib = _load(num)
    address = ffi.new("uint32_t[]", [index << 8 | sub for index, sub, _ in objects])
    value = ffi.new("int64_t[]", [raw for _, _, raw in objects])
    force_N = np.empty((periods, 2))
    doubles = ffi.from_buffer("double *", force_N)
    if lib.ks_response(len(objects), address, value, controller, second, counts, periods, doubles):
        raise ValueError("an object is out of range, or the parameters do not fit together")
    return force_N
