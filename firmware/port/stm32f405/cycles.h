/* SPDX-License-Identifier: Apache-2.0 */
/* cycles.h: counts the clock cycles of servo ticks by DWT CYCCNT (DDI 0403E C1.8), the last one and the worst since the
 * start, from the first line of the interrupt to its last. An emulator that lacks the counter counts none.
 *
 * Context: cycles_begin() and cycles_end() in the servo tick, the other functions in the background loop.
 */
#ifndef KONTUR_CYCLES_H
#define KONTUR_CYCLES_H
#include "hal/hal.h"

/* At start-up: let the counter run. */
void cycles_start(void);
void cycles_begin(void);
void cycles_end(void);
/* Set `tick_cycles` and `tick_cycles_worst`. */
void cycles_read(struct hal_health *health);
#endif
