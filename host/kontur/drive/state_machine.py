# SPDX-License-Identifier: Apache-2.0
"""The CiA 402 state machine of both axes, which are switched together (`device.axes`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from kontur.can import wire
from kontur.can.emcy import describe_emcy
from kontur.can.link import RESEND_S
from kontur.drive.fault_reports import FaultReports
from kontur.drive.master import Master
from kontur.drive.objects import Objects
from kontur.drive.pdos import COMMANDS, DATED, Pdos
from kontur.errors import DeviceError, KonturError, NoAnswerError

# Controlwords of CiA 402, and its states by (mask, value) of the statusword.
SHUTDOWN, SWITCH_ON, ENABLE, DISABLE_VOLTAGE, FAULT_RESET = 0x06, 0x07, 0x0F, 0x00, 0x80
RUN_PATH = ENABLE | 0x10
"""In interpolated position mode bit 4 lets path time run."""
BIT_TARGET_REACHED, BIT_PATH_RUNS = 1 << 10, 1 << 12

SETTLE_S = 0.01  # after power-on or a change of state, until the drive's objects and statuswords are current

_STATES = (
    ("fault", 0x4F, 0x08),
    ("fault reaction active", 0x4F, 0x0F),
    ("not ready to switch on", 0x4F, 0x00),
    ("switch on disabled", 0x4F, 0x40),
    ("ready to switch on", 0x6F, 0x21),
    ("switched on", 0x6F, 0x23),
    ("operation enabled", 0x6F, 0x27),
    ("quick stop active", 0x6F, 0x07),
)
_TOWARDS_ENABLED = {
    "fault": FAULT_RESET,
    "switch on disabled": SHUTDOWN,
    "ready to switch on": SWITCH_ON,
    "switched on": ENABLE,
    "operation enabled": ENABLE,
}
_MODE_INTERPOLATED = 7
_STATE_TIMEOUT_S = 2.0
_STOP_TIMEOUT_S = 5.0  # limits.path_stop_time is at most 1 s


def state_of(statusword: int) -> str:
    """CiA 402's name of the state that a statusword tells."""
    return next((name for name, mask, value in _STATES if statusword & mask == value), "unknown")


