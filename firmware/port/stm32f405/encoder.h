/* SPDX-License-Identifier: Apache-2.0 */
/* encoder.h: quadrature encoders on timers in encoder mode (RM0090 18.3.12), extended to 32 bits: two, and where the
 * board has pins for them a second one of each axis.
 *
 * The timer counts every edge, so a line of the encoder is four counts. The index pulse captures the counter in
 * hardware (18.3.5), so its count is exact at any speed.
 *
 * A timer in encoder mode does not report an illegal transition (of A and B at once), but counts wrong. The driver
 * reports HAL_ENCODER_FAULT for a read with one of its symptoms:
 * - more counts in one control period than any movement makes (jump_counts);
 * - a distance between two index pulses that is more than one line off a multiple of index_counts. A pulse is one
 *   line wide, and may be met from either side.
 *
 * Context: encoder_read() in the servo tick, the other functions in the background loop.
 */
#ifndef KONTUR_ENCODER_H
#define KONTUR_ENCODER_H
#include "hal/hal.h"

/* At start-up: pins, timers, and count 0. */
void encoder_init(void);
/* Set the wiring; no axis has power. */
void encoder_configure(const struct hal_axis_cfg cfg[AXES]);
/* Set `count`, `second`, `index_pulses` and `index_count` of both axes,
 * read within 2 us, and add HAL_ENCODER_FAULT to `inputs`. */
void encoder_read(struct hal_drive_in *in);
/* There was no servo tick for a while: a jump found by the next read is no fault. It remains a fault of a 16-bit timer,
 * which may have wrapped meanwhile. */
void encoder_paused(void);
#endif
