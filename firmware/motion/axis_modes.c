/* SPDX-License-Identifier: Apache-2.0 */
#include "motion/axis_modes.h"

#include "hal/hal.h"

enum {
    HALT_QUICK_STOP_RAMP = 2, /* 605Dh: halt slows down with 6085h */
    CYCLIC_END = 100          /* knots after which the path of set-points that stay the same ends */
};

void axis_modes_reset(struct axis_modes *m)
{
    m->generating = false;
    cyclic_reset(&m->cyclic);
    for (int i = 0; i < 2; i++) {
        m->axis[i].set_points = CYCLIC_TAKEN;
        m->axis[i].mode = MODE_INTERPOLATED_POSITION;
        profile_start(&m->axis[i].profile, 0); /* not followed; its moving average needs a length */
        m->axis[i].homing.state = HOMING_NONE;
    }
}

bool axis_modes_known(int64_t mode)
{
    return mode == MODE_PROFILE_VELOCITY || mode == MODE_HOMING || mode == MODE_INTERPOLATED_POSITION ||
           mode == MODE_CYCLIC_POSITION;
}

bool axis_modes_follow_stream(const struct axis_modes *m)
{
    return !m->generating && m->axis[0].mode == MODE_INTERPOLATED_POSITION &&
           m->axis[1].mode == MODE_INTERPOLATED_POSITION;
}

static bool cyclic_mode(const struct axis_mode *a)
{
    return a->mode == MODE_CYCLIC_POSITION;
}

/* Whether an axis stands by its own knots. */
static bool own_stands(const struct axis_modes *m, int i)
{
    return m->cyclic.axis[i].follows ? cyclic_stands(&m->cyclic, i) : profile_stands(&m->axis[i].profile);
}

bool axis_modes_stands(const struct axis_modes *m, int axis, bool standing)
{
    return standing || (m->generating && own_stands(m, axis));
}

bool axis_modes_cyclic(const struct axis_modes *m)
{
    return m->cyclic.axis[0].follows || m->cyclic.axis[1].follows;
}

bool axis_modes_led(const struct axis_modes *m, int axis)
{
    return axis_modes_follow_stream(m) || m->cyclic.axis[axis].follows;
}

/* Whether the flags of path time belong to the queue as it is: the tick uses this queue, and this step has discarded or
 * shifted nothing so far (axis 0 comes first). */
static bool path_current(const struct axis_modes_in *in, const struct axis_modes_out *out)
{
    return in->path->current && !out->hold && !out->set_origin[0];
}

/* Whether path time stands and does not start by itself. */
static bool idle(const struct axis_modes *m, const struct axis_modes_in *in, const struct axis_modes_out *out)
{
    return !m->generating && in->path->standing && (!in->path_may_run || (path_current(in, out) && in->path->at_end));
}

static void take_over_mode(struct axis_modes *m, int i, const struct axis_modes_in *in, struct axis_modes_out *out)
{
    struct axis_mode *a = &m->axis[i];
    const int8_t mode = in->od->axis[i].mode;
    if (mode == a->mode || !axis_modes_known(mode)) {
        return;
    }
    /* a homing axis also stands on the switch, before it turns back */
    if (!homing_busy(&a->homing) && (m->generating ? own_stands(m, i) : idle(m, in, out))) {
        if (!m->generating) {
            out->hold = true;
        }
        a->mode = mode;
        m->cyclic.axis[i].known = false;
        a->homing.state = HOMING_NONE; /* bits 12 and 13 are about a homing of this stay in the mode */
    }
}

/* ---- settings ---- */

/* Target velocity that the master asks for, in mode 3 */
static int32_t requested_velocity(const struct axis_modes *m, int i, const struct axis_modes_in *in)
{
    const struct axis_mode_in *axis = &in->axis[i];
    const bool moves = m->axis[i].mode == MODE_PROFILE_VELOCITY && axis->enabled && (axis->controlword & CW_HALT) == 0;
    return moves ? in->od->axis[i].target_velocity : 0;
}

