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

/* The next speed, >= 0, of an axis that moves upwards at v. `room` is the distance to the limit. The speed is so low that
 * the axis can stop within the room. This holds in the next step, too, because slowing down is always allowed. */
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

void profile_start(struct profile *p, int32_t nm)
{
    *p = (struct profile){.pos_pm = (int64_t)nm * PM};
    moving_average_fill(&p->average, PROFILE_ROUND, p->pos_pm);
}

/* The mean lags behind its ramp by (PROFILE_ROUND - 1) / 2 steps. */
void profile_go_on(struct profile *p, int32_t nm, int32_t step_nm)
{
    const int64_t step_pm = (int64_t)step_nm * PM;
    const int64_t first_pm = (int64_t)nm * PM - step_pm * (PROFILE_ROUND - 1) / 2;
    profile_start(p, nm);
    for (int i = 0; i < PROFILE_ROUND; i++) {
        (void)moving_average_step(&p->average, first_pm + i * step_pm);
    }
    p->pos_pm = first_pm + (PROFILE_ROUND - 1) * step_pm;
    p->vel_pmpms = step_pm;
    p->settling = PROFILE_SETTLE;
}

int32_t profile_step(struct profile *p, const struct profile_in *in)
{
    const int64_t target = (int64_t)in->target_umps * PM;
    const int64_t before = p->vel_pmpms;
    const bool up = p->vel_pmpms > 0 || (p->vel_pmpms == 0 && target >= 0);
    p->limited = false;
    if (up) {
        p->vel_pmpms = upwards(p->vel_pmpms, target, (int64_t)in->max_nm * PM - p->pos_pm, in, &p->limited);
    } else {
        p->vel_pmpms = -upwards(-p->vel_pmpms, -target, p->pos_pm - (int64_t)in->min_nm * PM, in, &p->limited);
    }
    p->pos_pm += p->vel_pmpms;
    p->settling = (uint8_t)(p->vel_pmpms != before ? PROFILE_SETTLE : p->settling > 0 ? p->settling - 1 : 0);
    return (int32_t)moving_average_round(moving_average_step(&p->average, p->pos_pm), (int64_t)PROFILE_ROUND * PM);
}

bool profile_stands(const struct profile *p)
{
    return p->vel_pmpms == 0 && p->settling == 0;
}

bool profile_reached(const struct profile *p, int32_t target_umps)
{
    return p->vel_pmpms == (int64_t)target_umps * PM && p->settling == 0;
}
