# SPDX-License-Identifier: Apache-2.0
"""The peripherals of an STM32F405 as far as the image uses them, and the rules for their use.

Sources: ST, RM0090 (reference manual; the section stands at each class and rule), DS8626 (data sheet: times and
voltages). Each model keeps what is written, does what the manual says follows of it, and notes broken rules.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from chip import STORE, Block, Chip

HSI_HZ = 16e6


def make_peripherals(chip: Chip) -> list[Block]:
    """All of them."""
    from analog import Spi2, Spi3
    from guards import Dbgmcu, Dwt, Iwdg, Wwdg
    from wires import Can, Usart1, Usart3

    gpio = [
        type(f"Gpio{c}", (Gpio,), {"base": 0x40020000 + 0x400 * n, "clock": ("AHB1", n)})
        for n, c in enumerate("ABCDEFGHI")
    ]
    kinds = [
        Rcc,
        Flash,
        Pwr,
        Exti,
        Tim2,
        Tim3,
        Tim4,
        Tim5,
        Tim8,
        Tim1,
        Dac,
        Usart1,
        Usart3,
        Can,
        Iwdg,
        Wwdg,
        Dbgmcu,
        Dwt,
    ]
    kinds += [Spi2, Spi3]
    return [kind(chip) for kind in (*kinds, *gpio)]


class Peripheral(Block):
    def power_on(self) -> None:
        """Power-on reset, before the system reset."""

    def reset_by(self, cause: str) -> None:
        """After the system reset."""

    def left_by_loader(self) -> None:
        """The state in which ST's loader starts an image."""

    def exceptions(self) -> set[int]:
        return set()


_PIN = 1 << 26  # every reset pulls the pin low
_RESET_FLAGS = {"power": 1 << 27 | 1 << 25, "pin": 0, "software": 1 << 28, "IWDG": 1 << 29, "WWDG": 1 << 30}


