/* SPDX-License-Identifier: Apache-2.0 */
/* servo.c: the order of the control law, servo.h. Runs in the servo tick. */
#include "core/servo.h"

static const vec2 ZERO;

/* Where the tool is. Not inline, so that it costs nothing where the encoders are at the tool. */
static __attribute__((noinline)) void locate(const struct servo_cfg *cfg, struct servo_state *state,
                                             const struct servo_in *in, pos_t tool[2])
{
    const bool first = !state->geometry.started;
    geometry_step(&cfg->geometry, &state->geometry, in->measured, in->origin_nm, state->friction.shape);
    state->placed = state->geometry.force;
    state->correction = state->geometry.position;
    state->disagree = false;
    for (int i = 0; i < 2; i++) {
        num *const placed = i == 0 ? &state->placed.x : &state->placed.y;
        num *const correction = i == 0 ? &state->correction.x : &state->correction.y;
        const num turn = i == 0 ? state->geometry.turn.x : state->geometry.turn.y;
        struct dual_feedback_state *dual = &state->dual_feedback[i];
        if (cfg->dual_feedback[i].on) {
            *placed = n_add(*placed, turn);
            const pos_t table = pos_add(in->measured[i], *placed);
            state->disagree |= !dual_feedback_step(&cfg->dual_feedback[i], dual, table, in->second[i]);
            *placed = n_add(*placed, dual->offset);
        } else {
            *correction = n_add(*correction, turn);
        }
        tool[i] = pos_add(in->measured[i], n_add(*placed, *correction));
        if (first) {
            observer_reset(&state->observer[i], tool[i]);
        }
    }
}

static inline void observe(const struct servo_cfg *cfg, struct servo_state *state, const pos_t measured[2], vec2 net,
                           pos_t q[2], vec2 *q_dot)
{
    const struct plant_cfg *p = &cfg->plant;
    struct observer_state *ob = state->observer;
    observer_step(&cfg->observer, &ob[0], measured[0], net.x, p->mass.x, p->viscous.x);
    observer_step(&cfg->observer, &ob[1], measured[1], net.y, p->mass.y, p->viscous.y);
    for (int i = 0; i < 2; i++) {
        q[i] = ob[i].pos;
    }
    *q_dot = v2(ob[0].vel, ob[1].vel);
    if (state->slot < 2u) {
        const bool y = state->slot == 1u;
        const struct observer_state *axis = &ob[state->slot];
        energy_step(&cfg->energy[state->slot], &state->energy[state->slot], y ? p->mass.y : p->mass.x,
                    y ? p->viscous.y : p->viscous.x, y ? p->coulomb.y : p->coulomb.x, axis->vel, axis->acc);
    }
}

/* The configurations of the laws that are in effect. */
struct laws {
    const struct smc_cfg *smc;
    const struct compensator_cfg *compensator;
    const struct cascade_cfg *cascade;
};

static inline struct laws laws_in_effect(const struct servo_cfg *cfg, const struct servo_state *state)
{
    const struct servo_gains *g = &state->lowered;
    return state->gains_lowered ? (struct laws){&g->smc, &g->compensator, &g->cascade}
                                : (struct laws){&cfg->smc, &cfg->compensator, &cfg->cascade};
}

static void reset_laws(const struct laws *laws, struct servo_state *state, const pos_t q[2], vec2 q_dot)
{
    smc_reset(laws->smc, &state->smc);
    compensator_reset(laws->compensator, &state->compensator, q, q_dot);
    cascade_reset(&state->cascade);
    state->offset = ZERO;
    state->blending = false;
}

/* The direction in which friction is adapted where it has a shape of its own: the shape, and 0 at rest. */
static vec2 while_moving(const struct servo_cfg *cfg, vec2 r_dot, vec2 shape)
{
    const vec2 sign = smc_direction(cfg->smc.friction_speed, r_dot);
    return v2_mul(shape, v2_mul(sign, sign));
}