static void take_over_settings(struct axis_modes *m, int i, const struct axis_modes_in *in)
{
    struct axis_mode *a = &m->axis[i];
    const struct od_axis *od = &in->od->axis[i];
    const int32_t requested = requested_velocity(m, i, in);
    const bool goes_on =
        homing_busy(&a->homing) || (m->generating && !own_stands(m, i) && requested == a->requested_umps);
    a->requested_umps = requested;
    if (!m->generating) {
        a->settings.min_nm = od->position_limit.min;
        a->settings.max_nm = od->position_limit.max;
    }
    if (!goes_on) {
        a->settings.up_umps2 = od->profile_acceleration;
        a->settings.down_umps2 = od->profile_deceleration;
        a->settings.quick_umps2 = od->quick_stop_deceleration;
        a->settings.homing_umps2 = od->homing_acceleration;
        a->settings.search_umps = (int32_t)od->homing_speed.search;
        a->settings.zero_umps = (int32_t)od->homing_speed.zero;
        a->settings.home_offset_nm = od->home_offset;
        a->settings.halt_option = od->halt_option;
        a->settings.homing_method = od->homing_method;
    }
}

/* ---- homing ---- */

static struct homing_in homing_in(const struct axis_modes *m, int i, const struct axis_modes_in *in)
{
    const struct axis_mode_in *axis = &in->axis[i];
    const struct axis_settings *settings = &m->axis[i].settings;
    return (struct homing_in){
        .inputs = axis->inputs,
        .index_pulses = axis->index_pulses,
        .index_nm = axis->index_nm,
        .edge_nm = axis->edge_nm,
        .position_nm = axis->position_nm,
        .reach_nm = (int64_t)settings->max_nm - settings->min_nm,
        .switch_umps = settings->search_umps,
        .zero_umps = settings->zero_umps,
        .standing = axis_modes_stands(m, i, in->path->standing),
    };
}

/* Target velocity of an axis in mode 6. The result of a homing lasts while the axis stays enabled: a master whose statusword
 * is late then never takes it for that of the next one. A rising edge of bit 4 clears it, too, and starts the next homing,
 * which runs while the bit stays set, unless the axis is on halt. */
static int32_t homing_velocity(struct axis_modes *m, int i, const struct axis_modes_in *in)
{
    struct axis_mode *a = &m->axis[i];
    const uint16_t cw = in->axis[i].controlword;
    const bool edge = (cw & ~(unsigned)a->controlword & CW_ENABLE_IP) != 0;
    const struct homing_in homing = homing_in(m, i, in);
    if (!in->axis[i].enabled || (cw & CW_ENABLE_IP) == 0 || (cw & CW_HALT) != 0) {
        a->homing.state = !in->axis[i].enabled || edge || homing_busy(&a->homing) ? HOMING_NONE : a->homing.state;
        return 0;
    }
    if (edge) {
        homing_start(&a->homing, a->settings.homing_method);
    }
    return homing_step(&a->homing, &homing);
}

/* Give the home point the position 607Ch when it has been found and both axes stand. */
static void set_origin(struct axis_modes *m, int i, const struct axis_modes_in *in, struct axis_modes_out *out)
{
    struct homing *h = &m->axis[i].homing;
    if (h->state != HOMING_FOUND || !idle(m, in, out)) {
        return;
    }
    const int64_t origin = m->axis[i].settings.home_offset_nm - h->found_nm;
    const bool fits = origin >= -INT32_MAX && origin <= INT32_MAX;
    h->state = fits ? HOMING_DONE : HOMING_FAILED;
    out->set_origin[i] = fits;
    out->origin_nm[i] = fits ? (int32_t)origin : 0;
}

/* ---- profile velocity ---- */

/* Whether a limit switch stops an axis that has this velocity. */
static bool switch_ahead(uint8_t inputs, int64_t velocity)
{
    return (velocity > 0 && (inputs & HAL_LIMIT_MAX) != 0) || (velocity < 0 && (inputs & HAL_LIMIT_MIN) != 0);
}

/* FAULT_OVERSPEED trips at 2130h velocity: a profile stays a tenth below. */
static int32_t velocity_max(const struct od_data *od)
{
    return (int32_t)(od->limits.velocity / 10u * 9u);
}

