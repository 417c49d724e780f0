# SPDX-License-Identifier: Apache-2.0
"""Faults and warnings that the drive reports (`device.faults`): by statusword, error objects and EMCY."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import takewhile

from kontur.can.emcy import describe_emcy, faults
from kontur.drive.objects import Objects
from kontur.errors import EmcyError

_BIT_FAULT = 1 << 3
_LOWER_GAINS = 4  # 2122h:3
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
                seen = self.oscillation((code,))
                raise EmcyError(
                    code, register, data, f"the drive reports {describe_emcy(code)}{seen and f'. Seen: {seen}'}"
                )

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
        only_warns = {  # rows whose reaction is an option
            "tunnel": self._objects.read("tunnel.reaction") == 0,
            "oscillation": self._objects.read("oscillation.reaction") in (0, _LOWER_GAINS),
        }
        codes = dict.fromkeys((*self._objects.link.reported, *self.errors()))
        return tuple(c for c in codes if c in known and (known[c].warns or only_warns.get(known[c].name, False)))

    def oscillation(self, codes: Iterable[int]) -> str:
        """Which axes oscillated, and whether the gains are lowered; "" where it is none of these faults."""
        known = faults()
        if not any(code in known and known[code].name == "oscillation" for code in codes):
            return ""
        read = self._objects.read
        seen = [
            f"{axis} at {read(f'oscillation_state.frequency_{axis}'):.0f} Hz "
            f"with {read(f'oscillation_state.force_{axis}'):.0f} N"
            for axis in "xy"
            if read(f"oscillation_state.count_{axis}")
        ]
        if (gain := read("oscillation_state.gain")) < 1:
            seen.append(f"gains lowered to {gain:g} of the parameters")
        return ", ".join(seen)
