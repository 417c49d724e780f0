/* SPDX-License-Identifier: Apache-2.0 */
/* supply.h: the chip's voltage detector (RM0090 5.2.3) with PLS = 110: low below 2.85 to 2.99 V, and good again above
 * 2.96 to 3.10 V (DS8626, embedded reset and power control block). 168 MHz with five wait states and writing words to
 * the flash need 2.7 V. When the supply falls, the outputs become safe and the chip is reset, which the next run
 * reports as a brown-out. While it stays low, the servo tick raises the same fault.
 * The chip's own brown-out reset (BOR) is an option byte, which is off on a new chip.
 *
 * Context: supply_start() at power-on, supply_low() in any context, supply_irq() in the vector table.
 */
#ifndef KONTUR_SUPPLY_H
#define KONTUR_SUPPLY_H
#include <stdbool.h>

/* At start-up, after clock_start(). false: the supply is low and stays low for 100 ms. */
bool supply_start(void);
/* Whether the supply is low: too low for power on an axis, and to write the flash. */
bool supply_low(void);
/* Interrupt: the supply has become low. */
void supply_irq(void);
#endif
