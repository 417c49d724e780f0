/* SPDX-License-Identifier: Apache-2.0 */
/* watchdog.h: the independent watchdog (RM0090 21), 50 ms by its own oscillator (34 to 94 ms: LSI 17..47 kHz, DS8626).
 * It resets the chip, which makes every output an input, so that the board's resistors disable the amplifiers.
 *
 * It is fed only when both halves of the firmware are alive: by the background loop, in a pass that has done its own
 * work and finds that the servo tick has advanced since the last feeding.
 *
 * Context: the background loop; sectors.c feeds it while the flash is busy. The servo tick calls watchdog_in_halt().
 */
#ifndef KONTUR_WATCHDOG_H
#define KONTUR_WATCHDOG_H
#include <stdbool.h>
#include <stdint.h>

/* Start it. It cannot be stopped again. */
void watchdog_start(void);
/* Whether it runs on while a debugger halts the core. The servo tick calls this each time, because debuggers set the
 * same bits when they connect (RM0090 38.16.4). */
void watchdog_in_halt(bool runs);
/* At the end of each pass of the background loop. `ticks` is the number of servo ticks so far; `healthy` says that the
 * background loop has kept up with its work. */
void watchdog_pass(uint32_t ticks, bool healthy);
/* Feed it while the chip waits for the flash. */
void watchdog_feed(void);
#endif
