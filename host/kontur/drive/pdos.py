# SPDX-License-Identifier: Apache-2.0
"""The PDOs that host and drive talk in (`device.pdos`): as the EDS declares them, or not as another master left them.

Another master may change a drive's PDOs, and store them so. Then controlwords, knots or statuswords would not arrive,
or others in their place. What is needed is compared before an axis is enabled. Telemetry is off until a host needs
it, and is switched off again when the host leaves.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

from kontur.can import wire
from kontur.drive.objects import Objects, refused_in_this_state
from kontur.errors import DeviceError, KonturError

COMMANDS = ("rpdo1", "rpdo2", "tpdo1")
"""Controlwords, knots, and the statuswords that answer both."""
OUTPUTS = ("rpdo5",)
"""Outputs tied to knots; off by default."""
TELEMETRY = ("tpdo2", "tpdo3", "tpdo4", "tpdo5")
"""Off by default."""
RANGE = ("tpdo6",)
"""Off by default; the contour error of all control periods."""
DATED = TELEMETRY[:2]
"""These carry the drive's tick."""

_EMCY = "emcy_cob_id"
_UNUSED, _ID = 1 << 31, 0x7FF
_NO_RTR = 1 << 30  # has no effect
_ASYNCHRONOUS = (254, 255)
_ATTEMPTS = 5
_SHOWN = 3


