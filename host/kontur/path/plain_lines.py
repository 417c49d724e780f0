# SPDX-License-Identifier: Apache-2.0
"""Lines of G-code that consist of G0 or G1, x, y and F, or less, many at a time: nine tenths of a long file.

A line is *plain* if it is a row of letters with one number each, none of them twice, and of blanks before letters and
at its end; G must be 0 or 1 and F above zero. All others are read word by word (kontur.path.gcode_words). Numbers are
made by float(), as there.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_left
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from kontur.path.geometry import FloatArray

_CHARACTERS = 1 << 19  # of a text at once
_END = re.compile(r"\r\n|\r|\n")
_LETTERS = b"GXYFN"
_OTHER, _LETTER, _DIGIT, _DOT, _SIGN, _BLANK, _NEWLINE = range(7)
_FOLLOWED = {  # what of a plain line may stand before what
    _LETTER: (_DIGIT, _DOT, _SIGN),
    _DIGIT: (_DIGIT, _DOT, _BLANK, _LETTER, _NEWLINE),
    _DOT: (_DIGIT, _BLANK, _LETTER, _NEWLINE),
    _SIGN: (_DIGIT, _DOT),
    _BLANK: (_BLANK, _LETTER, _NEWLINE),
    _NEWLINE: (_BLANK, _LETTER, _NEWLINE),
}
_LARGEST, _LEAST_FEED = 1e12, 1e-300


def _tables() -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.bool_], npt.NDArray[np.uint8], bytes]:
    """By byte: its kind, and the column of a letter; whether two kinds may not follow each other; letters to blanks."""
    kind, column = np.full(256, _OTHER, np.uint8), np.zeros(256, np.uint8)
    both = _LETTERS + _LETTERS.lower()
    for characters, of in ((both, _LETTER), (b"0123456789", _DIGIT), (b".", _DOT), (b"+-", _SIGN), (b" \t", _BLANK)):
        kind[list(characters)] = of
    kind[ord("\n")] = _NEWLINE
    column[list(both)] = [*range(len(_LETTERS))] * 2
    wrong = np.ones(64, np.bool_)
    for before, after in _FOLLOWED.items():
        wrong[[8 * before + one for one in after]] = False
    return kind, wrong, column, bytes.maketrans(both, b" " * len(both))


_KIND, _WRONG, _COLUMN, _TO_BLANKS = _tables()


class Lines:
    """Lines of a text, the first of them its line `number`. `values` (n, 4): the numbers of G, X, Y and F of the plain
    ones, NaN where there is none."""

    def __init__(self, text: str, number: int) -> None:
        data = text.encode("utf-8", "surrogatepass") + b"\n"
        if b"\r" in data:
            data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        self.number = number
        self._data = data
        raw = np.frombuffer(data, np.uint8)
        kind = _KIND[raw]
        self._end = np.flatnonzero(kind == _NEWLINE)
        self._begin = np.append(0, self._end[:-1] + 1)
        before = np.append(np.uint8(_NEWLINE), kind[:-1])
        plain = ~np.logical_or.reduceat(_WRONG[8 * before + kind], self._begin)
        self.values = self._read(raw, kind == _LETTER, plain)[:, :4]
        g, feed = self.values[:, 0], self.values[:, 3]
        plain &= (np.isnan(g) | (g == 0.0) | (g == 1.0)) & (np.isnan(feed) | (feed > _LEAST_FEED))
        self._others: list[int] = np.flatnonzero(~plain).tolist()

    def _read(
        self, raw: npt.NDArray[np.uint8], is_letter: npt.NDArray[np.bool_], plain: npt.NDArray[np.bool_]
    ) -> FloatArray:
        """The numbers of the `plain` lines by letter (n, letters). A line that has a letter twice, or a number that is
        none or too large, is not `plain`."""
        values = np.full((len(plain), len(_LETTERS)), math.nan)
        if not np.all(plain):
            of_plain = np.repeat(plain, np.diff(self._end, prepend=-1))
            is_letter &= of_plain
            words = raw[of_plain].tobytes()
        else:
            words = self._data
        letter = np.flatnonzero(is_letter)
        line = np.searchsorted(self._end, letter)
        try:
            value = np.fromiter(map(float, words.translate(_TO_BLANKS).split()), float, len(letter))
        except ValueError:  # such as "1.2.3"
            plain[:] = False
            return values
        values[line, _COLUMN[raw[letter]]] = value
        has = ~np.isnan(values)
        if np.count_nonzero(has) < len(letter):
            plain &= np.bincount(line, minlength=len(plain)) == np.count_nonzero(has, axis=1)
        plain[line[~(np.abs(value) < _LARGEST)]] = False
        return values

    def __len__(self) -> int:
        return len(self.values)

    def text(self, row: int) -> str:
        return self._data[self._begin[row] : self._end[row]].decode("utf-8", "surrogatepass")

    def plain_until(self, row: int) -> int:
        """The next row from `row` on that is not plain."""
        at = bisect_left(self._others, row)
        return self._others[at] if at < len(self._others) else len(self)


def lines(text: str) -> Iterator[Lines]:
    """The lines of `text` as those of kontur.files.text_lines, part by part."""
    begin, number = len(text) - len(text.removeprefix("\ufeff")), 1
    while end := _END.search(text, begin + _CHARACTERS):
        part = Lines(text[begin : end.start()], number)
        yield part
        begin, number = end.end(), number + len(part)
    yield Lines(text[begin:], number)


def carried(values: FloatArray, before: float) -> FloatArray:
    """`values` (n,), with the last one, or the one `before` all, in place of each NaN."""
    missing = np.isnan(values)
    if not np.any(missing):
        return values
    row = np.where(missing, -1, np.arange(len(values)))
    np.maximum.accumulate(row, out=row)
    return np.where(row < 0, before, values[row])
