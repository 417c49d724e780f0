# SPDX-License-Identifier: Apache-2.0
"""A drive: its objects and parameters by name, its state machine (CiA 402, both axes together), its errors.

Names, units and ranges come from the EDS alone (docs/objects.md): `smc.lambda`, `plant_x.mass`, `position_actual_y`.
"""

from __future__ import annotations

import math
import secrets
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from decimal import Decimal
from itertools import takewhile
from typing import Any

import can
from canopen.objectdictionary import ObjectDictionaryError, ODVariable, datatypes
from canopen.sdo import SdoAbortedError, SdoCommunicationError

from kontur.can import wire
from kontur.can.emcy import describe_emcy, faults
from kontur.can.link import Link
from kontur.errors import BusError, DeviceError, EmcyError, HeldError, KonturError, NoAnswerError, ParameterError
from kontur.planning.path_time import RATE_MAX

CONTROLLERS = ("track", "cc", "ccu", "cascade", "ccc")

_SDO_ATTEMPTS = 6
_ABORT_INCOMPATIBLE = 0x06040043
_SIGNATURE = {"store": 0x65766173, "restore": 0x64616F6C}  # "save", "load"
_STORE_REFUSALS = {
    0x08000022: "an axis has power, and writing the flash would stop its control: switch the axes off first",
    0x06060000: "its flash reports an error; what was stored before still holds. Try again; if the error stays, the "
    "controller board is to be replaced",
}
_FLASH_S = 5.0  # more than erasing a sector takes
_ABORTS_OF_TRANSFER = (0x05030000, 0x05040001, 0x05040004)  # toggle bit, command, CRC: a frame was lost or corrupted
_SEGMENT, _PROGRESS_EACH = 7, 64  # bytes of a segment of SDO; segments
RESEND_S = 0.05
"""Time after which a command that shows no effect is sent again."""
_ABORT_STATE = 0x08000022
_HOST_TIMEOUT_MS = 500  # of the drive, for the heartbeat of who holds it
_KEY_BITS = 24
_STATE_TIMEOUT_S = 2.0
_SETTLE_S = 0.01  # after power-on or a change of state, until what the drive tells of itself is of now
_STOP_TIMEOUT_S = 5.0  # limits.path_stop_time is at most 1 s
_MODE_INTERPOLATED = 7

# Controlwords of CiA 402, and its states by (mask, value) of the statusword.
SHUTDOWN, SWITCH_ON, ENABLE, DISABLE_VOLTAGE, FAULT_RESET = 0x06, 0x07, 0x0F, 0x00, 0x80
RUN_PATH = ENABLE | 0x10
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
BIT_TARGET_REACHED, BIT_PATH_RUNS = 1 << 10, 1 << 12
_BIT_FAULT = 1 << 3
_ERRORS = 8  # entries of 2033h
_CAN_STATES = ("error active", "error warning", "error passive", "off")

# Objects that are read back when they are written, besides the parameters.
_READ_BACK = (
    "stream.total",
    "stream.start_x",
    "stream.start_y",
    "controller.select",
    "feed_override",
    "mode_x",
    "mode_y",
)


@dataclass(frozen=True)
class Parameter:
    """A parameter as the EDS declares it; `least`, `greatest` and `default` in `unit`."""

    name: str
    unit: str
    least: float
    greatest: float
    default: float
    description: str


@dataclass(frozen=True)
class Info:
    """Who answered. `warnings`, `error_code`: EMCY codes; `can`: what its CAN controller says of the bus."""

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


