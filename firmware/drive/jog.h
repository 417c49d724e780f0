/* SPDX-License-Identifier: Apache-2.0 */
/* jog.h: the way of one axis that is told a speed: one knot a millisecond, for jogging and homing. Background only.
 *
 * The speed ramps to its target with constant acceleration; the mean over JOG_ROUND milliseconds of that way is what
 * comes out, so acceleration ramps too: jerk is acceleration / JOG_ROUND. The mean moves no end point: a stop ends
 * exactly where the ramp does, JOG_ROUND milliseconds later, and never beyond a limit that the ramp keeps.
 * Integers: pm and pm/ms, so that 1 um/s2 is 1 pm/ms more each millisecond and nothing is rounded but the knots.
 */
#ifndef KONTUR_JOG_H
#define KONTUR_JOG_H
#include <stdbool.h>

#include "box.h"

enum {
    JOG_ROUND = 50, /* ms, at most BOX_MAX */
    JOG_AHEAD = 10, /* ms that knots are made ahead of path time */
    JOG_SETTLE = JOG_ROUND + JOG_AHEAD + 4
};

struct jog_in {
    int32_t target_umps;
    uint32_t up_umps2, down_umps2; /* to speed up, to slow down; > 0 */
    int32_t min_nm, max_nm;        /* slows down before; an axis that is outside comes back only */
};

struct jog {
    int64_t pos_pm, vel_pmpms; /* of the ramp */
    struct box box;
    uint8_t settling;          /* knots until the mean is as steady as the ramp, and path time past that */
    bool limited;              /* slower than asked for, because of min_nm or max_nm */
};

/* At rest. */
void jog_start(struct jog *j, int32_t nm);
/* The next knot, nm. */
int32_t jog_step(struct jog *j, const struct jog_in *in);
/* It stands: the next knot is the last one again, unless a target says otherwise. */
bool jog_rests(const struct jog *j);
/* It moves with the target's speed, no more ramping. */
bool jog_reached(const struct jog *j, int32_t target_umps);
#endif
