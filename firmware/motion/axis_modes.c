/* SPDX-License-Identifier: Apache-2.0 */
#include "motion/axis_modes.h"

#include "hal/hal.h"

enum { CYCLIC_END = 100 /* knots after which the path of set-points that stay the same ends */ };

void axis_modes_reset(struct axis_modes *m)
{
    m->generating = false;
    cyclic_reset(&m->cyclic);
    for (int i = 0; i < 2; i++) {
        m->torque[i] = (struct cyclic_torque){0};
        axis_target_reset(&m->axis[i]);
    }
}

bool axis_modes_known(int64_t mode)
{
    return mode == MODE_PROFILE_POSITION || mode == MODE_PROFILE_VELOCITY || mode == MODE_HOMING ||
           mode == MODE_INTERPOLATED_POSITION || mode == MODE_CYCLIC_POSITION || mode == MODE_CYCLIC_VELOCITY ||
           mode == MODE_CYCLIC_TORQUE;
}

bool axis_modes_follow_stream(const struct axis_modes *m)
{
    return !m->generating && m->axis[0].mode == MODE_INTERPOLATED_POSITION &&
           m->axis[1].mode == MODE_INTERPOLATED_POSITION;
}

static bool cyclic_mode(const struct axis_mode *a)
{
    return a->mode == MODE_CYCLIC_POSITION || a->mode == MODE_CYCLIC_VELOCITY;
}

/* Whether set-points of the axis come with SYNC. */
static bool by_sync(const struct axis_mode *a)
{
    return cyclic_mode(a) || a->mode == MODE_CYCLIC_TORQUE;
}

/* Whether an axis stands by its own knots. */
static bool own_stands(const struct axis_modes *m, int i)
{
    if (m->torque[i].follows) {
        return cyclic_torque_stands(&m->torque[i]);
    }
    return m->cyclic.axis[i].follows ? cyclic_stands(&m->cyclic, i) : profile_stands(&m->axis[i].profile);
}

bool axis_modes_stands(const struct axis_modes *m, int axis, bool standing)
{
    return standing || (m->generating && own_stands(m, axis));
}

/* Whether an axis follows the set-points of mode 8 or 9. */
static bool is_cyclic(const struct axis_modes *m)
{
    return m->cyclic.axis[0].follows || m->cyclic.axis[1].follows;
}

static bool follows(const struct axis_modes *m, int axis)
{
    return m->cyclic.axis[axis].follows || m->torque[axis].follows;
}

bool axis_modes_led(const struct axis_modes *m, int axis)
{
    return axis_modes_follow_stream(m) || follows(m, axis);
}

enum cyclic_result axis_modes_refused(const struct axis_modes *m, int axis)
{
    const enum cyclic_result refused = m->cyclic.axis[axis].refused;
    return refused != CYCLIC_TAKEN ? refused : m->torque[axis].refused;
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
        axis_target_enter(a, mode);
        m->cyclic.axis[i].known = false;
    }
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

/* ---- cyclic modes ---- */

void axis_modes_set_point(struct axis_modes *m, int axis)
{
    cyclic_told(&m->cyclic, axis);
}

void axis_modes_sync(struct axis_modes *m, const struct od_data *od, uint32_t now)
{
    const int first = by_sync(&m->axis[0]) ? 0 : 1;
    if (!by_sync(&m->axis[first])) {
        return;
    }
    cyclic_sync(&m->cyclic, now, CONTROL_HZ / 1000u, od->axis[first].ip_period.value);
    for (int i = 0; i < 2; i++) {
        const struct axis_settings *settings = &m->axis[i].settings;
        const struct cyclic_limits limits = {
            .max_nmpms2 = od->limits.acceleration,
            .min_nm = settings->min_nm,
            .max_nm = settings->max_nm,
            .stop_umps2 = settings->down_umps2,
        };
        if (m->axis[i].mode == MODE_CYCLIC_POSITION) {
            cyclic_take(&m->cyclic, i, od->axis[i].target_position, &limits);
        }
        if (m->axis[i].mode == MODE_CYCLIC_VELOCITY) {
            const int64_t umps = (int64_t)od->axis[i].target_velocity + od->axis[i].velocity_offset;
            cyclic_take_velocity(&m->cyclic, i, umps, &limits);
        }
        if (m->axis[i].mode == MODE_CYCLIC_TORQUE) {
            cyclic_torque_take(&m->torque[i], &m->cyclic, i, &od->axis[i]);
        }
    }
}

