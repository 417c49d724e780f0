/* SPDX-License-Identifier: Apache-2.0 */
#include "servo.h"

static const vec2 ZERO;

static void observe(const struct servo_cfg *cfg, struct servo_state *state, const struct servo_in *in, pos_t q[2],
                    vec2 *q_dot)
{
    const struct plant_cfg *p = &cfg->plant;
    struct observer_state *ob = state->observer;
    const vec2 moving = v2_sub(state->last[1].force, state->last[1].balance);
    observer_step(&cfg->observer, &ob[0], in->measured[0], moving.x, p->mass.x, p->viscous.x);
    observer_step(&cfg->observer, &ob[1], in->measured[1], moving.y, p->mass.y, p->viscous.y);
    for (int i = 0; i < 2; i++) {
        q[i] = ob[i].pos;
    }
    *q_dot = v2(ob[0].vel, ob[1].vel);
    if (state->turn < 2) {
        const bool y = state->turn == 1;
        const struct observer_state *turn = &ob[state->turn];
        energy_step(&cfg->energy[state->turn], &state->energy[state->turn], y ? p->mass.y : p->mass.x,
                    y ? p->viscous.y : p->viscous.x, y ? p->coulomb.y : p->coulomb.x, turn->vel, turn->acc);
    }
}

static void reset_laws(const struct servo_cfg *cfg, struct servo_state *state, const pos_t q[2], vec2 q_dot)
{
    asmc_reset(&cfg->asmc, &state->asmc);
    uncertainty_reset(&cfg->uncertainty, &state->uncertainty, q, q_dot);
    cascade_reset(&state->cascade);
    state->offset = ZERO;
}

/* What the law asks for. */
static struct servo_history law(const struct servo_cfg *cfg, struct servo_state *state, enum controller controller,
                                const pos_t q[2], struct servo_out *out)
{
    const struct contour_out *c = &out->contour;
    const vec2 direction = asmc_direction(cfg->asmc.friction_speed, c->r_dot);
    struct servo_history h;
    if (controller == CONTROLLER_CASCADE || controller == CONTROLLER_CCC) {
        h.balance = v2_mul(cfg->plant.coulomb, direction);
        h.model = cascade_step(&cfg->cascade, &cfg->plant, &state->cascade, c, controller == CONTROLLER_CCC, cfg->dt);
        h.force = v2_add(h.model, h.balance);
        out->asmc = (struct asmc_out){.k_hat = ZERO};
        out->uncertainty = (struct uncertainty_out){.mu = ZERO};
        return h;
    }

    struct asmc_in in = {.t = c->t,
                         .e = c->e_n,
                         .e_dot = c->e_n_dot,
                         .a_n = c->a_n,
                         .q_dot = out->velocity,
                         .direction = direction};
    if (controller == CONTROLLER_TRACK) { /* R = I, r_n = r */
        in.t = v2(NUM(1), NUM(0));
        in.e = c->e_w;
        in.e_dot = c->e_w_dot;
        in.a_n = c->r_ddot;
    }
    asmc_step(&cfg->asmc, &cfg->plant, &state->asmc, &in, cfg->dt, &out->asmc);
    h.balance = out->asmc.u_friction;
    h.force = v2_add(out->asmc.u_linear, h.balance);
    h.model = cfg->uncertainty.whole_input ? h.force : out->asmc.u_linear;
    if (controller == CONTROLLER_CCU) {
        uncertainty_step(&cfg->uncertainty, &cfg->plant, &state->uncertainty, q, out->velocity, c->t, c->theta_dot,
                         cfg->dt, &out->uncertainty);
        const vec2 learned = learning_force(&state->learning, direction, c->r_ddot);
        h.balance = v2_add(h.balance, learned);
        h.force = v2_add(h.force, v2_add(out->uncertainty.u, learned));
        if (state->turn >= 2 && !state->saturated) { /* a force that was not given teaches nothing */
            learning_step(&cfg->learning, &cfg->plant, &state->learning, state->turn - 2, direction, c->r_ddot,
                          out->uncertainty.u, n_mul(NUM(SERVO_TURNS), cfg->dt));
        }
    } else {
        out->uncertainty = (struct uncertainty_out){.mu = ZERO};
    }
    return h;
}

/* Nothing acts on an axis that is disabled. */
static vec2 where_enabled(const bool enabled[2], vec2 v)
{
    return v2(enabled[0] ? v.x : NUM(0), enabled[1] ? v.y : NUM(0));
}

static vec2 limit(const struct plant_cfg *plant, vec2 force)
{
    const vec2 max = plant->force_max;
    return v2(n_within(force.x, max.x), n_within(force.y, max.y));
}

void servo_reset(const struct servo_cfg *cfg, struct servo_state *state, const pos_t measured[2])
{
    *state = (struct servo_state){.controller = CONTROLLERS};
    for (int i = 0; i < 2; i++) {
        observer_reset(&state->observer[i], measured[i]);
        energy_reset(&state->energy[i]);
    }
    learning_reset(&state->learning);
    reset_laws(cfg, state, measured, ZERO);
}

/* One function on the target, so that what stages hand on stays in registers: 5 % of the tick. */
__attribute__((flatten)) void servo_step(const struct servo_cfg *cfg, struct servo_state *state, const struct servo_in *in,
                struct servo_out *out)
{
    pos_t q[2];
    state->turn = (state->turn + 1) % SERVO_TURNS;
    observe(cfg, state, in, q, &out->velocity);
    struct servo_history now = {ZERO, ZERO, ZERO};
    const bool fresh = in->enabled[0] != state->enabled[0] || in->enabled[1] != state->enabled[1];
    if (!in->enabled[0] && !in->enabled[1]) { /* no reference: where the axes stand */
        *out = (struct servo_out){.velocity = out->velocity};
    } else {
        contour_step(&cfg->contour, &state->kept, in->ring, &in->path, q, out->velocity, &out->contour);
        const bool switched = in->controller != state->controller;
        uncertainty_model(&cfg->plant, &state->uncertainty, state->last[1].model, cfg->dt);
        if (fresh || switched) {
            reset_laws(cfg, state, q, out->velocity);
        }
        now = law(cfg, state, in->controller, q, out);
        state->offset =
            switched && !fresh ? v2_sub(state->last[0].force, now.force) : v2_scale(cfg->blend, state->offset);

        const vec2 wanted = v2_add(now.force, state->offset);
        out->force = now.force = where_enabled(in->enabled, limit(&cfg->plant, wanted));
        const vec2 excess = v2_sub(wanted, out->force);
        out->saturated = (in->enabled[0] && n_lt(NUM(0), n_abs(excess.x))) ||
                         (in->enabled[1] && n_lt(NUM(0), n_abs(excess.y)));
        now.balance = where_enabled(in->enabled, now.balance);
        now.model = where_enabled(in->enabled, v2_add(now.model, v2_sub(state->offset, excess)));
    }
    state->enabled[0] = in->enabled[0];
    state->enabled[1] = in->enabled[1];
    state->controller = in->controller;
    state->saturated = out->saturated;
    state->last[1] = state->last[0];
    state->last[0] = now;
}
