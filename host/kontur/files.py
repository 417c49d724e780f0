# SPDX-License-Identifier: Apache-2.0
"""Files are written whole or not at all: what stood there before stays until the new content is complete."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from kontur.errors import FileError


def check_folder(path: Path) -> None:
    """Raise FileError where there is no folder to write `path` to: before the work whose result goes there."""
    if not path.parent.is_dir():
        raise FileError(path, f"there is no folder {path.parent}; make it, or give another one")


def write_atomically(path: Path, content: bytes) -> None:
    """Write `content` beside `path`, then put it in its place. Raises FileError."""
    part = path.parent / f"{path.name}.part"
    try:
        part.write_bytes(content)
        os.replace(part, path)
    except OSError as error:
        with suppress(OSError):
            part.unlink()
        raise FileError(path, f"cannot be written ({error.strerror}); give another place") from error
