/* SPDX-License-Identifier: Apache-2.0 */
/* crash.c: saves a crash over a reset, crash.h. */
#include "port/stm32f405/crash.h"

#include <string.h>

#include "port/stm32f405/cpu.h"
#include "port/stm32f405/output.h"

enum { MAGIC = 0x4B43524D };
/* How the last run has ended; REPORTED: crash_read() has reported its end. */
enum { REPORTED, CRASHED, SUPPLY_FAILED };

/* It lies in RAM that is neither cleared nor loaded at start-up (kontur.ld). */
struct saved_crash {
    uint32_t magic;
    uint32_t end;
    struct hal_crash crash;
    uint32_t check;
};
#ifdef __arm__
__attribute__((section(".noinit")))
#endif
static struct saved_crash saved;

#ifdef __arm__
extern uint32_t kontur_stack_bottom[], kontur_stack_top[];
#else
extern uint32_t kontur_stack_bottom[16];
#define kontur_stack_top (kontur_stack_bottom + 16)
#endif

/* Adler's checksum. RAM has random contents after power-on, and almost never a valid checksum. */
static uint32_t check(const struct saved_crash *r)
{
    const uint8_t *byte = (const uint8_t *)r;
    uint32_t a = 1, b = 0;
    for (size_t i = 0; i < offsetof(struct saved_crash, check); i++) {
        a = (a + byte[i]) % 65521u;
        b = (b + a) % 65521u;
    }
    return b << 16 | a;
}

static bool valid(void)
{
    return saved.magic == MAGIC && saved.check == check(&saved);
}

static void seal(void)
{
    saved.magic = MAGIC;
    saved.check = check(&saved);
}

static void reset(uint32_t end)
{
    saved.end = end;
    seal();
    cpu_barrier();
    SCB->AIRCR = SCB_AIRCR_KEY | SCB_AIRCR_SYSRESETREQ;
#ifdef __arm__
    for (;;) { /* until the reset comes, or the watchdog resets */
    }
#endif
}

void crash_record(const uint32_t *frame)
{
    output_safe();
    const uint32_t count = valid() ? saved.crash.count : 0u;
    memset(&saved, 0, sizeof saved);
    if (frame >= kontur_stack_bottom && frame + 8 <= kontur_stack_top) { /* not after a stack overflow */
        saved.crash.lr = frame[5];
        saved.crash.pc = frame[6];
        saved.crash.psr = frame[7];
    }
    saved.crash.cfsr = SCB->CFSR;
    saved.crash.hfsr = SCB->HFSR;
    saved.crash.bfar = SCB->BFAR;
    saved.crash.count = count + 1u;
    reset(CRASHED);
}

void crash_supply(void)
{
    output_safe();
    if (!valid()) {
        memset(&saved, 0, sizeof saved);
    }
    reset(SUPPLY_FAILED);
}

#ifdef __arm__
extern uint32_t kontur_crash_stack[];
__attribute__((naked)) void crash_irq(void)
{
    /* The stack may be the cause, so this uses another one. */
    __asm volatile("cpsid i\n\t"
                   "mrs r0, msp\n\t"
                   "ldr r1, =kontur_crash_stack\n\t"
                   "msr msp, r1\n\t"
                   "b crash_record");
}
#endif

/* RM0090 7.3.21. Every reset pulls the pin low, so its flag is looked at last. */
static enum hal_reset cause(uint32_t csr)
{
    if ((csr & RCC_CSR_PORRSTF) != 0) {
        return HAL_RESET_POWER;
    }
    if ((csr & RCC_CSR_BORRSTF) != 0) { /* without the power-on flag: the supply was low for a moment */
        return HAL_RESET_BROWN_OUT;
    }
    if ((csr & (RCC_CSR_IWDGRSTF | RCC_CSR_WWDGRSTF)) != 0) {
        return HAL_RESET_WATCHDOG;
    }
    if ((csr & RCC_CSR_SFTRSTF) != 0) {
        return HAL_RESET_SOFTWARE;
    }
    return (csr & RCC_CSR_PINRSTF) != 0 ? HAL_RESET_PIN : HAL_RESET_UNKNOWN;
}

void crash_read(enum hal_reset *reset_cause, struct hal_crash *crash)
{
    *reset_cause = cause(RCC->CSR);
    RCC->CSR |= RCC_CSR_RMVF;
    if (*reset_cause == HAL_RESET_POWER || *reset_cause == HAL_RESET_BROWN_OUT || !valid()) {
        memset(&saved, 0, sizeof saved);
    } else if (saved.end != REPORTED) {
        *reset_cause = saved.end == CRASHED ? HAL_RESET_CRASH : HAL_RESET_BROWN_OUT;
    }
    saved.end = REPORTED;
    seal();
    *crash = saved.crash;
}
