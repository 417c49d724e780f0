/* SPDX-License-Identifier: Apache-2.0 */
#include "drive/drive.h"

#include <stddef.h>

static bool both_enabled(const struct drive *d)
{
    return cia402_enabled(&d->axis[0]) && cia402_enabled(&d->axis[1]);
}

bool drive_powered(const struct drive *d)
{
    return cia402_powered(&d->axis[0]) || cia402_powered(&d->axis[1]);
}

void drive_fault(struct drive *d, enum fault f)
{
    const bool stop_first = fault_reaction(d->od, f) == REACT_PATH_STOP;
    d->first = d->faults == 0 ? (uint8_t)f : d->first;
    d->faults |= FAULT_BIT(f);
    scope_fault(&d->loop.scope, FAULT_BIT(f));
    for (int i = 0; i < 2; i++) {
        struct od_axis *axis = &d->od->axis[i];
        cia402_fault(&d->axis[i], stop_first);
        axis->error_code = axis->error_code == 0 ? fault_table[f].emcy : axis->error_code;
    }
}

struct knot drive_position(struct drive *d)
{
    const struct servo_snapshot *s = servo_loop_snapshot(&d->loop);
    return queue_user(&d->queue, (struct knot){{s->position_nm[0], s->position_nm[1]}});
}

struct knot drive_reference(struct drive *d)
{
    const struct servo_snapshot *s = servo_loop_snapshot(&d->loop);
    const struct knot at = {{s->reference_nm[0], s->reference_nm[1]}};
    return queue_user(&d->queue, d->queue.stream->state == STREAM_IDLE ? d->queue.ring.start : at);
}

/* Path time starts anew, on other knots. */
static void restart(struct drive *d)
{
    atomic_store(&d->loop.command.complete, false);
    atomic_store(&d->loop.command.rest, false);
    d->begun++;
    atomic_store(&d->loop.command.begin, d->begun);
}

void drive_hold(struct drive *d)
{
    struct knot start = drive_reference(d);
    for (int i = 0; i < 2; i++) {
        if (!d->powered[i]) {
            start.nm[i] = drive_position(d).nm[i];
        }
    }
    queue_hold(&d->queue, start);
    restart(d);
}

void drive_begin(struct drive *d, struct knot start, uint32_t total)
{
    queue_begin(&d->queue, start, total);
    restart(d);
}

void drive_shift_origin(struct drive *d, int axis, int32_t origin_nm)
{
    const struct servo_snapshot *s = servo_loop_snapshot(&d->loop);
    const struct knot at = {{s->reference_nm[0], s->reference_nm[1]}};
    const struct knot servo = d->queue.stream->state == STREAM_IDLE ? d->queue.ring.start : at;
    d->queue.origin_nm[axis] = origin_nm;
    atomic_store(&d->loop.command.origin_nm[axis], origin_nm);
    queue_hold(&d->queue, queue_user(&d->queue, servo));
    d->od->axis[axis].position_actual = drive_position(d).nm[axis]; /* what was told before is no more */
    restart(d);
}

uint32_t drive_scope_command(struct drive *d, uint8_t command)
{
    if (command == SCOPE_COMMAND_OFF) {
        scope_off(&d->loop.scope);
        return SDO_OK;
    }
    if (command == SCOPE_COMMAND_DEFAULTS) {
        od_restore(d->od, 0, 0x2300, 0x2301);
    }
    return scope_arm(&d->loop.scope, d->od, d->queue.origin_nm) ? SDO_OK : SDO_ABORT_INCOMPATIBLE;
}

bool drive_in_step(const struct drive *d)
{
    return atomic_load(&d->loop.begun) == atomic_load(&d->loop.command.begin);
}

bool drive_stands(const struct drive *d)
{
    return atomic_load(&d->loop.standing);
}

static bool run_wanted(const struct drive *d)
{
    if (d->modes.generating) { /* the axes stop by themselves, but for a fault, which stops both on the path */
        return d->faults == 0;
    }
    if (!axis_modes_follows_stream(d) || !axis_modes_may_start(d)) {
        return false;
    }
    for (int i = 0; i < 2; i++) {
        const uint16_t cw = d->axis[i].controlword;
        if (!cia402_enabled(&d->axis[i]) || (cw & CW_ENABLE_IP) == 0 || (cw & CW_HALT) != 0) {
            return false;
        }
    }
    return d->queue.stream->state != STREAM_IDLE && !d->queue.suspended;
}

static bool within_start_window(const struct drive *d, struct knot a, struct knot b)
{
    const int64_t window = d->od->limits.start_window;
    for (int i = 0; i < 2; i++) {
        const int64_t distance = (int64_t)a.nm[i] - b.nm[i];
        if (distance > window || -distance > window) {
            return false;
        }
    }
    return true;
}

