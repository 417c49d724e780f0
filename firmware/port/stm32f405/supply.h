/* SPDX-License-Identifier: Apache-2.0 */
/* supply.h: the chip's voltage detector (RM0090 5.2.3), at 2.8 V nominal (PLS = 110). It is
 * above the 2.7 V that 168 MHz with five wait states and writing words to the flash need. Below
 * it the outputs become safe and the chip is reset, which the next run reports as a brown-out.
 * The chip's own brown-out reset (BOR) is an option byte, which is off on a new chip.
 *
 * Context: supply_start() at power-on, supply_low() in the background loop, supply_irq() in the vector table.
 */
#ifndef KONTUR_SUPPLY_H
#define KONTUR_SUPPLY_H
#include <stdbool.h>

/* At start-up, after clock_start(). false: the supply is low and stays low for 100 ms. */
bool supply_start(void);
/* Whether the supply is too low to write the flash. */
bool supply_low(void);
/* Interrupt: the supply has become low. */
void supply_irq(void);
#endif