/* Target velocity of an axis in mode 3 */
static int32_t limited_velocity(struct axis_modes *m, int i, const struct axis_modes_in *in)
{
    struct axis_mode *a = &m->axis[i];
    const struct axis_mode_in *axis = &in->axis[i];
    const struct axis_settings *settings = &a->settings;
    const int32_t max = velocity_max(in->od);
    const int64_t here_pm = m->generating ? a->profile.pos_pm : (int64_t)axis->reference_nm * 1000;
    int32_t velocity = a->requested_umps > max ? max : a->requested_umps < -max ? -max : a->requested_umps;
    if (switch_ahead(axis->inputs, velocity) || (velocity > 0 && here_pm >= (int64_t)settings->max_nm * 1000) ||
        (velocity < 0 && here_pm <= (int64_t)settings->min_nm * 1000)) {
        velocity = 0;
    }
    a->limited = velocity != a->requested_umps;
    return velocity;
}

/* Slow down with 6085h. This also holds for an axis without power: it coasts, and its profile is to end soon. */
static bool on_quick_stop_ramp(const struct axis_modes *m, int i, const struct axis_modes_in *in)
{
    const struct axis_mode_in *axis = &in->axis[i];
    if (!axis->powered) {
        return true;
    }
    if (axis->quick_stop != NO_QUICK_STOP) {
        return axis->quick_stop == 2 || axis->quick_stop == 6;
    }
    return ((axis->controlword & CW_HALT) != 0 && m->axis[i].settings.halt_option == HALT_QUICK_STOP_RAMP) ||
           switch_ahead(axis->inputs, m->axis[i].profile.vel_pmpms);
}

static struct profile_in profile_in(struct axis_modes *m, int i, const struct axis_modes_in *in)
{
    const struct axis_settings *settings = &m->axis[i].settings;
    struct profile_in profile = {.up_umps2 = settings->up_umps2,
                                 .down_umps2 = settings->down_umps2,
                                 .min_nm = settings->min_nm,
                                 .max_nm = settings->max_nm};
    if (m->axis[i].mode == MODE_PROFILE_VELOCITY) {
        profile.target_umps = limited_velocity(m, i, in);
    } else if (m->axis[i].mode == MODE_HOMING) {
        profile.up_umps2 = profile.down_umps2 = settings->homing_umps2;
        profile.target_umps = homing_velocity(m, i, in);
        profile.min_nm = INT32_MIN;
        profile.max_nm = INT32_MAX;
    }
    if (on_quick_stop_ramp(m, i, in)) {
        profile.down_umps2 = settings->quick_umps2;
    }
    return profile;
}

/* ---- cyclic modes ---- */

void axis_modes_set_point(struct axis_modes *m, int axis)
{
    m->cyclic.axis[axis].fresh = true;
}

static void take_set_point(struct axis_modes *m, int i, const struct od_data *od)
{
    struct axis_mode *a = &m->axis[i];
    struct cyclic_axis *c = &m->cyclic.axis[i];
    const bool repeats = c->known && !c->moved; /* a master at rest need not send its set-point again */
    const struct cyclic_limits limits = {
        .max_nmpms2 = od->limits.acceleration,
        .min_nm = a->settings.min_nm,
        .max_nm = a->settings.max_nm,
        .stop_umps2 = a->settings.down_umps2,
    };
    if (c->fresh || repeats) {
        const int32_t nm = c->fresh ? od->axis[i].target_position : cyclic_newest(c);
        c->known = c->known && c->follows; /* what was not followed is no way */
        const enum cyclic_result result = cyclic_set_point(&m->cyclic, i, nm, &limits);
        a->set_points = result == CYCLIC_TAKEN ? a->set_points : result;
    }
    c->fresh = false;
}

void axis_modes_sync(struct axis_modes *m, const struct od_data *od, uint32_t now)
{
    const int first = cyclic_mode(&m->axis[0]) ? 0 : 1;
    if (!cyclic_mode(&m->axis[first])) {
        return;
    }
    cyclic_sync(&m->cyclic, now, CONTROL_HZ / 1000u, od->axis[first].ip_period.value);
    for (int i = 0; i < 2; i++) {
        if (cyclic_mode(&m->axis[i])) {
            take_set_point(m, i, od);
        }
    }
}

void axis_modes_interrupt(struct axis_modes *m)
{
    m->generating = false;
    m->cyclic.runs = false;
}

