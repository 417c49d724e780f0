# SPDX-License-Identifier: Apache-2.0
"""A drive at the other end of a link. A `Device` reads and writes its objects; its parts do the rest.

| part | what it is for |
|---|---|
| `device.parameters` | parameters: set together, read together, stored in the drive (kontur.drive.parameters) |
| `device.master` | which host commands the drive (kontur.drive.master) |
| `device.axes` | CiA 402's state machine: enable, disable, controlwords (kontur.drive.state_machine) |
| `device.pdos` | its PDOs, as kontur needs them (kontur.drive.pdos) |
| `device.faults` | faults and warnings that the drive reports (kontur.drive.fault_reports) |

What moves axes takes a device: kontur.drive.stream (a trajectory), kontur.drive.single_axis (jogging, homing). Its
scope is in kontur.drive.scope.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import can

from kontur.can import wire
from kontur.can.link import Link
from kontur.drive.controllers import CONTROLLERS, named
from kontur.drive.objects import Objects
from kontur.drive.parameters import Parameters
from kontur.drive.state_machine import SETTLE_S, StateMachine, state_of
from kontur.errors import DeviceError, NoAnswerError, ParameterError
from kontur.planning.path_time import RATE_MAX

_SYNC_US = 1000  # time that passes at a SYNC where 1006h is 0
_CAN_STATES = ("error active", "error warning", "error passive", "off")


@dataclass(frozen=True)
class Info:
    """Identity and state of a drive. `warnings`, `error_code`: EMCY codes; `can`: state of its CAN controller; `tpdos`:
    identifiers of the TPDOs that it sends."""

    node_id: int
    name: str
    build: str
    num: str
    control_hz: int
    controller: str
    state: tuple[str, str]
    position_m: tuple[float, float]
    error_code: tuple[int, int]
    warnings: tuple[int, ...]
    can: str
    tpdos: dict[str, int]


class Device(Objects):
    """The drive at the other end of `link`. Raises NoAnswerError when there is none."""

    def __init__(self, link: Link) -> None:
        super().__init__(link)
        self.parameters = Parameters(self)
        self.axes = StateMachine(self)
        self.master = self.axes.master
        self.faults = self.axes.faults
        self.pdos = self.axes.pdos
        self.read("device_type")  # in one frame, so that another host that asks meanwhile does not disturb it
        if self.read_stable("clock.pace"):
            self._follow_sync()

    def info(self) -> Info:
        """Identity and state."""
        self.link.wait(lambda: False, SETTLE_S)
        x, y = (state_of(int(self.read(f"statusword_{axis}"))) for axis in "xy")
        return Info(
            node_id=self.link.node_id,
            name=self.read("device_name"),
            build=self.read("build_id"),
            num=self.read("num_backend"),
            control_hz=self.read("clock.control_hz"),
            controller=CONTROLLERS[self.read("controller.active")],
            state=(x, y),
            position_m=self.position_m(),
            error_code=(self.read("error_code_x"), self.read("error_code_y")),
            warnings=self.faults.warnings(),
            can=_CAN_STATES[self.read("can.state")],
            tpdos=self.pdos.sent(),
        )

    def position_nm(self) -> tuple[int, int]:
        """Position by the encoders."""
        return (int(self.read("position_actual_x")), int(self.read("position_actual_y")))

    def position_m(self) -> tuple[float, float]:
        """Position by the encoders."""
        x, y = self.position_nm()
        return (x * wire.M_PER_NM, y * wire.M_PER_NM)

    def demand_m(self) -> tuple[float, float]:
        """Where the drive holds its enabled axes (6062h)."""
        x, y = (int(self.read(f"position_demand_{axis}")) * wire.M_PER_NM for axis in "xy")
        return (x, y)

    def select_controller(self, name: str) -> None:
        """Use a controller from now on, by either of its names. Raises ParameterError."""
        self.write("controller.select", CONTROLLERS.index(named(name)))

    def override_feed(self, rate: float) -> None:
        """Let streams run at `rate` of the programmed speed, 0 to 1.2, from now on; 0 holds them on their path.

        Above 1 the accelerations grow with the square of it, beyond what was planned. Raises ParameterError.
        """
        if not 0.0 <= rate <= RATE_MAX:
            raise ParameterError(f"feed override {rate * 100:g} % is out of range; it must be 0..{RATE_MAX * 100:g} %")
        self.write("feed_override", rate * 100.0)

    def wait(self, condition: Callable[[], bool], timeout_s: float, otherwise: str) -> None:
        """Handle frames until `condition` holds. Raises EmcyError when the drive reports a fault, else NoAnswerError.

        `otherwise` ends the sentence "the drive ..." of that message, e.g. "does not stop".
        """

        def done() -> bool:
            self.faults.check()
            return condition()

        if not self.link.wait(done, timeout_s):
            raise NoAnswerError(f"the drive (node {self.link.node_id}) {otherwise}, {timeout_s:g} s waited")

    def _follow_sync(self) -> None:
        period_us = int(self.read_stable("sync_period")) or _SYNC_US
        if period_us % 1000:
            raise DeviceError(
                f"the drive's time passes with SYNC, {period_us} us at each (sync_period): kontur needs whole ms; "
                "set object 1006h to 1000"
            )
        self.link.follow_sync(self._tick_ms(), period_us // 1000)

    def _tick_ms(self) -> int:
        """The drive's tick, the same in two reads, or where another host's SYNC lets it go on, the last one."""
        try:
            return int(self.read_stable("clock.tick"))
        except NoAnswerError:
            raise
        except DeviceError:
            return int(self.read("clock.tick"))


@contextmanager
def connected(bus: can.BusABC, node_id: int) -> Iterator[Device]:
    """The drive on `bus`; at the end PDOs are as they were found, and the bus is shut down."""
    try:
        device = Device(Link(bus, node_id))
        try:
            yield device
        finally:
            device.pdos.restore()
    finally:
        bus.shutdown()
