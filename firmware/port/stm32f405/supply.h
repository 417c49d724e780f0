/* SPDX-License-Identifier: Apache-2.0 */
/* supply.h: the chip's voltage detector (RM0090 5.2.3), at 2.8 V nominal (PLS = 110): above the 2.7 V that 168 MHz with
 * five wait states and writing words to the flash need. Below it the chip is reset, outputs safe, which is told as a
 * brown-out. Its own reset for that (BOR) is an option byte, and off as the chip is delivered.
 */
#ifndef KONTUR_SUPPLY_H
#define KONTUR_SUPPLY_H
#include <stdbool.h>

/* At start-up, after the clock. false: it is low and stays so for 100 ms. */
bool supply_start(void);
/* The flash is not to be written. */
bool supply_low(void);
/* Interrupt: it has become low. */
void supply_irq(void);
#endif
