/* SPDX-License-Identifier: Apache-2.0 */
/* main_loop.h: the firmware on the chip: start-up, the servo tick
 * and the background loop. main_loop.c is also the HAL of the chip.
 *
 * Context: reset_irq() (start.c) calls main_loop_start() once and then main_loop_pass() for ever; the vector table
 * has tick_irq(). A host can run it, too, on the registers of tests/unit/chip.h.
 */
#ifndef KONTUR_MAIN_LOOP_H
#define KONTUR_MAIN_LOOP_H

/* Start-up after a reset: safe outputs, clock, drivers, firmware, servo tick, watchdog. Its time is bounded. */
void main_loop_start(void);
/* One pass of the background loop. It ends with sleep until the next interrupt. */
void main_loop_pass(void);
/* Interrupt: SysTick, the servo tick, at CONTROL_HZ. */
void tick_irq(void);
#endif
