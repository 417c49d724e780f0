# SPDX-License-Identifier: Apache-2.0
"""What a program switches beside the path: words such as M3 and S1000, each before an item of the program."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
import numpy.typing as npt

from kontur.path.rows import Rows


@dataclass(frozen=True)
class Event:
    """A word of the program that switches something beside the path, such as "M3", "S1000", "M62 P0" or "Z-1" (a pen).

    It happens before item `before` of the program, or at its end. `line` is the line of the file.
    """

    word: str
    before: int
    line: int

    @property
    def kind(self) -> str:
        return kind(self.word)


def kind(word: str) -> str:
    """The word of an M code; of the others, which have values, the letter."""
    return word.split()[0] if word[0] == "M" else word[0]


_NONE = np.empty(0, np.int64)


class Events(Rows[Event]):
    """A sequence of events like a tuple, as rows of numbers: 24 bytes an event in place of 250. Event i is the word
    `words[code[i]]`; `code`, `before` and `line` are (n,). `words` are in the order in which they first come."""

    def __init__(
        self,
        words: Sequence[str] = (),
        code: npt.NDArray[np.int64] = _NONE,
        before: npt.NDArray[np.int64] = _NONE,
        line: npt.NDArray[np.int64] = _NONE,
    ) -> None:
        self.words, self.code, self.before, self.line = words, code, before, line

    def __len__(self) -> int:
        return len(self.code)

    @overload
    def __getitem__(self, index: int) -> Event: ...
    @overload
    def __getitem__(self, index: slice) -> Events: ...
    def __getitem__(self, index: int | slice) -> Event | Events:
        if isinstance(index, slice):
            return Events(self.words, self.code[index], self.before[index], self.line[index])
        return Event(self.words[self.code[index]], int(self.before[index]), int(self.line[index]))

    def rows(self, words: Iterable[str]) -> npt.NDArray[np.intp]:
        """Which events are one of these `words`."""
        codes = [code for code, word in enumerate(self.words) if word in words]
        return np.flatnonzero(np.isin(self.code, codes))

    def kinds(self) -> dict[str, tuple[int, Event]]:
        """How many events there are of each kind, and the first one of them, in the order in which they first come."""
        found: dict[str, tuple[int, Event]] = {}
        if not len(self):
            return found
        used, first, counts = np.unique(self.code, return_index=True, return_counts=True)
        for order in np.argsort(first).tolist():
            of_word = kind(self.words[int(used[order])])
            before, event = found.get(of_word, (0, self[int(first[order])]))
            found[of_word] = before + int(counts[order]), event
        return found


class Builder:
    """Makes Events of words that come one after the other."""

    def __init__(self) -> None:
        self._codes: dict[str, int] = {}
        self._code, self._before, self._line = array("q"), array("q"), array("q")

    def add(self, word: str, before: int, line: int) -> None:
        self._code.append(self._codes.setdefault(word, len(self._codes)))
        self._before.append(before)
        self._line.append(line)

    def powers(self, s: npt.NDArray[np.float64], before: npt.NDArray[np.int64], line: npt.NDArray[np.int64]) -> None:
        """S words with the values `s` (n,)."""
        values, inverse = np.unique(s, return_inverse=True)
        words = [f"S{value:g}" for value in values.tolist()]
        codes = np.array([self._codes.setdefault(word, len(self._codes)) for word in words], np.int64)
        for column, rows in ((self._code, codes[inverse]), (self._before, before), (self._line, line)):
            column.frombytes(rows.astype(np.int64).tobytes())

    def events(self) -> Events:
        return Events(list(self._codes), *(np.frombuffer(c, np.int64) for c in (self._code, self._before, self._line)))
