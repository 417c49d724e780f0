/* SPDX-License-Identifier: Apache-2.0 */
#include "motion/profile.h"

#define PM 1000 /* in a nm */

static int64_t smaller(int64_t a, int64_t b)
{
    return a < b ? a : b;
}

static int64_t larger(int64_t a, int64_t b)
{
    return a > b ? a : b;
}

/* Way of a stop from v >= 0: (v - down) + (v - 2 down) + ... */
static int64_t stopping(int64_t v, int64_t down)
{
    const int64_t steps = v / down;
    return steps * v - down * (steps * (steps + 1) / 2);
}

/* The next speed, >= 0, of an axis that moves upwards at v. `room`: to the limit. What can be stopped within the room
 * this time can be so the next time, too: slowing down is always allowed. */
static int64_t upwards(int64_t v, int64_t target, int64_t room, const struct profile_in *in, bool *limited)
{
    const int64_t up = in->up_umps2;
    const int64_t down = in->down_umps2;
    const int64_t slowest = larger(v - down, 0);
    const int64_t next = target > v ? smaller(v + up, target) : larger(v - down, larger(target, 0));
    if (next + stopping(next, down) <= room) {
        return next;
    }
    *limited = true;
    int64_t good = slowest;
    int64_t bad = next;
    while (bad - good > 1) {
        const int64_t middle = good + (bad - good) / 2;
        if (middle + stopping(middle, down) <= room) {
            good = middle;
        } else {
            bad = middle;
        }
    }
    return good;
}

void profile_start(struct profile *j, int32_t nm)
{
    *j = (struct profile){.pos_pm = (int64_t)nm * PM};
    moving_average_fill(&j->average, PROFILE_ROUND, j->pos_pm);
}

int32_t profile_step(struct profile *j, const struct profile_in *in)
{
    const int64_t target = (int64_t)in->target_umps * PM;
    const int64_t before = j->vel_pmpms;
    const bool up = j->vel_pmpms > 0 || (j->vel_pmpms == 0 && target >= 0);
    j->limited = false;
    if (up) {
        j->vel_pmpms = upwards(j->vel_pmpms, target, (int64_t)in->max_nm * PM - j->pos_pm, in, &j->limited);
    } else {
        j->vel_pmpms = -upwards(-j->vel_pmpms, -target, j->pos_pm - (int64_t)in->min_nm * PM, in, &j->limited);
    }
    j->pos_pm += j->vel_pmpms;
    j->settling = (uint8_t)(j->vel_pmpms != before ? PROFILE_SETTLE : j->settling > 0 ? j->settling - 1 : 0);
    return (int32_t)moving_average_round(moving_average_step(&j->average, j->pos_pm), (int64_t)PROFILE_ROUND * PM);
}

bool profile_stands(const struct profile *j)
{
    return j->vel_pmpms == 0 && j->settling == 0;
}

bool profile_reached(const struct profile *j, int32_t target_umps)
{
    return j->vel_pmpms == (int64_t)target_umps * PM && j->settling == 0;
}
