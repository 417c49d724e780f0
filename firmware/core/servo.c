/* SPDX-License-Identifier: Apache-2.0 */
#include "core/servo.h"

static const vec2 ZERO;

static inline void observe(const struct servo_cfg *cfg, struct servo_state *state, const struct servo_in *in,
                           vec2 moving, pos_t q[2], vec2 *q_dot)
{
    const struct plant_cfg *p = &cfg->plant;
    struct observer_state *ob = state->observer;
    observer_step(&cfg->observer, &ob[0], in->measured[0], moving.x, p->mass.x, p->viscous.x);
    observer_step(&cfg->observer, &ob[1], in->measured[1], moving.y, p->mass.y, p->viscous.y);
    for (int i = 0; i < 2; i++) {
        q[i] = ob[i].pos;
    }
    *q_dot = v2(ob[0].vel, ob[1].vel);
    if (state->turn < 2u) {
        const bool y = state->turn == 1u;
        const struct observer_state *turn = &ob[state->turn];
        energy_step(&cfg->energy[state->turn], &state->energy[state->turn], y ? p->mass.y : p->mass.x,
                    y ? p->viscous.y : p->viscous.x, y ? p->coulomb.y : p->coulomb.x, turn->vel, turn->acc);
    }
}

static void reset_laws(const struct servo_cfg *cfg, struct servo_state *state, const pos_t q[2], vec2 q_dot)
{
    smc_reset(&cfg->smc, &state->smc);
    compensator_reset(&cfg->compensator, &state->compensator, q, q_dot);
    cascade_reset(&state->cascade);
    state->offset = ZERO;
    state->blending = false;
}

/* What the law asks for: `balance` balances friction, and mass beyond the nominal. */
static inline struct servo_asked law(const struct servo_cfg *cfg, struct servo_state *state, enum controller controller,
                                     const pos_t q[2], struct servo_out *out, vec2 *balance)
{
    const struct contour_out *c = &out->contour;
    const vec2 direction = smc_direction(cfg->smc.friction_speed, c->r_dot);
    struct servo_asked asked;
    if (controller == CONTROLLER_CASCADE || controller == CONTROLLER_CCC) {
        *balance = v2_mul(cfg->plant.coulomb, direction);
        asked.moving =
            cascade_step(&cfg->cascade, &cfg->plant, &state->cascade, c, controller == CONTROLLER_CCC, cfg->dt);
        asked.model = asked.moving;
        out->smc = (struct smc_out){.k_hat = ZERO};
        out->compensator = (struct compensator_out){.mu = ZERO};
        return asked;
    }

    struct smc_in in = {
        .t = c->t, .e = c->e_n, .e_dot = c->e_n_dot, .a_n = c->a_n, .q_dot = out->velocity, .direction = direction};
    if (controller == CONTROLLER_TRACK) { /* R = I, r_n = r */
        in.t = v2(NUM(1), NUM(0));
        in.e = c->e_w;
        in.e_dot = c->e_w_dot;
        in.a_n = c->r_ddot;
    }
    smc_step(&cfg->smc, &cfg->plant, &state->smc, &in, &out->smc);
    const int axis = (int)(state->turn % 2u);
    const num turns_dt = n_mul(NUM(SERVO_TURNS), cfg->dt);
    const bool adapts = state->turn < 2u;
    if (adapts) {
        smc_adapt(&cfg->smc, &state->smc, axis, out->smc.s_bar, turns_dt);
    }
    *balance = out->smc.u_friction;
    asked.moving = out->smc.u_linear;
    asked.model = cfg->compensator.whole_input ? v2_add(out->smc.u_linear, out->smc.u_friction) : out->smc.u_linear;
    if (controller == CONTROLLER_CCU) {
        compensator_step(&cfg->compensator, &cfg->plant, &state->compensator, q, out->velocity, c->t, c->theta_dot,
                         &out->compensator);
        asked.moving = v2_add(asked.moving, out->compensator.u);
        *balance = v2_add(*balance, feedforward_force(&state->feedforward, direction, c->r_ddot));
        if (adapts) {
            compensator_adapt(&cfg->compensator, &state->compensator, axis, out->compensator.s, turns_dt);
        } else if (!state->saturated) { /* a force that was not given teaches nothing */
            feedforward_step(&cfg->feedforward, &cfg->plant, &state->feedforward, axis, direction, c->r_ddot,
                             out->compensator.u, turns_dt);
        }
    } else {
        out->compensator = (struct compensator_out){.mu = ZERO};
    }
    return asked;
}

