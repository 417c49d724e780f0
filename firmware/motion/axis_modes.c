/* SPDX-License-Identifier: Apache-2.0 */
#include "motion/axis_modes.h"

#include "drive/drive.h"

enum { AXIS_STEP = 0x800 };

void axis_modes_reset(struct drive *d)
{
    d->modes.generating = false;
    for (int i = 0; i < 2; i++) {
        d->modes.axis[i].mode = MODE_PATH;
        profile_start(&d->modes.axis[i].profile, 0); /* of use for nothing, but never without a sense */
        if (homing_busy(&d->modes.axis[i].homing)) {
            d->modes.axis[i].homing.state = HOMING_NONE;
        }
    }
}

static bool mode_known(int64_t mode)
{
    return mode == MODE_VELOCITY || mode == MODE_HOMING || mode == MODE_PATH;
}

bool axis_modes_follows_stream(const struct drive *d)
{
    return !d->modes.generating && d->modes.axis[0].mode == MODE_PATH && d->modes.axis[1].mode == MODE_PATH;
}

bool axis_modes_stands(const struct drive *d, int axis)
{
    return drive_stands(d) || (d->modes.generating && profile_rests(&d->modes.axis[axis].profile));
}

/* Path time stands and will not move by itself. */
static bool idle(const struct drive *d)
{
    const struct servo_loop *loop = &d->loop;
    return !d->modes.generating && drive_stands(d) &&
           (!atomic_load(&loop->command.run) || (drive_in_step(d) && atomic_load(&loop->at_end)));
}

static void take_mode(struct drive *d, int i)
{
    struct axis_mode *a = &d->modes.axis[i];
    const int8_t mode = d->od->axis[i].mode;
    if (mode == a->mode || !mode_known(mode)) {
        return;
    }
    /* an axis that homes stands on the switch, too, before it turns */
    if (!homing_busy(&a->homing) && (d->modes.generating ? profile_rests(&a->profile) : idle(d))) {
        if (!d->modes.generating) {
            drive_hold(d);
        }
        a->mode = mode;
    }
}

/* ---- homing ---- */

static struct homing_in homing_in(struct drive *d, int i)
{
    const struct servo_snapshot *s = servo_loop_snapshot(&d->loop);
    const struct od_axis *od = &d->od->axis[i];
    return (struct homing_in){
        .inputs = s->inputs[i],
        .index_pulses = s->index_pulses[i],
        .index_nm = s->index_nm[i],
        .edge_nm = s->edge_nm[i],
        .position_nm = s->position_nm[i],
        .reach_nm = (int64_t)od->position_limit.max - od->position_limit.min,
        .switch_umps = (int32_t)od->homing_speed.search,
        .zero_umps = (int32_t)od->homing_speed.zero,
        .resting = axis_modes_stands(d, i),
    };
}

/* Speed of an axis in mode 6. Homing runs while bit 4 stays set, and is begun by its edge. */
static int32_t homing(struct drive *d, int i, bool on)
{
    struct axis_mode *a = &d->modes.axis[i];
    const uint16_t cw = d->axis[i].controlword;
    const bool wanted = on && (cw & CW_ENABLE_IP) != 0 && (cw & CW_HALT) == 0;
    const struct homing_in in = homing_in(d, i);
    if (!wanted) {
        a->homing.state = homing_busy(&a->homing) ? HOMING_NONE : a->homing.state;
        return 0;
    }
    if ((a->controlword & CW_ENABLE_IP) == 0) {
        homing_start(&a->homing, d->od->axis[i].homing_method, &in);
    }
    return homing_step(&a->homing, &in);
}

/* The home point has been found and both axes stand: it gets the position 607Ch. */
static void shift_origin(struct drive *d, int i)
{
    struct homing *h = &d->modes.axis[i].homing;
    if (h->state != HOMING_FOUND || !idle(d)) {
        return;
    }
    const int64_t origin = d->od->axis[i].home_offset - h->found_nm;
    h->state = origin < -INT32_MAX || origin > INT32_MAX ? HOMING_FAILED : HOMING_DONE;
    if (h->state == HOMING_DONE) {
        drive_shift_origin(d, i, (int32_t)origin);
    }
}

/* ---- jogging ---- */

/* The limit switch that stops an axis with this speed */
static bool switch_ahead(struct drive *d, int i, int64_t speed)
{
    const uint8_t inputs = servo_loop_snapshot(&d->loop)->inputs[i];
    return (speed > 0 && (inputs & HAL_LIMIT_MAX) != 0) || (speed < 0 && (inputs & HAL_LIMIT_MIN) != 0);
}

/* The trip of 2130h is no speed to go with. */
static int32_t fastest(const struct drive *d)
{
    return (int32_t)(d->od->limits.velocity / 10u * 9u);
}

