# SPDX-License-Identifier: Apache-2.0
"""Reading and writing files. Results are written atomically: the old content stays until the new one is complete."""

from __future__ import annotations

import io
import os
import re
import secrets
import select
import shutil
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, BinaryIO

from kontur.errors import FileError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_PIPE_S = 10.0  # how long a pipe may bring nothing


def check_folder(path: Path) -> None:
    """Raise FileError when `path` cannot be written, because its folder does not exist or for another reason that is
    known before; called before the work whose result goes there."""
    if not os.path.isdir(path.parent):  # Path.is_dir() raises OSError for a name that is too long
        raise FileError(path, f"the folder {path.parent} does not exist; make it, or name another one")
    try:
        exists = _status(path) is not None
    except OSError as error:
        raise FileError(path, f"cannot be written ({error.strerror}); name another file") from error
    if not os.access(path if exists else path.parent, os.W_OK):
        raise FileError(path, "you may not write there; name another file")


def make_folder(path: Path) -> None:
    """Make the folder `path`, where it is not there. Raises FileError."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(path, f"cannot be made ({error.strerror}); give another folder") from error


def write_atomically(path: Path, content: bytes) -> None:
    """Write `content` to `path` as atomic_writer() does. Raises FileError."""
    with atomic_writer(path) as file:
        file.write(content)


@contextmanager
def atomic_writer(path: Path) -> Iterator[BinaryIO]:
    """A file to write to that takes the place of `path`, on the disk, at the end of the block; not after an exception.

    It has a name of its own in the same folder, so programs that write to the same path do not disturb each other. Of
    a link the target is replaced. A file that is replaced keeps its mode and, where that is allowed, its owner. What is
    no regular file, such as a device or a pipe, is written to directly. Raises FileError when it cannot be written.
    """
    try:
        old = _status(path)
        target = Path(os.path.realpath(path))
        if old is not None and not stat.S_ISREG(old.st_mode):
            with path.open("wb") as file:
                yield file
            return
        # Its name is unpredictable, and "x" neither follows a link nor opens what is there.
        part = target.parent / f".kontur-{secrets.token_hex(8)}.part"
        created = create_for(path, part)
        try:
            with io.BufferedWriter(created) as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            os.replace(part, target)
        except BaseException:
            with suppress(OSError):
                part.unlink()
            raise
    except OSError as error:
        raise FileError(path, f"cannot be written ({error.strerror}); name another file") from error


def create_for(path: Path, part: Path) -> io.FileIO:
    """Make the file `part`, which will take the place of `path`: with its mode and owner, if it exists, from the start.

    Raises OSError; FileExistsError when there is such a file.
    """
    old = _status(path)
    kept = old if old is not None and stat.S_ISREG(old.st_mode) else None
    mode = 0o666 if kept is None else 0o600
    file = io.FileIO(part, "xb", opener=lambda name, flags: os.open(name, flags, mode))
    if kept is not None:
        try:
            _keep_owner_and_mode(file.fileno(), kept)
        except OSError:
            file.close()
            part.unlink()
            raise
    return file


def put_in_place(part: Path, path: Path) -> None:
    """Let the complete file `part` take the place of `path`, as atomic_writer() does. Raises FileError; `part` stays
    then."""
    try:
        old = _status(path)
        if old is not None and not stat.S_ISREG(old.st_mode):
            with part.open("rb") as source, path.open("wb") as file:
                shutil.copyfileobj(source, file)
            part.unlink()
            return
        with part.open("rb+") as file:
            if old is not None:
                _keep_owner_and_mode(file.fileno(), old)
            os.fsync(file.fileno())
        os.replace(part, os.path.realpath(path))
    except OSError as error:
        raise FileError(path, f"cannot be written ({error.strerror}); its content is in {part}") from error


def _status(path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except FileNotFoundError:
        return None


def _keep_owner_and_mode(descriptor: int, old: os.stat_result) -> None:
    if hasattr(os, "fchown"):  # not on Windows
        with suppress(PermissionError):
            os.fchown(descriptor, old.st_uid, old.st_gid)
        os.fchmod(descriptor, stat.S_IMODE(old.st_mode))


def read_bytes(path: Path) -> bytes:
    """The content of a regular file, or what another program writes into a pipe. Raises FileError."""
    try:
        with open(path, "rb", opener=_open_without_waiting) as file:
            mode = os.fstat(file.fileno()).st_mode
            if stat.S_ISFIFO(mode):
                return _read_pipe(file.fileno(), path)
            if not stat.S_ISREG(mode):
                raise FileError(path, "is a device; name a regular file")
            return file.read()
    except OSError as error:
        raise FileError(path, f"cannot be read ({error.strerror}); is the name right?") from error


def open_bytes(path: Path) -> IO[bytes]:
    """A regular file, to read a part at a time; or what read_bytes() gives. Raises FileError."""
    try:
        if path.is_file():
            return path.open("rb")
    except OSError as error:
        raise FileError(path, f"cannot be read ({error.strerror}); is the name right?") from error
    return io.BytesIO(read_bytes(path))


def _open_without_waiting(name: str, flags: int) -> int:
    return os.open(name, flags | getattr(os, "O_NONBLOCK", 0))  # not on Windows


def _read_pipe(descriptor: int, path: Path) -> bytes:
    content = bytearray()
    while select.select([descriptor], [], [], _PIPE_S)[0]:
        piece = os.read(descriptor, 1 << 16)
        if not piece:
            return bytes(content)
        content += piece
    raise FileError(path, f"is a pipe that brought nothing for {_PIPE_S:g} s; write into it, or name a regular file")


def read_text(path: Path) -> str:
    """The content of a text file, UTF-8. Raises FileError."""
    try:
        return read_bytes(path).decode()
    except UnicodeDecodeError as error:
        raise FileError(path, "is not a text file (UTF-8)") from error


def text_lines(text: str) -> Iterator[str]:
    """The lines of a text, without a byte order mark. Only CR, LF and CRLF end one, as for other programs; what str
    takes for an end besides, such as VT or U+2028, may stand in a comment."""
    begin = len(text) - len(text.removeprefix("\ufeff"))
    for end in re.finditer(r"\r\n|\r|\n", text):
        yield text[begin : end.start()]
        begin = end.end()
    yield text[begin:]


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file. Raises FileError."""
    try:
        return tomllib.loads(read_text(path))
    except ValueError as error:  # TOMLDecodeError, and that of a number with thousands of digits
        raise FileError(path, f"is not a TOML file: {error}") from error
    except RecursionError as error:
        raise FileError(path, "is not a TOML file of Kontur: it is nested too deeply") from error
