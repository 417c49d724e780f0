/* SPDX-License-Identifier: Apache-2.0 */
/* run.h: the firmware on the chip: the port's HAL, the servo tick, the background loop. A host can run it, too, on the
 * registers of tests/unit/chip.h. */
#ifndef KONTUR_RUN_H
#define KONTUR_RUN_H
/* After reset: outputs safe, clock, drivers, firmware, tick, watchdog. Bounded. */
void run_start(void);
/* One pass of the background loop, which ends with sleep until the next interrupt. */
void run_pass(void);
/* SysTick: the servo tick, CONTROL_HZ. */
void tick_irq(void);
#endif