class Rcc(Peripheral):
    """Clocks: RM0090 7.3. Times: DS8626, oscillators and PLL."""

    base, size = 0x40023800, 0x400
    CR, PLLCFGR, CFGR, CIR, AHB1ENR, CSR = 0x00, 0x04, 0x08, 0x0C, 0x30, 0x74
    CCM = 1 << 20  # in AHB1ENR: on after reset (7.3.10)
    crystal_hz: float | None = 8e6  # None: it does not start

    def power_on(self) -> None:
        self.flags = 0

    def reset(self) -> None:
        self.words = {self.PLLCFGR: 0x24003010, self.AHB1ENR: self.CCM, 0x40: 0, 0x44: 0}
        self.on_since = {0: self.chip.now_ns - 1e9}  # bit of CR: HSI 0, HSE 16, PLL 24
        self.cfgr = self.cssf = self.csson = 0

    def reset_by(self, cause: str) -> None:
        self.flags |= _RESET_FLAGS[cause] | _PIN

    def left_by_loader(self) -> None:
        self.on_since |= {16: self.chip.now_ns - 1e9, 24: self.chip.now_ns - 1e9}
        self.words[self.PLLCFGR] = int(self.crystal_hz or 8e6) // 2000000 | 120 << 6 | 1 << 16 | 1 << 22 | 5 << 24
        self.cfgr = 2 | 4 << 10
        self._update()

    def ready(self, bit: int) -> bool:
        wait_ns = {0: 4e3, 16: 2e6, 24: 200e3}[bit]
        if bit not in self.on_since or self.chip.now_ns < self.on_since[bit] + wait_ns:
            return False
        if bit == 24:
            return self.ready(16 if self.words[self.PLLCFGR] >> 22 & 1 else 0)
        return bit != 16 or self.crystal_hz is not None

    def read(self, offset: int) -> int:
        if offset == self.CR:
            on = sum(1 << bit for bit in self.on_since)
            return on | sum(2 << bit for bit in (0, 16, 24) if self.ready(bit)) | 0x10 << 3 | self.csson << 19
        if offset == self.CFGR:
            return self.cfgr | (self.cfgr & 3) << 2
        if offset == self.CIR:
            return self.cssf << 7
        if offset == self.CSR:
            return self.flags
        return super().read(offset)

    def write(self, offset: int, value: int) -> None:
        if offset == self.CR:
            self._switch_sources(value)
        elif offset == self.PLLCFGR:
            if 24 in self.on_since:
                self.broken("PLLCFGR written while the PLL is on (7.3.2)")
            else:
                self.words[offset] = value
        elif offset == self.CFGR:
            self._choose(value)
        elif offset == self.CIR:
            self.cssf &= 1 - (value >> 23 & 1)
        elif offset == self.CSR:
            self.flags = 0 if value >> 24 & 1 else self.flags
        elif offset == self.AHB1ENR and not value & self.CCM:
            self.broken("the core-coupled memory loses its clock (7.3.10)")
        else:
            super().write(offset, value)
        self._update()

    def _switch_sources(self, value: int) -> None:
        used = {0: 0, 1: 16, 2: 24}[self.cfgr & 3]
        for bit in (0, 16, 24):
            if value >> bit & 1:
                self.on_since.setdefault(bit, self.chip.now_ns)
            elif bit != used:
                self.on_since.pop(bit, None)
            elif bit in self.on_since:
                self.broken("the clock that the system uses is switched off (7.3.1)")
        self.csson = value >> 19 & 1

    def _choose(self, value: int) -> None:
        """RM0090 7.3.3"""
        source = {0: 0, 1: 16, 2: 24}[value & 3]
        if not self.ready(source):
            self.broken("a clock is chosen that is not ready (7.3.3, SW)")
            value = value & ~3 | self.cfgr & 3
        if value & 3 == 2 and self.cfgr & 3 != 2:
            hz = self.pll_hz()
            for shift, most, name in ((10, 42e6, "APB1"), (13, 84e6, "APB2")):
                if hz / self.divider(self.cfgr, shift) > most:
                    self.broken(
                        f"{name} is faster than {most / 1e6:g} MHz for up to 16 clocks: "
                        "its prescaler is not set before the clock is switched (7.3.3, PPRE)"
                    )
            if self.chip.flash.read(0) & 7 < 5:
                self.broken("168 MHz with less than five wait states (3.5.1)")
            if not self.chip.pwr.read(0) >> 14 & 1:
                self.broken("168 MHz without voltage scale 1 (5.4.1, VOS)")
        self.cfgr = value & ~0xC

    @staticmethod
    def divider(cfgr: int, shift: int) -> int:
        field = cfgr >> shift & 7
        return 2 << (field & 3) if field & 4 else 1

    def pll_hz(self) -> float:
        p = self.words[self.PLLCFGR]
        source = (self.crystal_hz or 0.0) if p >> 22 & 1 else HSI_HZ
        vco_in = source / (p & 63)
        vco = vco_in * (p >> 6 & 511)
        if not (0.95e6 <= vco_in <= 2.1e6 and 100e6 <= vco <= 432e6):
            self.broken(f"PLL out of range: {vco_in / 1e6:g} MHz in, VCO {vco / 1e6:g} MHz (7.3.2)")
        return vco / (2 + 2 * (p >> 16 & 3))

    def system_hz(self) -> float:
        return (HSI_HZ, self.crystal_hz or HSI_HZ, self.pll_hz() if self.cfgr & 3 == 2 else 0.0)[self.cfgr & 3]

    def bus_hz(self, bus: str) -> float:
        return self.system_hz() / self.divider(self.cfgr, {"APB1": 10, "APB2": 13}[bus])

    def _update(self) -> None:
        self.chip.cycle_ns = 1e9 / self.system_hz()
        self.chip.wwdg.clock_changed()

    def fail_crystal(self) -> None:
        """The crystal stops (RM0090 7.2.7)."""
        self.crystal_hz = None
        if self.csson:
            self.on_since.pop(16, None)
            self.on_since.pop(24, None)
            self.cfgr &= ~3
            self.cssf = 1
            self._update()
            self.chip.attend()

    def exceptions(self) -> set[int]:
        return {2} if self.cssf else set()


