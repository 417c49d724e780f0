/* SPDX-License-Identifier: Apache-2.0 */
/* cascade.c: the P-PI law of cascade.h. Runs in the servo tick. */
#include "core/cascade.h"

static num integrate(num integral, num x, num dt, num limit)
{
    return n_state(n_within(n_mad(integral, x, dt), limit));
}

/* K_v (x + K_i integral x) */
static num pi(const struct cascade_cfg *cfg, num x, num integral)
{
    return n_mul(cfg->k_v, n_mad(x, cfg->k_i, integral));
}

void cascade_reset(struct cascade_state *state)
{
    state->integral = v2(NUM(0), NUM(0));
    state->coupled = NUM(0);
}

vec2 cascade_step(const struct cascade_cfg *cfg, const struct plant_cfg *plant, struct cascade_state *state,
                  const struct contour_out *c, bool coupled, num dt)
{
    const vec2 e_v = v2_scale(NUM(-1), v2_mad(c->e_w_dot, cfg->k_p, c->e_w));
    state->integral.x = integrate(state->integral.x, e_v.x, dt, cfg->integral_max);
    state->integral.y = integrate(state->integral.y, e_v.y, dt, cfg->integral_max);
    vec2 a = v2_add(c->r_ddot, v2(pi(cfg, e_v.x, state->integral.x), pi(cfg, e_v.y, state->integral.y)));

    if (coupled) {
        const num w = n_neg(n_mad(c->e_n_dot.y, cfg->k_p, c->e_n.y));
        state->coupled = integrate(state->coupled, w, dt, cfg->integral_max);
        a = v2_mad(a, n_mul(cfg->coupling, pi(cfg, w, state->coupled)), v2_normal(c->t));
    } else {
        state->coupled = NUM(0);
    }
    return v2_add(v2_mul(plant->mass, a), v2_mul(plant->viscous, c->r_dot));
}