/* The force demand of the law. *balance is the part that cancels friction and mass beyond the nominal. */
static inline struct servo_demand law(const struct servo_cfg *cfg, const struct laws *laws, struct servo_state *state,
                                      enum controller controller, const pos_t q[2], struct servo_out *out,
                                      vec2 *balance)
{
    const struct contour_out *c = &out->contour;
    if (!cfg->friction.on) {
        state->friction.shape = smc_direction(laws->smc->friction_speed, c->r_dot);
    }
    const vec2 direction = state->friction.shape;
    struct servo_demand demand;
    if (controller == CONTROLLER_CASCADE || controller == CONTROLLER_CCC) {
        *balance = v2_mul(cfg->plant.coulomb, direction);
        demand.net =
            cascade_step(laws->cascade, &cfg->plant, &state->cascade, c, controller == CONTROLLER_CCC, cfg->dt);
        demand.model = demand.net;
        out->smc = (struct smc_out){.k_hat = ZERO};
        out->compensator = (struct compensator_out){.mu = ZERO};
        return demand;
    }

    struct smc_in in = {
        .t = c->t, .e = c->e_n, .e_dot = c->e_n_dot, .a_n = c->a_n, .q_dot = out->velocity, .direction = direction};
    if (controller == CONTROLLER_TRACK) { /* R = I, r_n = r */
        in.t = v2(NUM(1), NUM(0));
        in.e = c->e_w;
        in.e_dot = c->e_w_dot;
        in.a_n = c->r_ddot;
    }
    smc_step(laws->smc, &cfg->plant, &state->smc, &in, &out->smc);
    const int axis = (int)(state->slot % 2u);
    const num slot_dt = n_mul(NUM(SERVO_SLOTS), cfg->dt);
    const bool adapts = state->slot < 2u;
    if (adapts) {
        smc_adapt(laws->smc, &state->smc, axis, out->smc.s_bar, slot_dt);
    }
    *balance = out->smc.u_friction;
    demand.net = out->smc.u_linear;
    demand.model =
        laws->compensator->input_printed ? v2_add(out->smc.u_linear, out->smc.u_friction) : out->smc.u_linear;
    if (controller == CONTROLLER_CCU) {
        compensator_step(laws->compensator, &cfg->plant, &state->compensator, q, out->velocity, c->t, c->theta_dot,
                         &out->compensator);
        demand.net = v2_add(demand.net, out->compensator.u);
        *balance = v2_add(*balance, feedforward_force(&state->feedforward, direction, c->r_ddot));
        if (adapts) {
            compensator_adapt(laws->compensator, &state->compensator, axis, out->compensator.s, slot_dt);
        } else if (!state->saturated) { /* a limited force says nothing about friction and mass */
            const vec2 along = cfg->friction.on ? while_moving(cfg, c->r_dot, direction) : direction;
            feedforward_step(&cfg->feedforward, &cfg->plant, &state->feedforward, axis, along, c->r_ddot,
                             out->compensator.u, slot_dt);
        }
    } else {
        out->compensator = (struct compensator_out){.mu = ZERO};
    }
    return demand;
}

static bool negligible(vec2 force)
{
    return n_lt(n_abs(force.x), NUM(SERVO_OFFSET_MIN)) && n_lt(n_abs(force.y), NUM(SERVO_OFFSET_MIN));
}

/* Let the offset of a change of controllers decay. */
static inline vec2 blend(const struct servo_cfg *cfg, struct servo_state *state)
{
    state->offset = v2_scale(cfg->blend, state->offset);
    if (negligible(state->offset)) {
        state->offset = ZERO;
        state->blending = false;
    }
    return state->offset;
}

/* v with 0 for an axis that is disabled. */
static vec2 where_enabled(const bool enabled[2], vec2 v)
{
    return v2(enabled[0] ? v.x : NUM(0), enabled[1] ? v.y : NUM(0));
}

/* Each axis starts with the force of now, so that its filters change nothing where the force stays. */
static inline vec2 filter(const struct servo_cfg *cfg, struct servo_state *state, bool start, vec2 force)
{
    if (start) {
        force_filter_reset(&state->force_filter, force);
    }
    const vec2 filtered = force_filter_step(&cfg->force_filter, &state->force_filter, force);
    state->filtering = v2_sub(filtered, force);
    return filtered;
}

