# SPDX-License-Identifier: Apache-2.0
"""The objects of a drive by name, over SDO. Names, units and ranges come from the EDS alone (docs/objects.md).

`smc.lambda`, `plant_x.mass` and `position_actual_y` are such names. Everything that talks to a drive reads and writes
through this module. A transfer is repeated where the bus lost a frame of it, and what matters is read back.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

from canopen.objectdictionary import ObjectDictionaryError, ODVariable, datatypes
from canopen.sdo import SdoAbortedError, SdoCommunicationError

from kontur.can.link import Link
from kontur.errors import DeviceError, NoAnswerError, ParameterError

_PATIENCE = (1, 1, 1, 1, 2, 4)
"""Times as long as usual that each attempt waits: a bus loses few frames in a row, a busy machine is slow for long."""
_SDO_ATTEMPTS = len(_PATIENCE)
# SDO abort codes, CiA 301 table 22
_ABORT_INCOMPATIBLE, _ABORT_STATE = 0x06040043, 0x08000022
_ABORTS_OF_TRANSFER = (0x05030000, 0x05040001, 0x05040004)  # toggle bit, command, CRC: a frame was lost or corrupted
_SEGMENT, _PROGRESS_EACH = 7, 64  # bytes of a segment of SDO; segments

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


def unknown(name: str, names: Iterable[str]) -> str:
    """What is wrong with `name`, which is none of `names`."""
    close = difflib.get_close_matches(name, names, n=3)
    hint = f"did you mean {', '.join(close)}?" if close else "see `kontur param list`"
    return f"no such parameter; {hint}"


class Objects:
    """Reads and writes the objects of the drive at the other end of `link`."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self._variables = {_name(v): v for v in _variables(link.node.object_dictionary)}
        self.declared = {
            name: _parameter(name, v) for name, v in self._variables.items() if v.storage_location == "PARAMETER"
        }
        """All parameters, by name."""
        self._written: dict[str, float] = {}  # parameters, with the values that this host has set

    def read(self, name: str) -> Any:
        """Value of an object in its unit: float, int where a count is the unit, or str."""
        variable = self._variable(name)
        raw = self._transfer(name, lambda: variable.decode_raw(self.link.node.sdo.upload(*_address(variable))))
        return raw if isinstance(raw, str) else _physical(variable, raw)

    def read_stable(self, name: str) -> Any:
        """Value of an object that came the same twice running, so that one corrupted frame has no consequence."""
        value = self.read(name)
        for _ in range(_SDO_ATTEMPTS):
            self.read("error_register")  # in between, so that a repeated frame is not taken for the second answer
            before, value = value, self.read(name)
            if value == before:
                return value
        raise DeviceError(f"{name}: reads differently each time; does the bus corrupt frames?")

    def read_domain(self, name: str, progress: Callable[[float], None] = lambda share: None) -> bytes:
        """Bytes of a domain, by block upload with CRC; `progress` is called with the share read."""
        address = _address(self._variable(name))

        def transfer() -> bytes:
            data = bytearray()
            try:
                return receive(data)
            except AttributeError as error:  # python-canopen 2.4.1 raises it when the end of a block is lost
                raise SdoCommunicationError("end of a block upload is lost") from error

        def receive(data: bytearray) -> bytes:
            with self.link.node.sdo.open(*address, "rb", buffering=0, block_transfer=True) as stream:
                while segment := stream.read(_SEGMENT):
                    data += segment
                    if len(data) % (_PROGRESS_EACH * _SEGMENT) == 0 and stream.size:
                        progress(len(data) / stream.size)
            return bytes(data)

        content: bytes = self._transfer(name, transfer)
        progress(1.0)
        return content

    def names(self) -> list[str]:
        """Names of all objects."""
        return list(self._variables)

    def address(self, name: str) -> str:
        """Index and sub-index of an object, as in 1400h:1."""
        index, subindex = _address(self._variable(name))
        return f"{index:04X}h:{subindex}" if subindex else f"{index:04X}h"

    def on_wire(self, name: str, value: float) -> tuple[int, int, int]:
        """Index, sub-index and count of a parameter for `value` in its unit. Raises ParameterError."""
        raw = self.check_value(name, value)
        return (*_address(self._variables[name]), raw)

    def default(self, name: str) -> float | int:
        """The value of a number that the EDS declares, in its unit; NaN where it declares none."""
        variable = self._variable(name)
        return math.nan if variable.default is None else _physical(variable, variable.default)

    def unit(self, name: str) -> str:
        """Unit of an object, empty for a bare number."""
        return self._variable(name).unit or ""

    def write(self, name: str, value: float) -> None:
        """Set an object, `value` in its unit; parameters and what describes a stream are read back.

        Raises ParameterError when it is out of range or does not fit others.
        """
        variable = self._variable(name)
        raw = _counts(name, variable, value)
        self._download(name, variable, raw, read_back=name in self.declared or name in _READ_BACK)
        if name in self.declared:
            self._written[name] = value

    def check_value(self, name: str, value: float) -> int:
        """The count of a parameter for `value`. Raises ParameterError when it is none, or `value` is out of range."""
        if name not in self.declared:
            raise ParameterError(f"{name}: {unknown(name, self._variables)}")
        return _counts(name, self._variables[name], value)

    def restore_written(self) -> None:
        """Write the parameters again that this host has set, where a reset of the drive has undone that."""
        for name, value in self._written.items():
            if self.read(name) != value:
                self.write(name, value)

    def _variable(self, name: str) -> ODVariable:
        if name not in self._variables:
            raise ParameterError(f"{name}: {unknown(name, self._variables)}")
        return self._variables[name]

    def _download(self, name: str, variable: ODVariable, raw: int, read_back: bool) -> None:
        """Write, and read back; again where a corrupted frame wrote something else."""
        sdo, address = self.link.node.sdo, _address(variable)
        for _ in range(_SDO_ATTEMPTS):
            self._transfer(name, lambda: sdo.download(*address, variable.encode_raw(raw)))
            right = not read_back or raw == self._transfer(name, lambda: variable.decode_raw(sdo.upload(*address)))
            self._repair_misdirected()
            if right:
                return
        raise DeviceError(f"{name}: does not read as it was written; does the bus corrupt frames?")

    def _repair_misdirected(self) -> None:
        """Write the parameters again that a corrupted request has changed in place of the one that was meant."""
        while self.link.misdirected:
            address = self.link.misdirected.pop()
            name = next((n for n, v in self._variables.items() if _address(v) == address), f"{address[0]:04X}h")
            if name not in self.declared:
                continue  # of a stream or an axis: checked before each motion
            if name not in self._written:
                raise DeviceError(
                    f"{name}: changed by a corrupted frame; set it (kontur param set {name}=...), then start again"
                )
            self.write(name, self._written[name])

    def _transfer(self, name: str, transfer: Callable[[], Any]) -> Any:
        """Run an SDO transfer, again where the bus lost a frame of it."""
        refusal = 0
        for attempt, patience in enumerate(_PATIENCE, 1):
            try:
                with _waiting(self.link.node.sdo, patience):
                    return transfer()
            except SdoAbortedError as error:
                if error.code in _ABORTS_OF_TRANSFER and attempt < _SDO_ATTEMPTS:
                    continue
                if error.code != refusal and attempt < _SDO_ATTEMPTS:  # the first refusal may be of a corrupted request
                    refusal = error.code
                    continue
                if error.code == _ABORT_INCOMPATIBLE:
                    raise ParameterError(
                        f"{name}: the value does not fit another parameter or the control rate; docs/protocol.md, "
                        "Parameters, says which"
                    ) from error
                raise DeviceError(f"{name}: the drive refuses: {error}") from error
            except (SdoCommunicationError, ObjectDictionaryError, UnicodeDecodeError) as error:  # or a wrong length
                if attempt == _SDO_ATTEMPTS:
                    raise NoAnswerError(
                        f"node {self.link.node_id} on {self.link.bus.channel_info} does not answer (asked for {name}). "
                        "Is the drive powered, the bitrate right, the node id right (--node)?"
                    ) from error


@contextmanager
def _waiting(sdo: Any, patience: int) -> Iterator[None]:
    """Wait for answers `patience` times as long as usual."""
    usual_s = sdo.RESPONSE_TIMEOUT
    sdo.RESPONSE_TIMEOUT = patience * usual_s
    try:
        yield
    finally:
        sdo.RESPONSE_TIMEOUT = usual_s


def refused_in_this_state(error: DeviceError) -> bool:
    """Whether the drive refused an access because of the state that it is in."""
    return isinstance(error.__cause__, SdoAbortedError) and error.__cause__.code == _ABORT_STATE


def _variables(dictionary: Any) -> Iterator[ODVariable]:
    for entry in dictionary.values():
        if isinstance(entry, ODVariable):
            yield entry
        else:
            # The number of entries is an object where it can be set, as in the mapping of a PDO.
            yield from (v for v in entry.values() if v.subindex or v.writable)


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
