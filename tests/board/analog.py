# SPDX-License-Identifier: Apache-2.0
"""The serial DAC of a board: the SPI that sends to it, and a DAC8563 (TI, SLAS719E) that receives.

The times of its pins are those of the DAC8568, whose interface is the same (TI, SBAS430F, timing requirements, 2.7 to
5.5 V): a clock of SCLK 20 ns, SYNC high 80 ns, SYNC low 13 ns before the first falling edge of SCLK, and SYNC high
10 ns after the last one.
"""

from __future__ import annotations

from chip import Chip
from peripherals import Peripheral

MID_SCALE = 0x8000
INPUT, UPDATE, WRITE_UPDATE_ALL, WRITE_UPDATE, POWER, RESET, LDAC, REFERENCE = range(8)  # table 17, C2 to C0
GAIN, BOTH = 2, 7  # addresses beside 0 (A) and 1 (B)


class Spi(Peripheral):
    """RM0090 28.3, 28.5: a master that sends bytes. `receiver` gets each of them at its last clock."""

    CR1, SR, DR = 0x00, 0x08, 0x0C
    receiver: Dac8563 | None = None

    def reset(self) -> None:
        super().reset()
        self.shifting = False
        self.waiting: int | None = None

    def bit_ns(self) -> float:
        return (2 << (self.words[self.CR1] >> 3 & 7)) / self.chip.rcc.bus_hz("APB1") * 1e9

    def read(self, offset: int) -> int:
        if offset == self.SR:
            return (0 if self.waiting is not None else 2) | (1 << 7 if self.shifting else 0)
        return super().read(offset)

    def write(self, offset: int, value: int) -> None:
        if offset != self.DR:
            super().write(offset, value)
            return
        cr1 = self.words.get(self.CR1, 0)
        if not (cr1 >> 6 & 1 and cr1 >> 2 & 1 and cr1 >> 8 & 3 == 3):
            self.broken("DR written while it is no enabled master with SSM and SSI (28.3.3)")
        elif self.waiting is not None:
            self.broken("DR written while TXE is 0 (28.3.7)")
        elif self.shifting:
            self.waiting = value & 0xFF
        else:
            self._shift(value & 0xFF)

    def _shift(self, byte: int) -> None:
        self.shifting = True
        self.chip.at(self.chip.now_ns + 8 * self.bit_ns(), lambda: self._sent(byte))

    def _sent(self, byte: int) -> None:
        self.shifting = False
        if self.receiver is not None:
            self.receiver.clock_in(byte, self.words[self.CR1], self.bit_ns())
        if self.waiting is not None:
            byte, self.waiting = self.waiting, None
            self._shift(byte)


class Spi2(Spi):
    base, clock = 0x40003800, ("APB1", 14)


class Spi3(Spi):
    base, clock = 0x40003C00, ("APB1", 15)


class Dac8563:
    """Its pin LDAC is low, so that it updates at once unless its register says otherwise. `history`: (ns, A, B) at each
    update. A reset of the chip does not reset it."""

    def __init__(self, chip: Chip) -> None:
        self.chip = chip
        self.power_on()

    def power_on(self) -> None:
        self.bits = self.word = 0
        self.selected = False
        self.rose_ns = self.fell_ns = self.clocked_ns = -1e9
        self.history: list[tuple[float, int, int]] = []
        self._reset()

    def _reset(self) -> None:
        self.inputs, self.codes = [MID_SCALE, MID_SCALE], [MID_SCALE, MID_SCALE]
        self.gain, self.reference, self.ldac_inactive = 1, False, False

    def sync(self, high: bool) -> None:
        """The pin SYNC changes."""
        if high:
            if self.selected and self.bits != 24:
                self._broken(f"SYNC rises after {self.bits} bits (8.5.1)")
            if self.selected and self.chip.now_ns - self.clocked_ns < 10:
                self._broken("SYNC rises less than 10 ns after the last falling edge of SCLK (7.6)")
            self.rose_ns = self.chip.now_ns
        elif self.chip.now_ns - self.rose_ns < 80:
            self._broken("SYNC is high for less than 80 ns (7.6)")
        else:
            self.fell_ns = self.chip.now_ns
        self.selected, self.bits, self.word = not high, 0, 0

    def clock_in(self, byte: int, cr1: int, bit_ns: float) -> None:
        if not self.selected:
            return
        if (cr1 & 1) == (cr1 >> 1 & 1):
            self._broken("it takes a bit at the falling edge of SCLK: CPHA and CPOL must differ (7.6)")
        if bit_ns < 20:
            self._broken(f"SCLK has {1e3 / bit_ns:.0f} MHz, more than 50 (7.6)")
        self.clocked_ns = self.chip.now_ns - bit_ns / 2
        if self.bits == 0 and self.clocked_ns - 7 * bit_ns - self.fell_ns < 13:
            self._broken("SYNC falls less than 13 ns before the first falling edge of SCLK (7.6)")
        self.word, self.bits = self.word << 8 | byte, self.bits + 8
        if self.bits == 24:
            self._command(self.word >> 19 & 7, self.word >> 16 & 7, self.word & 0xFFFF)

    def _command(self, command: int, address: int, data: int) -> None:
        """Table 17."""
        channels = {0: (0,), 1: (1,), BOTH: (0, 1)}.get(address, ())
        if command in (INPUT, WRITE_UPDATE_ALL, WRITE_UPDATE) and address != GAIN:
            for channel in channels:
                self.inputs[channel] = data
            update = (0, 1) if command == WRITE_UPDATE_ALL else channels
            if command != INPUT or not self.ldac_inactive:
                self._update(update)
        elif command == INPUT:
            self.gain = 1 if data & 1 else 2
        elif command == UPDATE:
            self._update(channels)
        elif command == RESET:
            if data & 1:
                self._reset()
            else:
                self.inputs = [MID_SCALE, MID_SCALE]
            self._update((0, 1))
        elif command == LDAC:
            self.ldac_inactive = data & 3 == 3
        elif command == REFERENCE:
            self.reference, self.gain = bool(data & 1), 2 if data & 1 else 1
        else:
            self._broken(f"the model lacks the command {command}")

    def _update(self, channels: tuple[int, ...]) -> None:
        for channel in channels:
            self.codes[channel] = self.inputs[channel]
        self.history.append((self.chip.now_ns, *self.codes))

    def volts(self) -> tuple[float, ...]:
        """At its outputs; 8.3.1"""
        return tuple(code / 65536 * 2.5 * self.gain if self.reference else 0.0 for code in self.codes)

    def _broken(self, rule: str) -> None:
        self.chip.broken.append(f"Dac8563: {rule} ({self.chip.now_ns / 1e6:.3f} ms)")