static vec2 limit(vec2 force, vec2 force_max)
{
    return v2(n_within(force.x, force_max.x), n_within(force.y, force_max.y));
}

/* Mostly true: both axes are enabled, and the force is within
 * its limits. A force that is no number is not within them. */
static inline bool within_limits(vec2 max, const struct servo_in *in, vec2 force)
{
    return in->enabled[0] && in->enabled[1] && n_lt(n_abs(force.x), max.x) && n_lt(n_abs(force.y), max.y);
}

/* What the next period needs of friction and screw is computed at the end of this one, where nothing else has to be
 * kept. The force of the next period acts in the middle of the one after it, this long after the reading of now. */
static num until_next_force(const struct servo_cfg *cfg)
{
    return n_mul(NUM(2.5), cfg->dt);
}

__attribute__((noinline)) static void predict_friction(const struct servo_cfg *cfg, struct servo_state *state,
                                                       const struct servo_in *in, const struct servo_out *out)
{
    const vec2 r_dot = v2_mad(out->contour.r_dot, until_next_force(cfg), out->contour.r_ddot);
    friction_step(&cfg->friction, &state->friction, in->enabled, r_dot, smc_direction(cfg->smc.friction_speed, r_dot),
                  cfg->dt);
}

__attribute__((noinline)) static void predict_screw(const struct servo_cfg *cfg, struct servo_state *state,
                                                    const struct servo_in *in, const struct servo_out *out)
{
    const vec2 demand = where_enabled(in->enabled, v2_sub(out->force, state->screw));
    const vec2 ahead = v2_scale(until_next_force(cfg), out->velocity);
    const pos_t at[2] = {pos_add(in->measured[0], ahead.x), pos_add(in->measured[1], ahead.y)};
    state->screw = v2_sub(screw_cancel(&cfg->screw, at, demand), demand);
}

/* The gains of the configuration times `gain`. Products of two gains, as those that act on a position, go with its square. */
__attribute__((noinline, cold)) static void lower_gains(const struct servo_cfg *cfg, struct servo_state *state)
{
    const num gain = n_max(NUM(OSCILLATION_GAIN_MIN), n_mul(state->gain, cfg->oscillation.gain_step));
    struct servo_gains g = {cfg->smc, cfg->compensator, cfg->cascade};
    num *const gains[] = {&g.smc.lambda,  &g.smc.gamma,         &g.smc.k_0,          &g.smc.k_max,
                          &g.smc.zeta,    &g.compensator.alpha, &g.compensator.mu_0, &g.compensator.mu_max,
                          &g.cascade.k_p, &g.cascade.k_v,       &g.cascade.k_i};
    for (unsigned i = 0; i < sizeof gains / sizeof gains[0]; i++) {
        *gains[i] = n_mul(*gains[i], gain);
    }
    state->lowered = g;
    state->gain = gain;
    state->gains_lowered = state->gains_changed = true;
}

void servo_reset_oscillation(struct servo_state *state)
{
    state->gains_changed = state->gains_lowered;
    state->gains_lowered = false;
    state->gain = NUM(1);
    state->oscillation[0] = state->oscillation[1] = (struct oscillation_state){.count = 0};
}

void servo_reset(const struct servo_cfg *cfg, struct servo_state *state, const pos_t measured[2])
{
    *state = (struct servo_state){.controller = CONTROLLERS, .gain = NUM(1)};
    geometry_reset(&state->geometry);
    for (int i = 0; i < 2; i++) {
        observer_reset(&state->observer[i], measured[i]);
        dual_feedback_reset(&state->dual_feedback[i]);
        energy_reset(&state->energy[i]);
    }
    feedforward_reset(&state->feedforward);
    force_filter_reset(&state->force_filter, ZERO);
    force_limit_reset(&state->force_limit, cfg->plant.force_max);
    state->lowered = (struct servo_gains){cfg->smc, cfg->compensator, cfg->cascade};
    const struct laws laws = laws_in_effect(cfg, state);
    reset_laws(&laws, state, measured, ZERO);
}

