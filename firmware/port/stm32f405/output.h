/* SPDX-License-Identifier: Apache-2.0 */
/* output.h: two force commands, two enable signals and two brakes, which are released only while their axis is enabled;
 * with them the outputs beside the axes (switches.h).
 *
 * DAC: 12 bits; code 2048 + n is n/2048 of full scale, and the board makes -10..10 V of 0..3.3 V. Serial DAC:
 * the same with 16 bits (spi_dac.h). PWM: steps of 1/168
 * MHz, with a direction pin, so that a dead line commands no force; or in locked antiphase, where a dead line commands
 * full negative force. The rounding error of a command is added to the
 * next one (first-order error feedback): the mean of the output is exact, and its steps are noise near the control
 * rate, where the mass of an axis does not respond. RM0090 14 (DAC), 17 (PWM mode).
 *
 * Where the board has a break input (RM0090 17.3.12), it switches PWM off without the firmware. PWM stays off until the
 * input is inactive and neither axis is commanded to be enabled.
 *
 * Context: output_read() and output_write() in the servo tick; output_safe() in any context; the other functions in the background loop.
 */
#ifndef KONTUR_OUTPUT_H
#define KONTUR_OUTPUT_H
#include "hal/hal.h"

/* At start-up: zero force, not enabled, brakes engaged, and the DAC as the output of both axes. */
void output_init(void);
/* Set the wiring; no axis has power. */
void output_configure(const struct hal_axis_cfg cfg[AXES]);
/* Add HAL_AMPLIFIER_FAULT to `inputs` of an axis with PWM, which the break input has switched off. */
void output_read(struct hal_drive_in *in);
/* Put out both forces, enable signals and brakes. */
void output_write(const struct hal_drive_out *out);
/* Enable off, brakes engaged, DACs to zero volts, PWM off, by direct writes to registers. It works in
 * any state of the firmware. After it output_write() does nothing until the servo
 * tick commands neither axis to be enabled, which shows that the drive has noticed. */
void output_safe(void);
#endif
