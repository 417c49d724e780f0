/* SPDX-License-Identifier: Apache-2.0 */
#include "motion/positioning.h"

void positioning_reset(struct positioning *p)
{
    *p = (struct positioning){0};
}

static int32_t add_nm(int32_t a, int32_t b)
{
    const int64_t sum = (int64_t)a + b;
    return sum > INT32_MAX ? INT32_MAX : sum < INT32_MIN ? INT32_MIN : (int32_t)sum;
}

static void take(struct positioning *p, const struct positioning_in *in)
{
    struct positioning_set_point taken = in->set_point;
    if ((in->controlword & CW_RELATIVE) != 0) {
        taken.nm = add_nm(p->waits ? p->next.nm : p->active ? p->now.nm : in->reference_nm, taken.nm);
    }
    if (p->active && !in->arrived && (in->controlword & CW_AT_ONCE) == 0) {
        p->next = taken;
        p->waits = true;
    } else {
        p->now = taken;
        p->active = true;
        p->waits = false;
    }
    p->acknowledged = true;
}

/* Whether the axis is in the window of its target, for its time. */
static bool reached(struct positioning *p, const struct positioning_in *in)
{
    const bool inside = in->arrived && in->distance_nm <= in->window_nm && in->distance_nm >= -(int64_t)in->window_nm;
    if (!inside) {
        p->inside_since = in->now;
    }
    return inside && in->now - p->inside_since >= in->window_periods;
}

void positioning_step(struct positioning *p, const struct positioning_in *in)
{
    if (!in->enabled) {
        positioning_reset(p);
        return;
    }
    p->reached = reached(p, in);
    if (p->waits && in->arrived) {
        p->now = p->next;
        p->waits = false;
        p->reached = false;
    }
    const bool edge = (in->controlword & ~(unsigned)in->before & CW_NEW_SET_POINT) != 0;
    if (edge && (!p->waits || (in->controlword & CW_AT_ONCE) != 0)) {
        take(p, in);
        p->reached = false;
    }
    if ((in->controlword & CW_NEW_SET_POINT) == 0) {
        p->acknowledged = p->waits;
    }
}
