/* SPDX-License-Identifier: Apache-2.0 */
/* encoder.h: two quadrature encoders on timers in encoder mode (RM0090 18.3.12), counted on to 32 bits. Servo
 * interrupt: encoder_read(); background: the rest.
 *
 * The timer counts every edge, so a line of the encoder is four counts. The index pulse captures the counter in
 * hardware (18.3.5), so its count is exact at any speed.
 *
 * A timer in encoder mode does not tell of an illegal transition (A and B at once): it counts wrong. What shows it is
 * looked for instead, and reported as HAL_ENCODER_FAULT of that read:
 * - more counts in one control period than any movement makes (jump_counts);
 * - a count between two index pulses that is more than one line off a multiple of index_counts. A pulse is as wide as a
 * line, and is met from either side.
 */
#ifndef KONTUR_ENCODER_H
#define KONTUR_ENCODER_H
#include "hal/hal.h"

void encoder_init(void);
/* Without power on an axis. */
void encoder_configure(const struct hal_axis_cfg cfg[AXES]);
/* Sets `count`, `index_pulses`, `index_count` of both axes, read within 1 us; adds HAL_ENCODER_FAULT to `inputs`. */
void encoder_read(struct hal_drive_in *in);
/* No servo tick has been for a while: what the next read finds is no jump. A timer of 16 bits may have gone round
 * meanwhile, so that there it is one. */
void encoder_paused(void);
#endif
