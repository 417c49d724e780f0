/* SPDX-License-Identifier: Apache-2.0 */
#include "drive/path.h"

static const struct servo_snapshot *servo(const struct path *p)
{
    return &p->loop->snapshot;
}

void path_read(struct path *p)
{
    (void)servo_loop_snapshot(p->loop);
    p->progress = servo_loop_progress(p->loop);
}

/* ---- where the axes and the path are, in user's positions ---- */

struct knot path_position(const struct path *p)
{
    return queue_user(&p->queue, (struct knot){{servo(p)->position_nm[0], servo(p)->position_nm[1]}});
}

/* The servo's reference or, while there is no path, the position at which it will be. */
static struct knot servo_reference(const struct path *p)
{
    const struct knot at = {{servo(p)->reference_nm[0], servo(p)->reference_nm[1]}};
    return p->queue.stream->state == STREAM_IDLE ? p->queue.ring->start : at;
}

struct knot path_reference(const struct path *p)
{
    return queue_user(&p->queue, servo_reference(p));
}

static bool within_start_window(const struct od_data *od, struct knot a, struct knot b)
{
    const int64_t window = od->limits.start_window;
    for (int i = 0; i < 2; i++) {
        const int64_t distance = (int64_t)a.nm[i] - b.nm[i];
        if (distance > window || -distance > window) {
            return false;
        }
    }
    return true;
}

/* ---- begin and end ---- */

/* The queue has other knots: path time starts anew at its first one. */
static void restart(struct path *p)
{
    struct servo_loop_command *c = &p->loop->command;
    atomic_store(&c->complete, false);
    atomic_store(&c->may_end, false);
    atomic_store(&c->released, 0u);
    p->stream++;
    p->overflow = false;
    p->short_lag = false;
    atomic_store(&c->stream, p->stream);
    p->progress.current = false;
}

/* Discard the stream. Axes with power are held at their reference, the others where they are. */
static void hold(struct path *p, const bool powered[2])
{
    const struct knot position = path_position(p);
    struct knot start = path_reference(p);
    for (int i = 0; i < 2; i++) {
        start.nm[i] = powered[i] ? start.nm[i] : position.nm[i];
    }
    queue_hold(&p->queue, start);
    restart(p);
}

static void begin(struct path *p, struct knot start, uint32_t total)
{
    queue_begin(&p->queue, start, total);
    restart(p);
}

/* At standstill: the user's positions of an axis become the servo's plus origin_nm. Nothing moves. */
static void set_origin(struct path *p, struct od_data *od, int axis, int32_t origin_nm)
{
    const struct knot at = servo_reference(p);
    p->queue.origin_nm[axis] = origin_nm;
    atomic_store(&p->loop->command.origin_nm[axis], origin_nm);
    queue_hold(&p->queue, queue_user(&p->queue, at));
    od->axis[axis].position_actual = path_position(p).nm[axis];
    restart(p);
}

void path_init(struct path *p, struct servo_loop *loop, struct spline_ring *ring, struct od_stream *stream)
{
    *p = (struct path){.loop = loop};
    queue_init(&p->queue, ring, stream);
}

void path_reset(struct path *p, struct od_stream *stream)
{
    static const bool no_power[2] = {false, false};
    const int32_t origin_nm[2] = {p->queue.origin_nm[0], p->queue.origin_nm[1]};
    queue_init(&p->queue, p->queue.ring, stream);
    p->queue.origin_nm[0] = origin_nm[0];
    p->queue.origin_nm[1] = origin_nm[1];
    hold(p, no_power);
}

void path_power_on(struct path *p, const struct od_data *od, const bool powered[2])
{
    const bool may_resume = p->queue.suspended && p->queue.stream->state == STREAM_STOPPED;
    if (!may_resume || !within_start_window(od, path_position(p), p->suspended_at)) {
        axis_modes_interrupt(&p->modes);
        hold(p, powered);
    }
}

void path_power_off(struct path *p)
{
    if (p->progress.standing && p->progress.current) {
        p->suspended_at = path_reference(p);
        queue_suspend(&p->queue);
    } else {
        queue_close(&p->queue);
    }
}

/* ---- the step ---- */

