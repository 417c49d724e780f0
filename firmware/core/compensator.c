/* SPDX-License-Identifier: Apache-2.0 */
/* compensator.c: the uncertainty compensator of compensator.h. Runs in the servo tick. */
#include "core/compensator.h"

void compensator_reset(const struct compensator_cfg *cfg, struct compensator_state *state, const pos_t q[2], vec2 q_dot)
{
    const num mu = cfg->law_printed ? NUM(0) : cfg->mu_0;
    state->q_bar[0] = q[0];
    state->q_bar[1] = q[1];
    state->q_bar_dot = q_dot;
    state->mu[0] = state->mu[1] = acc_from(mu);
}

void compensator_adapt(const struct compensator_cfg *cfg, struct compensator_state *state, int axis, vec2 s, num dt)
{
    acc_t *mu = &state->mu[axis];
    const num size = n_abs(axis == 0 ? s.x : s.y);
    if (cfg->law_printed || n_lt(cfg->dead_zone, size)) {
        *mu = acc_clamp(acc_mad(*mu, n_mul(cfg->rho, size), dt), NUM(0), cfg->mu_max);
    }
}

/* The model's position *q_bar, from which q is further off than the limit, is moved so that it is not. Not inline, so that
 * it costs nothing where that is not so. */
__attribute__((noinline, cold)) static num move_model(num z, num limit, const pos_t *q, pos_t *q_bar)
{
    const num limited = n_lt(z, NUM(0)) ? n_neg(limit) : limit;
    *q_bar = pos_add(*q, n_neg(limited));
    return limited;
}

/* q - q_bar, within the limit */
static inline num model_error(num limit, const pos_t *q, pos_t *q_bar)
{
    const num z = pos_sub(*q, *q_bar);
    return rarely(n_lt(limit, n_abs(z))) ? move_model(z, limit, q, q_bar) : z;
}

void compensator_step(const struct compensator_cfg *cfg, const struct plant_cfg *plant, struct compensator_state *state,
                      const pos_t q[2], vec2 q_dot, vec2 t, num theta_dot, struct compensator_out *out)
{
    const num z_max = n_div(cfg->phi, cfg->alpha);
    vec2 z; /* (17) */
    z.x = model_error(z_max, &q[0], &state->q_bar[0]);
    z.y = model_error(z_max, &q[1], &state->q_bar[1]);
    const vec2 z_dot = v2_sub(q_dot, state->q_bar_dot);
    out->z_n = v2_to_frame(t, z);
    const vec2 zn_dot = v2_to_frame(t, v2_mad(z_dot, n_mul(cfg->turning, theta_dot), v2_ie(z)));

    out->mu = v2(acc_to(state->mu[0]), acc_to(state->mu[1]));
    out->s = v2_mad(zn_dot, cfg->alpha, out->z_n); /* (21), desired z = 0 */
    out->v.x = n_msub(n_neg(n_mul(cfg->alpha, zn_dot.x)), out->mu.x, n_sat(out->s.x, cfg->phi)); /* (24) */
    out->v.y = n_msub(n_neg(n_mul(cfg->alpha, zn_dot.y)), out->mu.y, n_sat(out->s.y, cfg->phi));
    out->u = v2_mul(plant->mass, v2_from_frame(t, out->v));
}

static num model_axis(num mass, num viscous, num u, num dt, num *v)
{
    const num v0 = *v;
    *v = n_state(n_mad(v0, dt, n_div(n_sub(u, n_mul(viscous, v0)), mass)));
    return n_mul(n_mul(NUM(0.5), n_add(v0, *v)), dt);
}

void compensator_model(const struct plant_cfg *plant, struct compensator_state *state, vec2 u_bar, num dt)
{
    const num dx = model_axis(plant->mass.x, plant->viscous.x, u_bar.x, dt, &state->q_bar_dot.x);
    const num dy = model_axis(plant->mass.y, plant->viscous.y, u_bar.y, dt, &state->q_bar_dot.y);
    state->q_bar[0] = pos_add(state->q_bar[0], dx);
    state->q_bar[1] = pos_add(state->q_bar[1], dy);
}
