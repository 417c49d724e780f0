/* SPDX-License-Identifier: Apache-2.0 */
/* crash.h: what happens when the processor faults (DDI 0403E B1.5). The outputs become safe, the registers are saved
 * in RAM that survives a reset, and the chip is reset. At the next start the saved crash is object 2030h, and the
 * fault is reported. The saved crash is lost with the power. An interrupt without a handler ends here, too; the low
 * bits of `psr` are its number.
 *
 * Context: exceptions, clock.c and supply.c, which never return from it; crash_read() at power-on.
 */
#ifndef KONTUR_CRASH_H
#define KONTUR_CRASH_H
#include "hal/hal.h"

/* Once at start-up, before anything writes RCC_CSR: why the processor has started, and the saved crash. */
void crash_read(enum hal_reset *reset_cause, struct hal_crash *crash);
/* Interrupt: HardFault and every exception without a handler. It goes on in crash_record() on a stack of its own. */
void crash_irq(void);
/* Save the crash and reset. `frame` is what the exception has pushed on the stack; NULL: there was no exception. */
void crash_record(const uint32_t *frame);
/* The supply fails: make the outputs safe and reset. The next start is one after a brown-out. */
void crash_supply(void);
#endif
