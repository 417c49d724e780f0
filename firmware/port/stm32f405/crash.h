/* SPDX-License-Identifier: Apache-2.0 */
/* crash.h: what happens when the processor faults (DDI 0403E B1.5): outputs safe, a record kept in RAM over the reset,
 * reset. At the next start the record is object 2030h and the fault is reported; it is lost with the power. An
 * interrupt that nobody expects ends here, too: the low bits of `psr` are its number. */
#ifndef KONTUR_CRASH_H
#define KONTUR_CRASH_H
#include "hal/hal.h"

/* At start-up, before anything writes RCC_CSR: why the processor has started, and the record. Once. */
void crash_read(enum hal_reset *reset_cause, struct hal_crash *crash);
/* HardFault and all exceptions without a handler. */
void crash_irq(void);
/* The rest of it, on a stack of its own. frame: what the exception has stacked; NULL: there was none. */
void crash_record(const uint32_t *frame);
/* The supply fails: outputs safe, reset; the next start is one after a brown-out. */
void crash_supply(void);
#endif
