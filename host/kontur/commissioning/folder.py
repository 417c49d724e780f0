# SPDX-License-Identifier: Apache-2.0
"""The folder of a commissioning: what each finished step has found, so that one that was broken off can go on."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from kontur.drive.device import Device
from kontur.drive.target import Target
from kontur.errors import FileError
from kontur.files import read_text, write_atomically

MACHINE, RESULT = "machine.toml", "commission.json"
_NAME = "progress.json"
_OF_THE_AXIS = ("wiring_", "second_encoder_", "position_limit_")
"""Parameters, besides the lengths of counts, that make an axis another one for what was found."""
_OF_THE_RESULT = ("drive", "machine")
"""What a finished folder belongs to. A commissioning may have set the rest itself."""


def identity(target: Target, device: Device) -> dict[str, Any]:
    """What drive, what machine, and how it is wired. Serial number and node tell two drives of one kind apart."""
    names = [name for name in device.declared if name.startswith(_OF_THE_AXIS) or name.endswith(".encoder")]
    return {
        "drive": [str(device.read("device_name")), int(device.read("identity.serial")), target.node_id],
        "machine": json.loads(json.dumps(target.machine.described())),
        "told": target.told if target.in_process else None,
        "wiring": {name: device.read(name) for name in names},
    }


class Progress:
    """The steps in a folder that are done, each with the options that it was done with; or that all of them are."""

    def __init__(self, out: Path, who: Mapping[str, Any]) -> None:
        """Go on with what is in `out`, or begin. Raises FileError where it is another drive's or machine's."""
        self.file = out / _NAME
        self._steps: dict[str, Any] = {"who": dict(who)}
        if not self.file.exists():
            if (out / MACHINE).exists() and not (out / RESULT).exists():
                raise FileError(
                    out / MACHINE,
                    "is of no commissioning in this folder, and would be overwritten; name another folder with --out",
                )
            return
        try:
            steps = json.loads(read_text(self.file))
            before = steps["who"]
            ended = bool(steps.get("ended"))
            of = _OF_THE_RESULT if ended else tuple(who)
            changed = [name for name in of if before.get(name) != who[name]]
        except (ValueError, LookupError, TypeError, AttributeError) as error:
            raise FileError(self.file, "is not what kontur commission writes; delete it to begin anew") from error
        if changed and (ended or steps.keys() > {"who", "before"}):
            raise FileError(
                self.file,
                f"is of a commissioning that {'was finished' if ended else 'was broken off'} with another "
                f"{' and '.join(changed)}; {_set_again(before, who) if changed == ['wiring'] else ''}"
                f"name another folder with --out, or delete this file to "
                f"{'overwrite what is in this one' if ended else 'begin anew'}",
            )
        if not changed and not ended:  # what has changed before the first step is done was mended
            self._steps = steps

    def done(self, step: str, options: Mapping[str, Any]) -> Any:
        """What `step` has found with these options; None where it is not done."""
        kept = self._steps.get(step)
        return kept["found"] if isinstance(kept, dict) and kept.get("options") == dict(options) else None

    def keep(self, step: str, options: Mapping[str, Any], found: Any) -> None:
        """Keep what `step` has found. Raises FileError."""
        self._steps[step] = {"options": dict(options), "found": found}
        write_atomically(self.file, (json.dumps(self._steps) + "\n").encode())

    def end(self) -> None:
        """All is done: the next one with the same drive and machine begins anew. Raises FileError."""
        write_atomically(self.file, (json.dumps({"who": self._steps["who"], "ended": True}) + "\n").encode())


def _set_again(before: Mapping[str, Any], who: Mapping[str, Any]) -> str:
    """What brings the wiring back that a drive without power has forgotten."""
    was, now = before["wiring"], who["wiring"]
    other = " ".join(f"{name}={was[name]:g}" for name in now if name in was and was[name] != now[name])
    return f"where the drive has lost its power since, set again what it has not stored (`kontur param set {other}`), "