/* Flattened, so that values pass from stage to stage in registers: this saves 5 % of the tick. */
__attribute__((flatten)) void servo_step(const struct servo_cfg *cfg, struct servo_state *state,
                                         const struct servo_in *in, struct servo_out *out)
{
    pos_t q[2];
    state->slot = (state->slot + 1u) % SERVO_SLOTS;
    struct servo_demand *applied = &state->demand[state->slot % 2u]; /* replaced at the end by this period's */
    vec2 force_max = cfg->plant.force_max;
    if (cfg->force_limit.on) {
        force_max = force_limit_step(&cfg->force_limit, &state->force_limit, state->force, cfg->plant.force_max);
    }
    const pos_t *measured = in->measured;
    pos_t tool[2];
    if (cfg->geometry.on) {
        locate(cfg, state, in, tool);
        measured = tool;
    }
    observe(cfg, state, measured, applied->net, q, &out->velocity);
    struct servo_demand demand = {ZERO, ZERO};
    const bool enabling_changed = in->enabled[0] != state->enabled[0] || in->enabled[1] != state->enabled[1];
    if (!in->enabled[0] && !in->enabled[1]) { /* there is no reference */
        *out = (struct servo_out){.velocity = out->velocity};
        state->oscillation[0].half_waves = state->oscillation[1].half_waves = 0; /* an oscillation ends */
    } else {
        contour_step(&cfg->contour, &state->spline_cache, in->ring, &in->path, q, out->velocity, &out->contour);
        const bool switched = in->controller != state->controller || state->gains_changed;
        const struct laws laws = laws_in_effect(cfg, state);
        state->gains_changed = false;
        compensator_model(&cfg->plant, &state->compensator, applied->model, cfg->dt);
        if (enabling_changed || switched) {
            reset_laws(&laws, state, q, out->velocity);
        }
        vec2 balance;
        demand = law(cfg, &laws, state, in->controller, q, out, &balance);
        if (cfg->screw.on) {
            balance = v2_add(balance, state->screw);
        }
        if (switched && !enabling_changed) {
            state->offset = v2_sub(v2_sub(state->force, state->filtering), v2_add(demand.net, balance));
            state->blending = true;
        }
        if (state->blending) {
            const vec2 offset = switched ? state->offset : blend(cfg, state);
            demand.net = v2_add(demand.net, offset);
            demand.model = v2_add(demand.model, offset);
        }

        out->force = v2_add(demand.net, balance);
        out->saturated = false;
        if (cfg->force_filter.on) {
            out->force = filter(cfg, state, enabling_changed, out->force);
            demand.net = v2_add(demand.net, state->filtering);
            demand.model = v2_add(demand.model, state->filtering);
        }
        if (!within_limits(force_max, in, out->force)) {
            const vec2 unlimited = out->force;
            const vec2 limited = limit(unlimited, force_max);
            const vec2 excess = v2_sub(unlimited, limited);
            out->force = where_enabled(in->enabled, limited);
            out->saturated =
                (in->enabled[0] && n_lt(NUM(0), n_abs(excess.x))) || (in->enabled[1] && n_lt(NUM(0), n_abs(excess.y)));
            demand.net = where_enabled(in->enabled, v2_sub(demand.net, excess));
            demand.model = where_enabled(in->enabled, v2_sub(demand.model, excess));
        }
        if (cfg->oscillation.on &&
            oscillation_step(&cfg->oscillation, state->oscillation, in->enabled, demand.net, out->contour.r_dot,
                             out->contour.r_ddot) &&
            cfg->oscillation.lower) {
            lower_gains(cfg, state);
        }
    }
    if (cfg->geometry.on) {
        state->geometry.r_dot = where_enabled(in->enabled, out->contour.r_dot);
        state->geometry.r_ddot = where_enabled(in->enabled, out->contour.r_ddot);
    }
    state->enabled[0] = in->enabled[0];
    state->enabled[1] = in->enabled[1];
    state->controller = in->controller;
    state->saturated = out->saturated;
    state->force = out->force;
    *applied = demand;
    if (cfg->friction.on) {
        predict_friction(cfg, state, in, out);
    }
    if (cfg->screw.on) {
        predict_screw(cfg, state, in, out);
    }
}
