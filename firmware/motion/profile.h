/* SPDX-License-Identifier: Apache-2.0 */
/* motion/profile.h: the way of one axis that is told a speed: one knot a millisecond, for jogging and homing. Background only.
 *
 * The speed ramps to its target with constant acceleration; the mean over PROFILE_ROUND milliseconds of that way is what
 * comes out, so acceleration ramps too: jerk is acceleration / PROFILE_ROUND. The mean moves no end point: a stop ends
 * exactly where the ramp does, PROFILE_ROUND milliseconds later, and never beyond a limit that the ramp keeps.
 * Integers: pm and pm/ms, so that 1 um/s2 is 1 pm/ms more each millisecond and nothing is rounded but the knots.
 */
#ifndef KONTUR_JOG_H
#define KONTUR_JOG_H
#include <stdbool.h>

#include "motion/moving_average.h"

enum {
    PROFILE_ROUND = 50, /* ms, at most MOVING_AVERAGE_MAX */
    PROFILE_AHEAD = 10, /* ms that knots are made ahead of path time */
    PROFILE_SETTLE = PROFILE_ROUND + PROFILE_AHEAD + 4
};

struct profile_in {
    int32_t target_umps;
    uint32_t up_umps2, down_umps2; /* to speed up, to slow down; > 0 */
    int32_t min_nm, max_nm;        /* slows down before; an axis that is outside comes back only */
};

struct profile {
    int64_t pos_pm, vel_pmpms; /* of the ramp */
    struct moving_average average;
    uint8_t settling; /* knots until the mean is as steady as the ramp, and path time past that */
    bool limited;     /* slower than asked for, because of min_nm or max_nm */
};

/* At rest. */
void profile_start(struct profile *j, int32_t nm);
/* The next knot, nm. */
int32_t profile_step(struct profile *j, const struct profile_in *in);
/* It stands: the next knot is the last one again, unless a target says otherwise. */
bool profile_stands(const struct profile *j);
/* It moves with the target's speed, no more ramping. */
bool profile_reached(const struct profile *j, int32_t target_umps);
#endif
