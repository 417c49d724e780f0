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

_NAME = "progress.json"
_OF_THE_AXIS = ("wiring_", "second_encoder_", "position_limit_")
"""Parameters, besides the lengths of counts, that make an axis another one for what was found."""


def identity(target: Target, device: Device) -> dict[str, Any]:
    """What drive, what machine, and how it is wired."""
    names = [name for name in device.declared if name.startswith(_OF_THE_AXIS) or name.endswith(".encoder")]
    return {
        "drive": [str(device.read("device_name")), int(device.read("identity.serial"))],
        "machine": json.loads(json.dumps(target.machine.described())),
        "told": target.told if target.in_process else None,
        "wiring": {name: device.read(name) for name in names},
    }


class Progress:
    """The steps in a folder that are done. Each has the options that it was done with."""

    def __init__(self, out: Path, who: Mapping[str, Any]) -> None:
        """Go on with what is in `out`, or begin. Raises FileError where steps of another drive or machine are done."""
        self.file = out / _NAME
        self._steps: dict[str, Any] = {"who": dict(who)}
        if not self.file.exists():
            return
        try:
            steps = json.loads(read_text(self.file))
            before = steps["who"]
            changed = [name for name in who if before.get(name) != who[name]]
        except (ValueError, LookupError, TypeError, AttributeError) as error:
            raise FileError(self.file, "is not what kontur commission writes; delete it to begin anew") from error
        if changed and not steps.keys() > {"who", "before"}:
            return  # no step is done yet: the user has mended something
        if changed:
            raise FileError(
                self.file,
                f"is of a commissioning that was broken off with another {' and '.join(changed)}; delete it to begin "
                "anew, or name another folder with --out",
            )
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
        """All is done: the next one begins anew."""
        self.file.unlink(missing_ok=True)
