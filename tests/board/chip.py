# SPDX-License-Identifier: Apache-2.0
"""An STM32F405 that runs an image: Unicorn executes the instructions, this file is what else the core has.

That is time, reset, exceptions with their stacking and priorities (ARM, DDI 0403E B1.5), SysTick (B3.3), NVIC (B3.4)
and a halt by a debugger. The peripherals are in peripherals.py. README.md lists what is not modelled.

A rule that the image breaks is a line in `Chip.broken`, with address and section; the fixture `board` fails on any.
"""

from __future__ import annotations

import heapq
import itertools
import struct
from collections.abc import Callable
from pathlib import Path

import unicorn
from unicorn import arm_const as arm

FLASH, FLASH_BYTES, STORE = 0x08000000, 0x100000, range(0x08004000, 0x0800C000)
RAM, RAM_BYTES, CCM, CCM_BYTES = 0x20000000, 0x20000, 0x10000000, 0x10000
LOADER, LOADER_BYTES = 0x1FFF0000, 0x8000  # ST's boot loader in system memory (RM0090 2.4)
NMI, HARD_FAULT, SYSTICK, EXTERNAL = 2, 3, 15, 16  # exception numbers; EXTERNAL is that of interrupt 0
FOREVER = float("inf")

_FRAME = (arm.UC_ARM_REG_R0, arm.UC_ARM_REG_R1, arm.UC_ARM_REG_R2, arm.UC_ARM_REG_R3, arm.UC_ARM_REG_R12)
_FRAME += (arm.UC_ARM_REG_LR, arm.UC_ARM_REG_PC, arm.UC_ARM_REG_XPSR)
_FLOATS = (*tuple(arm.UC_ARM_REG_S0 + n for n in range(16)), arm.UC_ARM_REG_FPSCR)
_EXCEPTION_RETURN = 8  # the number by which Unicorn tells of a branch to EXC_RETURN


class Block:
    """The registers of a peripheral: 32-bit words that keep what is written to them, unless a subclass says more."""

    base, size = 0, 0x400
    clock: tuple[str, int] | None = None  # its clock: register and bit of RCC; None: always on

    def __init__(self, chip: Chip) -> None:
        self.chip = chip
        self.reset()

    def reset(self) -> None:
        """System reset."""
        self.words: dict[int, int] = {}

    def read(self, offset: int) -> int:
        return self.words.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        self.words[offset] = value

    def interrupts(self) -> set[int]:
        """The interrupts that it asks for at present."""
        return set()

    def broken(self, rule: str) -> None:
        self.chip.broken.append(
            f"{type(self).__name__}: {rule} (pc {self.chip.pc():#x}, {self.chip.now_ns / 1e6:.3f} ms)"
        )


class Core(Block):
    """SysTick, SCB, NVIC and DWT. `pending` and `active` are exception numbers."""

    base, size = 0xE000E000, 0x1000
    CALIB, ICSR, VTOR, AIRCR, CPACR = 0x01C, 0xD04, 0xD08, 0xD0C, 0xD88

    def reset(self) -> None:
        super().reset()
        self.pending: set[int] = set()
        self.enabled: set[int] = set()
        self.next_tick_ns = FOREVER
        self.words[0xD00] = 0x410FC241  # CPUID of a Cortex-M4 r0p1

    def read(self, offset: int) -> int:
        if offset == self.ICSR:
            return (1 << 26 if SYSTICK in self.pending else 0) | (self.chip.active[-1] if self.chip.active else 0)
        return super().read(offset)

    def write(self, offset: int, value: int) -> None:
        super().write(offset, value)
        if offset == 0x010:  # SYST_CSR
            enabled = (value & 3) == 3
            self.next_tick_ns = self.chip.now_ns + self.period_ns() if enabled else FOREVER
            self.chip.at(self.next_tick_ns, self._tick)
        elif 0x100 <= offset < 0x120:
            self.enabled |= self._numbers(offset - 0x100, value)
        elif 0x180 <= offset < 0x1A0:
            self.enabled -= self._numbers(offset - 0x180, value)
        elif 0x200 <= offset < 0x220:
            self.pending |= {EXTERNAL + n for n in self._numbers(offset - 0x200, value)}
        elif 0x280 <= offset < 0x2A0:
            self.pending -= {EXTERNAL + n for n in self._numbers(offset - 0x280, value)}
        elif offset == self.AIRCR and value >> 16 == 0x05FA and value & 4:
            self.chip.request_reset("software")
        self.chip.attend()

    def period_ns(self) -> float:
        return (self.words.get(0x014, 0) + 1) * self.chip.cycle_ns

    def _tick(self) -> None:
        if self.next_tick_ns <= self.chip.now_ns:
            self.pending.add(SYSTICK)
            self.next_tick_ns += self.period_ns()
            self.chip.at(self.next_tick_ns, self._tick)

    @staticmethod
    def _numbers(offset: int, value: int) -> set[int]:
        return {offset * 8 + bit for bit in range(32) if value >> bit & 1}

    def priority(self, exception: int) -> int:
        if exception < 4:
            return exception - 4
        at = 0x400 + exception - EXTERNAL if exception >= EXTERNAL else 0xD18 + exception - 4
        return self.words.get(at & ~3, 0) >> (at % 4 * 8 + 4) & 15


