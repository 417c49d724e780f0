# SPDX-License-Identifier: Apache-2.0
"""Faults and warnings that the drive reports (`device.faults`): by statusword, error objects and EMCY."""

from __future__ import annotations

from itertools import takewhile

from kontur.can.emcy import describe_emcy, faults
from kontur.drive.objects import Objects
from kontur.errors import EmcyError

_BIT_FAULT = 1 << 3
_ERRORS = 8  # entries of 2033h (`errors`)


class FaultReports:
    """What the drive says is wrong."""

    def __init__(self, objects: Objects) -> None:
        self._objects = objects

    def check(self) -> None:
        """Raise EmcyError when the drive is in fault by its statusword, with the code that it names.

        The statusword comes again and the code is read twice, so no lost or corrupted frame decides. EMCY objects,
        which may be lost or corrupted, only add the details.
        """
        if not any(word & _BIT_FAULT for word in self._objects.link.statuswords):
            return
        for axis in "xy":
            if code := self._objects.read_stable(f"error_code_{axis}"):
                reported = {emcy[0]: emcy for emcy in self.clear_emergencies()}
                _, register, data = reported.get(code, (code, self._objects.read("error_register"), b""))
                raise EmcyError(code, register, data, f"the drive reports {describe_emcy(code)}")

    def clear_emergencies(self) -> list[tuple[int, int, bytes]]:
        """The EMCY objects received since the last call, as (code, register, data)."""
        received, self._objects.link.emergencies = self._objects.link.emergencies, []
        return received

    def errors(self) -> tuple[int, ...]:
        """EMCY codes of all errors and warnings in effect, oldest first."""
        if not self._objects.read("error_register"):
            return ()
        codes = (int(self._objects.read(f"errors.entry_{i}")) for i in range(1, _ERRORS + 1))
        return tuple(takewhile(bool, codes))

    def warnings(self) -> tuple[int, ...]:
        """EMCY codes of the warnings since the drive is connected, and of those in effect before, each once."""
        known = faults()
        only_warns = {"tunnel": self._objects.read("tunnel.reaction") == 0}  # rows whose reaction is an option
        codes = dict.fromkeys((*self._objects.link.reported, *self.errors()))
        return tuple(c for c in codes if c in known and (known[c].warns or only_warns.get(known[c].name, False)))
