/* SPDX-License-Identifier: Apache-2.0 */
/* motion/profile.h: velocity profile of one axis: one knot a millisecond towards a target velocity.
 *
 * The velocity ramps to its target with constant acceleration. The knots are the mean of that ramp over PROFILE_ROUND
 * milliseconds, so acceleration ramps, too: jerk is acceleration / PROFILE_ROUND. The mean moves no end point: a stop ends
 * exactly where the ramp does, PROFILE_ROUND milliseconds later, and never beyond a limit that the ramp keeps.
 * Units are pm and pm/ms, so 1 um/s2 is 1 pm/ms more each millisecond, and only the knots are rounded.
 *
 * Pure, background only; axis_modes.c uses one for each axis in profile velocity and homing.
 */
#ifndef KONTUR_PROFILE_H
#define KONTUR_PROFILE_H
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
    int32_t min_nm, max_nm;        /* the axis stops there; from outside it moves back only */
};

struct profile {
    int64_t pos_pm, vel_pmpms; /* of the ramp */
    struct moving_average average;
    uint8_t settling; /* knots until the mean is as steady as the ramp, and path time has passed them */
    bool limited;     /* slower than the target, because of min_nm or max_nm */
};

/* Start at standstill. */
void profile_start(struct profile *p, int32_t nm);
/* Start while the axis moves: its latest knot was `nm`, by `step_nm` further than the one before. */
void profile_go_on(struct profile *p, int32_t nm, int32_t step_nm);
/* One millisecond: returns the next knot, nm. */
int32_t profile_step(struct profile *p, const struct profile_in *in);
/* Whether the profile stands: with target 0 the next knot equals the last one. */
bool profile_stands(const struct profile *p);
/* Whether the target velocity has been reached. */
bool profile_reached(const struct profile *p, int32_t target_umps);
#endif
