/* SPDX-License-Identifier: Apache-2.0 */
/* clock.h: 168 MHz out of the crystal, or out of the internal oscillator (HSI, 1 % at room temperature) when the
 * crystal does not start or stops. AHB 168 MHz, APB1 42 MHz (its timers 84), APB2 84 MHz (its timers 168).
 *
 * Sources: RM0090 7.2 (clocks; PLL: 2 MHz in, 336 MHz VCO; clock security system), 7.3, 3.5.1 (wait states), 5.4.1
 * (voltage scale 1 for more than 144 MHz).
 */
#ifndef KONTUR_CLOCK_H
#define KONTUR_CLOCK_H
#include <stdbool.h>

#define CLOCK_HZ 168000000u
#define CLOCK_APB1_HZ 42000000u

/* At start-up. Takes 100 ms at most. true: on the crystal, which is watched from now on. Where the PLL locks on neither
 * oscillator nothing would have its time, on the wire neither: the chip is reset, as after a crash, and tries again. */
bool clock_start(void);
/* Nonmaskable interrupt: the crystal has stopped and the chip runs on 16 MHz. Makes the outputs safe, then 168 MHz
 * again, or a reset. */
void clock_failed_irq(void);
/* Not on the crystal (false in an emulator, which has none). */
bool clock_degraded(void);
#endif
