/* SPDX-License-Identifier: Apache-2.0 */
#include "learning.h"

void learning_reset(struct learning_state *state)
{
    for (int i = 0; i < 2; i++) {
        state->friction[i] = acc_from(NUM(0));
        state->mass[i] = acc_from(NUM(0));
    }
}

static num force(acc_t friction, acc_t mass, num friction_speed, num r_dot, num r_ddot)
{
    return n_mad(n_mul(acc_to(friction), n_sat(r_dot, friction_speed)), acc_to(mass), r_ddot);
}

vec2 learning_force(const struct learning_state *state, num friction_speed, vec2 r_dot, vec2 r_ddot)
{
    return v2(force(state->friction[0], state->mass[0], friction_speed, r_dot.x, r_ddot.x),
              force(state->friction[1], state->mass[1], friction_speed, r_dot.y, r_ddot.y));
}

/* What a period teaches is far below the resolution of a num. */
static acc_t learn(acc_t value, num rate, num dt, num u_along, num lowest, num highest)
{
    const num gain = n_mul(n_mul(NUM(ACC_GAIN), rate), dt);
    return acc_state(acc_clamp(acc_mad(value, gain, u_along), lowest, highest));
}

static void axis(const struct learning_cfg *cfg, num mass, num coulomb, acc_t *m, acc_t *l, num d, num a, num u, num dt)
{
    const num size = n_hypot(a, cfg->acceleration); /* a / size^2 in two steps: a^2 may leave the range */
    *l = learn(*l, cfg->friction_rate, dt, n_mul(u, d), n_neg(coulomb), n_mul(NUM(3), coulomb));
    *m = learn(*m, cfg->mass_rate, dt, n_div(n_mul(u, n_div(a, size)), size), n_mul(NUM(-0.5), mass), mass);
}

void learning_step(const struct learning_cfg *cfg, const struct plant_cfg *plant, struct learning_state *state,
                   num friction_speed, vec2 r_dot, vec2 r_ddot, vec2 u, num dt)
{
    axis(cfg, plant->mass.x, plant->coulomb.x, &state->mass[0], &state->friction[0], n_sat(r_dot.x, friction_speed),
         r_ddot.x, u.x, dt);
    axis(cfg, plant->mass.y, plant->coulomb.y, &state->mass[1], &state->friction[1], n_sat(r_dot.y, friction_speed),
         r_ddot.y, u.y, dt);
}
