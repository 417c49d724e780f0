/* SPDX-License-Identifier: Apache-2.0 */
/* output.h: two force commands and two enable signals. Servo interrupt: output_write(); background: the rest.
 *
 * DAC: 12 bits, code 2048 + n for n/2048 of full scale; the board makes -10..10 V of 0..3.3 V. PWM: 40 kHz in 4200
 * steps, with a direction pin, so that a dead line asks for no force. What a command loses in rounding is added to the
 * next one (first-order error feedback): its mean is exact, and the steps of the output appear as noise near the
 * control rate, where the mass of an axis is deaf. RM0090 14 (DAC), 17 (PWM mode).
 */
#ifndef KONTUR_OUTPUT_H
#define KONTUR_OUTPUT_H
#include "hal/hal.h"

/* Zero force, not enabled; DAC until told otherwise. */
void output_init(void);
/* Without power on an axis. */
void output_configure(const struct hal_axis_cfg cfg[AXES]);
void output_write(const struct hal_drive_out *out);
/* From anywhere, whatever has happened: enable off, DAC to zero volts, PWM off; direct register writes. What the servo
 * writes after it changes nothing until it wants neither axis enabled any more: it knows of the reason. */
void output_safe(void);
#endif