/* The axes get power. They are held where they stand, but on a path that can go on, where that stands. */
static void take_up(struct drive *d)
{
    const bool may_go_on = d->queue.suspended && d->queue.stream->state == STREAM_STOPPED;
    if (!may_go_on || !within_start_window(d, drive_position(d), d->left_at)) {
        drive_hold(d);
    }
}

/* They lose it: a path that stands may go on later. */
static void let_go(struct drive *d)
{
    if (drive_stands(d) && drive_in_step(d)) {
        d->left_at = drive_reference(d);
        queue_suspend(&d->queue);
    } else {
        queue_close(&d->queue);
    }
}

/* What the scope holds of a fault or a warning is done with. */
static void release_capture(struct drive *d)
{
    if (scope_holds_fault(&d->loop.scope)) {
        (void)scope_arm(&d->loop.scope, d->od, d->queue.origin_nm);
    }
}

/* Power and path as the axes' states want them. */
static void apply(struct drive *d)
{
    bool off = false;
    bool on = false;
    for (int i = 0; i < 2; i++) {
        const bool powered = cia402_powered(&d->axis[i]);
        off = off || (d->powered[i] && !powered);
        on = on || (!d->powered[i] && powered);
    }
    if (on) {
        take_up(d);
    }
    if (on && !d->powered[0] && !d->powered[1]) {
        release_capture(d); /* of a warning: that of a fault went with it */
    }
    if (off && !d->modes.generating) {
        let_go(d);
    }
    if (off || both_enabled(d)) {
        command_guard_disarm(&d->command_guard);
    }
    for (int i = 0; i < 2; i++) {
        d->powered[i] = cia402_powered(&d->axis[i]);
        atomic_store(&d->loop.command.powered[i], d->powered[i] ? SERVO_LOOP_ON : SERVO_LOOP_OFF);
    }
    atomic_store(&d->loop.command.rate, d->modes.generating ? 1000u : d->od->feed_override);
    atomic_store(&d->loop.command.run, run_wanted(d));
}

/* An axis without power is on its way: it runs out, or somebody moves it. */
static bool moving(struct drive *d)
{
    const int32_t least = (int32_t)(d->od->limits.velocity / 100u);
    const struct servo_snapshot *s = servo_loop_snapshot(&d->loop);
    for (int i = 0; i < 2; i++) {
        if (!cia402_powered(&d->axis[i]) && (s->velocity_umps[i] > least || s->velocity_umps[i] < -least)) {
            return true;
        }
    }
    return false;
}

uint32_t drive_now(const struct drive *d)
{
    return atomic_load(&d->loop.ticks);
}

void drive_told(struct drive *d, int axis)
{
    const unsigned now = cia402_statusword(&d->axis[axis]);
    if (((now ^ d->od->axis[axis].statusword) & SW_STATE) == 0) {
        command_guard_sent(&d->command_guard, axis, d->axis[axis].changes);
    }
}

/* A controlword for one axis; `fresh`: one that has just come, and not one that had to wait. */
static void obey(struct drive *d, int i, bool fresh, bool may_enable)
{
    struct cia402 *axis = &d->axis[i];
    const bool was_fault = axis->state == CIA402_FAULT;
    const bool permitted =
        fresh && command_guard_permits(&d->command_guard, i, axis->changes, d->od->claim_required != 0, drive_now(d));
    axis->quick_stop = d->od->axis[i].quick_stop_option;
    cia402_command(axis, d->od->axis[i].controlword, may_enable && permitted);
    if (fresh && cia402_waits(axis)) {
        command_guard_refused(&d->command_guard, i, drive_now(d));
        if (may_enable) { /* else that is why */
            fault_monitor_event(&d->fault_monitor, FAULT_STALE_COMMAND);
        }
    }
    if (was_fault && axis->state != CIA402_FAULT) {
        d->od->axis[i].error_code = 0;
    }
}

void drive_command(struct drive *d, unsigned received)
{
    const bool is_moving = moving(d);
    /* where the axes stand is known in the units of the configuration from the second snapshot on; an axis that joins
     * in makes the path start anew, which the other one can follow from standstill only */
    const bool may_enable =
        d->faults == 0 && !is_moving && drive_stands(d) && atomic_load(&d->loop.published) - d->configured_at >= 2u;
    d->refused = false;
    for (int i = 0; i < 2; i++) {
        obey(d, i, (received >> i & 1u) != 0, may_enable);
        d->refused = d->refused || (is_moving && cia402_waits(&d->axis[i]));
    }
    if (d->axis[0].state != CIA402_FAULT && d->axis[1].state != CIA402_FAULT && !drive_powered(d)) {
        if (d->faults != 0) {
            release_capture(d);
        }
        (void)atomic_fetch_and(&d->loop.faults, ~d->faults); /* the tick may have raised another one meanwhile */
        d->faults = 0;
    }
    apply(d);
}

