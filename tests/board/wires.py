# SPDX-License-Identifier: Apache-2.0
"""What of an STM32F405 talks: USART and bxCAN, see peripherals.py."""

from __future__ import annotations

from collections import deque

from peripherals import Peripheral

RXNE, TXE, ORE, NOISE, FRAMING = 1 << 5, 1 << 7, 1 << 3, 1 << 2, 1 << 1


class Usart(Peripheral):
    """RM0090 30.6. `sent` has the bytes that went out; `receive()` lets bytes come in."""

    SR, DR, BRR, CR1 = 0x00, 0x04, 0x08, 0x0C
    irq, bus = 0, ""

    def reset(self) -> None:
        super().reset()
        self.sent = bytearray()
        self.flags, self.byte, self.read_status = TXE | 1 << 6, 0, False

    def byte_ns(self) -> float:
        return 10 * self.words[self.BRR] / self.chip.rcc.bus_hz(self.bus) * 1e9

    def receive(self, data: bytes, error: int = 0) -> None:
        """Bytes come in, one after the other, each with an error flag (NOISE, FRAMING) or 0."""
        for n, byte in enumerate(data):
            self.chip.at(self.chip.now_ns + (n + 1) * self.byte_ns(), lambda b=byte: self._arrive(b, error))  # type: ignore[misc]

    def _arrive(self, byte: int, error: int) -> None:
        if self.flags & RXNE:
            self.flags |= ORE
        else:
            self.byte = byte
        self.flags |= RXNE | error

    def read(self, offset: int) -> int:
        if offset == self.SR:
            self.read_status = True
            return self.flags
        if offset == self.DR:
            self.flags &= ~RXNE
            if self.read_status:
                self.flags &= ~(ORE | NOISE | FRAMING)
            return self.byte
        return super().read(offset)

    def write(self, offset: int, value: int) -> None:
        if offset == self.DR:
            if not self.flags & TXE:
                self.broken("DR written while it is not empty (30.6.2)")
            self.sent.append(value & 255)
            self.flags &= ~TXE
            self.chip.at(self.chip.now_ns + self.byte_ns(), self._empty)
        elif offset == self.CR1 and value >> 13 & 1 and not self.words.get(self.BRR):
            self.broken("enabled without a bit rate (30.6.3)")
        super().write(offset, value)

    def _empty(self) -> None:
        self.flags |= TXE

    def interrupts(self) -> set[int]:
        cr1 = self.words.get(self.CR1, 0)
        asked = (cr1 >> 5 & 1 and self.flags & (RXNE | ORE)) or (cr1 >> 7 & 1 and self.flags & TXE)
        return {self.irq} if asked else set()


class Usart1(Usart):
    base, clock, irq, bus = 0x40011000, ("APB2", 4), 37, "APB2"


class Usart3(Usart):
    base, clock, irq, bus = 0x40004800, ("APB1", 18), 39, "APB1"