/* Speed of an axis in mode 3 */
static int32_t jogging(struct drive *d, int i, bool on)
{
    struct axis_mode *a = &d->modes.axis[i];
    const struct od_axis *od = &d->od->axis[i];
    const bool halt = (d->axis[i].controlword & CW_HALT) != 0;
    const int32_t max = fastest(d);
    const int64_t here_pm = d->modes.generating ? a->profile.pos_pm : (int64_t)drive_reference(d).nm[i] * 1000;
    a->wish_umps = on && !halt ? od->target_velocity : 0;
    int32_t speed = a->wish_umps > max ? max : a->wish_umps < -max ? -max : a->wish_umps;
    if (switch_ahead(d, i, speed) || (speed > 0 && here_pm >= (int64_t)od->position_limit.max * 1000) ||
        (speed < 0 && here_pm <= (int64_t)od->position_limit.min * 1000)) {
        speed = 0;
    }
    a->limited = speed != a->wish_umps;
    return speed;
}

/* On the quick-stop ramp; without power the axis coasts, and the other one's path shall be rid of it. */
static bool quick(struct drive *d, int i)
{
    if (!d->powered[i]) {
        return true;
    }
    const struct od_axis *od = &d->od->axis[i];
    const int16_t option = d->axis[i].quick_stop;
    if (d->axis[i].state == CIA402_QUICK_STOP_ACTIVE) {
        return option == 2 || option == 6;
    }
    return ((d->axis[i].controlword & CW_HALT) != 0 && od->halt_option == 2) ||
           switch_ahead(d, i, d->modes.axis[i].profile.vel_pmpms);
}

/* What the axis is to do now. */
static struct profile_in plan(struct drive *d, int i)
{
    const struct od_axis *od = &d->od->axis[i];
    const bool on = cia402_enabled(&d->axis[i]);
    struct profile_in in = {.up_umps2 = od->profile_acceleration,
                            .down_umps2 = od->profile_deceleration,
                            .min_nm = od->position_limit.min,
                            .max_nm = od->position_limit.max};
    if (d->modes.axis[i].mode == MODE_VELOCITY) {
        in.target_umps = jogging(d, i, on);
    } else if (d->modes.axis[i].mode == MODE_HOMING) {
        in.up_umps2 = in.down_umps2 = od->homing_acceleration;
        in.target_umps = homing(d, i, on);
        in.min_nm = INT32_MIN;
        in.max_nm = INT32_MAX;
    }
    if (quick(d, i)) {
        in.down_umps2 = od->quick_stop_deceleration;
    }
    return in;
}

static void begin(struct drive *d)
{
    const struct knot start = drive_reference(d);
    drive_begin(d, start, 0);
    for (int i = 0; i < 2; i++) {
        profile_start(&d->modes.axis[i].profile, start.nm[i]);
    }
    d->modes.generating = true;
    d->modes.ending = false;
}

/* Knots up to PROFILE_AHEAD before path time. The path is complete at any time: when it stands, its last knots do. */
static void make_knots(struct drive *d, const struct profile_in in[2])
{
    struct axis_mode *a = d->modes.axis;
    const struct od_stream *s = d->queue.stream;
    while (!d->modes.ending && s->accepted - s->executed < PROFILE_AHEAD) {
        const struct knot knot = {{profile_step(&a[0].profile, &in[0]), profile_step(&a[1].profile, &in[1])}};
        if (queue_push(&d->queue, knot) != QUEUE_TAKEN) {
            break; /* outside the limits; drive_poll() reports it */
        }
        d->modes.ending = in[0].target_umps == 0 && profile_rests(&a[0].profile) && in[1].target_umps == 0 &&
                          profile_rests(&a[1].profile);
    }
    if (d->modes.ending) {
        (void)queue_end(&d->queue, s->accepted);
    }
    atomic_store(&d->loop.command.complete, true);
}

/* The way has come to its end, or was stopped. */
static void follow_end(struct drive *d)
{
    struct axis_modes *m = &d->modes;
    if (!m->generating || !drive_in_step(d)) {
        return;
    }
    const bool at_end = atomic_load(&d->loop.at_end);
    if (at_end && !m->ending) {
        drive_fault(d, FAULT_UNDERRUN); /* nobody made knots for PROFILE_AHEAD milliseconds */
    }
    if (at_end || !drive_powered(d)) { /* a fault that stops the axes on the path switches them off there */
        m->generating = false;
        queue_close(&d->queue);
    }
}