/* The axis follows its set-points no longer. A profile takes over: its ramp is ahead of its knots by half of their mean. */
static void leave(struct axis_modes *m, int i)
{
    struct cyclic_axis *c = &m->cyclic.axis[i];
    if (c->follows && m->generating) {
        profile_go_on(&m->axis[i].profile, c->knot_nm, c->step_nm);
    }
    c->known = c->known && !c->follows; /* the next one comes after the stop */
    c->follows = false;
}

static bool may_follow(const struct axis_modes *m, int i, const struct axis_modes_in *in)
{
    const struct axis_mode_in *axis = &in->axis[i];
    return cyclic_mode(&m->axis[i]) && axis->enabled && (axis->controlword & CW_HALT) == 0 &&
           m->axis[i].set_points == CYCLIC_TAKEN;
}

static bool within_window(int64_t a, int64_t b, int64_t window)
{
    return a - b <= window && b - a <= window;
}

/* An axis that stands begins to follow its set-points where the first of them is close to it. */
static void enter(struct axis_modes *m, int i, const struct axis_modes_in *in, const struct axis_modes_out *out)
{
    const bool stands = m->generating ? profile_stands(&m->axis[i].profile) : idle(m, in, out);
    if (!stands || !cyclic_ready(&m->cyclic, i, in->now)) {
        return;
    }
    const int32_t at_nm = in->axis[i].reference_nm;
    if (within_window(cyclic_newest(&m->cyclic.axis[i]), at_nm, in->od->limits.start_window)) {
        cyclic_follow(&m->cyclic, i, at_nm);
    } else {
        m->axis[i].set_points = CYCLIC_RANGE;
    }
}

/* Whether the set-points of an axis that stands ask for a movement. */
static bool follow(struct axis_modes *m, int i, const struct axis_modes_in *in, const struct axis_modes_out *out)
{
    const struct cyclic_axis *c = &m->cyclic.axis[i];
    if (c->follows && cyclic_missing(&m->cyclic, i, in->now)) {
        m->axis[i].set_points = CYCLIC_MISSED;
    }
    if (!may_follow(m, i, in)) {
        leave(m, i);
        m->axis[i].set_points = in->axis[i].enabled ? m->axis[i].set_points : CYCLIC_TAKEN;
    } else if (!c->follows) {
        enter(m, i, in, out);
    }
    return c->follows && (c->moved || cyclic_newest(c) != in->axis[i].reference_nm);
}

void axis_modes_step(struct axis_modes *m, const struct axis_modes_in *in, struct axis_modes_out *out)
{
    *out = (struct axis_modes_out){0};
    bool wanted = false;
    for (int i = 0; i < 2; i++) {
        take_over_mode(m, i, in, out);
        take_over_settings(m, i, in);
        m->axis[i].target = profile_in(m, i, in);
        m->axis[i].controlword = in->axis[i].controlword;
        wanted = follow(m, i, in, out) || wanted || m->axis[i].target.target_umps != 0;
    }
    if (wanted && idle(m, in, out) && path_current(in, out)) {
        out->begin = true;
        m->generating = true;
        m->ending = false;
        m->cyclic.runs = false;
        for (int i = 0; i < 2; i++) {
            profile_start(&m->axis[i].profile, in->axis[i].reference_nm);
        }
    }
    for (int i = 0; i < 2; i++) {
        set_origin(m, i, in, out);
    }
}

/* ---- the path of the profiles ---- */

bool axis_modes_end(struct axis_modes *m, struct queue *q, const struct path_progress *path, bool powered)
{
    if (!m->generating || !path->current) {
        return false;
    }
    if (path->at_end || !powered) { /* a fault that stops the axes on the path has switched them off there */
        axis_modes_interrupt(m);
        queue_close(q);
    }
    return path->at_end && !m->ending;
}

/* Whether an axis stands, and is to. */
static bool ends(const struct axis_modes *m, int i)
{
    const struct cyclic_axis *c = &m->cyclic.axis[i];
    if (c->follows) {
        return !c->moved && c->same >= CYCLIC_END;
    }
    return m->axis[i].target.target_umps == 0 && profile_stands(&m->axis[i].profile);
}

static int32_t next_knot(struct axis_modes *m, int i)
{
    struct axis_mode *a = &m->axis[i];
    return m->cyclic.axis[i].follows ? cyclic_knot(&m->cyclic, i) : profile_step(&a->profile, &a->target);
}

