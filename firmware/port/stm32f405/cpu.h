/* SPDX-License-Identifier: Apache-2.0 */
/* cpu.h: what the core itself does: interrupts off and on, sleep, priorities. On a host, where tests run in one thread,
 * nothing. */
#ifndef KONTUR_CPU_H
#define KONTUR_CPU_H
#include <stdbool.h>

#include "port/stm32f405/regs.h"

/* Priorities, 0 first; the chip has the upper four bits (RM0090 12.1.1). The serial line has one byte of room and so
 * goes before the servo, for some 40 instructions a byte; bxCAN has room for three frames, 140 us, and waits. */
enum { PRIORITY_SUPPLY = 0, PRIORITY_SERIAL = 0, PRIORITY_SERVO = 1, PRIORITY_CAN = 2 };

static inline void cpu_irq_enable(unsigned irq, unsigned priority)
{
    const unsigned shift = irq % 4u * 8u;
    NVIC->IPR[irq / 4u] = (NVIC->IPR[irq / 4u] & ~(0xFFu << shift)) | priority << (shift + 4u);
    NVIC->ISER[irq / 32u] = 1u << irq % 32u;
}

/* Interrupts off; returns what cpu_unlock() takes. For a few instructions only. */
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

/* Until the next interrupt */
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

/* Whether this is an emulator (QEMU). Looked at once, before anything is written: RCC_CR is 0 there, and on a chip 83h and
 * what calibration has set (RM0090 7.3.1). QEMU up to 9.1 reads it as 0 ever after, later ones as what was written. */
void cpu_look(void);
bool cpu_emulated(void);

/* Clear flags of a register in which writing ones clears. */
static inline void clear_flags(reg *r, uint32_t flags)
{
#ifdef __arm__
    *r = flags;
#else
    *r &= ~flags;
#endif
}

/* Poll until (*r & mask) == value, `polls` times at most, and not at all in an emulator that does not know the
 * register. false: it has not come. A test's own version of it (tests/unit/chip.c) plays the hardware. */
bool wait_until(const reg *r, uint32_t mask, uint32_t value, uint32_t polls);
#endif
