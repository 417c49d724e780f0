/* SPDX-License-Identifier: Apache-2.0 */
/* switches.h: the outputs beside the axes: digital ones, and their power as PWM of TIM1 (RM0090 17.3.9), 10 kHz in steps of
 * 1/168 MHz. A change of the power takes effect at once, within a period of the PWM. Which pins they have is the board's
 * (board.h); those that it does not have are left out. A debugger that halts the core stops the PWM.
 *
 * Context: switches_write() in the servo tick; switches_safe() in any context. output.c calls all of them.
 */
#ifndef KONTUR_SWITCHES_H
#define KONTUR_SWITCHES_H
#include "hal/hal.h"

/* At start-up: all off. */
void switches_init(void);
/* Put out `digital` and `power`. */
void switches_write(const struct hal_drive_out *out);
/* All off, by direct writes to registers. */
void switches_safe(void);
#endif
