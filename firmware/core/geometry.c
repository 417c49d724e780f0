/* SPDX-License-Identifier: Apache-2.0 */
/* geometry.c: the position of the tool, geometry.h. Runs in the servo tick. */
#include "core/geometry.h"

#include "core/trig.h"

/* The error of the screw at the user's position p_nm, um. */
static num lead(const struct geometry_axis_cfg *cfg, int64_t p_nm)
{
    const int64_t from_start = p_nm - cfg->start_nm;
    if (cfg->points == 0 || from_start <= 0) {
        return cfg->lead[0]; /* 0 where there is no map */
    }
    const uint32_t distance = from_start > UINT32_MAX ? UINT32_MAX : (uint32_t)from_start;
    const uint32_t k = distance / cfg->step_nm;
    if (k >= cfg->points - 1u) {
        return cfg->lead[cfg->points - 1u];
    }
    const num part = n_ratio((int32_t)(distance - k * cfg->step_nm), (int32_t)cfg->step_nm);
    return n_mad(cfg->lead[k], part, n_sub(cfg->lead[k + 1u], cfg->lead[k]));
}

/* The correction `placed` without a step: a new origin changes it by what `bridge` takes up. */
static num without_step(struct geometry_placed *s, num placed, bool bridged, num dt)
{
    if (bridged) {
        s->bridge = n_add(s->bridge, n_sub(s->placed, placed));
    }
    if (n_lt(NUM(0), n_abs(s->bridge))) {
        const num left = n_sub(n_abs(s->bridge), n_mul(NUM(GEOMETRY_ORIGIN_RATE), dt));
        s->bridge = n_lt(left, NUM(0)) ? NUM(0) : n_state(n_lt(s->bridge, NUM(0)) ? n_neg(left) : left);
    }
    s->placed = n_state(placed);
    return n_add(placed, s->bridge);
}

/* The correction of axis i by the user's position p of it and of the other one. */
static num by_position(const struct geometry_cfg *cfg, struct geometry_state *state, int i, pos_t p, pos_t other,
                       bool bridged, num dt)
{
    const num squareness = cfg->axis[1 - i].squareness;
    const num placed =
        n_mad(lead(&cfg->axis[i], pos_to_wide_nm(p)), squareness, n_ratio(pos_to_wide_nm(other), 1000000));
    return without_step(&state->axis[i].position, placed, bridged, dt);
}

/* The correction of an axis by the angle of its screw at the user's position p. */
static num by_angle(const struct geometry_axis_cfg *cfg, struct geometry_axis_state *s, pos_t p, bool bridged, num dt)
{
    if (cfg->turns == 0) {
        return NUM(0);
    }
    const struct trig_circle c = trig_circle(pos_phase(p, cfg->turns));
    const num placed = n_mad(n_mul(cfg->error_cos, c.cos), cfg->error_sin, c.sin);
    return without_step(&s->turn, placed, bridged, dt);
}

/* The correction of an axis by the force at its table, of a reference that moves in `direction`. */
static num by_force(const struct geometry_axis_cfg *cfg, struct geometry_axis_state *s, num r_dot, num r_ddot,
                    num direction, num dt)
{
    const num friction = n_mad(n_mul(cfg->coulomb, direction), cfg->viscous, r_dot);
    const num force = n_mad(friction, cfg->mass, r_ddot);
    const num change = n_sub(n_mul(cfg->compliance, force), s->deflection);
    s->deflection = n_state(n_add(s->deflection, n_within(change, n_mul(NUM(GEOMETRY_DEFLECTION_RATE), dt))));

    const num push = n_mad(force, NUM(GEOMETRY_PUSH), direction);
    if (!n_lt(n_abs(push), NUM(GEOMETRY_PUSH_MIN))) {
        s->target = n_lt(push, NUM(0)) ? NUM(-1) : NUM(1);
    }
    const num w = cfg->side_bandwidth;
    const num rate = n_msub(n_mul(w, n_sub(s->target, s->side)), NUM(2), s->side_rate);
    s->side_rate = n_state(n_mad(s->side_rate, n_mul(w, dt), rate));
    s->side = n_state(n_mad(s->side, dt, s->side_rate));
    s->gap_force = n_mul(cfg->gap_inertia, n_mul(w, rate));
    return n_neg(n_mad(s->deflection, cfg->half_gap, s->side));
}

void geometry_reset(struct geometry_state *state)
{
    *state = (struct geometry_state){.started = false};
}

/* The first step, or one with a new origin: both axes. Not inline, so that it costs nothing where that is not so. */
__attribute__((noinline)) static void step_both(const struct geometry_cfg *cfg, struct geometry_state *state,
                                                const pos_t encoder[2], const int32_t origin_nm[2])
{
    const pos_t p[2] = {pos_moved(encoder[0], origin_nm[0]), pos_moved(encoder[1], origin_nm[1])};
    bool bridged = false;
    for (int i = 0; i < 2; i++) {
        bridged = bridged || (state->started && origin_nm[i] != state->axis[i].origin_nm);
        state->axis[i].origin_nm = origin_nm[i];
    }
    state->position = v2(by_position(cfg, state, 0, p[0], p[1], bridged, cfg->dt),
                         by_position(cfg, state, 1, p[1], p[0], bridged, cfg->dt));
    state->turn = v2(by_angle(&cfg->axis[0], &state->axis[0], p[0], bridged, cfg->dt),
                     by_angle(&cfg->axis[1], &state->axis[1], p[1], bridged, cfg->dt));
    state->started = true;
}

static inline void step_axis(const struct geometry_cfg *cfg, struct geometry_state *state, int i, pos_t p, pos_t other,
                             bool with_position, num *position, num *turn)
{
    if (with_position) {
        *position = by_position(cfg, state, i, p, other, false, n_mul(NUM(2), cfg->dt));
    }
    *turn = by_angle(&cfg->axis[i], &state->axis[i], p, false, cfg->dt);
}

void geometry_step(const struct geometry_cfg *cfg, struct geometry_state *state, const pos_t encoder[2],
                   const int32_t origin_nm[2], int turn)
{
    const struct geometry_axis_state *axis = state->axis;
    if (rarely(turn < 0 || !state->started || origin_nm[0] != axis[0].origin_nm || origin_nm[1] != axis[1].origin_nm)) {
        step_both(cfg, state, encoder, origin_nm);
        return;
    }
    const pos_t x = pos_moved(encoder[0], origin_nm[0]);
    const pos_t y = pos_moved(encoder[1], origin_nm[1]);
    if (turn % 2 == 0) {
        step_axis(cfg, state, 0, x, y, turn > 1, &state->position.x, &state->turn.x);
    } else {
        step_axis(cfg, state, 1, y, x, turn > 1, &state->position.y, &state->turn.y);
    }
}

void geometry_push(const struct geometry_cfg *cfg, struct geometry_state *state, int axis, num r_dot, num r_ddot,
                   num direction)
{
    if (axis == 0) {
        state->force.x = by_force(&cfg->axis[0], &state->axis[0], r_dot, r_ddot, direction, cfg->dt);
    } else {
        state->force.y = by_force(&cfg->axis[1], &state->axis[1], r_dot, r_ddot, direction, cfg->dt);
    }
}