class Pdos:
    """PDOs of a drive. `may_set`: what differs is set, in the drive's RAM alone, instead of refused."""

    def __init__(self, objects: Objects) -> None:
        self._objects = objects
        self.may_set = False
        self._needed: frozenset[str] = frozenset()
        self._switched_on: list[str] = []

    def sent(self) -> dict[str, int]:
        """The identifiers of the TPDOs that the drive sends, by their names."""
        cob_ids = {pdo: int(self._objects.read(f"{pdo}.cob_id")) for pdo in self._all() if pdo.startswith("tpdo")}
        return {pdo: cob_id & _ID for pdo, cob_id in cob_ids.items() if not cob_id & _UNUSED}

    def restore(self) -> None:
        """Switch off again what require() has switched on, where the drive still answers."""
        switched_on, self._switched_on = self._switched_on, []
        with suppress(KonturError):
            for pdo in switched_on:
                name = f"{pdo}.cob_id"
                self._objects.write(name, int(self._objects.read(name)) | _UNUSED)

    def require(self, *pdos: str) -> None:
        """Raise DeviceError unless `pdos`, and the identifier of EMCY, are as the EDS declares them.

        Those that are only off, and are so by default, are switched on until restore(). With `may_set` all that differs
        is set, which leaves the node in *pre-operational*. The drive must be claimed.
        """
        self._needed = frozenset(pdos)
        for _ in range(_ATTEMPTS):
            self._switch_on(pdos)
            differing = {name: is_ for pdo in self._wanted(pdos) for name, is_ in self._differing(pdo)}
            if not differing:
                return
            if not self.may_set:
                raise DeviceError(self._message(differing))
            for pdo in dict.fromkeys(name.partition(".")[0].removesuffix("_map") for name in differing):
                self._set(pdo)
        raise DeviceError(
            f"{self._message(differing)}; they do not stay as they are set: does another master set them?"
        )

    def check(self, *pdos: str) -> None:
        """Raise DeviceError where require() of `pdos` would. The drive stays as it is, and need not be claimed."""
        self._needed = frozenset(pdos)
        wanted = [pdo for pdo in self._wanted(pdos) if not self._is_only_off(pdo)]
        if differing := {name: is_ for pdo in wanted for name, is_ in self._differing(pdo)}:
            raise DeviceError(self._message(differing))

    def _switch_on(self, pdos: tuple[str, ...]) -> None:
        for pdo in pdos:
            if self._is_only_off(pdo):
                name = f"{pdo}.cob_id"
                self._objects.write(name, self._declared(name))
                self._switched_on.append(pdo)

    def _is_only_off(self, pdo: str) -> bool:
        """Whether a PDO that is needed is as declared, but off, as it is by default."""
        name = _EMCY if pdo == _EMCY else f"{pdo}.cob_id"
        off = [(name, self._declared(name) | _UNUSED)]
        return bool(int(self._objects.default(name)) & _UNUSED) and list(self._differing(pdo)) == off

    def _wanted(self, needed: tuple[str, ...]) -> list[str]:
        """What is needed, and others that have an identifier of it: their frames would be taken for these."""
        ids = {self._declared(f"{pdo}.cob_id") & _ID for pdo in needed}
        others = [pdo for pdo in self._all() if pdo not in needed]
        cob_ids = {pdo: int(self._objects.read(f"{pdo}.cob_id")) for pdo in others}
        return [_EMCY, *needed, *(pdo for pdo, id_ in cob_ids.items() if not id_ & _UNUSED and id_ & _ID in ids)]

    def _all(self) -> list[str]:
        return [name.removesuffix(".cob_id") for name in self._objects.names() if name.endswith(".cob_id")]

    def _differing(self, pdo: str) -> Iterator[tuple[str, Any]]:
        """Objects of a PDO with other values than declared, and these values, read twice."""
        for name in self._names(pdo):
            if not self._as_declared(name, self._objects.read(name)):
                value = self._objects.read_stable(name)
                if not self._as_declared(name, value):
                    yield name, value

    def _names(self, pdo: str) -> list[str]:
        """The objects that make a PDO what it is, in the order in which they are set."""
        if pdo == _EMCY:
            return [_EMCY]
        entries = range(1, self._declared(f"{pdo}_map.highest_sub") + 1)
        timing = ["inhibit", "event_ms"] if pdo.startswith("tpdo") else []
        return [
            *(f"{pdo}.{name}" for name in ["type", *timing]),
            *(f"{pdo}_map.map_{k}" for k in entries),
            f"{pdo}_map.highest_sub",
            f"{pdo}.cob_id",
        ]

    def _declared(self, name: str) -> int:
        """The default; what is needed is on."""
        on = name.partition(".")[0] in self._needed and name.endswith(".cob_id")
        return int(self._objects.default(name)) & (~_UNUSED if on else ~0)

    def _as_declared(self, name: str, value: Any) -> bool:
        declared = self._declared(name)
        if name.endswith("cob_id"):
            return (int(value) ^ declared) & ~_NO_RTR == 0
        if name.endswith(".type"):
            return value == declared or {value, declared} <= set(_ASYNCHRONOUS)
        return bool(value == declared)

    def _set(self, pdo: str) -> None:
        """Set one as declared, while it is not in use and the node is not operational."""
        link = self._objects.link
        names = self._names(pdo)
        for attempt in range(_ATTEMPTS):
            link.send(wire.NMT, bytes([wire.NMT_PRE_OPERATIONAL, link.node_id]))
            try:
                self._objects.write(names[-1], self._declared(names[-1]) | _UNUSED)
                if len(names) > 1:
                    self._objects.write(f"{pdo}_map.highest_sub", 0)
                for name in names:
                    self._objects.write(name, self._declared(name))
                return
            except DeviceError as error:  # the frame of NMT was lost
                if attempt == _ATTEMPTS - 1 or not refused_in_this_state(error):
                    raise

    def _message(self, differing: dict[str, Any]) -> str:
        def shown(name: str, value: Any) -> str:
            form = "{:X}h" if name.endswith("cob_id") or "map_" in name.partition(".")[2] else "{:g}"
            return (
                f"{self._objects.address(name)} {name} is {form.format(value)}, not {form.format(self._declared(name))}"
            )

        parts = [shown(name, value) for name, value in list(differing.items())[:_SHOWN]]
        if len(differing) > _SHOWN:
            parts.append(f"and {len(differing) - _SHOWN} more")
        link = self._objects.link
        return (
            f"the PDOs of drive {link.node_id} on {link.bus.channel_info} are not those that kontur needs: "
            f"{', '.join(parts)}. Another master has changed them; --set-pdos sets them until the drive is reset, and "
            "leaves alone what is stored in it"
        )