void drive_stop(struct drive *d)
{
    for (int i = 0; i < 2; i++) {
        d->od->axis[i].controlword = (uint16_t)(d->od->axis[i].controlword & ~(unsigned)CW_QUICK_STOP);
        cia402_stop(&d->axis[i]);
    }
    drive_command(d, 0);
}

void drive_reset(struct drive *d)
{
    const int32_t origin_nm[2] = {d->queue.origin_nm[0], d->queue.origin_nm[1]};
    for (int i = 0; i < 2; i++) {
        cia402_init(&d->axis[i]);
        d->od->axis[i].error_code = 0;
    }
    axis_modes_reset(d);
    apply(d); /* power off first: from here on the tick moves nothing */
    atomic_store(&d->loop.command.controller, d->od->controller.select);
    queue_init(&d->queue, &d->od->stream);
    d->queue.origin_nm[0] = origin_nm[0];
    d->queue.origin_nm[1] = origin_nm[1];
    drive_configure(d, true);
    drive_hold(d);
    (void)scope_arm(&d->loop.scope, d->od, origin_nm);
}

void drive_init(struct drive *d, struct od_data *od, const struct hal *hal)
{
    *d = (struct drive){.od = od};
    servo_loop_init(&d->loop, hal, &d->queue.ring);
    queue_init(&d->queue, &od->stream);
    drive_reset(d);
}

/* Path time has run through an open-ended stream as far as it can. */
static void end_at_rest(struct drive *d)
{
    struct od_stream *s = d->queue.stream;
    if (queue_rests(&d->queue) && s->accepted - s->executed <= 4u) { /* no knot has come meanwhile */
        queue_executed(&d->queue, s->accepted);
        queue_close(&d->queue);
        s->state = STREAM_DONE;
    }
}

static void follow_stream(struct drive *d)
{
    struct od_stream *s = d->queue.stream;
    if (!drive_in_step(d)) {
        return;
    }
    const bool at_end = atomic_load(&d->loop.at_end); /* before `executed`, which then is the whole */
    const bool starved = atomic_load(&d->loop.starved);
    queue_executed(&d->queue, atomic_load(&d->loop.executed));
    s->underruns += starved && !d->starved ? 1u : 0u;
    d->starved = starved;
    if (s->state == STREAM_IDLE || s->state == STREAM_DONE) {
        return;
    }
    if (at_end && d->queue.total == 0 && !d->modes.generating) {
        end_at_rest(d);
    } else if (at_end) {
        s->state = STREAM_DONE;
    } else if (!drive_stands(d)) {
        s->state = atomic_load(&d->loop.command.run) ? STREAM_RUNNING : STREAM_STOPPING;
    } else if (s->state != STREAM_FILLING || !d->queue.open) {
        s->state = STREAM_STOPPED;
    }
}

/* A stream has run into a limit switch; who jogs or homes stops there without a fault. */
static bool on_switch(struct drive *d)
{
    const struct servo_snapshot *s = servo_loop_snapshot(&d->loop);
    return axis_modes_follows_stream(d) && !drive_stands(d) &&
           ((s->inputs[0] | s->inputs[1]) & (HAL_LIMIT_MIN | HAL_LIMIT_MAX)) != 0;
}

/* What holds now, stops the axes or is warned of; of several that are new the first one in time comes first. */
static void take_faults(struct drive *d)
{
    const struct fault_monitor_in in = {.od = d->od,
                                        .snapshot = servo_loop_snapshot(&d->loop),
                                        .powered = d->powered,
                                        .refused = d->refused,
                                        .store_lost = d->store_lost};
    const uint32_t warn = fault_mask(d->od, REACT_WARN);
    const uint32_t raised = fault_monitor_step(&d->fault_monitor, &in) | atomic_load(&d->loop.faults) |
                            (d->queue.open && d->queue.outside ? FAULT_BIT(FAULT_KNOT_RANGE) : 0u) |
                            (d->queue.open && d->queue.sharp ? FAULT_BIT(FAULT_KNOT_ACCELERATION) : 0u) |
                            (on_switch(d) ? FAULT_BIT(FAULT_LIMIT_SWITCH) : 0u);
    const unsigned first = atomic_load(&d->loop.first);
    for (unsigned i = 0; i < FAULTS; i++) {
        const unsigned f = (first + i) % FAULTS;
        if ((raised & ~warn & ~d->faults & FAULT_BIT(f)) != 0) {
            drive_fault(d, (enum fault)f);
        }
    }
    scope_warning(&d->loop.scope, raised & warn & ~d->warnings & FAULTS_CAPTURED);
    d->warnings = raised & warn;
}

