/* SPDX-License-Identifier: Apache-2.0 */
/* servo.c: the order of the control law, servo.h. Runs in the servo tick. */
#include "core/servo.h"

static const vec2 ZERO;

/* Where the tool is. */
static void locate(const struct servo_cfg *cfg, struct servo_state *state, const struct servo_table_in *in,
                   const pos_t measured[2])
{
    const struct geometry_state *const g = &state->geometry;
    const bool first = !g->started;
    geometry_step(&cfg->geometry, &state->geometry, measured, in->origin_nm, (int)state->slot);
    state->disagree = false;
    for (int i = 0; i < 2; i++) {
        num placed = i == 0 ? g->force.x : g->force.y;
        num correction = i == 0 ? g->position.x : g->position.y;
        const num turn = i == 0 ? g->turn.x : g->turn.y;
        struct dual_feedback_state *dual = &state->dual_feedback[i];
        if (cfg->dual_feedback[i].on) {
            placed = n_add(placed, turn);
            const num difference = n_sub(pos_sub(in->second[i], measured[i]), placed);
            if (rarely(!dual_feedback_step(&cfg->dual_feedback[i], dual, difference))) {
                state->disagree = true;
            }
            placed = n_add(placed, dual->offset);
        } else {
            correction = n_add(correction, turn);
        }
        *(i == 0 ? &state->placed.x : &state->placed.y) = placed;
        *(i == 0 ? &state->correction.x : &state->correction.y) = correction;
        state->tool[i] = pos_add(measured[i], n_add(placed, correction));
    }
    if (rarely(first)) {
        observer_reset(&state->observer[0], state->tool[0]);
        observer_reset(&state->observer[1], state->tool[1]);
    }
}

/* What comes before the observer with state->extras. It is not inline, and gets no inputs of the tick by their address,
 * so that the tick is as short as it was where all of it is off. The same holds for the other two. */
