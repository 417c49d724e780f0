# SPDX-License-Identifier: Apache-2.0
"""Writing files atomically: the old content stays until the new content is complete. All results are written so."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from kontur.errors import FileError


def check_folder(path: Path) -> None:
    """Raise FileError when the folder of `path` does not exist; called before the work whose result goes there."""
    if not path.parent.is_dir():
        raise FileError(path, f"the folder {path.parent} does not exist; make it, or name another one")


def write_atomically(path: Path, content: bytes) -> None:
    """Write `content` to a file beside `path`, then rename that to `path`. Raises FileError."""
    part = path.parent / f"{path.name}.part"
    try:
        part.write_bytes(content)
        os.replace(part, path)
    except OSError as error:
        with suppress(OSError):
            part.unlink()
        raise FileError(path, f"cannot be written ({error.strerror}); name another file") from error
