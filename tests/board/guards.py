# SPDX-License-Identifier: Apache-2.0
"""What of an STM32F405 watches the core, or stops with it: watchdogs and debug unit, see peripherals.py."""

from __future__ import annotations

from chip import FOREVER
from peripherals import Peripheral

LSI_HZ = 32e3


class Iwdg(Peripheral):
    """RM0090 21. It counts by the LSI, whatever the core does, unless a debugger halts it and DBG_IWDG_STOP is set."""

    base = 0x40003000
    lsi_hz = LSI_HZ

    def reset(self) -> None:
        self.words = {4: 0, 8: 0xFFF}
        self.started = self.access = False
        self.deadline_ns = FOREVER
        self.feeds: list[float] = []
        self.update_until_ns = 0.0

    def period_ns(self) -> float:
        return (self.words[8] + 1) * (4 << self.words[4]) / self.lsi_hz * 1e9

    def read(self, offset: int) -> int:
        if offset == 0xC:
            return 3 if self.chip.now_ns < self.update_until_ns else 0
        return super().read(offset)

    def write(self, offset: int, value: int) -> None:
        if offset == 0:
            self.access = value == 0x5555
            if value == 0xCCCC:
                self.started = True
            if value in (0xCCCC, 0xAAAA):
                if value == 0xAAAA and self.chip.now_ns < self.update_until_ns:
                    self.broken("it is fed while PR and RLR are still being taken over (21.4.4)")
                self.feeds.append(self.chip.now_ns)
                self._start()
        elif not self.access:
            self.broken("PR or RLR written without access (21.4.1)")
        else:
            self.words[offset] = value
            self.update_until_ns = self.chip.now_ns + 5 / self.lsi_hz * 1e9

    def _start(self) -> None:
        self.deadline_ns = self.chip.now_ns + self.period_ns() if self.started else FOREVER
        self.chip.at(self.deadline_ns, self._look)

    def _look(self) -> None:
        if self.chip.halted and self.chip.dbgmcu.words.get(8, 0) >> 12 & 1:
            self._start()  # it stands
        elif self.deadline_ns <= self.chip.now_ns:
            self.chip.request_reset("IWDG")


class Wwdg(Peripheral):
    """RM0090 22: counts 4096 clocks of APB1, divided by 2^WDGTB, and resets when T6 becomes 0."""

    base, clock = 0x40002C00, ("APB1", 11)

    def reset(self) -> None:
        self.words = {0: 0x7F, 4: 0x7F}
        self.deadline_ns = FOREVER
        self.feeds: list[float] = []
        self.count_ns = 0.0  # of the clock that it counts by now

    def clock_changed(self) -> None:
        if self.deadline_ns < FOREVER:
            before_ns, self.count_ns = self.count_ns, self._count_ns()
            now_ns = self.chip.now_ns
            self.deadline_ns = now_ns + (self.deadline_ns - now_ns) * self.count_ns / before_ns
            self.chip.at(self.deadline_ns, self._look)

    def _count_ns(self) -> float:
        return 4096 * (1 << (self.words[4] >> 7 & 3)) / self.chip.rcc.bus_hz("APB1") * 1e9

    def write(self, offset: int, value: int) -> None:
        if offset == 0:
            if value & 0x80 and not value & 0x40:
                self.chip.request_reset("WWDG")
            if self.deadline_ns < FOREVER:
                left = int((self.deadline_ns - self.chip.now_ns) / self._count_ns()) + 0x40
                if left > self.words[4] & 0x7F:
                    self.broken("it is fed before its window (22.3)")
                    self.chip.request_reset("WWDG")
            if value & 0x80 or self.deadline_ns < FOREVER:
                self.feeds.append(self.chip.now_ns)
                self.count_ns = self._count_ns()
                self.deadline_ns = self.chip.now_ns + ((value & 0x7F) - 0x3F) * self.count_ns
                self.chip.at(self.deadline_ns, self._look)
        super().write(offset, value)

    def _look(self) -> None:
        if self.chip.halted and self.chip.dbgmcu.words.get(8, 0) >> 11 & 1:
            self.deadline_ns = self.chip.now_ns + self._count_ns()
            self.chip.at(self.deadline_ns, self._look)
        elif self.deadline_ns <= self.chip.now_ns:
            self.chip.request_reset("WWDG")


class Dbgmcu(Peripheral):
    """RM0090 38.16. Only power-on resets it."""

    base = 0xE0042000
    revision = 0x1007

    def reset(self) -> None:
        self.words = getattr(self, "words", {})

    def power_on(self) -> None:
        self.words = {}

    def read(self, offset: int) -> int:
        return self.revision << 16 | 0x413 if offset == 0 else super().read(offset)


class Dwt(Peripheral):
    """DDI 0403E C1.8: CYCCNT alone, which counts while CTRL and DEMCR say so."""

    base = 0xE0001000

    def read(self, offset: int) -> int:
        if offset == 4 and self.words.get(0, 0) & 1 and self.chip.core.words.get(0xDFC, 0) >> 24 & 1:
            return int(self.chip.now_ns / self.chip.cycle_ns) & 0xFFFFFFFF
        return super().read(offset)