bool path_may_run(const struct path *p, const struct od_data *od, const struct path_axis axis[2], bool fault)
{
    if (p->modes.generating) { /* profiles stop the axes; a fault stops both on the path */
        return !fault;
    }
    for (int i = 0; i < 2; i++) {
        const uint16_t cw = axis[i].controlword;
        if (!axis[i].enabled || (cw & CW_ENABLE_IP) == 0 || (cw & CW_HALT) != 0) {
            return false;
        }
    }
    return axis_modes_follow_stream(&p->modes) && p->queue.stream->state != STREAM_IDLE && !p->queue.suspended &&
           !p->overflow && axis_modes_enough_knots(&p->modes, &p->queue, od->record_lag);
}

bool path_follow(struct path *p, bool may_run, bool powered)
{
    queue_follow(&p->queue, &p->progress, may_run, p->modes.generating);
    return !axis_modes_end(&p->modes, &p->queue, &p->progress, powered);
}

static struct axis_mode_in axis_mode_in(const struct path *p, const struct path_axis *axis, int i)
{
    const struct servo_snapshot *s = servo(p);
    return (struct axis_mode_in){
        .controlword = axis->controlword,
        .enabled = axis->enabled,
        .powered = axis->powered,
        .quick_stop = axis->quick_stop,
        .inputs = s->inputs[i],
        .index_pulses = s->index_pulses[i],
        .reference_nm = path_reference(p).nm[i],
        .position_nm = (int64_t)s->position_nm[i] - s->correction_nm[i],
        .index_nm = s->index_nm[i],
        .edge_nm = s->edge_nm[i],
    };
}

/* The forces of mode 10, before the word by which they act. */
static void write_forces(struct path *p)
{
    struct servo_loop_command *c = &p->loop->command;
    uint32_t forced = 0;
    for (int i = 0; i < 2; i++) {
        const struct cyclic_torque *t = &p->modes.torque[i];
        if (t->acts) {
            atomic_store(&c->force_mN[i], t->force_mN);
            forced |= i == 0 ? SERVO_LOOP_FORCED_X : SERVO_LOOP_FORCED_Y;
        }
    }
    atomic_store(&c->forced, forced);
}

/* Where records cease on their way, profiles lead on from the last one along the tangent. */
static void bridge(struct path *p, const struct path_axis axis[2], bool may_run)
{
    const struct od_stream *s = p->queue.stream;
    const bool moves = p->progress.current && !p->progress.standing && !p->modes.generating;
    if (p->short_lag && moves && s->accepted - s->executed < CYCLIC_AHEAD && !queue_ends_standing(&p->queue)) {
        p->ran_out = may_run;
        axis_modes_take_over(&p->modes, &p->queue);
    }
    p->ran_out = p->ran_out && axis[0].powered; /* the fault switches both axes off */
}

void path_step_modes(struct path *p, struct od_data *od, const struct path_axis axis[2], bool may_run)
{
    const bool powered[2] = {axis[0].powered, axis[1].powered};
    struct axis_modes_in in = {
        .od = od, .path = &p->progress, .now = atomic_load(&p->loop->ticks), .path_may_run = may_run};
    for (int i = 0; i < 2; i++) {
        in.axis[i] = axis_mode_in(p, &axis[i], i);
    }
    bridge(p, axis, may_run);
    struct axis_modes_out out;
    axis_modes_step(&p->modes, &in, &out);
    if (out.hold) {
        hold(p, powered);
    }
    if (out.begin) {
        begin(p, path_reference(p), 0);
    }
    if (p->modes.generating) {
        axis_modes_generate(&p->modes, &p->queue, od, in.now);
        atomic_store(&p->loop->command.complete, true); /* at any time: the path stands at its last knots */
    }
    for (int i = 0; i < 2; i++) {
        if (out.set_origin[i]) {
            set_origin(p, od, i, out.origin_nm[i]);
        }
    }
    write_forces(p);
}

void path_sync(struct path *p, const struct od_data *od)
{
    axis_modes_sync(&p->modes, od, atomic_load(&p->loop->ticks));
}

/* ---- streams of the master ---- */

static bool both_enabled(const struct path_axis axis[2])
{
    return axis[0].enabled && axis[1].enabled;
}

