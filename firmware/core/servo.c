/* SPDX-License-Identifier: Apache-2.0 */
#include "servo.h"

static const vec2 ZERO;

static void observe(const struct servo_cfg *cfg, struct servo_state *state, const struct servo_in *in, pos_t q[2],
                    vec2 *q_dot)
{
    const struct plant_cfg *p = &cfg->plant;
    struct observer_state *ob = state->observer;
    observer_step(&cfg->observer, &ob[0], in->measured[0], state->force[1].x, p->mass.x, p->viscous.x);
    observer_step(&cfg->observer, &ob[1], in->measured[1], state->force[1].y, p->mass.y, p->viscous.y);
    for (int i = 0; i < 2; i++) {
        q[i] = ob[i].pos;
    }
    *q_dot = v2(ob[0].vel, ob[1].vel);
    energy_step(&cfg->energy[0], &state->energy[0], p->mass.x, p->viscous.x, p->coulomb.x, ob[0].vel, ob[0].acc);
    energy_step(&cfg->energy[1], &state->energy[1], p->mass.y, p->viscous.y, p->coulomb.y, ob[1].vel, ob[1].acc);
}

static void reset_laws(const struct servo_cfg *cfg, struct servo_state *state, const pos_t q[2], vec2 q_dot)
{
    asmc_reset(&cfg->asmc, &state->asmc);
    uncertainty_reset(&cfg->uncertainty, &state->uncertainty, q, q_dot);
    cascade_reset(&state->cascade);
    state->offset = ZERO;
}

/* The law's force; *linear: the part of it that the linear reference model shall see. */
static vec2 law(const struct servo_cfg *cfg, struct servo_state *state, enum controller controller, const pos_t q[2],
                struct servo_out *out, vec2 *linear)
{
    const struct contour_out *c = &out->contour;
    if (controller == CONTROLLER_CASCADE || controller == CONTROLLER_CCC) {
        *linear = cascade_step(&cfg->cascade, &cfg->plant, &state->cascade, c, controller == CONTROLLER_CCC, cfg->dt);
        return v2_add(*linear, asmc_friction(&cfg->plant, cfg->asmc.friction_speed, c->r_dot));
    }

    struct asmc_in in = {.t = c->t,
                         .theta_dot = c->theta_dot,
                         .theta_ddot = c->theta_ddot,
                         .e_w = c->e_wn,
                         .e_w_dot = c->e_wn_dot,
                         .e = c->e_n,
                         .e_dot = c->e_n_dot,
                         .r_ddot = c->rn_ddot,
                         .q_dot = out->velocity,
                         .r_dot = c->r_dot};
    if (controller == CONTROLLER_TRACK) { /* R = I, r_n = r */
        in.t = v2(NUM(1), NUM(0));
        in.theta_dot = in.theta_ddot = NUM(0);
        in.e_w = in.e = c->e_w;
        in.e_w_dot = in.e_dot = c->e_w_dot;
        in.r_ddot = c->r_ddot;
    }
    asmc_step(&cfg->asmc, &cfg->plant, &state->asmc, &in, cfg->dt, &out->asmc);
    *linear = out->asmc.u_linear;
    vec2 u = v2_add(out->asmc.u_linear, out->asmc.u_friction);
    if (controller == CONTROLLER_CCU) {
        if (cfg->uncertainty.whole_input) {
            *linear = u;
        }
        uncertainty_step(&cfg->uncertainty, &cfg->plant, &state->uncertainty, q, out->velocity, c->t, c->theta_dot,
                         cfg->dt, &out->uncertainty);
        u = v2_add(u, out->uncertainty.u);
    }
    return u;
}

static vec2 limit(const struct plant_cfg *plant, const bool enabled[2], vec2 force)
{
    const vec2 max = plant->force_max;
    return v2(enabled[0] ? n_clamp(force.x, n_neg(max.x), max.x) : NUM(0),
              enabled[1] ? n_clamp(force.y, n_neg(max.y), max.y) : NUM(0));
}

void servo_reset(const struct servo_cfg *cfg, struct servo_state *state, const pos_t measured[2])
{
    *state = (struct servo_state){.controller = CONTROLLERS};
    for (int i = 0; i < 2; i++) {
        observer_reset(&state->observer[i], measured[i]);
        energy_reset(&state->energy[i]);
    }
    reset_laws(cfg, state, measured, ZERO);
}

void servo_step(const struct servo_cfg *cfg, struct servo_state *state, const struct servo_in *in,
                struct servo_out *out)
{
    pos_t q[2];
    *out = (struct servo_out){.force = ZERO};
    observe(cfg, state, in, q, &out->velocity);
    contour_step(&cfg->contour, in->ring, &in->path, q, out->velocity, &out->contour);

    vec2 linear = ZERO;
    const bool fresh = in->enabled[0] != state->enabled[0] || in->enabled[1] != state->enabled[1];
    if (in->enabled[0] || in->enabled[1]) {
        const bool switched = in->controller != state->controller;
        uncertainty_model(&cfg->plant, &state->uncertainty, state->model[1], cfg->dt);
        if (fresh || switched) {
            reset_laws(cfg, state, q, out->velocity);
        }
        const vec2 u = law(cfg, state, in->controller, q, out, &linear);
        state->offset = switched && !fresh ? v2_sub(state->force[0], u) : v2_scale(cfg->blend, state->offset);

        const vec2 wanted = v2_add(u, state->offset);
        out->force = limit(&cfg->plant, in->enabled, wanted);
        const vec2 excess = v2_sub(wanted, out->force);
        out->saturated = (in->enabled[0] && n_lt(NUM(0), n_abs(excess.x))) ||
                         (in->enabled[1] && n_lt(NUM(0), n_abs(excess.y)));
        linear = v2_add(linear, v2_sub(state->offset, excess));
    }
    state->enabled[0] = in->enabled[0];
    state->enabled[1] = in->enabled[1];
    state->controller = in->controller;
    state->force[1] = state->force[0];
    state->force[0] = out->force;
    state->model[1] = state->model[0];
    state->model[0] = linear;
}
