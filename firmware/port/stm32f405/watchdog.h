/* SPDX-License-Identifier: Apache-2.0 */
/* watchdog.h: both watchdogs. Each resets the chip, which makes every output an input, so that the board's resistors
 * disable the amplifiers.
 *
 * - The window watchdog (RM0090 22), 3.1 ms by the clock of APB1, is fed by the servo tick at its end. It bites when the
 *   core hangs or the tick stands still.
 * - The independent watchdog (RM0090 21), 50 ms by its own oscillator (34 to 94 ms: LSI 17..47 kHz, DS8626), is fed by
 *   the background loop, in a pass that has done its own work and finds that the servo tick has advanced since the last
 *   feeding. It bites when the background hangs, or the clock of the chip stands still.
 *
 * Context: beside each function.
 */
#ifndef KONTUR_WATCHDOG_H
#define KONTUR_WATCHDOG_H
#include <stdbool.h>
#include <stdint.h>

/* Start both, at the end of start-up. They cannot be stopped again. */
void watchdog_start(void);
/* At the end of each servo tick. */
void watchdog_tick(void);
/* Whether both run on while a debugger halts the core. The servo tick calls this each time, because debuggers set the
 * same bits when they connect (RM0090 38.16.4). */
void watchdog_in_halt(bool runs);
/* In the background, at the end of each pass of the background loop. `ticks` is the number of servo ticks so far; `healthy` says that the
 * background loop has kept up with its work. */
void watchdog_pass(uint32_t ticks, bool healthy);
/* Feed both while the chip waits for the flash, without a servo tick and with interrupts disabled. */
void watchdog_feed(void);
#endif