/* Whether a stream may begin: both axes are enabled in interpolated position, and stand within the window of `start`. */
static bool may_begin(const struct path *p, const struct od_data *od, const struct path_axis axis[2], struct knot start)
{
    return p->progress.standing && both_enabled(axis) && within_start_window(od, start, path_reference(p)) &&
           axis_modes_follow_stream(&p->modes);
}

static void begin_stream(struct path *p, const struct od_data *od, struct knot start, uint32_t total)
{
    begin(p, start, total);
    queue_limit_acceleration(&p->queue, od->limits.acceleration);
    axis_modes_begin_stream(&p->modes, od->axis[0].ip_period.value, start);
}

/* Bit 4 must be clear: setting it starts the motion. */
static bool resume_stream(struct path *p, const struct path_axis axis[2])
{
    const unsigned bits = axis[0].controlword | axis[1].controlword;
    return both_enabled(axis) && (bits & CW_ENABLE_IP) == 0 && queue_resume(&p->queue);
}

/* The knot, plus 1, at which the path is held; 0: it is not. */
static uint32_t held(const struct path *p)
{
    const uint32_t at = atomic_load(&p->loop->hold);
    return p->progress.current && at != atomic_load(&p->loop->command.released) ? at : 0u;
}

/* The path goes on from its hold, once it stands there. */
static uint32_t release(struct path *p)
{
    const uint32_t at = held(p);
    if (at == 0 || !p->progress.standing) {
        return SDO_ABORT_STATE;
    }
    atomic_store(&p->loop->command.released, at);
    return SDO_OK;
}

void path_report_outputs(const struct path *p, struct od_outputs *od)
{
    const uint32_t now = atomic_load(&p->loop->outputs);
    od->digital = (uint16_t)now;
    od->power = (uint16_t)(now >> 16);
    od->changes = p->queue.outputs.changes;
    od->checksum = p->queue.outputs.checksum;
    od->hold = held(p);
}

uint32_t path_command(struct path *p, const struct od_data *od, const struct path_axis axis[2], uint8_t command)
{
    const struct knot start = {{od->stream.start_x, od->stream.start_y}};
    const uint32_t total = od->stream.total;
    if (command == STREAM_COMMAND_RELEASE) {
        return release(p);
    }
    if (!p->progress.standing || atomic_load(&p->loop->command.run)) {
        return SDO_ABORT_STATE;
    }
    if (command == STREAM_COMMAND_DISCARD) {
        const bool powered[2] = {axis[0].powered, axis[1].powered};
        hold(p, powered);
        return SDO_OK;
    }
    if (command == STREAM_COMMAND_RESUME) {
        return resume_stream(p, axis) ? SDO_OK : SDO_ABORT_STATE;
    }
    if (!may_begin(p, od, axis, start) || total == 1 || total == 2) {
        return SDO_ABORT_STATE;
    }
    begin_stream(p, od, start, total);
    return SDO_OK;
}

/* Write for the tick where the path may end. */
static void report_end(struct path *p)
{
    const bool complete = queue_complete(&p->queue);
    atomic_store(&p->loop->command.may_end, !complete && p->queue.total == 0 && queue_ends_standing(&p->queue));
    /* With fewer knots than a stop on the path takes, path time runs on all the same: bridge() sees to it that it does not come
     * to their end. */
    if (complete || (p->short_lag && p->queue.stream->accepted >= CYCLIC_AHEAD)) {
        atomic_store(&p->loop->command.complete, true);
    }
}

uint32_t path_total(struct path *p, uint32_t total)
{
    const bool open_ended = p->queue.open && p->queue.total == 0 && !p->modes.generating;
    if (!open_ended || total == 0) {
        return SDO_OK; /* the total holds for the next stream */
    }
    if (!queue_end(&p->queue, total)) {
        return SDO_ABORT_STATE;
    }
    report_end(p);
    return SDO_OK;
}

enum queue_result path_push(struct path *p, struct knot knot)
{
    const enum queue_result result = queue_push(&p->queue, knot);
    if (result == QUEUE_ACCEPTED) {
        report_end(p);
    }
    return result;
}