void axis_modes_interrupt(struct axis_modes *m)
{
    m->generating = false;
    m->cyclic.runs = false;
}

static bool follow_torque(struct axis_modes *m, int i, const struct axis_modes_in *in, const struct cyclic_in *cyclic)
{
    struct axis_mode *a = &m->axis[i];
    struct cyclic_torque *t = &m->torque[i];
    const struct cyclic_torque_in torque = {
        .enabled = in->axis[i].enabled && a->mode == MODE_CYCLIC_TORQUE,
        .cyclic = cyclic,
        .od = &in->od->axis[i],
        .limits = {.min_nm = a->settings.min_nm, .max_nm = a->settings.max_nm, .stop_umps2 = a->settings.down_umps2},
    };
    const bool followed = t->follows;
    const bool wanted = cyclic_torque_update(t, &m->cyclic, &torque);
    if (followed && !t->follows && m->generating) {
        profile_go_on(&a->profile, t->knot_nm, t->step_nm);
    }
    return wanted;
}

/* Let an axis begin or cease to follow its set-points. When it ceases on its way, a profile takes over. */
static bool follow(struct axis_modes *m, int i, const struct axis_modes_in *in, const struct axis_modes_out *out)
{
    struct axis_mode *a = &m->axis[i];
    const struct cyclic_axis *c = &m->cyclic.axis[i];
    const struct cyclic_in cyclic = {
        .enabled = in->axis[i].enabled && cyclic_mode(a),
        .halt = (in->axis[i].controlword & CW_HALT) != 0,
        .stands = m->generating ? profile_stands(&a->profile) : idle(m, in, out),
        .at_nm = in->axis[i].reference_nm,
        .window_nm = in->od->limits.start_window,
        .now = in->now,
    };
    const bool followed = c->follows;
    const bool wanted = cyclic_update(&m->cyclic, i, &cyclic);
    if (followed && !c->follows && m->generating) {
        profile_go_on(&a->profile, c->knot_nm, c->step_nm);
    }
    return follow_torque(m, i, in, &cyclic) || wanted;
}

static void step_target(struct axis_modes *m, int i, const struct axis_modes_in *in)
{
    struct axis_mode_in axis = in->axis[i];
    axis.od = &in->od->axis[i];
    axis.velocity_max_umps = (int32_t)(in->od->limits.velocity / 10u * 9u);
    axis.now = in->now;
    axis.generating = m->generating;
    axis.stands = axis_modes_stands(m, i, in->path->standing);
    axis_target_step(&m->axis[i], &axis);
}