class Pwr(Peripheral):
    """RM0090 5.2.3 (PVD), 5.4. Thresholds of PLS = 110, typical: DS8626, embedded reset and power control block."""

    base, clock = 0x40007000, ("APB1", 28)
    FALLING_V, RISING_V = 2.92, 3.03

    def power_on(self) -> None:
        self.supply_v = 3.3
        self.low = False

    def set_supply(self, volts: float) -> None:
        self.supply_v = volts
        low = volts < (self.RISING_V if self.low else self.FALLING_V)
        rose, self.low = low and not self.low, low
        if rose and self.words.get(0, 0) >> 4 & 1:
            self.chip.exti.edge(16)

    def read(self, offset: int) -> int:
        if offset == 4:
            cr = self.words.get(0, 0)
            return (4 if self.low and cr >> 4 & 1 else 0) | 1 << 14
        return super().read(offset)

    def write(self, offset: int, value: int) -> None:
        super().write(offset, value)
        if offset == 0 and value >> 4 & 1 and value >> 5 & 7 != 6:
            self.broken("the model knows no other threshold than PLS = 110 (5.4.1)")


class Exti(Peripheral):
    """RM0090 12.3; line 16 is the PVD's and interrupt 1."""

    base, clock = 0x40013C00, None

    def edge(self, line: int) -> None:
        if self.words.get(8, 0) & self.words.get(0, 0) & 1 << line:
            self.words[0x14] = self.words.get(0x14, 0) | 1 << line
            self.chip.attend()

    def write(self, offset: int, value: int) -> None:
        super().write(offset, self.read(offset) & ~value if offset == 0x14 else value)

    def interrupts(self) -> set[int]:
        return {1} if self.words.get(0x14, 0) >> 16 & 1 else set()


class Flash(Peripheral):
    """RM0090 3.5 (read, caches), 3.6 (erase and program), 3.9. Times: DS8626, flash memory. A poll of SR while it is
    busy takes 50 us here, so that an erasure is some thousand polls."""

    base = 0x40023C00
    ACR, KEYR, SR, CR = 0x00, 0x04, 0x0C, 0x10
    BUSY, PG, SER, STRT, LOCK = 1 << 16, 1, 2, 1 << 16, 1 << 31
    KEYS = (0x45670123, 0xCDEF89AB)
    ERASE_NS, PROGRAM_NS, POLL_NS = 250e6, 16e3, 50e3

    def reset(self) -> None:
        self.words = {self.CR: self.LOCK}
        self.keys, self.barred = 0, False
        self.chip.busy_flash_ns = 0.0

    def left_by_loader(self) -> None:
        self.words[self.CR] &= ~self.LOCK

    def busy(self) -> bool:
        return self.chip.now_ns < self.chip.busy_flash_ns

    def read(self, offset: int) -> int:
        if offset == self.SR:
            if self.busy():
                self.chip.now_ns = min(self.chip.now_ns + self.POLL_NS, self.chip.busy_flash_ns)
            return super().read(offset) & ~self.BUSY | (self.BUSY if self.busy() else 0)
        return super().read(offset)

    def write(self, offset: int, value: int) -> None:
        if offset == self.KEYR:
            self._key(value)
        elif offset == self.SR:
            self.words[offset] = self.read(offset) & ~value
        elif offset == self.CR:
            self._command(value)
        else:
            if offset == self.ACR:
                on = self.words.get(offset, 0) | value
                if (value >> 11 & 1 and on >> 9 & 1) or (value >> 12 & 1 and on >> 10 & 1):
                    self.broken("a cache is reset while it is on (3.9.1, ICRST and DCRST)")
                if value >> 8 & 1 and self.chip.dbgmcu.revision == 0x1000:
                    self.broken("prefetch is on, which revision A does not support (ES0182)")
            super().write(offset, value)

    def _key(self, value: int) -> None:
        locked = self.words[self.CR] & self.LOCK
        if not locked or self.barred or value != self.KEYS[self.keys]:
            self.broken("a key that is wrong, or written while CR is not locked: CR stays locked until reset (3.6.1)")
            self.barred = True
            self.words[self.CR] |= self.LOCK
            return
        self.keys += 1
        if self.keys == 2:
            self.keys = 0
            self.words[self.CR] &= ~self.LOCK

    def _command(self, value: int) -> None:
        if self.words[self.CR] & self.LOCK:
            self.broken("CR written while it is locked (3.9.5)")
            return
        if self.busy():
            self.broken("CR written while the flash is busy (3.9.5)")
        if value & self.STRT and value & self.SER:
            sector = value >> 3 & 15
            if sector not in (1, 2):
                self.broken(f"sector {sector} is erased, which holds the image")
            else:
                at = (sector - 1) * 0x4000
                self.chip.store[at : at + 0x4000] = b"\xff" * 0x4000
                self._start(self.ERASE_NS)
        self.words[self.CR] = value & ~self.STRT

    def _start(self, ns: float) -> None:
        if self.chip.pwr.supply_v < 2.7:
            self.broken("32 bits at once below 2.7 V (3.6.2)")
        self.chip.busy_flash_ns = self.chip.now_ns + ns
        self.words[self.SR] = self.words.get(self.SR, 0) | 1  # EOP

    def program(self, at: int, size: int, value: int) -> None:
        """A write to the address range of the store."""
        cr = self.words[self.CR]
        if cr & self.LOCK or not cr & self.PG or cr >> 8 & 3 != 2 or size != 4:
            self.broken("the flash is written without PG, or not in the size of PSIZE (3.6.3)")
            return
        old = int.from_bytes(self.chip.store[at : at + 4], "little")
        if old != 0xFFFFFFFF:
            self.broken(f"the word at {STORE.start + at:#x} is written twice (3.6.3)")
        self.chip.store[at : at + 4] = (old & value).to_bytes(4, "little")
        self._start(self.PROGRAM_NS)