class Chip:
    """`Chip(image)` is a chip with the image in its flash and no power yet; `power_on()` starts it, `run()` lets time
    pass. `flash` is the parameter store, `now_ns` the time since the first power-on."""

    def __init__(self, image: Path) -> None:
        from peripherals import make_peripherals

        self.uc = uc = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        uc.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M4)
        self.broken: list[str] = []
        self.resets: list[tuple[float, str]] = []
        self.now_ns = 0.0
        self.cycle_ns = 1e3 / 16
        self.store = bytearray(b"\xff" * len(STORE))
        self.active: list[int] = []
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._number = itertools.count()
        self._stop_at_ns = 0.0
        self._fresh = False
        self._reset_cause: str | None = None
        self._returned = False
        self.asleep = self.halted = self.stuck = False
        for base, size in ((FLASH, STORE.start - FLASH), (STORE.stop, FLASH + FLASH_BYTES - STORE.stop)):
            uc.mem_map(base, size, unicorn.UC_PROT_READ | unicorn.UC_PROT_EXEC)
        uc.mem_map(RAM, RAM_BYTES)
        uc.mem_map(CCM, CCM_BYTES, unicorn.UC_PROT_READ | unicorn.UC_PROT_WRITE)
        uc.mem_map(LOADER, LOADER_BYTES, unicorn.UC_PROT_READ | unicorn.UC_PROT_EXEC)
        uc.mem_write(LOADER, b"\xfe\xe7" * (LOADER_BYTES // 2))  # a branch to itself: whoever comes here, stays here
        self.core = Core(self)
        self.blocks: dict[int, Block] = {}
        self.peripherals = make_peripherals(self)
        for block in self.peripherals:
            setattr(self, type(block).__name__.lower(), block)  # chip.rcc, chip.gpioa and so on
        for block in (self.core, *self.peripherals):
            for page in range(block.base, block.base + block.size, 0x400):
                self.blocks[page] = block
        for base, size in ((0x40000000, 0x30000), (0xE0000000, 0x100000)):
            uc.mmio_map(base, size, self._mmio_read, base, self._mmio_write, base)
        uc.mmio_map(STORE.start, len(STORE), self._store_read, None, self._store_write, None)
        uc.hook_add(unicorn.UC_HOOK_BLOCK, self._on_block)
        uc.hook_add(unicorn.UC_HOOK_INTR, self._on_intr)
        self._load(image)

    def _load(self, image: Path) -> None:
        elf = image.read_bytes()
        (offset,), (entry_bytes, entries) = struct.unpack_from("<I", elf, 28), struct.unpack_from("<HH", elf, 42)
        for n in range(entries):
            kind, at, _, address, size = struct.unpack_from("<5I", elf, offset + n * entry_bytes)
            if kind == 1 and size:
                self.uc.mem_write(address, elf[at : at + size])

    def gpio(self, port: str) -> Block:
        return getattr(self, f"gpio{port.lower()}")

    # ---- power, reset ----

    def power_on(self, *, after_loader: bool = False) -> None:
        """Start with random RAM. `after_loader`: ST's loader has started the image (`dfu-util :leave`)."""
        for base, size in ((RAM, RAM_BYTES), (CCM, CCM_BYTES)):
            self.uc.mem_write(base, bytes((n * 73 + 11) & 255 for n in range(size)))
        for block in self.peripherals:
            block.power_on()
        self._reset("power")
        if after_loader:
            for block in self.peripherals:
                block.left_by_loader()
            self.core.words[Core.VTOR] = LOADER

    def request_reset(self, cause: str) -> None:
        self._reset_cause = cause
        self.attend()

    def _reset(self, cause: str) -> None:
        self.resets.append((self.now_ns, cause))
        self._events.clear()
        self.active.clear()
        self.asleep = self.stuck = False
        self._reset_cause = None
        self.cycle_ns = 1e3 / 16
        self.core.reset()
        for block in self.peripherals:
            block.reset()
            block.reset_by(cause)
        self.uc.reg_write(arm.UC_ARM_REG_XPSR, 1 << 24)
        self.uc.reg_write(arm.UC_ARM_REG_PRIMASK, 0)
        stack, start = struct.unpack("<2I", self.uc.mem_read(FLASH, 8))
        self.uc.reg_write(arm.UC_ARM_REG_MSP, stack)
        self.uc.reg_write(arm.UC_ARM_REG_PC, start & ~1)

    # ---- time ----

    def at(self, ns: float, what: Callable[[], None]) -> None:
        """Call `what` at a time, unless a reset comes first."""
        if ns < FOREVER:
            heapq.heappush(self._events, (ns, next(self._number), what))
            self._stop_at_ns = min(self._stop_at_ns, ns)

    def attend(self) -> None:
        """Something has happened that the core must look at before its next block of instructions."""
        self._stop_at_ns = 0.0

    def run(self, ms: float) -> None:
        """Let time pass."""
        end_ns = self.now_ns + ms * 1e6
        while self.now_ns < end_ns:
            while self._events and self._events[0][0] <= self.now_ns:
                heapq.heappop(self._events)[2]()
            if self._reset_cause is not None:
                self._reset(self._reset_cause)
            until_ns = min(end_ns, self._events[0][0] if self._events else FOREVER)
            if self.halted or self.stuck or (self.asleep and not self._wakes()):
                self.now_ns = max(self.now_ns, until_ns)
                continue
            self.asleep = False
            blocked = self._take_exception()
            self._execute(0.0 if blocked else until_ns)

    def run_until(self, what: Callable[[], bool], ms: float, step_ms: float = 0.1) -> bool:
        """Let time pass until something is so, `ms` at most. Returns whether it is."""
        end_ns = self.now_ns + ms * 1e6
        while not what():
            if self.now_ns >= end_ns:
                return False
            self.run(step_ms)
        return True

    def pc(self) -> int:
        return self.uc.reg_read(arm.UC_ARM_REG_PC)

    def _execute(self, until_ns: float) -> None:
        self._stop_at_ns, self._fresh, self._stopped, self._returned = until_ns, True, False, False
        try:
            self.uc.emu_start(self.pc() | 1, 0xFFFFFFFF)
        except unicorn.UcError as error:
            self._hard_fault(str(error))
            return
        if self._returned:
            self._unstack()
        elif not self._stopped:
            self.asleep = True  # WFI

    def _on_block(self, uc: unicorn.Uc, address: int, size: int, _: object) -> None:
        if not self._fresh and self.now_ns >= self._stop_at_ns:
            self._stopped = True
            uc.emu_stop()
            return
        self._fresh = False
        if FLASH <= address < FLASH + FLASH_BYTES:
            self.now_ns = max(self.now_ns, self.busy_flash_ns)  # RM0090 3.5: a fetch waits while the flash is busy
        self.now_ns += size // 2 * self.cycle_ns

    def _on_intr(self, uc: unicorn.Uc, number: int, _: object) -> None:
        if number == _EXCEPTION_RETURN:
            self._returned = True
            uc.emu_stop()
        else:
            raise AssertionError(f"exception {number} of Unicorn at {self.pc():#x}")

    busy_flash_ns = 0.0

    # ---- exceptions ----

    def _requests(self) -> set[int]:
        requests = {n for n in self.core.pending if n < EXTERNAL or n - EXTERNAL in self.core.enabled}
        for block in self.peripherals:
            requests |= {EXTERNAL + n for n in block.interrupts() & self.core.enabled}
            requests |= block.exceptions()
        return requests

    def _best(self) -> int | None:
        """The exception that would be taken if PRIMASK were 0."""
        level = min((self.core.priority(n) for n in self.active), default=16)
        requests = [n for n in self._requests() if n not in self.active and self.core.priority(n) < level]
        return min(requests, key=lambda n: (self.core.priority(n), n), default=None)

    def _wakes(self) -> bool:
        return self._best() is not None

    def _take_exception(self) -> bool:
        """Enter the exception that is due. Returns whether one is due but masked."""
        best = self._best()
        if best is None:
            return False
        if self.uc.reg_read(arm.UC_ARM_REG_PRIMASK) & 1 and best > HARD_FAULT:
            return True
        self.core.pending.discard(best)
        self._stack(best)
        return False

    def _vector(self, number: int) -> int:
        table = self.core.words.get(Core.VTOR, 0)
        address = (FLASH if table < 0x100000 else 0) + table + 4 * number
        (entry,) = struct.unpack("<I", self.uc.mem_read(address, 4))
        return int(entry)

    def _stack(self, number: int) -> None:
        uc = self.uc
        values = [uc.reg_read(r) for r in (*_FRAME, *_FLOATS)]
        sp = uc.reg_read(arm.UC_ARM_REG_MSP)
        to = (sp - 104) & ~7
        values[7] = (values[7] & ~(1 << 9)) | (1 << 9 if (sp - 104) & 4 else 0)
        frame = struct.pack("<26I", *(v & 0xFFFFFFFF for v in values), 0)
        try:
            uc.mem_write(to, frame)
        except unicorn.UcError:  # no RAM there: a derived fault; the registers are lost
            if number != HARD_FAULT:
                self._hard_fault("stacking")
                return
        uc.reg_write(arm.UC_ARM_REG_MSP, to)
        entry = self._vector(number)
        if entry in range(LOADER, LOADER + LOADER_BYTES) or entry == 0xE7FEE7FE:
            self.broken.append(
                f"exception {number} goes to the boot loader: VTOR has not been written (DDI 0403E B3.2.5)"
            )
            self.stuck = True
            return
        self.active.append(number)
        uc.reg_write(arm.UC_ARM_REG_XPSR, 1 << 24 | number)
        uc.reg_write(arm.UC_ARM_REG_LR, 0xFFFFFFE1 if len(self.active) > 1 else 0xFFFFFFE9)
        uc.reg_write(arm.UC_ARM_REG_PC, entry & ~1)
        self.now_ns += 12 * self.cycle_ns

    def _unstack(self) -> None:
        uc = self.uc
        sp = uc.reg_read(arm.UC_ARM_REG_MSP)
        values = struct.unpack("<26I", uc.mem_read(sp, 104))
        self.active.pop()
        uc.reg_write(arm.UC_ARM_REG_XPSR, values[7] & ~(1 << 9))
        for register, value in zip((*_FRAME[:7], *_FLOATS), (*values[:7], *values[8:25]), strict=True):
            uc.reg_write(register, value)
        uc.reg_write(arm.UC_ARM_REG_MSP, sp + 104 + (4 if values[7] >> 9 & 1 else 0))
        self.now_ns += 12 * self.cycle_ns

    def _hard_fault(self, why: str) -> None:
        if HARD_FAULT in self.active:
            self.stuck = True  # lockup (DDI 0403E B1.5.15)
            return
        self.core.words[0xD28] = 1 << 8  # CFSR.IBUSERR, which stands for any
        self.core.words[0xD2C] = 1 << 30  # HFSR.FORCED
        self._stack(HARD_FAULT)

    # ---- memory ----

    def _mmio_read(self, uc: unicorn.Uc, offset: int, size: int, base: int) -> int:
        self.now_ns += 2 * self.cycle_ns
        block = self._block_at(base + offset, size)
        return (block.read(base + offset - block.base) & 0xFFFFFFFF) if block else 0

    def _mmio_write(self, uc: unicorn.Uc, offset: int, size: int, value: int, base: int) -> None:
        self.now_ns += 2 * self.cycle_ns
        block = self._block_at(base + offset, size)
        if block:
            block.write(base + offset - block.base, value)

    def _block_at(self, address: int, size: int) -> Block | None:
        block = self.blocks.get(address & ~0x3FF)
        if block is None or size != 4:
            self.broken.append(
                f"access of {size} bytes at {address:#x}, where there is no register (pc {self.pc():#x})"
            )
            return None
        if block.clock is not None and not self.clocked(block.clock):
            block.broken(f"used at {address:#x} without its clock, {block.clock} (RM0090 7.2.11)")
            return None
        return block

    def clocked(self, clock: tuple[str, int]) -> bool:
        return bool(self.rcc.words.get({"AHB1": 0x30, "APB1": 0x40, "APB2": 0x44}[clock[0]], 0) >> clock[1] & 1)

    def _store_read(self, uc: unicorn.Uc, offset: int, size: int, _: object) -> int:
        self.now_ns = max(self.now_ns, self.busy_flash_ns)
        return int.from_bytes(self.store[offset : offset + size], "little")

    def _store_write(self, uc: unicorn.Uc, offset: int, size: int, value: int, _: object) -> None:
        self.flash.program(offset, size, value)
