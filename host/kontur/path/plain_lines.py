# SPDX-License-Identifier: Apache-2.0
"""Lines of G-code that consist of G0 to G3, X, Y, I, J, F and S, or less, or of G4 with its P, many at a time: nine
tenths of a long file.

A line is *plain* if it is a row of letters with one number each, none of them twice, and of blanks and comments before
letters and at its end; G must be 0 to 3 and F above zero, or G 4 and P not negative and alone beside it. All others are
read word by word (kontur.path.gcode_words).
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
_LETTERS = b"GXYFSIJPN"  # their columns in Lines.values, but for N
_COMMENT = re.compile(rb"\([^()\n]*\)|;[^\n]*")
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
_MOTIONS, _DWELL = (0.0, 1.0, 2.0, 3.0), 4.0
_DIGITS = 15  # of a number that is read with others
_POWERS = 10.0 ** np.arange(_DIGITS + 1)


def _tables() -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.bool_], npt.NDArray[np.uint8]]:
    """By byte its kind; by two kinds whether they may not follow each other; by byte the column of a letter."""
    kind, column = np.full(256, _OTHER, np.uint8), np.zeros(256, np.uint8)
    both = _LETTERS + _LETTERS.lower()
    for characters, of in ((both, _LETTER), (b"0123456789", _DIGIT), (b".", _DOT), (b"+-", _SIGN), (b" \t", _BLANK)):
        kind[list(characters)] = of
    kind[ord("\n")] = _NEWLINE
    column[list(both)] = [*range(len(_LETTERS))] * 2
    wrong = np.ones(64, np.bool_)
    for before, after in _FOLLOWED.items():
        wrong[[8 * before + one for one in after]] = False
    return kind, wrong, column


_KIND, _WRONG, _COLUMN = _tables()


class Lines:
    """Lines of a text, the first of them its line `number`. `values` (8, n): the numbers of G, X, Y, F, S, I, J and P
    of the plain ones, NaN where there is none. A dwell has its P alone."""

    def __init__(self, text: str, number: int) -> None:
        data = text.encode("utf-8", "surrogatepass") + b"\n"
        if b"\r" in data:
            data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        self.number = number
        self._data = data
        code = data
        if b"(" in data or b";" in data:
            code = _COMMENT.sub(lambda comment: b" " * len(comment[0]), data)
        raw = np.frombuffer(code, np.uint8)
        kind = _KIND[raw]
        self._end = np.flatnonzero(kind == _NEWLINE)
        self._begin = np.append(0, self._end[:-1] + 1)
        before = np.append(np.uint8(_NEWLINE), kind[:-1])
        plain = ~np.logical_or.reduceat(_WRONG[8 * before + kind], self._begin)
        self.values = self._read(raw, kind, plain)[:-1]
        g, feed, wait = self.values[0], self.values[3], self.values[7]
        plain &= np.isnan(feed) | (feed > _LEAST_FEED)
        dwell = (g == _DWELL) & (wait >= 0.0)
        if np.any(dwell):
            dwell &= np.all(np.isnan(self.values[1:7]), axis=0)
            g[dwell] = math.nan
        plain &= (np.isnan(g) | np.isin(g, _MOTIONS)) & (dwell | np.isnan(wait))
        self._others: list[int] = np.flatnonzero(~plain).tolist()

    def _read(
        self, raw: npt.NDArray[np.uint8], kind: npt.NDArray[np.uint8], plain: npt.NDArray[np.bool_]
    ) -> FloatArray:
        """The numbers of the `plain` lines by letter (letters, n). A line that has a letter twice, or a number that is
        none or too large, is not `plain`."""
        values = np.full((len(_LETTERS), len(plain)), math.nan)
        is_letter, is_number = kind == _LETTER, (kind == _DIGIT) | (kind == _DOT) | (kind == _SIGN)
        if not np.all(plain):
            of_plain = np.repeat(plain, np.diff(self._end, prepend=-1))
            is_letter &= of_plain
            is_number &= of_plain
        letter = np.flatnonzero(is_letter)
        line = np.searchsorted(self._end, letter)
        stop = np.flatnonzero(is_number[:-1] & ~is_number[1:]) + 1
        value = _numbers(raw, letter + 1, stop)
        values[_COLUMN[raw[letter]], line] = value
        has = ~np.isnan(values)
        if np.count_nonzero(has) < len(letter):
            plain &= np.bincount(line, minlength=len(plain)) == np.count_nonzero(has, axis=0)
        plain[line[~(np.abs(value) < _LARGEST)]] = False
        return values

    def __len__(self) -> int:
        return len(self._end)

    def text(self, row: int) -> str:
        return self._data[self._begin[row] : self._end[row]].decode("utf-8", "surrogatepass")

    def plain_until(self, row: int) -> int:
        """The next row from `row` on that is not plain."""
        at = bisect_left(self._others, row)
        return self._others[at] if at < len(self._others) else len(self)


def _numbers(raw: npt.NDArray[np.uint8], begin: npt.NDArray[np.intp], stop: npt.NDArray[np.intp]) -> FloatArray:
    """The decimal numbers (n,) from `begin` to `stop` as float() reads them; NaN for what is none, such as 1.2.3.

    An integer of so few digits, divided by a power of ten, is exact but for the division, which rounds right.
    """
    negative = raw[begin] == ord("-")
    begin = begin + (negative | (raw[begin] == ord("+")))
    length = stop - begin
    digits, places, points = (np.zeros(len(begin), np.int64) for _ in range(3))
    for i in range(min(int(np.max(length, initial=0)), _DIGITS + 1)):
        byte = raw[np.minimum(begin + i, len(raw) - 1)].astype(np.int64)
        is_point = (length > i) & (byte == ord("."))
        is_digit = (length > i) & ~is_point
        digits = np.where(is_digit, 10 * digits + (byte - ord("0")), digits)
        places += is_digit & (points > 0)
        points += is_point
    value = digits / _POWERS[places]
    value[(points > 1) | (length == points)] = math.nan
    for i in np.flatnonzero(length > _DIGITS + 1).tolist():
        try:
            value[i] = float(raw[begin[i] : stop[i]].tobytes())
        except ValueError:
            value[i] = math.nan
    return np.where(negative, -value, value)


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