class Gpio(Peripheral):
    """RM0090 8.4. `outside` drives pins from the board; `edges` are the changes of outputs: (ns, pin, level), which
    `watch` is told, too."""

    MODER, PUPDR, IDR, ODR, BSRR = 0x00, 0x0C, 0x10, 0x14, 0x18
    watch: Mapping[int, Callable[[bool], None]] = MappingProxyType({})

    def reset(self) -> None:
        a, b = self.base == 0x40020000, self.base == 0x40020400
        self.words = {self.MODER: 0xA8000000 if a else 0x280 if b else 0}
        self.words |= {self.PUPDR: 0x64000000 if a else 0x100 if b else 0}

    def power_on(self) -> None:
        self.outside: dict[int, bool] = {}
        self.edges: list[tuple[float, int, bool]] = []

    def mode(self, pin: int) -> int:
        return self.words[self.MODER] >> 2 * pin & 3

    def alternate(self, pin: int) -> int | None:
        """The number of the alternate function, None when the pin has another mode."""
        return self.words.get(0x20 + 4 * (pin // 8), 0) >> 4 * (pin % 8) & 15 if self.mode(pin) == 2 else None

    def level(self, pin: int) -> bool | None:
        """What the chip drives, or None."""
        return bool(self.words.get(self.ODR, 0) >> pin & 1) if self.mode(pin) == 1 else None

    def read(self, offset: int) -> int:
        if offset != self.IDR:
            return super().read(offset)
        bits = 0
        for pin in range(16):
            level = self.level(pin)
            if level is None:
                level = self.outside.get(pin, self.words[self.PUPDR] >> 2 * pin & 3 == 1)
            bits |= level << pin
        return bits

    def write(self, offset: int, value: int) -> None:
        if offset == self.BSRR:
            before = self.words.get(self.ODR, 0)
            after = before & ~(value >> 16) | value & 0xFFFF
            self.words[self.ODR] = after
            for pin in range(16):
                if (before ^ after) >> pin & 1:
                    level = bool(after >> pin & 1)
                    self.edges.append((self.chip.now_ns, pin, level))
                    if pin in self.watch and self.mode(pin) == 1:
                        self.watch[pin](level)
        else:
            super().write(offset, value)


class Tim(Peripheral):
    """RM0090 18.4. Encoder mode alone: a test sets `count`."""

    CR1, SMCR, SR, CCMR1, CNT, ARR, CCER, CCR1, BDTR = 0x00, 0x08, 0x10, 0x18, 0x24, 0x2C, 0x20, 0x34, 0x44
    top = 0xFFFF

    def write(self, offset: int, value: int) -> None:
        if offset == self.CR1 and value & 1 and (self.words.get(self.SMCR, 0) & 7) != 3:
            self.broken("it counts before encoder mode is set (18.3.12)")
        super().write(offset, value & self.top if offset in (self.CNT, self.ARR) else value)

    def move(self, counts: int) -> None:
        self.words[self.CNT] = (self.words.get(self.CNT, 0) + counts) & self.top


class Tim2(Tim):
    base, clock, top = 0x40000000, ("APB1", 0), 0xFFFFFFFF


class Tim3(Tim):
    base, clock = 0x40000400, ("APB1", 1)


class Tim4(Tim):
    base, clock = 0x40000800, ("APB1", 2)


class Tim5(Tim):
    base, clock, top = 0x40000C00, ("APB1", 3), 0xFFFFFFFF


class Tim8(Peripheral):
    """RM0090 17.4: PWM. A duty changes at once; the preload registers are not modelled. The break input is at PA6
    (DS8626, AF3) and acts without a clock (17.3.12)."""

    base, clock = 0x40010400, ("APB2", 1)
    MOE, BKP, BKE, BIF = 1 << 15, 1 << 13, 1 << 12, 1 << 7

    def _take_break(self) -> None:
        bdtr, port = self.words.get(Tim.BDTR, 0), self.chip.gpio("A")
        level = bool(port.read(port.IDR) >> 6 & 1) if port.alternate(6) == 3 else False
        if bdtr & self.BKE and level == bool(bdtr & self.BKP):
            self.words[Tim.BDTR] = bdtr & ~self.MOE
            self.words[Tim.SR] = self.words.get(Tim.SR, 0) | self.BIF

    def read(self, offset: int) -> int:
        self._take_break()
        return super().read(offset)

    def write(self, offset: int, value: int) -> None:
        super().write(offset, self.words.get(offset, 0) & value if offset == Tim.SR else value)
        self._take_break()
        get = self.words.get
        if offset == Tim.BDTR and value & self.MOE:
            if not (get(Tim.CCMR1, 0) and get(Tim.CCER, 0) and get(Tim.ARR, 0)):
                self.broken("MOE before channels and period are configured (17.3.11)")
            if self.stopped_by_halt and not value >> 10 & 1:
                self.broken("outputs float in a halt: OSSI is not set (17.4.18)")

    stopped_by_halt = False

    def duty(self, channel: int) -> float:
        """Part of the time that an output is high; 0 while the outputs are off. A debugger's halt with DBG_TIM8_STOP
        stops the counter and switches the outputs off, as a break does (RM0008 31.16.3; RM0090 38.16.5 names the
        first alone)."""
        get = self.words.get
        self._take_break()
        on = get(Tim.BDTR, 0) & self.MOE and get(Tim.CR1, 0) & 1 and get(Tim.CCER, 0) >> 4 * (channel - 1) & 1
        if self.chip.halted and self.chip.dbgmcu.words.get(0xC, 0) >> self.clock[1] & 1:
            return 0.0
        return get(Tim.CCR1 + 4 * (channel - 1), 0) / (get(Tim.ARR, 0) + 1) if on else 0.0


class Tim1(Tim8):
    """The same without a break input. Its bit of DBGMCU is that of its clock, as of TIM8."""

    base, clock = 0x40010000, ("APB2", 0)

    def _take_break(self) -> None:
        pass


class Dac(Peripheral):
    """RM0090 14. `codes`: what both channels put out; None: off, the pin floats."""

    base, clock = 0x40007400, ("APB1", 29)
    CR, DHR12RD, ENABLED = 0x00, 0x20, (1 << 0, 1 << 16)

    def reset(self) -> None:
        super().reset()
        self.history: list[tuple[float, int, int]] = []

    def write(self, offset: int, value: int) -> None:
        if offset == self.DHR12RD:
            if value & ~0x0FFF0FFF:
                self.broken(f"a code of more than 12 bits: {value:#x} (14.5.9)")
            self.history.append((self.chip.now_ns, value & 0xFFF, value >> 16))
        elif offset == self.CR and value & (1 | 1 << 16):
            if self.words.get(self.DHR12RD) != 0x08000800:
                self.broken("it is enabled with another code than mid-scale, which is no force")
            if any(self.chip.gpio("A").mode(pin) != 3 for pin in (4, 5)):
                self.broken("it is enabled before its pins are analog (14.2)")
        elif offset not in (self.CR, self.DHR12RD):
            self.broken(f"the model lacks the register at {offset:#x}")
        super().write(offset, value)

    def codes(self) -> tuple[int | None, int | None]:
        code, cr = self.words.get(self.DHR12RD, 0), self.words.get(self.CR, 0)
        return (code & 0xFFF if cr & 1 else None, code >> 16 & 0xFFF if cr >> 16 & 1 else None)