static bool small(vec2 force)
{
    return n_lt(n_abs(force.x), NUM(SERVO_BLENDED)) && n_lt(n_abs(force.y), NUM(SERVO_BLENDED));
}

/* The offset after a change of controllers, until it has decayed. */
static inline vec2 blend(const struct servo_cfg *cfg, struct servo_state *state)
{
    state->offset = v2_scale(cfg->blend, state->offset);
    if (small(state->offset)) {
        state->offset = ZERO;
        state->blending = false;
    }
    return state->offset;
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

/* Is all of it given, as mostly? */
static inline bool all_given(const struct servo_cfg *cfg, const struct servo_in *in, vec2 force)
{
    return in->enabled[0] && in->enabled[1] && n_lt(n_abs(force.x), cfg->plant.force_max.x) &&
           n_lt(n_abs(force.y), cfg->plant.force_max.y); /* what is no number is not less: limits find it out */
}

void servo_reset(const struct servo_cfg *cfg, struct servo_state *state, const pos_t measured[2])
{
    *state = (struct servo_state){.controller = CONTROLLERS};
    for (int i = 0; i < 2; i++) {
        observer_reset(&state->observer[i], measured[i]);
        energy_reset(&state->energy[i]);
    }
    feedforward_reset(&state->feedforward);
    reset_laws(cfg, state, measured, ZERO);
}

/* One function on the target, so that what stages hand on stays in registers: 5 % of the tick. */
__attribute__((flatten)) void servo_step(const struct servo_cfg *cfg, struct servo_state *state,
                                         const struct servo_in *in, struct servo_out *out)
{
    pos_t q[2];
    state->turn = (state->turn + 1u) % SERVO_TURNS;
    struct servo_asked *acted = &state->asked[state->turn % 2u]; /* until this period's takes its place */
    observe(cfg, state, in, acted->moving, q, &out->velocity);
    struct servo_asked asked = {ZERO, ZERO};
    const bool fresh = in->enabled[0] != state->enabled[0] || in->enabled[1] != state->enabled[1];
    if (!in->enabled[0] && !in->enabled[1]) { /* no reference: where the axes stand */
        *out = (struct servo_out){.velocity = out->velocity};
    } else {
        contour_step(&cfg->contour, &state->kept, in->ring, &in->path, q, out->velocity, &out->contour);
        const bool switched = in->controller != state->controller;
        compensator_model(&cfg->plant, &state->compensator, acted->model, cfg->dt);
        if (fresh || switched) {
            reset_laws(cfg, state, q, out->velocity);
        }
        vec2 balance;
        asked = law(cfg, state, in->controller, q, out, &balance);
        if (switched && !fresh) {
            state->offset = v2_sub(state->force, v2_add(asked.moving, balance));
            state->blending = true;
        }
        if (state->blending) {
            const vec2 offset = switched ? state->offset : blend(cfg, state);
            asked.moving = v2_add(asked.moving, offset);
            asked.model = v2_add(asked.model, offset);
        }

        out->force = v2_add(asked.moving, balance);
        out->saturated = false;
        if (!all_given(cfg, in, out->force)) {
            const vec2 wanted = out->force;
            const vec2 given = limit(&cfg->plant, wanted);
            const vec2 excess = v2_sub(wanted, given);
            out->force = where_enabled(in->enabled, given);
            out->saturated =
                (in->enabled[0] && n_lt(NUM(0), n_abs(excess.x))) || (in->enabled[1] && n_lt(NUM(0), n_abs(excess.y)));
            asked.moving = where_enabled(in->enabled, v2_sub(asked.moving, excess));
            asked.model = where_enabled(in->enabled, v2_sub(asked.model, excess));
        }
    }
    state->enabled[0] = in->enabled[0];
    state->enabled[1] = in->enabled[1];
    state->controller = in->controller;
    state->saturated = out->saturated;
    state->force = out->force;
    *acted = asked;
}
