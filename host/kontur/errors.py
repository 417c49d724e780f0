# SPDX-License-Identifier: Apache-2.0
"""The exception tree. Every room raises these. And visible() and shown(), for texts and numbers from outside.

A message says what went wrong, where, and what to do next. The command line prints it, without a traceback.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

_LONG = 16  # characters of a number
_WORD_MAX, _PROBLEM_MAX = 200, 1500  # characters that a message shows of a file's own text


def visible(text: str) -> str:
    """`text` with what a terminal would obey and not show, such as control characters, as escapes like \\x1b.

    Line breaks and tabs stay.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in text)


def _shortened(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[:most]}..."


def shown(value: float, digits: int = 3) -> str:
    """A number in a message, with `digits` after the point; with an exponent where that would be long."""
    text = f"{value:.{digits}f}"
    return text if len(text) <= _LONG else f"{value:.4g}"


class KonturError(Exception):
    """Base of every error that a user of kontur can cause or meet. It can be sent to another process."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpickled, (type(self), self.args), self.__dict__


def _unpickled(kind: type[KonturError], args: tuple[object, ...]) -> KonturError:
    """The error as it was, without its __init__, whose arguments are others than `args`."""
    return kind.__new__(kind, *args)


class InputError(KonturError):
    """A file or value given by the user cannot be used."""


class FileError(InputError):
    """A mistake in an input file.

    `line` is counted from 1; `word` is the offending piece of text. Both may be unknown (None).
    """

    def __init__(self, file: str | Path, problem: str, line: int | None = None, word: str | None = None) -> None:
        self.file = str(file)
        self.problem = problem
        self.line = line
        self.word = word
        where = self.file if line is None else f"{self.file}:{line}"
        what = problem if word is None else f"{_shortened(word, _WORD_MAX)}: {problem}"
        super().__init__(f"{where}: {_shortened(what, _PROBLEM_MAX)}")


class PathError(InputError):
    """A path that cannot be planned or driven: outside the limits, empty, without a feed."""


class MachineError(InputError):
    """A machine file that cannot be used."""


class ParameterError(InputError):
    """An unknown parameter, or a value outside its range."""


class LibraryError(KonturError):
    """The simulator library is missing or does not fit this version of the package."""


class SimulatorError(KonturError):
    """The process of the simulated drive does not start, or has failed."""


class BusError(KonturError):
    """The CAN bus cannot be opened, or failed."""


class DeviceError(KonturError):
    """The drive answered with an error, or does not reach the wanted state."""


class NoAnswerError(DeviceError):
    """The drive does not answer."""


class HeldError(DeviceError):
    """Another program commands the drive."""


class StreamError(DeviceError):
    """A trajectory could not be streamed to its end."""


class EmcyError(DeviceError):
    """The drive reported an emergency (EMCY) object.

    `code` is the EMCY error code, `register` the error register 1001h, `data` the five manufacturer bytes.
    """

    def __init__(self, code: int, register: int, data: bytes, text: str) -> None:
        self.code = code
        self.register = register
        self.data = data
        super().__init__(text)


class LogError(InputError):
    """A log file that cannot be read or written."""
