/* SPDX-License-Identifier: Apache-2.0 */
/* dual_feedback.h: the position of an axis from two encoders, one at the motor and one at the table.
 *
 * A complementary filter with one crossover: below it the second encoder, above it the first one.
 *
 *   d = second - first,   o' = w (d - o),   position = first + o
 *
 * so that position = first w_h + second w_l with w_h + w_l = 1, w_l = w / (s + w). The speed is that of the motor, in which the
 * spring between motor and table does not turn the phase; the position is that of the table, without the errors of the
 * screw. The caller takes a known deflection off `first`, of which the filter then passes nothing.
 *
 * Both encoders are equal where the drive is switched on, so |d| is small for as long as both work: what is beyond the
 * tolerance is a fault.
 *
 * Context: servo_step() (servo.c) calls it in the servo tick, before the observer.
 */
#ifndef KONTUR_DUAL_FEEDBACK_H
#define KONTUR_DUAL_FEEDBACK_H
#include "core/num.h"

struct dual_feedback_cfg {
    bool on;       /* false: there is no second encoder */
    num gain;      /* w dt, 0..1 */
    num tolerance; /* of d, um, > 0 */
};

struct dual_feedback_state {
    num offset; /* o, um */
};

/* Start with o = 0. */
void dual_feedback_reset(struct dual_feedback_state *state);
/* One control period with the difference d, um: the position is first + state->offset. Returns whether the encoders
 * agree. */
bool dual_feedback_step(const struct dual_feedback_cfg *cfg, struct dual_feedback_state *state, num difference);
#endif
