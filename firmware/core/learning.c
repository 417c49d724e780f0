/* SPDX-License-Identifier: Apache-2.0 */
#include "learning.h"

void learning_reset(struct learning_state *state)
{
    const vec2 zero = v2(NUM(0), NUM(0));
    state->friction = zero;
    state->mass = zero;
}

static num force(num friction, num mass, num friction_speed, num r_dot, num r_ddot)
{
    return n_mad(n_mul(friction, n_sat(r_dot, friction_speed)), mass, r_ddot);
}

vec2 learning_force(const struct learning_state *state, num friction_speed, vec2 r_dot, vec2 r_ddot)
{
    return v2(force(state->friction.x, state->mass.x, friction_speed, r_dot.x, r_ddot.x),
              force(state->friction.y, state->mass.y, friction_speed, r_dot.y, r_ddot.y));
}

static num learn(num value, num rate, num direction, num u, num dt, num lowest, num highest)
{
    const num step = n_mul(n_mul(n_mul(rate, dt), u), direction);
    return n_state(n_clamp(n_add(value, step), lowest, highest));
}

static void axis(const struct learning_cfg *cfg, num mass, num coulomb, num *m, num *l, num d, num a, num u, num dt)
{
    const num size = n_hypot(a, cfg->acceleration); /* a / size^2 in two steps: a^2 may leave the range */
    *l = learn(*l, cfg->friction_rate, d, u, dt, n_neg(coulomb), n_mul(NUM(3), coulomb));
    *m = learn(*m, cfg->mass_rate, n_div(n_div(a, size), size), u, dt, n_mul(NUM(-0.5), mass), mass);
}

void learning_step(const struct learning_cfg *cfg, const struct plant_cfg *plant, struct learning_state *state,
                   num friction_speed, vec2 r_dot, vec2 r_ddot, vec2 u, num dt)
{
    axis(cfg, plant->mass.x, plant->coulomb.x, &state->mass.x, &state->friction.x, n_sat(r_dot.x, friction_speed),
         r_ddot.x, u.x, dt);
    axis(cfg, plant->mass.y, plant->coulomb.y, &state->mass.y, &state->friction.y, n_sat(r_dot.y, friction_speed),
         r_ddot.y, u.y, dt);
}