class StateMachine:
    """Both axes of a drive: their states, and the controlwords that change them."""

    def __init__(self, objects: Objects) -> None:
        self._objects = objects
        self._link = objects.link
        self.master = Master(objects, lambda: "fault reaction active" in self.states())
        self.faults = FaultReports(objects)
        self.pdos = Pdos(objects)

    def enable(self, also: tuple[str, ...] = ()) -> None:
        """Bring both axes to *operation enabled*, holding their position; a latched fault is reset first.

        The drive is claimed, and from here on watches the host's heartbeat. Raises HeldError when another program holds
        it, DeviceError with the state that it got stuck in, or when its PDOs, and those `also` needed, are others.
        """
        self.master.claim()
        dated = DATED[:1] if self._link.follows_sync and not also else ()
        self.pdos.require(*COMMANDS, *also, *dated)
        self.start_node()
        self.faults.clear_emergencies()
        self._objects.restore_written()
        self._objects.write("mode_x", _MODE_INTERPOLATED)
        self._objects.write("mode_y", _MODE_INTERPOLATED)
        end_s = self._link.time_s + _STATE_TIMEOUT_S
        while (states := self.states()) != ("operation enabled", "operation enabled"):
            if self._link.time_s > end_s:
                raise DeviceError(self._stuck("enabled", states))
            if "switched on" in states:
                self.master.allow_enabling()
            if "fault" in states:  # a reset is an edge of its bit, which a master before may have left set
                self.controlwords(DISABLE_VOLTAGE, DISABLE_VOLTAGE)
            self.controlwords(*(_TOWARDS_ENABLED.get(state, DISABLE_VOLTAGE) for state in states))
            self._link.wait(lambda before=states: self.states() != before, RESEND_S)  # type: ignore[misc]
        self._link.wait(lambda: False, SETTLE_S)

    def reset_faults(self) -> None:
        """Reset latched faults; no axis gets power. Raises DeviceError where one stays, and what enable() raises."""
        with self.master.held():
            self.master.claim()
            self.pdos.require(*COMMANDS)
            self.start_node()
            self.faults.clear_emergencies()
            self.controlwords(DISABLE_VOLTAGE, DISABLE_VOLTAGE)  # a reset is an edge of its bit
            if not self.command_until(FAULT_RESET, lambda: "fault" not in self.states(), _STATE_TIMEOUT_S):
                raise DeviceError(self._stuck("reset", self.states()))
            self.controlwords(DISABLE_VOLTAGE, DISABLE_VOLTAGE)

    @contextmanager
    def enabled(self, also: tuple[str, ...] = ()) -> Iterator[None]:
        """The drive held, and both axes enable()d inside; switched off afterwards, whatever happened."""
        with self.master.held():
            self.enable(also)
            try:
                yield
            except BaseException:
                with suppress(KonturError):  # the first error is the one to report
                    self.disable()
                raise
            self.disable()

    def disable(self) -> None:
        """Stop on the path if it runs, switch both axes off, and release the drive unless it is held().

        Raises DeviceError when they stay enabled.
        """
        for controlword, left in ((SWITCH_ON, "operation enabled"), (DISABLE_VOLTAGE, "switched on")):
            if not self.command_until(controlword, lambda left=left: left not in self.states(), _STOP_TIMEOUT_S):  # type: ignore[misc]
                raise DeviceError(self._stuck("disabled", self.states()))
        if not self.master.is_held:
            self.master.release()

    def controlwords(self, x: int, y: int) -> None:
        """Send both controlwords in one frame (RPDO1)."""
        self._link.send(wire.RPDO1 + self._link.node_id, wire.pack_controlwords(x, y))

    def command_until(self, controlword: int, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Send a controlword to both axes until `condition` holds; False when it does not within `timeout_s`."""
        end_s = self._link.time_s + timeout_s
        while self._link.time_s < end_s:
            self.controlwords(controlword, controlword)
            if self._link.wait(condition, RESEND_S):
                return True
        return False

    def stop_path(self) -> None:
        """Clear the bit that lets path time run, and read back that the drive has received this."""

        def received() -> bool:
            return all(self._objects.read(f"controlword_{axis}") == ENABLE for axis in "xy")

        if not self.command_until(ENABLE, received, _STATE_TIMEOUT_S):
            raise DeviceError("the drive does not receive the controlword; does the bus lose all frames to it?")

    def statuswords(self) -> tuple[int, int]:
        """Latest statuswords received, each the same twice running."""
        return self._link.statuswords

    def status(self, axis: str) -> int:
        """Latest statusword received of `axis`, "x" or "y"."""
        return self.statuswords()[0 if axis == "x" else 1]

    def refresh(self) -> None:
        """Wait for statuswords that the drive has sent since now.

        After an SDO write they are about what was written; those before may be about an older command. Raises
        NoAnswerError.
        """
        now = self._link.status_count
        if not self._link.wait(lambda: self._link.statuswords_since(now), _STATE_TIMEOUT_S):
            raise NoAnswerError(
                f"the drive (node {self._link.node_id}) sends no status any more, {_STATE_TIMEOUT_S:g} s waited"
            )

    def states(self) -> tuple[str, str]:
        """Latest states of both axes received."""
        x, y = self.statuswords()
        return (state_of(x), state_of(y))

    def both(self, bit: int, wanted: bool = True) -> bool:
        """Whether `bit` of the latest statuswords is set (or clear) on both axes."""
        return all(bool(word & bit) == wanted for word in self.statuswords())

    def start_node(self) -> None:
        """Bring the node to NMT state operational, which shows by the TPDO1 that come."""
        seen = self._link.status_count
        end_s = self._link.time_s + _STATE_TIMEOUT_S
        while self._link.time_s < end_s:
            self._link.send(wire.NMT, bytes([wire.NMT_START, self._link.node_id]))
            if self._link.wait(lambda: self._link.status_count >= seen + 3, RESEND_S):
                return
        raise NoAnswerError(
            f"the drive (node {self._link.node_id}) sends no status in NMT state operational, "
            f"{_STATE_TIMEOUT_S:g} s waited"
        )

    def _stuck(self, wanted: str, states: tuple[str, str]) -> str:
        codes = [self._objects.read("error_code_x"), self._objects.read("error_code_y")]
        faults = ", ".join(f"{axis}: {describe_emcy(code)}" for axis, code in zip("xy", codes, strict=True) if code)
        return f"the axes cannot be {wanted}: x is {states[0]!r}, y is {states[1]!r}" + (
            f" ({faults})" if faults else ""
        )