void axis_modes_poll(struct drive *d)
{
    struct axis_modes *m = &d->modes;
    struct profile_in in[2];
    follow_end(d);
    bool wanted = false;
    for (int i = 0; i < 2; i++) {
        take_mode(d, i);
        in[i] = plan(d, i);
        m->axis[i].controlword = d->axis[i].controlword;
        wanted = wanted || in[i].target_umps != 0;
    }
    if (wanted && idle(d) && drive_in_step(d)) {
        begin(d);
    }
    if (m->generating) {
        for (int i = 0; i < 2; i++) {
            if (m->axis[i].mode == MODE_HOMING) {
                queue_unlimited(&d->queue, i);
            }
        }
        make_knots(d, in);
    }
    for (int i = 0; i < 2; i++) {
        shift_origin(d, i);
    }
}

/* ---- status ---- */

static unsigned homing_status(const struct homing *h, bool stands)
{
    const unsigned still = stands ? SW_TARGET_REACHED : 0u;
    switch (h->state) {
    case HOMING_NONE: return still;
    case HOMING_DONE: return SW_HOMING_ATTAINED | SW_TARGET_REACHED;
    case HOMING_FAILING: return SW_HOMING_ERROR;
    case HOMING_FAILED: return SW_HOMING_ERROR | still;
    default: return 0;
    }
}

static unsigned velocity_status(const struct axis_mode *a, bool generating, bool stands)
{
    const bool reached = generating ? profile_reached(&a->profile, a->wish_umps) : a->wish_umps == 0 && stands;
    const bool limited = a->limited || (generating && a->profile.limited);
    return (reached ? SW_TARGET_REACHED : 0u) | (limited ? SW_INTERNAL_LIMIT : 0u) | (stands ? SW_SPEED_0 : 0u);
}

uint16_t axis_modes_status(const struct drive *d, int axis)
{
    const struct axis_mode *a = &d->modes.axis[axis];
    const uint8_t stream = d->queue.stream->state;
    if (a->mode == MODE_HOMING) {
        return (uint16_t)homing_status(&a->homing, axis_modes_stands(d, axis));
    }
    if (a->mode == MODE_VELOCITY) {
        return (uint16_t)velocity_status(a, d->modes.generating, axis_modes_stands(d, axis));
    }
    if (!axis_modes_follows_stream(d)) {
        return 0;
    }
    return (uint16_t)((stream == STREAM_RUNNING || stream == STREAM_STOPPING ? SW_IP_ACTIVE : 0u) |
                      (stream == STREAM_DONE ? SW_TARGET_REACHED : 0u));
}

/* ---- records ---- */

bool axis_modes_may_start(const struct drive *d)
{
    const struct od_stream *s = d->queue.stream;
    const uint32_t stop = d->od->limits.path_stop_time / 2u + 4u;
    return s->state != STREAM_FILLING || !d->modes.by_record ||
           s->accepted >= stop + 2u * d->modes.record.ms + RECORD_JITTER || queue_complete(&d->queue);
}

uint32_t axis_modes_record(struct drive *d, struct knot record)
{
    struct od_stream *s = d->queue.stream;
    if (!d->queue.open || s->state == STREAM_DONE) {
        const uint32_t code = drive_begin_at(d, drive_reference(d), record);
        if (code != SDO_OK) {
            s->rejected_state++;
            return code;
        }
        d->modes.by_record = true;
    }
    if (d->modes.generating || d->modes.by_frame) {
        s->rejected_state++;
        return SDO_ABORT_STATE;
    }
    if (s->free < d->modes.record.ms) {
        s->rejected_full++;
        return SDO_ABORT_STATE;
    }
    for (unsigned k = 0; k < d->modes.record.ms; k++) {
        if (drive_push(d, record_step(&d->modes.record, record)) != QUEUE_TAKEN) {
            return SDO_ABORT_STATE;
        }
    }
    return SDO_OK;
}

uint32_t axis_modes_check_write(struct drive *d, const struct od_entry *entry, int64_t value)
{
    const int axis = entry->index >= 0x6000 + AXIS_STEP ? 1 : 0;
    switch (entry->index - axis * AXIS_STEP) {
    case 0x605A: return value == 3 || value == 4 ? SDO_ABORT_VALUE : SDO_OK;
    case 0x6060: return mode_known(value) ? SDO_OK : SDO_ABORT_VALUE;
    case 0x6098: return homing_method_known(value) ? SDO_OK : SDO_ABORT_VALUE;
    case 0x60C1:
        return axis == 0 ? SDO_OK
                         : axis_modes_record(d, (struct knot){{d->od->axis[0].ip_record.position, (int32_t)value}});
    case 0x60C2: return d->queue.open && d->queue.stream->state != STREAM_DONE ? SDO_ABORT_STATE : SDO_OK;
    case 0x60C4: return entry->sub == 6 && value == 0 ? drive_stream_command(d, 2) : SDO_OK;
    default: return SDO_OK;
    }
}
