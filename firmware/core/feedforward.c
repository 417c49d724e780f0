/* SPDX-License-Identifier: Apache-2.0 */
/* feedforward.c: the adaptive feedforward of feedforward.h. Runs in the servo tick. */
#include "core/feedforward.h"

void feedforward_reset(struct feedforward_state *state)
{
    for (int i = 0; i < 2; i++) {
        state->friction[i] = acc_from(NUM(0));
        state->mass[i] = acc_from(NUM(0));
    }
}

vec2 feedforward_force(const struct feedforward_state *state, vec2 direction, vec2 r_ddot)
{
    const vec2 friction = v2(acc_to(state->friction[0]), acc_to(state->friction[1]));
    const vec2 mass = v2(acc_to(state->mass[0]), acc_to(state->mass[1]));
    return v2(n_mad(n_mul(friction.x, direction.x), mass.x, r_ddot.x),
              n_mad(n_mul(friction.y, direction.y), mass.y, r_ddot.y));
}

/* gain is ACC_GAIN rate dt, because the change in one period is far below the resolution of a num. */
static acc_t adapt(acc_t value, num gain, num u_along, num lowest, num highest)
{
    return acc_state(acc_clamp(acc_mad(value, gain, u_along), lowest, highest));
}

void feedforward_step(const struct feedforward_cfg *cfg, const struct plant_cfg *plant, struct feedforward_state *state,
                      int axis, vec2 direction, vec2 r_ddot, vec2 u, num dt)
{
    const bool y = axis == 1;
    const num mass = y ? plant->mass.y : plant->mass.x;
    const num coulomb = y ? plant->coulomb.y : plant->coulomb.x;
    const num d = y ? direction.y : direction.x;
    const num a = y ? r_ddot.y : r_ddot.x;
    const num force = y ? u.y : u.x;
    const num gain_l = n_mul(n_mul(NUM(ACC_GAIN), cfg->friction_rate), dt);
    const num gain_m = n_mul(n_mul(NUM(ACC_GAIN), cfg->mass_rate), dt);
    const num size = n_hypot(a, cfg->acceleration); /* a^2 may leave the range: a / size^2 takes two divisions */
    const num along = n_div(n_mul(force, n_div(a, size)), size);
    state->friction[axis] =
        adapt(state->friction[axis], gain_l, n_mul(force, d), n_neg(coulomb), n_mul(NUM(3), coulomb));
    state->mass[axis] = adapt(state->mass[axis], gain_m, along, n_mul(NUM(-0.5), mass), mass);
}
