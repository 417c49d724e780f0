/* SPDX-License-Identifier: Apache-2.0 */
#include "motion/cyclic_torque.h"

#include "motion/axis_target.h"
#include "motion/moving_average.h"

enum {
    FULL = 1000,   /* 6071h at the force limit */
    FINE = 256,    /* in a nm */
    REST_NM = 100, /* in a ms: less is noise */
    AHEAD_MOST = 8 /* ms; CYCLIC_AHEAD and what a flipped bit may add */
};

void cyclic_torque_take(struct cyclic_torque *t, struct cyclic *c, int axis, const struct od_axis *od)
{
    const bool repeats = t->known && t->force_mN == 0; /* without force it need not be sent again */
    if (c->axis[axis].fresh) {
        const int32_t sum = (int32_t)od->target_torque + od->torque_offset;
        const int32_t within = sum > FULL ? FULL : sum < -FULL ? -FULL : sum;
        t->known = true;
        t->limited = within != sum;
        t->force_mN = (int32_t)((int64_t)within * od->plant.force_limit / FULL);
    }
    if (c->axis[axis].fresh || repeats) {
        t->latest = c->clock.cycle;
    }
    c->axis[axis].fresh = false;
}

void cyclic_torque_join(struct cyclic_torque *t, int32_t nm)
{
    t->at = (int64_t)nm * FINE;
    t->step = 0;
    t->knot_nm = nm;
    t->step_nm = 0;
    t->rest = 0;
}

static bool far(int64_t a, int64_t b, int64_t window)
{
    return a - b > window || b - a > window;
}

/* Why an axis that follows may do so no longer. */
static enum cyclic_result check(const struct cyclic_torque *t, const struct cyclic *c,
                                const struct cyclic_torque_in *in)
{
    const int32_t umps = in->od->velocity_actual;
    const int64_t window = in->cyclic->window_nm; /* noise moves an axis at a limit out and in */
    const int64_t here = in->od->position_actual;
    const int64_t clear = umps > 0 ? here - window : here + window;
    if (cyclic_leaves(&in->limits, clear, umps, 1)) {
        return CYCLIC_RANGE;
    }
    const bool rests = t->force_mN == 0 && (!t->acts || cyclic_torque_stands(t));
    return !rests && cyclic_missing(c, t->latest, in->cyclic->now) ? CYCLIC_MISSED : CYCLIC_TAKEN;
}

/* The next set-point that counts comes after this. */
static void leave(struct cyclic_torque *t)
{
    t->known = false;
    t->follows = false;
    t->acts = false;
    t->limited = false;
}

bool cyclic_torque_update(struct cyclic_torque *t, const struct cyclic *c, const struct cyclic_torque_in *in)
{
    if (t->follows) {
        t->refused = check(t, c, in);
    }
    t->refused = in->enabled ? t->refused : CYCLIC_TAKEN;
    const bool may_follow = in->enabled && !in->cyclic->halt && t->refused == CYCLIC_TAKEN;
    if (!may_follow) {
        leave(t);
    }
    if (may_follow && !t->follows && in->cyclic->stands && t->known && sync_clock_locked(&c->clock, in->cyclic->now)) {
        t->follows = true;
        cyclic_torque_join(t, in->cyclic->at_nm);
    }
    return t->follows &&
           (!t->acts || t->force_mN != 0 || far(in->od->position_actual, t->knot_nm, in->cyclic->window_nm));
}

/* An alpha-beta filter, whose position and speed are as far behind as noise of the measured speed allows. */
int32_t cyclic_torque_knot(struct cyclic_torque *t, const struct od_axis *od, uint32_t ahead_ms)
{
    const int64_t ahead = ahead_ms < AHEAD_MOST ? (int64_t)ahead_ms : AHEAD_MOST;
    const int64_t there = ((int64_t)od->position_actual + od->velocity_actual * ahead) * FINE;
    const int64_t ahead_of = there - t->at - t->step;
    t->at += t->step + ahead_of / 2;
    t->step += ahead_of / 6;
    t->knot_nm = (int32_t)moving_average_round(t->at, FINE);
    t->step_nm = (int32_t)moving_average_round(t->step, FINE);
    t->rest = (uint8_t)(far(t->step_nm, 0, REST_NM) ? 0 : t->rest + (t->rest < UINT8_MAX ? 1 : 0));
    t->acts = true;
    return t->knot_nm;
}

bool cyclic_torque_stands(const struct cyclic_torque *t)
{
    return t->rest >= CYCLIC_REST;
}

unsigned cyclic_torque_status(const struct cyclic_torque *t)
{
    return (t->follows ? SW_FOLLOWS : 0u) | (t->limited ? SW_INTERNAL_LIMIT : 0u);
}