enum queue_result path_knot(struct path *p, const struct od_knot *frame)
{
    if (p->modes.generating) {
        p->queue.stream->rejected_state++;
        return QUEUE_NOT_OPEN;
    }
    const enum queue_result result = queue_frame(&p->queue, frame);
    if (result == QUEUE_ACCEPTED) {
        report_end(p);
        p->modes.by_frame = true;
    }
    return result;
}

enum queue_result path_outputs(struct path *p, const struct od_knot_outputs *frame)
{
    if (p->modes.generating) {
        p->queue.stream->rejected_state++;
        return QUEUE_NOT_OPEN;
    }
    return queue_outputs_frame(&p->queue, frame);
}

/* What a stop on the path takes of knots, and what comes late. */
static bool is_short(const struct od_data *od)
{
    return od->record_lag < od->limits.path_stop_time / 2u + RECORD_JITTER;
}

/* Open a stream at the reference, for the first record. */
static bool begin_by_record(struct path *p, const struct od_data *od, const struct path_axis axis[2],
                            struct knot record)
{
    if (!may_begin(p, od, axis, record) || od->axis[0].ip_period.value != od->axis[1].ip_period.value) {
        return false;
    }
    begin_stream(p, od, path_reference(p), 0);
    p->modes.by_record = true;
    p->short_lag = is_short(od);
    return true;
}

uint32_t path_record(struct path *p, const struct od_data *od, const struct path_axis axis[2], struct knot record)
{
    struct od_stream *s = p->queue.stream;
    const bool open = p->queue.open && s->state != STREAM_DONE;
    if (p->overflow || (!open && !begin_by_record(p, od, axis, record)) || p->modes.generating || p->modes.by_frame) {
        s->rejected_state++;
        return SDO_ABORT_STATE;
    }
    if (s->free < p->modes.record.ms) {
        s->rejected_full++;
        p->overflow = true;
        return SDO_ABORT_STATE;
    }
    for (unsigned k = 0; k < p->modes.record.ms; k++) {
        if (path_push(p, ip_record_step(&p->modes.record, record)) != QUEUE_ACCEPTED) {
            return SDO_ABORT_STATE;
        }
    }
    return SDO_OK;
}

/* ---- the clock of a master that sends records ---- */

enum { WAITING = 4096, HASTE = 8 }; /* counts a knot; how much faster the loop is where the lag is short */
#define FOLLOW_MS 512u              /* time over which the number of waiting knots is averaged */

/* With 1/1000 for each knot more than at the start that waits, the loop is damped: it takes 1 s, the average half of it.
 * With a short lag it has an eighth of this time, so that the largest difference of the clocks takes 0.6 knots and not 5.
 * Whatever bit flips, it ends at once, and within PATH_FOLLOW_MAX. */
static int32_t follow(struct path *p, const struct od_data *od)
{
    const struct od_stream *s = p->queue.stream;
    const int32_t waiting = (int32_t)((s->accepted - s->executed) % SPLINE_RING) * WAITING;
    const int32_t passed_ms = (int32_t)((servo(p)->ms - p->follow_ms) % FOLLOW_MS);
    p->follow_ms = servo(p)->ms;
    if (!p->modes.by_record || s->state != STREAM_RUNNING || od->feed_override != od_defaults.feed_override) {
        p->waiting = waiting;
        p->waiting_wanted = waiting;
        return 0;
    }
    const int32_t haste = p->short_lag ? HASTE : 1;
    const int32_t passed = passed_ms * haste < (int32_t)FOLLOW_MS ? passed_ms * haste : (int32_t)FOLLOW_MS;
    p->waiting += (int32_t)(((int64_t)waiting - p->waiting) * passed / (int32_t)FOLLOW_MS);
    const int64_t more = ((int64_t)p->waiting - p->waiting_wanted) * haste / WAITING;
    return more > PATH_FOLLOW_MAX ? PATH_FOLLOW_MAX : more < -PATH_FOLLOW_MAX ? -PATH_FOLLOW_MAX : (int32_t)more;
}

uint16_t path_rate(struct path *p, const struct od_data *od)
{
    const int32_t more = follow(p, od);
    return p->modes.generating ? 1000u : (uint16_t)((int32_t)od->feed_override + more);
}
