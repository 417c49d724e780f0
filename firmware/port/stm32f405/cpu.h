/* SPDX-License-Identifier: Apache-2.0 */
/* cpu.h: interrupt lock, sleep, barrier and interrupt priorities of the core, and
 * the detection of an emulator. On a host, where tests run in one thread, the
 * functions of the core do nothing. The background loop and interrupts call it.
 */
#ifndef KONTUR_CPU_H
#define KONTUR_CPU_H
#include <stdbool.h>

#include "port/stm32f405/regs.h"

#define CLOCK_HZ 168000000u /* of the core and of the timers at APB2: clock_start() */

/* Interrupt priorities; 0 is the highest. The chip implements the upper four bits (RM0090 12.1.1). The serial port
 * buffers one byte, so it is above the servo tick, for some 40 instructions a byte. bxCAN buffers three frames,
 * 140 us, so it is below the servo tick. */
enum { PRIORITY_SUPPLY = 0, PRIORITY_SERIAL = 0, PRIORITY_SERVO = 1, PRIORITY_CAN = 2 };

static inline void cpu_irq_enable(unsigned irq, unsigned priority)
{
    const unsigned shift = irq % 4u * 8u;
    NVIC->IPR[irq / 4u] = (NVIC->IPR[irq / 4u] & ~(0xFFu << shift)) | priority << (shift + 4u);
    NVIC->ISER[irq / 32u] = 1u << irq % 32u;
}

/* Disable interrupts, for a few instructions only. Returns the argument of cpu_unlock(). */
static inline uint32_t cpu_lock(void)
{
#ifdef __arm__
    uint32_t primask;
    __asm volatile("mrs %0, primask\n\tcpsid i" : "=r"(primask)::"memory");
    return primask;
#else
    return 0;
#endif
}

static inline void cpu_unlock(uint32_t primask)
{
#ifdef __arm__
    __asm volatile("msr primask, %0" ::"r"(primask) : "memory");
#else
    (void)primask;
#endif
}

/* Sleep until the next interrupt. */
static inline void cpu_sleep(void)
{
#ifdef __arm__
    __asm volatile("dsb\n\twfi" ::: "memory");
#endif
}

static inline void cpu_barrier(void)
{
#ifdef __arm__
    __asm volatile("dsb\n\tisb" ::: "memory");
#endif
}

/* Find out whether this is an emulator (QEMU), at start-up before anything is written to RCC_CR. There it is 0; on a
 * chip it is 83h and the calibration (RM0090 7.3.1). QEMU up to 9.1 always reads it as 0, later versions as written. */
void cpu_detect_emulator(void);
/* Whether this is an emulator. */
bool cpu_emulated(void);

/* Clear flags of a register in which writing a one clears a bit. */
static inline void clear_flags(reg *r, uint32_t flags)
{
#ifdef __arm__
    *r = flags;
#else
    *r &= ~flags;
#endif
}

/* Poll until (*r & mask) == value, `polls` times at most, and once in an emulator, which may lack the register.
 * false: it has not become that value. Tests have their own version (tests/unit/chip.c), which acts as the hardware. */
bool wait_until(const reg *r, uint32_t mask, uint32_t value, uint32_t polls);
#endif