class Can(Peripheral):
    """RM0090 32: bxCAN 1 with three mailboxes, FIFO 0 and filter bank 0. `sent` has what went out: (ns, id, data).
    `acknowledged` = False: there is nobody else on the bus."""

    base, clock = 0x40006400, ("APB1", 25)
    MCR, MSR, TSR, RF0R, IER, ESR, BTR = 0x00, 0x04, 0x08, 0x0C, 0x14, 0x18, 0x1C
    INRQ, FMR, FA1R = 1, 0x200, 0x21C
    RELEASE_NS = 300.0  # how long RFOM stays set; the manual gives no time (32.9.2)

    def reset(self) -> None:
        self.words = {self.MCR: 0x00010002, self.FMR: 0x2A1C0E01, self.BTR: 0x01230000}
        self.init = False
        self.sleeping = True
        self.sent: list[tuple[float, int, bytes]] = []
        self.fifo: deque[tuple[int, bytes]] = deque()
        self.requested: list[int] = []
        self.completed = self.overrun = self.msr_flags = 0
        self.release_at_ns: float | None = None
        self.acknowledged = True
        self.sending = False

    def bit_ns(self) -> float:
        btr = self.words[self.BTR]
        quanta = 3 + (btr >> 16 & 15) + (btr >> 20 & 7)
        return quanta * ((btr & 1023) + 1) / self.chip.rcc.bus_hz("APB1") * 1e9

    def sample_point(self) -> float:
        btr = self.words[self.BTR]
        one, two = (btr >> 16 & 15) + 1, (btr >> 20 & 7) + 1
        return (1 + one) / (1 + one + two)

    def _settle(self) -> None:
        if self.release_at_ns is not None and self.chip.now_ns >= self.release_at_ns:
            self.release_at_ns = None
            if self.fifo:
                self.fifo.popleft()

    def read(self, offset: int) -> int:
        self._settle()
        if offset == self.MSR:
            return (1 if self.init else 0) | (2 if self.sleeping else 0) | self.msr_flags | 0xC00
        if offset == self.TSR:
            empty = sum(1 << 26 + n for n in range(3) if n not in self.requested)
            return self.completed | empty
        if offset == self.RF0R:
            return min(len(self.fifo), 3) | self.overrun << 4 | (1 << 5 if self.release_at_ns is not None else 0)
        if 0x1B0 <= offset < 0x1C0:
            return self._mailbox(offset - 0x1B0)
        return super().read(offset)

    def _mailbox(self, offset: int) -> int:
        if not self.fifo:
            self.broken("the FIFO is read while it is empty (32.7.3)")
            return 0
        identifier, data = self.fifo[0]
        words = (identifier << 21, len(data), data[:4], data[4:])
        value = words[offset // 4]
        return value if isinstance(value, int) else int.from_bytes(value, "little")

    def write(self, offset: int, value: int) -> None:
        self._settle()
        if offset == self.MCR:
            self.sleeping = bool(value & 2)
            if value >> 15 & 1:
                self.reset()
                return
            self.chip.at(self.chip.now_ns + 11e3, self._change_mode)
        elif offset == self.BTR and not self.init:
            self.broken("BTR written outside of initialisation mode (32.9.2)")
            return
        elif offset == self.TSR:
            self.completed &= ~(value & 0x0F0F0F)
            self.requested = [
                n for n in self.requested if not value >> (7 + 8 * n) & 1 or (self.sending and n == self.requested[0])
            ]
        elif offset == self.RF0R:
            self.overrun &= ~(value >> 4)
            if value >> 5 & 1 and self.release_at_ns is None:
                self.release_at_ns = self.chip.now_ns + self.RELEASE_NS
        elif offset == self.MSR:
            self.msr_flags &= ~value
        elif (0x240 <= offset < 0x320 or offset in (0x204, 0x20C, 0x214)) and not self.words[self.FMR] & 1:
            self.broken("a filter is written outside of FINIT (32.9.4)")
        super().write(offset, value)
        if 0x180 <= offset < 0x1B0 and offset & 15 == 0 and value & 1:
            self._request((offset - 0x180) // 16)

    def _change_mode(self) -> None:
        wanted = bool(self.words[self.MCR] & self.INRQ)
        if self.init and not wanted and not self.words.get(self.FA1R, 0):
            pass  # it may join the bus before its filters are set: it receives nothing until then
        self.init = wanted
        self._send()

    def _request(self, mailbox: int) -> None:
        if mailbox in self.requested:
            self.broken(f"mailbox {mailbox} is written while its frame is pending (32.7.1)")
            return
        if self.words[self.MCR] & 4 == 0:
            self.broken("the model sends in the order of requests: TXFP must be set (32.9.2)")
        self.requested.append(mailbox)
        self._send()

    def _send(self) -> None:
        if self.requested and not self.sending and self.acknowledged and not self.init:
            self.sending = True
            size = self.words.get(0x184 + 16 * self.requested[0], 0) & 15
            self.chip.at(self.chip.now_ns + (47 + 8 * size + size) * self.bit_ns(), self._sent)

    def _sent(self) -> None:
        self.sending = False
        mailbox = self.requested.pop(0)
        at = 0x180 + 16 * mailbox
        size = self.words.get(at + 4, 0) & 15
        data = b"".join(self.words.get(at + 8 + 4 * n, 0).to_bytes(4, "little") for n in range(2))[:size]
        self.sent.append((self.chip.now_ns, self.words[at] >> 21, data))
        self.completed |= 3 << 8 * mailbox
        self._send()

    def receive(self, identifier: int, data: bytes) -> None:
        """A frame of another node has just ended on the bus."""
        self._settle()
        if self.init or self.sleeping or not self.chip.clocked(self.clock) or not self.words.get(self.FA1R, 0) & 1:
            return
        if len(self.fifo) == 3:
            self.overrun = 1
        else:
            self.fifo.append((identifier, data))
        self.chip.attend()

    def interrupts(self) -> set[int]:
        ier = self.words.get(self.IER, 0)
        self._settle()
        asked = {19} if ier & 1 and self.completed & 0x010101 else set()
        if (ier >> 1 & 1 and self.fifo) or (ier >> 3 & 1 and self.overrun):
            asked.add(20)
        if ier >> 15 & 1 and self.msr_flags >> 2 & 1:
            asked.add(22)
        return asked

    def bus_off(self) -> None:
        """The error counters say that the bus is off (32.7.6)."""
        self.words[self.ESR] = 7
        self.msr_flags |= 4
        self.chip.attend()
