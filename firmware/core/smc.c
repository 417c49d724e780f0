/* SPDX-License-Identifier: Apache-2.0 */
/* smc.c: the sliding mode law of smc.h. Runs in the servo tick. */
#include "core/smc.h"
#include "core/trig.h"

struct surface {
    num a; /* lambda + psi gamma */
    num b; /* psi' gamma + stiffness */
};

/* (11) and its derivative. Beyond e_max psi is constant. */
static struct surface surface(const struct smc_cfg *cfg, num e, num e_dot)
{
    num x = n_mul(cfg->k_bar, e);
    num x_dot = n_mul(cfg->k_bar, e_dot);
    if (rarely(n_lt(cfg->e_max, n_abs(e)))) {
        x = n_mul(cfg->k_bar, n_lt(e, NUM(0)) ? n_neg(cfg->e_max) : cfg->e_max);
        x_dot = NUM(0);
    }
    const struct trig_cosh h = trig_cosh(x);
    num psi, psi_dot;
    if (rarely(cfg->psi_printed)) {
        psi = n_mul(cfg->beta, h.cosh_x);
        psi_dot = n_mul(cfg->beta, n_mul(h.sinh_x, x_dot));
    } else {
        psi = n_div(cfg->beta, h.cosh_x);
        psi_dot = n_neg(n_mul(psi, n_mul(n_div(h.sinh_x, h.cosh_x), x_dot)));
    }
    const struct surface s = {n_mad(cfg->lambda, psi, cfg->gamma), n_mad(cfg->stiffness, psi_dot, cfg->gamma)};
    return s;
}

void smc_adapt(const struct smc_cfg *cfg, struct smc_state *state, int axis, vec2 s_bar, num dt)
{
    acc_t *k_hat = &state->k_hat[axis];
    const num s = n_abs(axis == 0 ? s_bar.x : s_bar.y);
    num rate = cfg->zeta_rate;
    if (n_lt(cfg->zeta, acc_to(*k_hat))) {
        const num grow = n_mul(cfg->xi, s);
        rate = n_lt(cfg->epsilon, s) ? grow : n_neg(grow);
    }
    *k_hat = acc_clamp(acc_mad(*k_hat, rate, dt), NUM(0), cfg->k_max);
}

vec2 smc_direction(num friction_speed, vec2 r_dot)
{
    return v2(n_sat(r_dot.x, friction_speed), n_sat(r_dot.y, friction_speed));
}

void smc_reset(const struct smc_cfg *cfg, struct smc_state *state)
{
    state->k_hat[0] = state->k_hat[1] = acc_from(cfg->k_0);
}

void smc_step(const struct smc_cfg *cfg, const struct plant_cfg *plant, const struct smc_state *state,
              const struct smc_in *in, struct smc_out *out)
{
    const struct surface s1 = surface(cfg, in->e.x, in->e_dot.x);
    const struct surface s2 = surface(cfg, in->e.y, in->e_dot.y);
    out->k_hat = v2(acc_to(state->k_hat[0]), acc_to(state->k_hat[1]));
    out->s_bar = v2(n_mad(in->e_dot.x, s1.a, in->e.x), n_mad(in->e_dot.y, s2.a, in->e.y)); /* (10) */

    /* (15): R (a_n - A e' - B e - K s). a_n contains the terms of r_n'', theta'' and theta'. */
    const vec2 feedback = v2(n_mad(n_mad(n_mul(s1.a, in->e_dot.x), s1.b, in->e.x), out->k_hat.x, out->s_bar.x),
                             n_mad(n_mad(n_mul(s2.a, in->e_dot.y), s2.b, in->e.y), out->k_hat.y, out->s_bar.y));
    const vec2 a = v2_from_frame(in->t, v2_sub(in->a_n, feedback));
    out->u_linear = v2(n_mad(n_mul(plant->viscous.x, in->q_dot.x), plant->mass.x, a.x),
                       n_mad(n_mul(plant->viscous.y, in->q_dot.y), plant->mass.y, a.y));
    out->u_friction = v2_mul(plant->coulomb, in->direction);
}