class Device:
    """The drive at the other end of `link`. Raises NoAnswerError when there is none."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self._dictionary = link.node.object_dictionary
        self._variables = {_name(v): v for v in _variables(self._dictionary)}
        self.parameters = {
            name: _parameter(name, v) for name, v in self._variables.items() if v.storage_location == "PARAMETER"
        }
        self._written: dict[str, float] = {}  # parameters, as they are to be
        self._key = 1 + secrets.randbelow((1 << _KEY_BITS) - 1)  # another one than that of any other host
        self._holders = 0  # claims within each other
        self.read("device_name")
        if self.confirmed("clock.pace"):
            self._follow_sync()

    # --- objects ---

    def read(self, name: str) -> Any:
        """Value of an object in its unit: float, int where a count is the unit, or str."""
        variable = self._variable(name)
        raw = self._transfer(name, lambda: variable.decode_raw(self.link.node.sdo.upload(*_address(variable))))
        return raw if isinstance(raw, str) else _physical(variable, raw)

    def read_domain(self, name: str, progress: Callable[[float], None] = lambda share: None) -> bytes:
        """Bytes of a domain, by block upload with CRC; `progress` is called with the share read."""
        address = _address(self._variable(name))

        def transfer() -> bytes:
            data = bytearray()
            try:
                return receive(data)
            except AttributeError as error:  # python-canopen 2.4.1 trips over a lost end
                raise SdoCommunicationError("end of a block upload is lost") from error

        def receive(data: bytearray) -> bytes:
            with self.link.node.sdo.open(*address, "rb", buffering=0, block_transfer=True) as stream:
                while segment := stream.read(_SEGMENT):
                    data += segment
                    if len(data) % (_PROGRESS_EACH * _SEGMENT) == 0 and stream.size:
                        progress(len(data) / stream.size)
            return bytes(data)

        whole: bytes = self._transfer(name, transfer)
        progress(1.0)
        return whole

    def confirmed(self, name: str) -> Any:
        """The same, when it came twice running: nothing that hangs on it is done for one corrupted frame."""
        value = self.read(name)
        for _ in range(_SDO_ATTEMPTS):
            self.read("error_register")  # lest the answer, come twice, passes for its own confirmation
            before, value = value, self.read(name)
            if value == before:
                return value
        raise DeviceError(f"{name}: reads differently each time; does the bus corrupt frames?")

    def unit(self, name: str) -> str:
        """Unit of an object, empty for a bare number."""
        return self._variable(name).unit or ""

    def write(self, name: str, value: float) -> None:
        """Set an object, `value` in its unit; parameters and what describes a stream are read back.

        Raises ParameterError when it is out of range or does not fit others.
        """
        variable = self._variable(name)
        raw = _counts(name, variable, value)
        self._download(name, variable, raw, read_back=name in self.parameters or name in _READ_BACK)
        if name in self.parameters:
            self._written[name] = value

    def set_parameters(self, values: Mapping[str, float]) -> None:
        """Set parameters by name; those that must fit together may come in any order.

        Raises ParameterError when one is unknown, out of range, or does not fit the others in the end; DeviceError when
        the drive refuses. All are then as they were before, unless the drive no longer answers.
        """
        for name, value in values.items():
            if name not in self.parameters:
                raise ParameterError(self._unknown(name))
            _counts(name, self._variables[name], value)
        changed: list[tuple[str, float]] = []  # with the value before
        try:
            self._set_in_any_order(dict(values), changed)
        except KonturError:
            with suppress(KonturError):  # what happened first is what is told
                for name, before in reversed(changed):  # back through what has fitted
                    self.write(name, before)
            raise

    def dump(self) -> dict[str, float]:
        """All parameters, name to value in its unit, but those of its place on the bus (`node.`)."""
        return {name: self.read(name) for name in self.parameters if not name.startswith("node.")}

    def save_parameters(self, everything: bool = False) -> None:
        """Let the drive start with its parameters as they are now; `everything`: with its communication objects, too.

        Raises DeviceError while an axis has power, and when the flash fails.
        """
        self._keep("store", everything)

    def restore_defaults(self, everything: bool = False) -> None:
        """Let the drive start with default parameters from its next reset on; `everything`: communication objects, too.

        Node id and bit rate stay. Raises DeviceError while an axis has power, and when the flash fails.
        """
        self._keep("restore", everything)

    def info(self) -> Info:
        """Identity and state."""
        self.link.wait(lambda: False, _SETTLE_S)
        states = (_state(self._statusword("x")), _state(self._statusword("y")))
        return Info(
            node_id=self.link.node_id,
            name=self.read("device_name"),
            build=self.read("build_id"),
            num=self.read("num_backend"),
            control_hz=self.read("clock.control_hz"),
            controller=CONTROLLERS[self.read("controller.active")],
            state=states,
            position_m=self.position_m(),
            error_code=(self.read("error_code_x"), self.read("error_code_y")),
            warnings=self.warnings(),
            can=_CAN_STATES[self.read("can.state")],
        )

    def position_nm(self) -> tuple[int, int]:
        """Position by the encoders."""
        return (int(self.read("position_actual_x")), int(self.read("position_actual_y")))

    def position_m(self) -> tuple[float, float]:
        """Position by the encoders."""
        x, y = self.position_nm()
        return (x * wire.M_PER_NM, y * wire.M_PER_NM)

    def select_controller(self, name: str) -> None:
        """Use one of CONTROLLERS from now on."""
        if name not in CONTROLLERS:
            raise ParameterError(f"controller {name!r} is unknown; there are {', '.join(CONTROLLERS)}")
        self.write("controller.select", CONTROLLERS.index(name))

    # --- feed ---

    def override_feed(self, rate: float) -> None:
        """Let streams run at `rate` of the programmed speed, 0 to 1.2, from now on; 0 holds them on their path.

        Above 1 the accelerations grow with the square of it, beyond what was planned. Raises ParameterError.
        """
        if not 0.0 <= rate <= RATE_MAX:
            raise ParameterError(f"feed override {rate * 100:g} % is out of range; it must be 0..{RATE_MAX * 100:g} %")
        self.write("feed_override", rate * 100.0)

    def hold(self) -> None:
        """Feed hold: stop on the path and stay there, enabled, until resume()."""
        self.override_feed(0.0)

    def resume(self, rate: float = 1.0) -> None:
        """Go on after hold()."""
        self.override_feed(rate)

    # --- who commands ---

    @contextmanager
    def held(self) -> Iterator[None]:
        """The drive is this host's alone inside, as long as its heartbeat comes: wait by `link`, not otherwise.

        Raises HeldError when another program holds it. May be nested.
        """
        self.claim()
        self._holders += 1
        try:
            yield
        finally:
            self._holders -= 1
            if not self._holders:
                with suppress(KonturError):  # what happened first is what is told
                    self.release()
                self.link.rest()  # at the latest this ends the claim

    def claim(self) -> None:
        """Hold the drive: it watches this host's heartbeat from now on. Raises HeldError when another program does."""
        end_s = self.link.time_s + 2e-3 * _HOST_TIMEOUT_MS
        while True:
            try:
                self.write("master.claim", self._key << 8 | wire.HOST_NODE_ID)
            except DeviceError as error:
                if not refused_now(error):
                    raise
                raise self._held_by(int(self.read("master.holder"))) from error
            if self.read("master.holder") == wire.HOST_NODE_ID:
                self.link.beat()
                return
            if self.link.time_s > end_s:  # a corrupted request has claimed it for a node that nobody is
                raise DeviceError("the drive cannot be claimed: master.holder reads differently from what was written")
            self.link.wait(lambda: False, RESEND_S)

    def release(self) -> None:
        """Hold the drive no longer, and send no heartbeat. Raises DeviceError while an axis is enabled."""
        self.link.wait(lambda: "fault reaction active" not in self.states(), _STOP_TIMEOUT_S)
        self.write("master.claim", self._key << 8)
        self.link.rest()

    # --- state machine ---

    def enable(self) -> None:
        """Bring both axes to *operation enabled*, holding their position; a latched fault is reset first.

        The drive is claimed, and from here on watches the host's heartbeat. Raises HeldError when another program holds
        it, DeviceError with the state that it got stuck in.
        """
        self.claim()
        self._start_node()
        self._take_emergencies()
        for name, value in self._written.items():  # it may have been reset since
            if self.read(name) != value:
                self.write(name, value)
        self.write("mode_x", _MODE_INTERPOLATED)
        self.write("mode_y", _MODE_INTERPOLATED)
        end_s = self.link.time_s + _STATE_TIMEOUT_S
        while (states := self.states()) != ("operation enabled", "operation enabled"):
            if self.link.time_s > end_s:
                raise DeviceError(self._stuck("enabled", states))
            if "switched on" in states:
                self._arm()
            self.controlwords(*(_TOWARDS_ENABLED.get(state, DISABLE_VOLTAGE) for state in states))
            self.link.wait(lambda before=states: self.states() != before, RESEND_S)  # type: ignore[misc]
        self.link.wait(lambda: False, _SETTLE_S)

    @contextmanager
    def enabled(self) -> Iterator[None]:
        """The drive held, and both axes enabled inside; switched off afterwards, whatever happened."""
        with self.held():
            self.enable()
            try:
                yield
            except BaseException:
                with suppress(KonturError):  # what happened first is what is told
                    self.disable()
                raise
            self.disable()

    def disable(self) -> None:
        """Stop on the path if it runs, switch both axes off, and release the drive unless it is held().

        Raises DeviceError when they stay enabled.
        """
        for controlword, left in ((SWITCH_ON, "operation enabled"), (DISABLE_VOLTAGE, "switched on")):
            if not self.insist(controlword, lambda left=left: left not in self.states(), _STOP_TIMEOUT_S):  # type: ignore[misc]
                raise DeviceError(self._stuck("disabled", self.states()))
        if not self._holders:
            self.release()

    def controlwords(self, x: int, y: int) -> None:
        """Send both controlwords in one frame."""
        self.link.send(wire.RPDO1 + self.link.node_id, wire.pack_controlwords(x, y))

    def insist(self, controlword: int, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Send a controlword to both axes until `condition` holds; False when it does not within `timeout_s`."""
        end_s = self.link.time_s + timeout_s
        while self.link.time_s < end_s:
            self.controlwords(controlword, controlword)
            if self.link.wait(condition, RESEND_S):
                return True
        return False

    def release_path(self) -> None:
        """Take back the command to run the path, and make sure that the drive knows."""

        def known() -> bool:
            return all(self.read(f"controlword_{axis}") == ENABLE for axis in "xy")

        if not self.insist(ENABLE, known, _STATE_TIMEOUT_S):
            raise DeviceError("the drive does not take the controlword; does the bus lose all frames to it?")

    def statuswords(self) -> tuple[int, int]:
        """Latest statuswords received, each twice running."""
        return self.link.statuswords

    def axis_status(self, axis: str) -> int:
        """Latest statusword received of `axis`, "x" or "y"."""
        return self.statuswords()[0 if axis == "x" else 1]

    def states(self) -> tuple[str, str]:
        """Latest states of both axes received."""
        x, y = self.statuswords()
        return (_state(x), _state(y))

    def both_axes(self, bit: int, wanted: bool = True) -> bool:
        """Whether `bit` of the latest statuswords is set (or clear) on both axes."""
        return all(bool(word & bit) == wanted for word in self.statuswords())

    def wait(self, condition: Callable[[], bool], timeout_s: float, otherwise: str) -> None:
        """Pump until `condition` holds. Raises EmcyError when the drive reports a fault, else NoAnswerError."""

        def done() -> bool:
            self.check()
            return condition()

        if not self.link.wait(done, timeout_s):
            raise NoAnswerError(f"the drive (node {self.link.node_id}) {otherwise}, {timeout_s:g} s waited")

    def check(self) -> None:
        """Raise EmcyError when the drive is in fault: by its statusword, which comes again, and its own word for it.

        EMCY objects, which may be lost or corrupted, only add the details.
        """
        if not any(word & _BIT_FAULT for word in self.statuswords()):
            return
        for axis in "xy":
            if code := self.confirmed(f"error_code_{axis}"):
                reported = {emcy[0]: emcy for emcy in self._take_emergencies()}
                _, register, data = reported.get(code, (code, self.read("error_register"), b""))
                raise EmcyError(code, register, data, f"the drive reports {describe_emcy(code)}")

    def errors(self) -> tuple[int, ...]:
        """EMCY codes of all errors and warnings in effect, oldest first."""
        if not self.read("error_register"):
            return ()
        codes = (int(self.read(f"errors.entry_{i}")) for i in range(1, _ERRORS + 1))
        return tuple(takewhile(bool, codes))

    def warnings(self) -> tuple[int, ...]:
        """EMCY codes of what the drive has warned of since it is connected, or was warning of before, each once."""
        known = faults()
        option = {"tunnel": self.read("tunnel.reaction") == 0}  # of rows that only may warn
        codes = dict.fromkeys((*self.link.reported, *self.errors()))
        return tuple(c for c in codes if c in known and (known[c].warns or option.get(known[c].name, False)))

    # --- inside ---

    def _set_in_any_order(self, waiting: dict[str, float], changed: list[tuple[str, float]]) -> None:
        while waiting:
            refused: dict[str, ParameterError] = {}
            for name, value in waiting.items():
                before = self.read(name)
                try:
                    self.write(name, value)
                    changed.append((name, before))
                except ParameterError as error:  # may fit once others are set
                    refused[name] = error
            if len(refused) == len(waiting):
                raise next(iter(refused.values()))
            waiting = {name: waiting[name] for name in refused}

    def _follow_sync(self) -> None:
        period_us = self.confirmed("sync_period")
        if period_us == 0 or period_us % 1000:
            raise DeviceError(
                f"the drive's time passes with SYNC, {period_us} us at each (sync_period): kontur needs whole ms; "
                "set object 1006h to 1000"
            )
        self.link.follow_sync(self.confirmed("clock.tick"), period_us // 1000)

    def _arm(self) -> None:
        """Let the drive be enabled by the next controlwords. Where a frame of it was lost, it is for another time."""
        try:
            self.write("master.arm", self.read("master.ticket"))
        except NoAnswerError:
            raise
        except DeviceError:
            pass

    def _held_by(self, holder: int) -> HeldError:
        drive = f"drive {self.link.node_id} on {self.link.bus.channel_info}"
        if not holder:
            return HeldError(
                f"{drive} has power for a master that has not claimed it: switch it off there, or reset the drive"
            )
        return HeldError(
            f"{drive} is held by master {holder}, another program that commands it: stop that program, or wait until "
            f"its heartbeat has been gone for {_HOST_TIMEOUT_MS} ms"
        )

    def _take_emergencies(self) -> list[tuple[int, int, bytes]]:
        taken, self.link.emergencies = self.link.emergencies, []
        return taken

    def _start_node(self) -> None:
        """NMT state operational, which is seen by statuswords that come."""
        seen = self.link.status_count
        end_s = self.link.time_s + _STATE_TIMEOUT_S
        while self.link.time_s < end_s:
            self.link.send(wire.NMT, bytes([wire.NMT_START, self.link.node_id]))
            if self.link.wait(lambda: self.link.status_count >= seen + 3, RESEND_S):
                return
        raise NoAnswerError(
            f"the drive (node {self.link.node_id}) sends no status in NMT state operational, "
            f"{_STATE_TIMEOUT_S:g} s waited"
        )

    def _statusword(self, axis: str) -> int:
        return int(self.read(f"statusword_{axis}"))

    def _stuck(self, wanted: str, states: tuple[str, str]) -> str:
        codes = [self.read("error_code_x"), self.read("error_code_y")]
        faults = ", ".join(f"{axis}: {describe_emcy(code)}" for axis, code in zip("xy", codes, strict=True) if code)
        return f"the axes cannot be {wanted}: x is {states[0]!r}, y is {states[1]!r}" + (
            f" ({faults})" if faults else ""
        )

    def _variable(self, name: str) -> ODVariable:
        if name not in self._variables:
            raise ParameterError(self._unknown(name))
        return self._variables[name]

    def _unknown(self, name: str) -> str:
        import difflib

        close = difflib.get_close_matches(name, self._variables, n=3)
        return f"{name}: no such parameter; " + (
            f"did you mean {', '.join(close)}?" if close else "see `kontur param list`"
        )

    def _keep(self, command: str, everything: bool) -> None:
        sdo = self.link.node.sdo
        before_s, sdo.RESPONSE_TIMEOUT = sdo.RESPONSE_TIMEOUT, _FLASH_S
        try:
            variable = self._dictionary[command][1 if everything else 3]
            self._download(command, variable, _SIGNATURE[command], read_back=False)
        except DeviceError as error:
            code = error.__cause__.code if isinstance(error.__cause__, SdoAbortedError) else 0
            if code not in _STORE_REFUSALS:
                raise
            why = _STORE_REFUSALS[code]
            raise DeviceError(f"the drive (node {self.link.node_id}) stores nothing: {why}") from error
        finally:
            sdo.RESPONSE_TIMEOUT = before_s

    def _download(self, name: str, variable: ODVariable, raw: int, read_back: bool) -> None:
        """Write, and read back; again where a corrupted frame wrote something else."""
        sdo, address = self.link.node.sdo, _address(variable)
        for _ in range(_SDO_ATTEMPTS):
            self._transfer(name, lambda: sdo.download(*address, variable.encode_raw(raw)))
            right = not read_back or raw == self._transfer(name, lambda: variable.decode_raw(sdo.upload(*address)))
            self._mend_astray()
            if right:
                return
        raise DeviceError(f"{name}: does not read as it was written; does the bus corrupt frames?")

    def _mend_astray(self) -> None:
        """Objects that a corrupted request has set instead of its own get the value back that this host set."""
        while self.link.astray:
            address = self.link.astray.pop()
            name = next((n for n, v in self._variables.items() if _address(v) == address), f"{address[0]:04X}h")
            if name not in self.parameters:
                continue  # of a stream or an axis: checked before each motion
            if name not in self._written:
                raise DeviceError(
                    f"{name}: changed by a corrupted frame; set it (kontur param set {name}=...), then start again"
                )
            self.write(name, self._written[name])

    def _transfer(self, name: str, transfer: Callable[[], Any]) -> Any:
        """Run an SDO transfer, again where the bus lost a frame of it."""
        refusal = 0
        for attempt in range(1, _SDO_ATTEMPTS + 1):
            try:
                return transfer()
            except SdoAbortedError as error:
                if error.code in _ABORTS_OF_TRANSFER and attempt < _SDO_ATTEMPTS:
                    continue
                if error.code != refusal and attempt < _SDO_ATTEMPTS:  # once may be a corrupted request
                    refusal = error.code
                    continue
                if error.code == _ABORT_INCOMPATIBLE:
                    raise ParameterError(
                        f"{name}: the value does not fit another parameter; docs/protocol.md, Parameters, says which"
                    ) from error
                raise DeviceError(f"{name}: the drive refuses: {error}") from error
            except (SdoCommunicationError, ObjectDictionaryError, UnicodeDecodeError) as error:  # or a wrong length
                if attempt == _SDO_ATTEMPTS:
                    raise NoAnswerError(
                        f"node {self.link.node_id} on {self.link.bus.channel_info} does not answer (asked for {name}). "
                        "Is the drive powered, the bitrate right, the node id right (--node)?"
                    ) from error
            except can.CanError as error:
                raise BusError(f"{self.link.bus.channel_info}: sending failed: {error}") from error


def refused_now(error: DeviceError) -> bool:
    """The drive refused it for the state that it is in."""
    return isinstance(error.__cause__, SdoAbortedError) and error.__cause__.code == _ABORT_STATE


@contextmanager
def connected(bus: can.BusABC, node_id: int) -> Iterator[Device]:
    """The drive on `bus`; the bus is shut down at the end."""
    try:
        yield Device(Link(bus, node_id))
    finally:
        bus.shutdown()


def _variables(dictionary: Any) -> Iterator[ODVariable]:
    for entry in dictionary.values():
        if isinstance(entry, ODVariable):
            yield entry
        else:
            yield from (v for v in entry.values() if v.subindex)


def _name(variable: ODVariable) -> str:
    name: str = variable.qualname
    return name


def _address(variable: ODVariable) -> tuple[int, int]:
    return variable.index, variable.subindex


def _is_text(variable: ODVariable) -> bool:
    return variable.data_type not in datatypes.NUMBER_TYPES


def _parameter(name: str, variable: ODVariable) -> Parameter:
    low, high, default = (
        math.nan if raw is None else float(_physical(variable, raw))
        for raw in (variable.min, variable.max, variable.default)
    )
    return Parameter(name, variable.unit or "", low, high, default, variable.description or "")


def _physical(variable: ODVariable, raw: int) -> float | int:
    """Counts times factor, exactly as written in decimals."""
    return raw if variable.factor == 1 else float(raw * Decimal(str(variable.factor)))


def _range(variable: ODVariable) -> tuple[int, int]:
    """Least and greatest raw value: as declared, else what the type holds."""
    bits, signed = len(variable), variable.data_type in datatypes.SIGNED_TYPES
    least, greatest = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
    return (
        least if variable.min is None else variable.min,
        greatest if variable.max is None else variable.max,
    )


def _counts(name: str, variable: ODVariable, value: float) -> int:
    """The raw value for `value` in the unit of the object. Raises ParameterError."""
    if _is_text(variable) or not variable.writable:
        raise ParameterError(f"{name}: cannot be set")
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ParameterError(f"{name}: {value!r} is not a number")
    factor = Decimal(str(variable.factor))
    raw = int((Decimal(str(value)) / factor).to_integral_value())
    unit = f" {variable.unit}" if variable.unit else ""
    least, greatest = _range(variable)
    if not least <= raw <= greatest:
        low, high = _physical(variable, least), _physical(variable, greatest)
        raise ParameterError(f"{name}: {value:g}{unit} is out of range; it must be {low:g}..{high:g}{unit}")
    return raw


def _state(statusword: int) -> str:
    return next((name for name, mask, value in _STATES if statusword & mask == value), "unknown")