/* Go on along the way of the set-points, if an axis follows it. */
static void step_cyclic(struct axis_modes *m, const struct od_stream *s, uint32_t now)
{
    const unsigned ahead_ms = s->accepted - s->executed; /* path time has just come to `executed` */
    if (!axis_modes_cyclic(m)) {
        m->cyclic.runs = false;
    } else if (m->cyclic.runs) {
        cyclic_step(&m->cyclic, now, ahead_ms);
    } else {
        const int32_t at_nm[2] = {s->end_x, s->end_y};
        cyclic_begin(&m->cyclic, now, ahead_ms, at_nm);
    }
}

void axis_modes_generate(struct axis_modes *m, struct queue *q, uint32_t now)
{
    const struct od_stream *s = q->stream;
    const uint32_t ahead = axis_modes_cyclic(m) ? CYCLIC_AHEAD : PROFILE_AHEAD;
    for (int i = 0; i < 2; i++) {
        if (m->axis[i].mode == MODE_HOMING) {
            queue_unlimited(q, i);
        }
    }
    while (!m->ending && s->accepted - s->executed < ahead) {
        step_cyclic(m, s, now);
        const struct knot knot = {{next_knot(m, 0), next_knot(m, 1)}};
        if (queue_push(q, knot) != QUEUE_ACCEPTED) {
            break; /* outside the limits, which is FAULT_KNOT_RANGE */
        }
        m->ending = ends(m, 0) && ends(m, 1);
    }
    if (m->ending) {
        (void)queue_end(q, s->accepted);
    }
}

/* ---- status ---- */

static unsigned homing_status(const struct homing *h, bool stands)
{
    const unsigned reached = stands ? SW_TARGET_REACHED : 0u;
    switch (h->state) {
    case HOMING_NONE: return reached;
    case HOMING_DONE: return SW_HOMING_ATTAINED | SW_TARGET_REACHED;
    case HOMING_FAILING: return SW_HOMING_ERROR;
    case HOMING_FAILED: return SW_HOMING_ERROR | reached;
    default: return 0;
    }
}

static unsigned velocity_status(const struct axis_mode *a, bool generating, bool stands)
{
    const bool reached =
        generating ? profile_reached(&a->profile, a->requested_umps) : a->requested_umps == 0 && stands;
    const bool limited = a->limited || (generating && a->profile.limited);
    return (reached ? SW_TARGET_REACHED : 0u) | (limited ? SW_INTERNAL_LIMIT : 0u) | (stands ? SW_SPEED_0 : 0u);
}

uint16_t axis_modes_status(const struct axis_modes *m, int axis, uint8_t stream_state, bool standing)
{
    const struct axis_mode *a = &m->axis[axis];
    const bool stands = axis_modes_stands(m, axis, standing);
    if (a->mode == MODE_HOMING) {
        return (uint16_t)homing_status(&a->homing, stands);
    }
    if (a->mode == MODE_PROFILE_VELOCITY) {
        return (uint16_t)velocity_status(a, m->generating, stands);
    }
    if (cyclic_mode(a)) {
        return m->cyclic.axis[axis].follows ? SW_FOLLOWS : 0u;
    }
    if (!axis_modes_follow_stream(m)) {
        return 0;
    }
    return (uint16_t)((stream_state == STREAM_RUNNING || stream_state == STREAM_STOPPING ? SW_IP_ACTIVE : 0u) |
                      (stream_state == STREAM_DONE ? SW_TARGET_REACHED : 0u));
}

/* ---- streams ---- */

void axis_modes_begin_stream(struct axis_modes *m, uint8_t record_ms, struct knot start)
{
    m->by_record = m->by_frame = false;
    ip_record_start(&m->record, record_ms, start);
}

bool axis_modes_enough_knots(const struct axis_modes *m, const struct queue *q, uint32_t stop_time)
{
    const struct od_stream *s = q->stream;
    const uint32_t stop = stop_time / 2u + 4u;
    return s->state != STREAM_FILLING || !m->by_record || s->accepted >= stop + 2u * m->record.ms + RECORD_JITTER ||
           queue_complete(q);
}