void drive_poll(struct drive *d)
{
    if (!drive_intact(d)) {
        servo_loop_raise(&d->loop,
                         FAULT_MEMORY); /* cuts the power with the next tick, whatever the background makes of it */
        drive_mend(d);
        drive_fault(d, FAULT_MEMORY);
    }
    take_faults(d);
    for (int i = 0; i < 2; i++) {
        cia402_poll(&d->axis[i], axis_modes_stands(d, i));
    }
    drive_command(d, 0); /* what had to wait; but nothing is enabled by an old command */
    follow_stream(d);
    axis_modes_poll(d);
    apply(d);
    for (int i = 0; i < 2; i++) {
        d->od->axis[i].mode_display = d->modes.axis[i].mode;
        d->od->axis[i].statusword = (uint16_t)(cia402_statusword(&d->axis[i]) | axis_modes_status(d, i) |
                                               (d->warnings != 0 || d->node_warns ? SW_WARNING : 0u));
    }
}

/* After a knot: the tick learns where the path may end. */
static enum queue_result taken(struct drive *d, enum queue_result result)
{
    if (result == QUEUE_TAKEN) {
        const bool complete = queue_complete(&d->queue);
        atomic_store(&d->loop.command.rest, !complete && d->queue.total == 0 && queue_rests(&d->queue));
        if (complete) {
            atomic_store(&d->loop.command.complete, true);
        }
    }
    return result;
}

/* A stream may begin, and does so where the axes are held. */
static bool near(struct drive *d, struct knot start)
{
    return both_enabled(d) && within_start_window(d, start, drive_reference(d)) && axis_modes_follows_stream(d);
}

static void begin_stream(struct drive *d, struct knot start, uint32_t total)
{
    drive_begin(d, start, total);
    queue_limit_acceleration(&d->queue, d->od->limits.acceleration);
    d->modes.by_record = d->modes.by_frame = false;
    record_start(&d->modes.record, d->od->axis[0].ip_period.value, start);
}

/* Command 3. Bit 4 must be clear: it is what starts the motion. */
static uint32_t resume_stream(struct drive *d)
{
    const unsigned bits = d->axis[0].controlword | d->axis[1].controlword;
    if (!both_enabled(d) || (bits & CW_ENABLE_IP) != 0 || !queue_resume(&d->queue)) {
        return SDO_ABORT_STATE;
    }
    return SDO_OK;
}

uint32_t drive_stream_command(struct drive *d, uint8_t command)
{
    const struct od_stream *s = d->queue.stream;
    const struct knot start = {{s->start_x, s->start_y}};
    if (!drive_stands(d) || atomic_load(&d->loop.command.run)) {
        return SDO_ABORT_STATE;
    }
    if (command == 2) {
        drive_hold(d);
        return SDO_OK;
    }
    if (command == 3) {
        return resume_stream(d);
    }
    if (!near(d, start) || s->total == 1 || s->total == 2) {
        return SDO_ABORT_STATE;
    }
    begin_stream(d, start, s->total);
    return SDO_OK;
}

uint32_t drive_begin_at(struct drive *d, struct knot start, struct knot first)
{
    const struct od_axis *axis = d->od->axis;
    if (!drive_stands(d) || !near(d, first) || axis[0].ip_period.value != axis[1].ip_period.value) {
        return SDO_ABORT_STATE;
    }
    begin_stream(d, start, 0);
    return SDO_OK;
}

uint32_t drive_stream_total(struct drive *d, uint32_t total)
{
    const bool open_ended = d->queue.open && d->queue.total == 0 && !d->modes.generating;
    if (!open_ended || total == 0) {
        return SDO_OK; /* for the next stream */
    }
    if (!queue_end(&d->queue, total)) {
        return SDO_ABORT_STATE;
    }
    (void)taken(d, QUEUE_TAKEN);
    return SDO_OK;
}

enum queue_result drive_knot(struct drive *d, const struct od_knot *frame)
{
    if (d->modes.generating) {
        d->queue.stream->rejected_state++;
        return QUEUE_NOT_OPEN;
    }
    const enum queue_result result = taken(d, queue_frame(&d->queue, frame));
    d->modes.by_frame = d->modes.by_frame || result == QUEUE_TAKEN;
    return result;
}

enum queue_result drive_push(struct drive *d, struct knot knot)
{
    return taken(d, queue_push(&d->queue, knot));
}
