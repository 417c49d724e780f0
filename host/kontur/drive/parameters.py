# SPDX-License-Identifier: Apache-2.0
"""The drive's parameters: set together, read together, stored in the drive (`device.parameters`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress

from canopen.sdo import SdoAbortedError

from kontur.drive.objects import Objects, Parameter, refused_in_this_state
from kontur.errors import DeviceError, KonturError, ParameterError

_SIGNATURE = {"store": 0x65766173, "restore": 0x64616F6C}  # "save" and "load", CiA 301, 1010h and 1011h
_STORE_REFUSALS = {
    0x08000022: "an axis has power, and writing the flash would stop its control: switch the axes off first",
    0x06060000: "its flash reports an error; what was stored before still holds. Try again; if the error stays, the "
    "controller board is to be replaced",
}
_STORED_TOO_OFTEN = (
    "it has been written too often of late, and each time wears its flash; what is stored is as before. Save again in "
    "a minute"
)
_FLASH_S = 5.0  # more than erasing a sector takes


class Parameters(Mapping[str, Parameter]):
    """The parameters that the EDS declares, by name; and what can be done with them together."""

    def __init__(self, objects: Objects) -> None:
        self._objects = objects

    def __getitem__(self, name: str) -> Parameter:
        return self._objects.declared[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._objects.declared)

    def __len__(self) -> int:
        return len(self._objects.declared)

    def set(self, values: Mapping[str, float]) -> None:
        """Set parameters by name; those that must fit together may come in any order.

        Raises ParameterError when one is unknown, out of range, or does not fit the others in the end; DeviceError when
        the drive refuses. All are then as they were before, unless the drive no longer answers.
        """
        for name, value in values.items():
            self._objects.check_value(name, value)
        changed: list[tuple[str, float]] = []  # with the value before
        try:
            self._set_in_any_order(dict(values), changed)
        except KonturError:
            with suppress(KonturError):  # the first error is the one to report
                for name, before in reversed(changed):  # in reverse, since each step back has fitted before
                    self._objects.write(name, before)
            raise

    def dump(self) -> dict[str, float]:
        """All parameters, name to value in its unit, but those of the node's place on the bus (`node.`)."""
        return {name: self._objects.read(name) for name in self if not name.startswith("node.")}

    def save(self, all_objects: bool = False) -> None:
        """Let the drive start with its parameters as they are now; `all_objects`: communication objects, too.

        Raises DeviceError while an axis has power, when the flash fails, and when it was written too often of late.
        """
        self._command_store("store", all_objects)

    def restore(self, all_objects: bool = False) -> None:
        """Let the drive start with default parameters after its next reset; `all_objects`: communication objects, too.

        Node id and bit rate stay. Raises DeviceError while an axis has power, and when the flash fails.
        """
        self._command_store("restore", all_objects)

    def _set_in_any_order(self, waiting: dict[str, float], changed: list[tuple[str, float]]) -> None:
        while waiting:
            refused: dict[str, ParameterError] = {}
            for name, value in waiting.items():
                before = self._objects.read(name)
                try:
                    self._objects.write(name, value)
                    changed.append((name, before))
                except ParameterError as error:  # may fit once others are set
                    refused[name] = error
            if len(refused) == len(waiting):
                raise next(iter(refused.values()))
            waiting = {name: waiting[name] for name in refused}

    def _command_store(self, command: str, all_objects: bool) -> None:
        link = self._objects.link
        sdo = link.node.sdo
        before_s, sdo.RESPONSE_TIMEOUT = sdo.RESPONSE_TIMEOUT, _FLASH_S
        try:
            self._objects.write(f"{command}.{'all' if all_objects else 'application'}", _SIGNATURE[command])
        except DeviceError as error:
            code = error.__cause__.code if isinstance(error.__cause__, SdoAbortedError) else 0
            if code not in _STORE_REFUSALS:
                raise
            too_often = refused_in_this_state(error) and self._objects.read("flash_wear.saves_left") == 0
            reason = _STORED_TOO_OFTEN if too_often else _STORE_REFUSALS[code]
            raise DeviceError(f"the drive (node {link.node_id}) stores nothing: {reason}") from error
        finally:
            sdo.RESPONSE_TIMEOUT = before_s
