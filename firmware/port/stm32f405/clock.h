/* SPDX-License-Identifier: Apache-2.0 */
/* clock.h: 168 MHz from the crystal, or from the internal oscillator (HSI, 1 % at room temperature) when the crystal
 * does not start or stops. AHB has 168 MHz, APB1 42 MHz (its timers 84), APB2 84 MHz (its timers 168).
 *
 * Sources: RM0090 7.2 (clocks; PLL: 2 MHz in, 336 MHz VCO; clock security system), 7.3, 3.5.1 (wait states), 5.4.1
 * (voltage scale 1 for more than 144 MHz).
 *
 * Context: main_loop_start() calls clock_start() at power-on, and the background loop clock_degraded(). The vector
 * table (start.c) has clock_failed_irq().
 */
#ifndef KONTUR_CLOCK_H
#define KONTUR_CLOCK_H
#include <stdbool.h>

/* At start-up; it takes 100 ms at most. true: the chip runs on the crystal, which is monitored from now on. When
 * the PLL locks on neither oscillator, neither control period nor bit rate would be right: the chip is reset, as
 * after a crash, and tries again. */
bool clock_start(void);
/* Nonmaskable interrupt: the crystal has stopped, and the chip runs on 16 MHz. It makes the outputs safe, and then sets
 * 168 MHz from the HSI or resets the chip. */
void clock_failed_irq(void);
/* Whether the chip runs without its crystal. It is false in an emulator, which has none. */
bool clock_degraded(void);
#endif
