/* SPDX-License-Identifier: Apache-2.0 */
/* observer.c: the extended state observer of observer.h. Runs in the servo tick. */
#include "core/observer.h"

struct observer_cfg observer_design(num bandwidth, num dt)
{
    /* p = (1 - x) / (1 + x) with x = bandwidth dt / 2, the bilinear image of the pole */
    const num x = n_mul(NUM(0.5), n_mul(bandwidth, dt));
    const num p = n_div(n_sub(NUM(1), x), n_add(NUM(1), x));
    const num q = n_sub(NUM(1), p);
    const num r = n_div(q, dt);
    struct observer_cfg cfg;
    cfg.gain_pos = n_sub(NUM(1), n_mul(p, n_mul(p, p)));
    cfg.gain_vel = n_mul(NUM(1.5), n_mul(n_mul(q, r), n_add(NUM(1), p)));
    cfg.gain_acc = n_mul(n_mul(r, r), q);
    cfg.dt = dt;
    return cfg;
}

void observer_reset(struct observer_state *state, pos_t pos)
{
    state->pos = pos;
    state->vel = NUM(0);
    state->disturbance = NUM(0);
    state->acc = NUM(0);
}

void observer_step(const struct observer_cfg *cfg, struct observer_state *state, pos_t measured, num force, num mass,
                   num viscous)
{
    const num explained = n_div(n_sub(force, n_mul(viscous, state->vel)), mass);
    state->acc = n_add(explained, state->disturbance);
    const num dv = n_mul(state->acc, cfg->dt);
    const num displacement = n_mul(n_mad(state->vel, NUM(0.5), dv), cfg->dt);
    const num innovation = n_sub(pos_sub(measured, state->pos), displacement);

    state->pos = pos_add(state->pos, n_mad(displacement, cfg->gain_pos, innovation));
    state->vel = n_state(n_mad(n_add(state->vel, dv), cfg->gain_vel, innovation));
    state->disturbance = n_state(n_mad(state->disturbance, cfg->gain_acc, innovation));
}