static __attribute__((noinline, flatten)) void prepare(const struct servo_cfg *cfg, struct servo_state *state,
                                                       const struct servo_table_in *in, pos_t x, pos_t y)
{
    if (cfg->force_limit.on && state->slot >= 2u) {
        force_limit_step(&cfg->force_limit, &state->force_limit, (int)state->slot - 2, state->force,
                         cfg->plant.force_max);
    }
    if (cfg->geometry.on) {
        const pos_t measured[2] = {x, y};
        locate(cfg, state, in, measured);
    } else {
        state->tool[0] = x;
        state->tool[1] = y;
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

/* The gains in effect */
static inline const struct servo_gains *gains(const struct servo_cfg *cfg, const struct servo_state *state)
{
    return state->gains_lowered ? &state->gains : &cfg->gains;
}

static void reset_laws(const struct servo_cfg *cfg, struct servo_state *state, const pos_t q[2], vec2 q_dot)
{
    smc_reset(&gains(cfg, state)->smc, &state->smc);
    compensator_reset(&gains(cfg, state)->compensator, &state->compensator, q, q_dot);
    cascade_reset(&state->cascade);
    state->offset = ZERO;
    state->blending = false;
}

/* The direction in which friction is adapted where it has a shape of its own: the shape, and 0 at rest. */
static vec2 while_moving(const struct servo_cfg *cfg, vec2 r_dot, vec2 shape)
{
    const vec2 sign = smc_direction(cfg->gains.smc.friction_speed, r_dot);
    return v2_mul(shape, v2_mul(sign, sign));
}

/* The force demand of the law. *balance is the part that cancels friction and mass beyond the nominal. */
static inline struct servo_demand law(const struct servo_cfg *cfg, struct servo_state *state,
                                      enum controller controller, const pos_t q[2], struct servo_out *out,
                                      vec2 *balance)
{
    const struct servo_gains *laws = gains(cfg, state);
    const struct contour_out *c = &out->contour;
    if (!cfg->friction.on) {
        state->friction.shape = smc_direction(laws->smc.friction_speed, c->r_dot);
    }
    const vec2 direction = state->friction.shape;
    struct servo_demand demand;
    if (controller == CONTROLLER_CASCADE || controller == CONTROLLER_CCC) {
        *balance = v2_mul(cfg->plant.coulomb, direction);
        demand.net =
            cascade_step(&laws->cascade, &cfg->plant, &state->cascade, c, controller == CONTROLLER_CCC, cfg->dt);
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
    smc_step(&laws->smc, &cfg->plant, &state->smc, &in, &out->smc);
    const int axis = (int)(state->slot % 2u);
    const num slot_dt = n_mul(NUM(SERVO_SLOTS), cfg->dt);
    const bool adapts = state->slot < 2u;
    if (adapts) {
        smc_adapt(&laws->smc, &state->smc, axis, out->smc.s_bar, slot_dt);
    }
    *balance = out->smc.u_friction;
    demand.net = out->smc.u_linear;
    demand.model = laws->compensator.input_printed ? v2_add(out->smc.u_linear, out->smc.u_friction) : out->smc.u_linear;
    if (controller == CONTROLLER_CCU) {
        compensator_step(&laws->compensator, &cfg->plant, &state->compensator, q, out->velocity, c->t, c->theta_dot,
                         &out->compensator);
        demand.net = v2_add(demand.net, out->compensator.u);
        *balance = v2_add(*balance, feedforward_force(&state->feedforward, direction, c->r_ddot));
        if (adapts) {
            compensator_adapt(&laws->compensator, &state->compensator, axis, out->compensator.s, slot_dt);
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

/* What goes beyond the law: lead, cancel cogging and ripple, then filter. Each axis starts with the force of now, so that its
 * filters change nothing where the force stays. */
static __attribute__((noinline, flatten)) vec2 refine(const struct servo_cfg *cfg, struct servo_state *state,
                                                      bool start, num net_x, num net_y, num balance_x, num balance_y)
{
    const vec2 balance = v2_add(v2(balance_x, balance_y), v2_add(state->screw, state->lead));
    const vec2 force = v2_add(v2(net_x, net_y), balance);
    if (!cfg->force_filter.on) {
        return force;
    }
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

/* What the next periods need of friction, deflection and screw is computed at the end of this one, where nothing else
 * has to be kept. The axes take turns. The forces of the next two periods act, in the mean, AHEAD periods after the
 * reading of now. Friction goes by the reference: it can be told further ahead than what goes by a position, which is a
 * part of the loop. So it takes turns of all slots, and moves in between to what it will be when the last of these
 * forces acts. */
#define AHEAD 3
#define AHEAD_FRICTION 5.5
_Static_assert(FRICTION_PERIODS == SERVO_SLOTS, "the friction of an axis is computed in one of the slots");

static inline void predict_friction(const struct servo_cfg *cfg, struct servo_state *state, int axis, num r_dot,
                                    num r_ddot)
{
    const num ahead = n_mad(cfg->delay.time[axis], NUM(AHEAD_FRICTION), cfg->dt);
    const num v = n_mad(r_dot, ahead, r_ddot);
    const bool slips = n_lt(NUM(0), cfg->friction.axis[axis].presliding);
    const num direction = slips ? NUM(0) : n_sat(v, cfg->gains.smc.friction_speed);
    (void)friction_step(&cfg->friction, &state->friction, axis, state->enabled[axis], v, direction,
                        n_mul(NUM(FRICTION_PERIODS), cfg->dt));
}

static inline num predict_screw(const struct servo_cfg *cfg, const struct servo_state *state, int axis, num force,
                                num screw, pos_t at, num velocity)
{
    const num demand = state->enabled[axis] ? n_sub(force, screw) : NUM(0);
    const pos_t then = pos_add(at, n_mul(n_mul(NUM(AHEAD), cfg->dt), velocity));
    return n_sub(screw_cancel(&cfg->screw.axis[axis], then, demand), demand);
}

/* The piece of the path of now is in the cache, as contour_step() has left it. What a change of the override adds to the
 * third derivative of the reference is left out. There is no lead while the force of an axis is given. */
static inline num predict_lead(const struct servo_cfg *cfg, const struct servo_state *state, int axis,
                               const struct path_state *path, num r_ddot)
{
    const struct spline_piece *piece = &state->spline_cache.piece[path->knot % SPLINE_CACHE_SIZE];
    const num jerk =
        n_mul(spline_third(axis == 0 ? piece->c3.x : piece->c3.y), n_mul(path->rate, n_mul(path->rate, path->rate)));
    const num mass = axis == 0 ? cfg->plant.mass.x : cfg->plant.mass.y;
    const num viscous = axis == 0 ? cfg->plant.viscous.x : cfg->plant.viscous.y;
    const num rate = n_mad(n_mul(mass, jerk), viscous, r_ddot);
    return state->enabled[axis] && usually(state->forced == 0u) ? n_mul(cfg->delay.time[axis], rate) : NUM(0);
}

/* In one of the slots of an axis its friction, in the other what the reference asks for besides. */
static inline void predict_axis(const struct servo_cfg *cfg, struct servo_state *state, const struct servo_out *out,
                                const struct path_state *path, int axis, pos_t at)
{
    const bool x = axis == 0;
    const num r_dot = x ? out->contour.r_dot.x : out->contour.r_dot.y;
    const num r_ddot = x ? out->contour.r_ddot.x : out->contour.r_ddot.y;
    if (state->slot < 2u) {
        if (cfg->friction.on) {
            predict_friction(cfg, state, axis, r_dot, r_ddot);
        }
    } else if (cfg->delay.on) {
        *(x ? &state->lead.x : &state->lead.y) = predict_lead(cfg, state, axis, path, r_ddot);
    }
    if (cfg->friction.on) {
        friction_move(&state->friction);
    }
    if (cfg->geometry.on) {
        const bool on = state->enabled[axis];
        geometry_push(&cfg->geometry, &state->geometry, axis, on ? r_dot : NUM(0), on ? r_ddot : NUM(0),
                      x ? state->friction.shape.x : state->friction.shape.y);
    }
    if (cfg->screw.on) {
        num *const screw = x ? &state->screw.x : &state->screw.y;
        *screw = predict_screw(cfg, state, axis, x ? out->force.x : out->force.y, *screw, at,
                               x ? out->velocity.x : out->velocity.y);
    }
}

static __attribute__((noinline, flatten)) void predict(const struct servo_cfg *cfg, struct servo_state *state,
                                                       const struct servo_out *out, const struct path_state *path,
                                                       pos_t x, pos_t y)
{
    if (state->slot % 2u == 0u) {
        predict_axis(cfg, state, out, path, 0, x);
    } else {
        predict_axis(cfg, state, out, path, 1, y);
    }
}

/* The gains of the configuration times `gain`. Products of two gains, as those that act on a position, go with its
 * square. */
__attribute__((noinline, cold)) static void lower_gains(const struct servo_cfg *cfg, struct servo_state *state)
{
    const num gain = n_max(NUM(OSCILLATION_GAIN_MIN), n_mul(state->gain, cfg->oscillation.gain_step));
    struct servo_gains g = cfg->gains;
    num *const lowered[] = {&g.smc.lambda,  &g.smc.gamma,         &g.smc.k_0,          &g.smc.k_max,
                            &g.smc.zeta,    &g.compensator.alpha, &g.compensator.mu_0, &g.compensator.mu_max,
                            &g.cascade.k_p, &g.cascade.k_v,       &g.cascade.k_i};
    for (unsigned i = 0; i < sizeof lowered / sizeof lowered[0]; i++) {
        *lowered[i] = n_mul(*lowered[i], gain);
    }
    g.smc.stiffness = n_mul(g.smc.stiffness, n_mul(gain, gain));
    state->gains = g;
    state->gain = gain;
    state->gains_lowered = state->gains_changed = true;
}

/* Copies of the configuration, which is sealed and these are not: made anew in one of the slots, since a bit may
 * flip. */
static __attribute__((noinline)) void copy_configuration(const struct servo_cfg *cfg, struct servo_state *state)
{
    state->extras = cfg->force_limit.on || cfg->geometry.on || cfg->screw.on || cfg->force_filter.on || cfg->delay.on ||
                    cfg->friction.on;
    if (!cfg->force_limit.on) {
        state->force_limit.limit = cfg->plant.force_max;
    }
}

static void take_gains(const struct servo_cfg *cfg, struct servo_state *state)
{
    state->gains = cfg->gains; /* in effect where a bit of gains_lowered flips */
    state->gains_lowered = false;
    state->gain = NUM(1);
}

void servo_reset_oscillation(const struct servo_cfg *cfg, struct servo_state *state)
{
    state->gains_changed = state->gains_lowered;
    take_gains(cfg, state);
    state->oscillation[0] = state->oscillation[1] = (struct oscillation_state){.count = 0};
}

void servo_reset(const struct servo_cfg *cfg, struct servo_state *state, const pos_t measured[2])
{
    *state = (struct servo_state){.controller = CONTROLLERS};
    geometry_reset(&state->geometry);
    for (int i = 0; i < 2; i++) {
        observer_reset(&state->observer[i], measured[i]);
        dual_feedback_reset(&state->dual_feedback[i]);
        energy_reset(&state->energy[i]);
    }
    feedforward_reset(&state->feedforward);
    force_filter_reset(&state->force_filter, ZERO);
    force_limit_reset(&state->force_limit, cfg->plant.force_max);
    copy_configuration(cfg, state);
    take_gains(cfg, state);
    reset_laws(cfg, state, measured, ZERO);
}

static bool is_forced(uint32_t forced, int axis)
{
    return (forced >> axis & 1u) != 0u;
}

/* Axes whose force is given are where they are to be, and the path, which follows them, asks nothing of them. There is
 * no contour, of which they would be a part. */
static __attribute__((noinline, cold)) void leave_path(struct contour_out *c, uint32_t forced)
{
    const bool follows[2] = {!is_forced(forced, 0), !is_forced(forced, 1)};
    c->e_w = where_enabled(follows, c->e_w);
    c->e_w_dot = where_enabled(follows, c->e_w_dot);
    c->r_dot = where_enabled(follows, c->r_dot);
    c->r_ddot = where_enabled(follows, c->r_ddot);
    c->e_n = ZERO;
    c->e_n_dot = ZERO;
}

/* The law's force, or the one that is given. */
static __attribute__((noinline, cold)) vec2 where_given(const struct servo_in *in, vec2 own)
{
    return v2(is_forced(in->forced, 0) ? in->force.x : own.x, is_forced(in->forced, 1) ? in->force.y : own.y);
}

/* Flattened, so that values pass from stage to stage in registers: this saves 5 % of the tick. */
__attribute__((flatten)) void servo_step(const struct servo_cfg *cfg, struct servo_state *state,
                                         const struct servo_in *in, struct servo_out *out)
{
    pos_t q[2];
    state->slot = (state->slot + 1u) % SERVO_SLOTS;
    struct servo_demand *applied = &state->demand[state->slot % 2u]; /* replaced at the end by this period's */
    pos_t measured[2] = {in->measured[0], in->measured[1]};
    if (rarely(state->slot == SERVO_SLOTS - 1u)) {
        copy_configuration(cfg, state);
    }
    if (state->extras) {
        prepare(cfg, state, in->table, in->measured[0], in->measured[1]);
        measured[0] = state->tool[0];
        measured[1] = state->tool[1];
    }
    observe(cfg, state, measured, applied->net, q, &out->velocity);
    struct servo_demand demand = {ZERO, ZERO};
    const bool enabling_changed = in->enabled[0] != state->enabled[0] || in->enabled[1] != state->enabled[1];
    if (rarely(!in->enabled[0] && !in->enabled[1])) { /* there is no reference */
        *out = (struct servo_out){.velocity = out->velocity};
        state->oscillation[0].half_waves = state->oscillation[1].half_waves = 0; /* an oscillation ends */
    } else {
        contour_step(&cfg->contour, &state->spline_cache, in->ring, &in->path, q, out->velocity, &out->contour);
        if (rarely(in->forced != 0u)) {
            leave_path(&out->contour, in->forced);
        }
        const bool switched =
            in->controller != state->controller || in->forced != state->forced || state->gains_changed;
        state->gains_changed = false;
        compensator_model(&cfg->plant, &state->compensator, applied->model, cfg->dt);
        if (rarely(enabling_changed || switched)) {
            reset_laws(cfg, state, q, out->velocity);
        }
        vec2 balance;
        demand = law(cfg, state, in->controller, q, out, &balance);
        if (cfg->geometry.on) {
            const struct geometry_axis_state *g = state->geometry.axis;
            balance = v2_add(balance, v2(g[0].gap_force, g[1].gap_force));
        }
        if (rarely(switched && !enabling_changed)) {
            state->offset = v2_sub(v2_sub(state->force, state->filtering),
                                   v2_add(demand.net, v2_add(balance, v2_add(state->screw, state->lead))));
            state->blending = true;
        }
        if (rarely(state->blending)) {
            const vec2 offset = switched ? state->offset : blend(cfg, state);
            demand.net = v2_add(demand.net, offset);
            demand.model = v2_add(demand.model, offset);
        }

        out->force = v2_add(demand.net, balance);
        out->saturated = false;
        if (state->extras) {
            out->force = refine(cfg, state, enabling_changed, demand.net.x, demand.net.y, balance.x, balance.y);
            demand.net = v2_add(demand.net, state->filtering);
            demand.model = v2_add(demand.model, state->filtering);
        }
        if (rarely(in->forced != 0u || !within_limits(state->force_limit.limit, in, out->force))) {
            const vec2 unlimited = in->forced != 0u ? where_given(in, out->force) : out->force;
            const vec2 limited = limit(unlimited, state->force_limit.limit);
            const vec2 beyond = v2_sub(unlimited, limited);
            const vec2 excess = v2_sub(out->force, limited);
            out->force = where_enabled(in->enabled, limited);
            out->saturated =
                (in->enabled[0] && n_lt(NUM(0), n_abs(beyond.x))) || (in->enabled[1] && n_lt(NUM(0), n_abs(beyond.y)));
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
    state->enabled[0] = in->enabled[0];
    state->enabled[1] = in->enabled[1];
    state->controller = in->controller;
    state->forced = in->forced;
    state->saturated = out->saturated;
    state->force = out->force;
    *applied = demand;
    if (state->extras) {
        predict(cfg, state, out, &in->path, in->measured[0], in->measured[1]);
    }
}