void axis_modes_step(struct axis_modes *m, const struct axis_modes_in *in, struct axis_modes_out *out)
{
    *out = (struct axis_modes_out){0};
    bool wanted = false;
    for (int i = 0; i < 2; i++) {
        take_over_mode(m, i, in, out);
        step_target(m, i, in);
        wanted = follow(m, i, in, out) || wanted || m->axis[i].target.target_umps != 0;
    }
    if (wanted && idle(m, in, out) && path_current(in, out)) {
        out->begin = true;
        m->generating = true;
        m->ending = false;
        m->cyclic.runs = false;
        for (int i = 0; i < 2; i++) {
            profile_start(&m->axis[i].profile, in->axis[i].reference_nm);
            cyclic_torque_join(&m->torque[i], in->axis[i].reference_nm);
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
    if (m->torque[i].follows) {
        return m->torque[i].force_mN == 0 && m->torque[i].rest >= CYCLIC_END;
    }
    return m->axis[i].target.target_umps == 0 && profile_stands(&m->axis[i].profile);
}

static int32_t next_knot(struct axis_modes *m, int i, const struct od_data *od)
{
    struct axis_mode *a = &m->axis[i];
    if (m->torque[i].follows) {
        return cyclic_torque_knot(&m->torque[i], &od->axis[i], od->stream.accepted - od->stream.executed);
    }
    return m->cyclic.axis[i].follows ? cyclic_knot(&m->cyclic, i) : profile_step(&a->profile, &a->target);
}

/* Go on along the way of the set-points, if an axis follows it. */
static void step_cyclic(struct axis_modes *m, const struct od_stream *s, uint32_t now)
{
    const unsigned ahead_ms = s->accepted - s->executed; /* path time has just come to `executed` */
    if (!is_cyclic(m)) {
        m->cyclic.runs = false;
    } else if (m->cyclic.runs) {
        cyclic_step(&m->cyclic, now, ahead_ms);
    } else {
        const int32_t at_nm[2] = {s->end_x, s->end_y};
        cyclic_begin(&m->cyclic, now, ahead_ms, at_nm);
    }
}

void axis_modes_generate(struct axis_modes *m, struct queue *q, const struct od_data *od, uint32_t now)
{
    const struct od_stream *s = q->stream;
    const uint32_t ahead = follows(m, 0) || follows(m, 1) ? CYCLIC_AHEAD : PROFILE_AHEAD;
    for (int i = 0; i < 2; i++) {
        if (m->axis[i].mode == MODE_HOMING || m->torque[i].follows) { /* knots follow the axis, wherever it is */
            queue_unlimited(q, i);
        }
    }
    while (!m->ending && s->accepted - s->executed < ahead) {
        step_cyclic(m, s, now);
        const struct knot knot = {{next_knot(m, 0, od), next_knot(m, 1, od)}};
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

uint16_t axis_modes_status(const struct axis_modes *m, int axis, uint8_t stream_state, bool standing)
{
    const struct axis_mode *a = &m->axis[axis];
    const bool stands = axis_modes_stands(m, axis, standing);
    if (axis_target_own(a)) {
        return (uint16_t)axis_target_status(a, m->generating, stands);
    }
    if (cyclic_mode(a)) {
        return m->cyclic.axis[axis].follows ? SW_FOLLOWS : 0u;
    }
    if (a->mode == MODE_CYCLIC_TORQUE) {
        return (uint16_t)cyclic_torque_status(&m->torque[axis]);
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

bool axis_modes_enough_knots(const struct axis_modes *m, const struct queue *q, uint32_t record_lag)
{
    const struct od_stream *s = q->stream;
    return s->state != STREAM_FILLING || !m->by_record ||
           s->accepted >= record_lag + m->record.ms - 1u + m->record.ms / 4u || queue_complete(q);
}

void axis_modes_take_over(struct axis_modes *m, const struct queue *q)
{
    const int64_t speed[2] = {q->step_nm[0] < 0 ? -q->step_nm[0] : q->step_nm[0],
                              q->step_nm[1] < 0 ? -q->step_nm[1] : q->step_nm[1]};
    const int64_t down[2] = {m->axis[0].settings.down_umps2, m->axis[1].settings.down_umps2};
    m->generating = true;
    m->ending = false;
    m->cyclic.runs = false;
    profile_go_on(&m->axis[0].profile, q->stream->end_x, (int32_t)q->step_nm[0]);
    profile_go_on(&m->axis[1].profile, q->stream->end_y, (int32_t)q->step_nm[1]);
    for (int i = 0; i < 2; i++) { /* both stand at the same time, so it is a line */
        if (speed[i] * down[1 - i] < speed[1 - i] * down[i]) {
            m->axis[i].settings.down_umps2 = (uint32_t)(speed[i] * down[1 - i] / speed[1 - i] + 1);
        }
    }
}
