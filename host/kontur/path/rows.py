# SPDX-License-Identifier: Apache-2.0
"""A sequence that is kept as columns of numbers, and makes an object of a row only where one is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")


class Rows(Sequence[T]):
    """What such sequences share: they are equal to any sequence of equal objects."""

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence):
            return NotImplemented
        return len(self) == len(other) and all(a == b for a, b in zip(self, other, strict=True))

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"{type(self).__name__}({list(self)})"
