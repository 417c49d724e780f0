/* SPDX-License-Identifier: Apache-2.0 */
/* watchdog.h: the independent watchdog (RM0090 21), 50 ms by its own oscillator (34 to 94 ms: LSI 17..47 kHz,
 * DS8626). It resets the chip, which makes every output an input: the board's resistors disable the amplifiers.
 * Background only.
 *
 * Fed only when both halves of the firmware are alive: by the background loop, in a pass that finds the servo tick
 * further on than the last feeding did and its own work done. Stands still while a debugger halts the core. */
#ifndef KONTUR_WATCHDOG_H
#define KONTUR_WATCHDOG_H
#include <stdbool.h>
#include <stdint.h>

void watchdog_start(void);
/* At the end of each pass of the background loop. ticks: servo ticks so far; healthy: this pass has kept up with its
 * work. */
void watchdog_pass(uint32_t ticks, bool healthy);
/* While the flash keeps the whole chip waiting, from the code that waits for it. */
void watchdog_feed(void);
#endif
