/* SPDX-License-Identifier: Apache-2.0 */
#include "port/stm32f405/crash.h"

#include <string.h>

#include "port/stm32f405/cpu.h"
#include "port/stm32f405/output.h"

enum { MAGIC = 0x4B43524D };
enum { OLD, CRASHED, SUPPLY_FAILED }; /* how the run before this one has ended */

/* Neither cleared nor loaded at start-up (kontur.ld). */
struct ip_record {
    uint32_t magic;
    uint32_t end;
    struct hal_crash crash;
    uint32_t check;
};
#ifdef __arm__
__attribute__((section(".noinit")))
#endif
static struct ip_record record;

#ifdef __arm__
extern uint32_t kontur_stack_bottom[], kontur_stack_top[];
#else
extern uint32_t kontur_stack_bottom[16];
#define kontur_stack_top (kontur_stack_bottom + 16)
#endif

/* Adler's sum: RAM without power comes up with anything, but not with this. */
static uint32_t check(const struct ip_record *r)
{
    const uint8_t *byte = (const uint8_t *)r;
    uint32_t a = 1, b = 0;
    for (size_t i = 0; i < offsetof(struct ip_record, check); i++) {
        a = (a + byte[i]) % 65521u;
        b = (b + a) % 65521u;
    }
    return b << 16 | a;
}

static bool valid(void)
{
    return record.magic == MAGIC && record.check == check(&record);
}

static void seal(void)
{
    record.magic = MAGIC;
    record.check = check(&record);
}

static void reset(uint32_t end)
{
    record.end = end;
    seal();
    cpu_barrier();
    SCB->AIRCR = SCB_AIRCR_KEY | SCB_AIRCR_SYSRESETREQ;
#ifdef __arm__
    for (;;) { /* until it has come, or the watchdog */
    }
#endif
}

void crash_record(const uint32_t *frame)
{
    output_safe();
    const uint32_t count = valid() ? record.crash.count : 0u;
    memset(&record, 0, sizeof record);
    if (frame >= kontur_stack_bottom && frame + 8 <= kontur_stack_top) { /* not after a stack overflow */
        record.crash.lr = frame[5];
        record.crash.pc = frame[6];
        record.crash.psr = frame[7];
    }
    record.crash.cfsr = SCB->CFSR;
    record.crash.hfsr = SCB->HFSR;
    record.crash.bfar = SCB->BFAR;
    record.crash.count = count + 1u;
    reset(CRASHED);
}

void crash_supply(void)
{
    output_safe();
    if (!valid()) {
        memset(&record, 0, sizeof record);
    }
    reset(SUPPLY_FAILED);
}

#ifdef __arm__
extern uint32_t kontur_crash_stack[];
__attribute__((naked)) void crash_irq(void)
{
    /* the stack may be what has gone wrong */
    __asm volatile("cpsid i\n\t"
                   "mrs r0, msp\n\t"
                   "ldr r1, =kontur_crash_stack\n\t"
                   "msr msp, r1\n\t"
                   "b crash_record");
}
#endif

/* RM0090 7.3.21; the pin is low in every reset, so its flag says least. */
static enum hal_reset cause(uint32_t csr)
{
    if ((csr & RCC_CSR_PORRSTF) != 0) {
        return HAL_RESET_POWER;
    }
    if ((csr & RCC_CSR_BORRSTF) != 0) { /* without power-on: the supply was down for a moment */
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
        memset(&record, 0, sizeof record);
    } else if (record.end != OLD) {
        *reset_cause = record.end == CRASHED ? HAL_RESET_CRASH : HAL_RESET_BROWN_OUT;
    }
    record.end = OLD;
    seal();
    *crash = record.crash;
}
