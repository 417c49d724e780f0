# SPDX-License-Identifier: Apache-2.0
"""Standard output and error of a command: text from outside cannot command the terminal, and no text ends the work.

- Control characters, in names of files for example, are printed as escapes such as \\x1b. So is what the encoding of
  the terminal does not have.
- A stream that takes nothing more (a closed pipe, a full disk) does not stop a motion, or keep a log from being
  written. The command goes on without it, and its exit code tells.
"""

from __future__ import annotations

import errno
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO

from kontur.errors import visible

EXIT_LOST_OUTPUT = 1
EXIT_CLOSED_PIPE = 141  # that of a program which SIGPIPE ends


class _Lasting(io.FileIO):
    """A descriptor that goes on taking text after it could not be written; `lost` says why it could not."""

    lost: OSError | None = None

    def write(self, data: Any, /) -> int:
        try:
            return super().write(data)
        except OSError as error:
            self.lost = self.lost or error
            return len(memoryview(data))


class _Visible(io.TextIOBase):
    """A text stream that prints control characters as escapes. `styled` takes what rich has formatted."""

    def __init__(self, styled: TextIO) -> None:
        self.styled = styled

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return self.styled.encoding

    def write(self, text: str, /) -> int:
        return self.styled.write(visible(text))

    def flush(self) -> None:
        self.styled.flush()

    def isatty(self) -> bool:
        return self.styled.isatty()

    def fileno(self) -> int:
        return self.styled.fileno()

    def writable(self) -> bool:
        return True


def styled(stream: TextIO) -> TextIO:
    """The stream for text with escape sequences of our own, from which others' have been taken out by visible()."""
    return stream.styled if isinstance(stream, _Visible) else stream


@contextmanager
def guarded() -> Iterator[None]:
    """Let sys.stdout and sys.stderr be as above. A SystemExit without an error gets the exit code of a lost output."""
    before = sys.stdout, sys.stderr
    sys.stdout, out = _guard(before[0])
    sys.stderr, err = _guard(before[1])
    try:
        yield
    except SystemExit as end:
        sys.stdout.flush()
        lost = next((raw.lost for raw in (out, err) if raw and raw.lost), None)
        if lost and lost.errno != errno.EPIPE:
            print(f"Error: the output cannot be written ({lost.strerror}); send it elsewhere", file=sys.stderr)
        if lost and not end.code:
            end.code = EXIT_CLOSED_PIPE if lost.errno == errno.EPIPE else EXIT_LOST_OUTPUT
        raise
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        sys.stdout, sys.stderr = before


def _guard(stream: TextIO | None) -> tuple[TextIO, _Lasting | None]:
    if stream is None:  # closed by the caller
        return open(os.devnull, "w"), None
    raw = None
    text = stream
    if os.name == "posix" and _has_descriptor(stream):
        stream.flush()
        raw = _Lasting(stream.fileno(), "wb", closefd=False)
        text = io.TextIOWrapper(io.BufferedWriter(raw), stream.encoding, "backslashreplace", write_through=True)
    visible_stream: TextIO = _Visible(text)  # type: ignore[assignment]
    return visible_stream, raw


def _has_descriptor(stream: TextIO) -> bool:
    try:
        return stream.fileno() >= 0
    except (OSError, ValueError):  # in a test
        return False
