# SPDX-License-Identifier: Apache-2.0
"""Outputs beside the axes that are tied to knots, and their frames (docs/protocol.md, Outputs tied to knots)."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kontur.can.wire import crc8

FULL_POWER = 65535
DIGITAL, HOLD, BY_RATE = 0x0FFF, 0x4000, 0x8000
"""Bits of digital outputs, and two beside them: the path is held at the knot; the power goes with the rate."""


@dataclass(frozen=True)
class Outputs:
    """Changes of the outputs: from `knot` (m,) on, which rises, they are `digital` (m,) and `power` (m,), 0 to
    FULL_POWER. Before the first one all are off."""

    knot: NDArray[np.int64]
    digital: NDArray[np.uint16]
    power: NDArray[np.uint16]

    def __len__(self) -> int:
        return len(self.knot)

    @property
    def holds(self) -> list[int]:
        """The knots at which the path is held."""
        return [int(knot) for knot in self.knot[self.digital & HOLD != 0]]

    @property
    def checksum(self) -> int:
        """CRC-32 of the changes, as the drive counts it (2180h:4)."""
        return zlib.crc32(np.stack([self.knot, self._words()], axis=1).astype("<u4").tobytes())

    def __getitem__(self, rows: slice) -> Outputs:
        """Some of the changes."""
        return Outputs(self.knot[rows], self.digital[rows], self.power[rows])

    def since(self, knot: int) -> Outputs:
        """The changes from this knot on."""
        return self[int(np.searchsorted(self.knot, knot)) :]

    def frames(self) -> NDArray[np.uint8]:
        """The frame (RPDO5) that precedes each knot with a change (m, 6)."""
        frames = np.empty((len(self), 6), dtype=np.uint8)
        frames[:, 0] = self.knot & 0xFF
        frames[:, 2:6] = self._words().astype("<u4").view(np.uint8).reshape(-1, 4)
        frames[:, 1] = crc8(frames[:, [0, 2, 3, 4, 5]])
        return frames

    def _words(self) -> NDArray[np.uint32]:
        return self.digital.astype(np.uint32) | self.power.astype(np.uint32) << np.uint32(16)


NONE = Outputs(np.empty(0, dtype=np.int64), np.empty(0, dtype=np.uint16), np.empty(0, dtype=np.uint16))


def chained(knots: bytearray, outputs: Outputs) -> None:
    """Change the CRC of the frames of `knots` that a frame of `outputs` precedes: they are refused without it."""
    crc = np.frombuffer(knots, dtype=np.uint8)[1::8]
    crc[outputs.knot] ^= outputs.frames()[:, 1] | 1
