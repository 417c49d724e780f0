/* SPDX-License-Identifier: Apache-2.0 */
/* friction.c: friction at reversal and at low speed, friction.h. Runs in the servo tick. */
#include "core/friction.h"

#include "core/trig.h"

struct friction_axis_cfg friction_design(num presliding, num breakaway, num stribeck)
{
    struct friction_axis_cfg cfg = {.presliding = presliding, .excess = n_sub(breakaway, NUM(1)), .stribeck = stribeck};
    for (int k = 0; k < FRICTION_ELEMENTS && n_lt(NUM(0), presliding); k++) {
        cfg.element[k].width = n_mul(presliding, n_ratio(k + 1, 2 * (int64_t)FRICTION_ELEMENTS));
        cfg.element[k].share = n_div(n_ratio(2, k + 1), presliding);
    }
    return cfg;
}

static num slip(const struct friction_axis_cfg *cfg, struct friction_axis_state *state, num dx)
{
    /* Where the last element slips, all do, as long as the axis does not turn back. This is mostly true. */
    const num last = state->stretch[FRICTION_ELEMENTS - 1];
    const bool reversed = n_lt(last, NUM(0)) ? n_lt(NUM(0), dx) : n_lt(dx, NUM(0));
    if (!reversed && !n_lt(n_abs(last), cfg->element[FRICTION_ELEMENTS - 1].width)) {
        return n_lt(last, NUM(0)) ? NUM(-1) : NUM(1);
    }
    num sum = NUM(0);
    for (int k = 0; k < FRICTION_ELEMENTS; k++) {
        const num stretch = n_state(n_within(n_add(state->stretch[k], dx), cfg->element[k].width));
        state->stretch[k] = stretch;
        sum = n_mad(sum, cfg->element[k].share, stretch);
    }
    return sum;
}

/* 1 + (breakaway - 1) exp(-|v| / stribeck) */
static num stribeck(const struct friction_axis_cfg *cfg, num v)
{
    const num speed = n_abs(v);
    if (!n_lt(NUM(0), cfg->excess) || !n_lt(n_mul(speed, NUM(1.0 / TRIG_DECAY_MAX)), cfg->stribeck)) {
        return NUM(1);
    }
    return n_mad(NUM(1), cfg->excess, trig_decay(n_div(speed, cfg->stribeck)));
}

static num axis_step(const struct friction_axis_cfg *cfg, struct friction_axis_state *state, num v, num direction,
                     num dt)
{
    const num along = n_lt(NUM(0), cfg->presliding) ? slip(cfg, state, n_mul(v, dt)) : direction;
    return n_mul(along, stribeck(cfg, v));
}

num friction_step(const struct friction_cfg *cfg, struct friction_state *state, int axis, bool enabled, num r_dot,
                  num direction, num dt)
{
    num *const shape = axis == 0 ? &state->shape.x : &state->shape.y;
    num then = NUM(0);
    if (enabled) {
        then = axis_step(&cfg->axis[axis], &state->axis[axis], r_dot, direction, dt);
    } else {
        *shape = NUM(0);
        state->axis[axis] = (struct friction_axis_state){.stretch = {NUM(0)}};
    }
    *(axis == 0 ? &state->change.x : &state->change.y) = n_mul(n_sub(then, *shape), NUM(1.0 / FRICTION_PERIODS));
    return then;
}
