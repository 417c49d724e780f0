/* SPDX-License-Identifier: Apache-2.0 */
#include "drive/drive.h"

#include <stddef.h>

#include "drive/configuration.h"

/* What the servo tells at the beginning of a step. */
struct servo_view {
    const struct servo_snapshot *snapshot;
    struct path_progress path;
};

static struct path_progress path_progress(const struct drive *d)
{
    const struct servo_loop *loop = &d->loop;
    struct path_progress p;
    p.current = atomic_load(&loop->begun) == atomic_load(&loop->command.begin);
    p.standing = atomic_load(&loop->standing);
    p.at_end = atomic_load(&loop->at_end); /* before `executed`, which is all knots then */
    p.starved = atomic_load(&loop->starved);
    p.executed = atomic_load(&loop->executed);
    return p;
}

static struct servo_view read_servo(struct drive *d)
{
    return (struct servo_view){.snapshot = servo_loop_snapshot(&d->loop), .path = path_progress(d)};
}

static bool both_enabled(const struct drive *d)
{
    return cia402_enabled(&d->axis[0]) && cia402_enabled(&d->axis[1]);
}

bool drive_powered(const struct drive *d)
{
    return cia402_powered(&d->axis[0]) || cia402_powered(&d->axis[1]);
}

uint32_t drive_now(const struct drive *d)
{
    return atomic_load(&d->loop.ticks);
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

/* ---- where the axes and the path are, in user's positions ---- */

static struct knot position(const struct drive *d, const struct servo_snapshot *s)
{
    return queue_user(&d->queue, (struct knot){{s->position_nm[0], s->position_nm[1]}});
}

struct knot drive_position(struct drive *d)
{
    return position(d, servo_loop_snapshot(&d->loop));
}

static struct knot reference(const struct drive *d, const struct servo_snapshot *s)
{
    const struct knot at = {{s->reference_nm[0], s->reference_nm[1]}};
    return queue_user(&d->queue, d->queue.stream->state == STREAM_IDLE ? d->queue.ring.start : at);
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

/* ---- the knots that the tick reads ---- */

/* The queue has other knots: path time starts anew at its first one. */
static void restart_path(struct drive *d, struct servo_view *v)
{
    atomic_store(&d->loop.command.complete, false);
    atomic_store(&d->loop.command.rest, false);
    d->begin++;
    atomic_store(&d->loop.command.begin, d->begin);
    v->path.current = false;
}

/* Discard the stream. Axes with power are held at their reference, the others where they are. */
static void hold(struct drive *d, struct servo_view *v)
{
    struct knot start = reference(d, v->snapshot);
    for (int i = 0; i < 2; i++) {
        if (!d->powered[i]) {
            start.nm[i] = position(d, v->snapshot).nm[i];
        }
    }
    queue_hold(&d->queue, start);
    restart_path(d, v);
}

static void begin_path(struct drive *d, struct servo_view *v, struct knot start, uint32_t total)
{
    queue_begin(&d->queue, start, total);
    restart_path(d, v);
}

/* At standstill: the user's positions of an axis become the servo's plus origin_nm. Nothing moves. */
static void set_origin(struct drive *d, struct servo_view *v, int axis, int32_t origin_nm)
{
    const struct servo_snapshot *s = v->snapshot;
    const struct knot at = {{s->reference_nm[0], s->reference_nm[1]}};
    const struct knot servo = d->queue.stream->state == STREAM_IDLE ? d->queue.ring.start : at;
    d->queue.origin_nm[axis] = origin_nm;
    atomic_store(&d->loop.command.origin_nm[axis], origin_nm);
    queue_hold(&d->queue, queue_user(&d->queue, servo));
    d->od->axis[axis].position_actual = position(d, s).nm[axis];
    restart_path(d, v);
}

/* Knots have come: tell the tick where the path may end. */
static enum queue_result report_knots(struct drive *d, enum queue_result result)
{
    if (result == QUEUE_ACCEPTED) {
        const bool complete = queue_complete(&d->queue);
        atomic_store(&d->loop.command.rest, !complete && d->queue.total == 0 && queue_ends_standing(&d->queue));
        if (complete) {
            atomic_store(&d->loop.command.complete, true);
        }
    }
    return result;
}

/* ---- the step ---- */

/* The scope keeps what led to a fault or a warning. That has been dealt with: arm it again. */
static void release_capture(struct drive *d)
{
    if (scope_holds_fault(&d->loop.scope)) {
        (void)scope_arm(&d->loop.scope, d->od, d->queue.origin_nm);
    }
}

/* An axis without power moves: it coasts, or somebody moves it. */
static bool coasting(const struct drive *d, const struct servo_snapshot *s)
{
    const int32_t least = (int32_t)(d->od->limits.velocity / 100u);
    for (int i = 0; i < 2; i++) {
        if (!cia402_powered(&d->axis[i]) && (s->velocity_umps[i] > least || s->velocity_umps[i] < -least)) {
            return true;
        }
    }
    return false;
}

/* The controlword of one axis; `fresh`: it has just come. */
static void take_controlword(struct drive *d, int i, bool fresh, bool may_enable)
{
    struct cia402 *axis = &d->axis[i];
    const bool was_fault = axis->state == CIA402_FAULT;
    const bool permitted =
        fresh && command_guard_permits(&d->command_guard, i, axis->changes, d->od->claim_required != 0, drive_now(d));
    axis->quick_stop = d->od->axis[i].quick_stop_option;
    cia402_command(axis, d->od->axis[i].controlword, may_enable && permitted);
    if (fresh && cia402_enable_pending(axis)) {
        command_guard_refused(&d->command_guard, i, drive_now(d));
        if (may_enable) { /* so the guard refused it */
            fault_monitor_event(&d->fault_monitor, FAULT_STALE_COMMAND);
        }
    }
    if (was_fault && axis->state != CIA402_FAULT) {
        d->od->axis[i].error_code = 0;
    }
}

/* Both axes have left the state fault. */
static void reset_faults(struct drive *d)
{
    if (d->faults != 0) {
        release_capture(d);
    }
    (void)atomic_fetch_and(&d->loop.faults, ~d->faults); /* the tick may have raised another one meanwhile */
    d->faults = 0;
}

/* Bit 0, 1 of `received`: the controlword of axis 0, 1 is fresh. An old one enables nothing. */
static void take_controlwords(struct drive *d, const struct servo_view *v, unsigned received)
{
    const bool moves = coasting(d, v->snapshot);
    /* From the second snapshot on it is known where the axes are by the new configuration. An axis that is enabled makes
     * the path start anew, which the other one can follow from standstill only. */
    const bool may_enable = d->faults == 0 && !moves && v->path.standing && v->snapshot->ms - d->configured_ms >= 2u;
    d->enable_refused = false;
    for (int i = 0; i < 2; i++) {
        take_controlword(d, i, (received >> i & 1u) != 0, may_enable);
        d->enable_refused = d->enable_refused || (moves && cia402_enable_pending(&d->axis[i]));
    }
    if (d->axis[0].state != CIA402_FAULT && d->axis[1].state != CIA402_FAULT && !drive_powered(d)) {
        reset_faults(d);
    }
}

static const struct servo_loop_cfg *cfg_in_use(const struct drive *d)
{
    return &d->loop.cfg[d->configured % 2u];
}

static bool at_fault(const struct drive *d)
{
    bool at = false;
    for (int i = 0; i < 2; i++) {
        at = at || d->axis[i].state == CIA402_FAULT || d->axis[i].state == CIA402_FAULT_REACTION_ACTIVE;
    }
    return at;
}

/* The tick reads the words that were written for it. */
static bool command_intact(const struct drive *d)
{
    const struct servo_loop_command *c = &d->loop.command;
    bool intact = atomic_load(&c->controller) == d->od->controller.select &&
                  atomic_load(&c->configured) == d->configured && atomic_load(&c->begin) == d->begin;
    for (int i = 0; i < 2; i++) {
        intact = intact && atomic_load(&c->powered[i]) == (d->powered[i] ? SERVO_LOOP_ON : SERVO_LOOP_OFF) &&
                 (!d->powered[i] || servo_loop_simulated(&d->loop) == cfg_in_use(d)->onchip_plant.simulated);
    }
    return intact;
}

static bool memory_intact(struct drive *d)
{
    return integrity_intact(&d->integrity, cfg_in_use(d), sizeof *cfg_in_use(d), d->od) && cia402_intact(&d->axis[0]) &&
           cia402_intact(&d->axis[1]) && command_intact(d) && at_fault(d) == (d->faults != 0);
}

/* Hand over the configuration that the parameters make. */
static void configure(struct drive *d)
{
    const uint32_t next = atomic_load(&d->loop.command.configured) + 1u;
    const struct hal *hal = d->loop.hal;
    d->configured_ms = atomic_load(&d->loop.published);
    d->loop.cfg[next % 2u] = configuration_servo_loop(d->od);
    d->configured = next;
    atomic_store(&d->loop.command.configured, next);
    if (hal->drive_configure != NULL) {
        struct hal_axis_cfg cfg[AXES];
        configuration_hal(d->od, cfg);
        hal->drive_configure(hal->ctx, cfg);
    }
    for (int i = 0; i < 2; i++) {
        d->queue.min_nm[i] = d->od->axis[i].position_limit.min;
        d->queue.max_nm[i] = d->od->axis[i].position_limit.max;
    }
}

void drive_configure(struct drive *d, bool all)
{
    configure(d);
    integrity_seal(&d->integrity, cfg_in_use(d), sizeof *cfg_in_use(d), d->od, all);
}

/* A bit has flipped: no power, and a state in which FAULT_MEMORY can be reset. */
static void restore_memory(struct drive *d)
{
    for (int i = 0; i < 2; i++) {
        cia402_fault(&d->axis[i], false);
        d->powered[i] = false;
        atomic_store(&d->loop.command.powered[i], SERVO_LOOP_OFF);
    }
    atomic_store(&d->loop.command.controller, d->od->controller.select);
    atomic_store(&d->loop.command.begin, d->begin);
    d->faults = 0; /* they may have been the bit */
    if (!d->integrity.lost) {
        drive_configure(d, false);
    }
}

/* A stream has run into a limit switch. Profile velocity and homing stop there without a fault. */
static bool stream_on_switch(const struct drive *d, const struct servo_view *v)
{
    const unsigned inputs = (unsigned)v->snapshot->inputs[0] | v->snapshot->inputs[1];
    return axis_modes_follow_stream(&d->modes) && !v->path.standing && (inputs & (HAL_LIMIT_MIN | HAL_LIMIT_MAX)) != 0;
}

/* FAULT_BIT()s of what is wrong now, whatever the reaction. */
static uint32_t find_faults(struct drive *d, const struct servo_view *v, const struct drive_in *in)
{
    const struct fault_monitor_in monitor = {.od = d->od,
                                             .snapshot = v->snapshot,
                                             .powered = d->powered,
                                             .refused = d->enable_refused,
                                             .store_lost = in->parameters_invalid};
    return fault_monitor_step(&d->fault_monitor, &monitor) | atomic_load(&d->loop.faults) |
           (d->queue.open && d->queue.outside ? FAULT_BIT(FAULT_KNOT_RANGE) : 0u) |
           (d->queue.open && d->queue.sharp ? FAULT_BIT(FAULT_KNOT_ACCELERATION) : 0u) |
           (stream_on_switch(d, v) ? FAULT_BIT(FAULT_LIMIT_SWITCH) : 0u);
}

/* Of several new faults the one that the tick saw first is latched first. */
static void supervise(struct drive *d, const struct servo_view *v, const struct drive_in *in)
{
    if (!memory_intact(d)) {
        servo_loop_raise(&d->loop, FAULT_MEMORY); /* the next tick cuts the power, whatever happens here */
        restore_memory(d);
        drive_fault(d, FAULT_MEMORY);
    }
    const uint32_t warn = fault_mask(d->od, REACT_WARN);
    const uint32_t raised = find_faults(d, v, in);
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

/* Transitions that waited for standstill, and what the controlword asks for after them. */
static void settle(struct drive *d, const struct servo_view *v)
{
    for (int i = 0; i < 2; i++) {
        if (axis_modes_stands(&d->modes, i, v->path.standing)) {
            cia402_standstill(&d->axis[i]);
        }
    }
    take_controlwords(d, v, 0);
}

/* Axes get power. They are held where they are, unless a suspended path can go on from there. */
static void power_on(struct drive *d, struct servo_view *v)
{
    const bool may_resume = d->queue.suspended && d->queue.stream->state == STREAM_STOPPED;
    if (!may_resume || !within_start_window(d, position(d, v->snapshot), d->suspended_at)) {
        hold(d, v);
    }
    if (!d->powered[0] && !d->powered[1]) {
        release_capture(d); /* of a warning: that of a fault was released with it */
    }
}

/* Axes lose power. A stream that stands may be resumed. */
static void power_off(struct drive *d, const struct servo_view *v)
{
    if (v->path.standing && v->path.current) {
        d->suspended_at = reference(d, v->snapshot);
        queue_suspend(&d->queue);
    } else {
        queue_close(&d->queue);
    }
}

static void switch_power(struct drive *d, struct servo_view *v)
{
    bool off = false;
    bool on = false;
    for (int i = 0; i < 2; i++) {
        const bool powered = cia402_powered(&d->axis[i]);
        off = off || (d->powered[i] && !powered);
        on = on || (!d->powered[i] && powered);
    }
    if (on) {
        power_on(d, v);
    }
    if (off && !d->modes.generating) {
        power_off(d, v);
    }
    if (off || both_enabled(d)) {
        command_guard_disarm(&d->command_guard);
    }
    for (int i = 0; i < 2; i++) {
        d->powered[i] = cia402_powered(&d->axis[i]);
    }
}

/* Whether path time may run. */
static bool path_may_run(const struct drive *d)
{
    if (d->modes.generating) { /* profiles stop the axes; a fault stops both on the path */
        return d->faults == 0;
    }
    for (int i = 0; i < 2; i++) {
        const uint16_t cw = d->axis[i].controlword;
        if (!cia402_enabled(&d->axis[i]) || (cw & CW_ENABLE_IP) == 0 || (cw & CW_HALT) != 0) {
            return false;
        }
    }
    return axis_modes_follow_stream(&d->modes) && d->queue.stream->state != STREAM_IDLE && !d->queue.suspended &&
           axis_modes_enough_knots(&d->modes, &d->queue, d->od->limits.path_stop_time);
}

static void follow_path(struct drive *d, const struct servo_view *v, bool may_run)
{
    queue_follow(&d->queue, &v->path, may_run, d->modes.generating);
    if (axis_modes_end(&d->modes, &d->queue, &v->path, drive_powered(d))) {
        drive_fault(d, FAULT_UNDERRUN);
    }
}

static struct axis_mode_in axis_mode_in(const struct drive *d, const struct servo_view *v, int i)
{
    const struct cia402 *axis = &d->axis[i];
    const struct servo_snapshot *s = v->snapshot;
    return (struct axis_mode_in){
        .controlword = axis->controlword,
        .enabled = cia402_enabled(axis),
        .powered = d->powered[i],
        .quick_stop = axis->state == CIA402_QUICK_STOP_ACTIVE ? axis->quick_stop : NO_QUICK_STOP,
        .inputs = s->inputs[i],
        .index_pulses = s->index_pulses[i],
        .reference_nm = reference(d, s).nm[i],
        .position_nm = s->position_nm[i],
        .index_nm = s->index_nm[i],
        .edge_nm = s->edge_nm[i],
    };
}

static void step_modes(struct drive *d, struct servo_view *v, bool may_run)
{
    const struct axis_modes_in in = {
        .od = d->od, .path = &v->path, .path_may_run = may_run, .axis = {axis_mode_in(d, v, 0), axis_mode_in(d, v, 1)}};
    struct axis_modes_out out;
    axis_modes_step(&d->modes, &in, &out);
    if (out.hold) {
        hold(d, v);
    }
    if (out.begin) {
        begin_path(d, v, reference(d, v->snapshot), 0);
    }
    if (d->modes.generating) {
        axis_modes_generate(&d->modes, &d->queue);
        atomic_store(&d->loop.command.complete, true); /* at any time: where its last knots are, the path stands */
    }
    for (int i = 0; i < 2; i++) {
        if (out.set_origin[i]) {
            set_origin(d, v, i, out.origin_nm[i]);
        }
    }
}

static void write_command(struct drive *d)
{
    struct servo_loop_command *c = &d->loop.command;
    for (int i = 0; i < 2; i++) {
        atomic_store(&c->powered[i], d->powered[i] ? SERVO_LOOP_ON : SERVO_LOOP_OFF);
    }
    atomic_store(&c->rate, d->modes.generating ? 1000u : d->od->feed_override);
    atomic_store(&c->run, path_may_run(d));
}

static void report_status(struct drive *d, const struct servo_view *v, bool node_warns)
{
    const unsigned warning = d->warnings != 0 || node_warns ? SW_WARNING : 0u;
    for (int i = 0; i < 2; i++) {
        const unsigned mode = axis_modes_status(&d->modes, i, d->queue.stream->state, v->path.standing);
        d->od->axis[i].mode_display = d->modes.axis[i].mode;
        d->od->axis[i].statusword = (uint16_t)(cia402_statusword(&d->axis[i]) | mode | warning);
    }
}

void drive_step(struct drive *d, const struct drive_in *in)
{
    struct servo_view servo = read_servo(d);
    if (in->received != 0) {
        take_controlwords(d, &servo, in->received);
    }
    supervise(d, &servo, in);
    settle(d, &servo);
    switch_power(d, &servo);
    const bool may_run = path_may_run(d);
    follow_path(d, &servo, may_run);
    step_modes(d, &servo, may_run);
    write_command(d);
    report_status(d, &servo, in->node_warns);
}

void drive_statusword_sent(struct drive *d, int axis)
{
    const unsigned now = cia402_statusword(&d->axis[axis]);
    if (((now ^ d->od->axis[axis].statusword) & SW_STATE) == 0) {
        command_guard_sent(&d->command_guard, axis, d->axis[axis].changes);
    }
}

/* ---- from outside the step ---- */

void drive_stop(struct drive *d)
{
    struct servo_view servo = read_servo(d);
    for (int i = 0; i < 2; i++) {
        d->od->axis[i].controlword = (uint16_t)(d->od->axis[i].controlword & ~(unsigned)CW_QUICK_STOP);
        cia402_stop(&d->axis[i]);
    }
    take_controlwords(d, &servo, 0);
    switch_power(d, &servo);
    write_command(d);
}

void drive_reset(struct drive *d)
{
    struct servo_view servo = read_servo(d);
    const int32_t origin_nm[2] = {d->queue.origin_nm[0], d->queue.origin_nm[1]};
    for (int i = 0; i < 2; i++) {
        cia402_init(&d->axis[i]);
        d->od->axis[i].error_code = 0;
    }
    axis_modes_reset(&d->modes);
    switch_power(d, &servo);
    write_command(d); /* power off first: from here on the tick moves nothing */
    atomic_store(&d->loop.command.controller, d->od->controller.select);
    queue_init(&d->queue, &d->od->stream);
    d->queue.origin_nm[0] = origin_nm[0];
    d->queue.origin_nm[1] = origin_nm[1];
    drive_configure(d, true);
    hold(d, &servo);
    (void)scope_arm(&d->loop.scope, d->od, origin_nm);
}

void drive_init(struct drive *d, struct od_data *od, const struct hal *hal)
{
    *d = (struct drive){.od = od};
    servo_loop_init(&d->loop, hal, &d->queue.ring);
    queue_init(&d->queue, &od->stream);
    drive_reset(d);
}

/* A stream may begin: both axes are enabled in interpolated position, within the window of `start`. */
static bool may_begin(const struct drive *d, const struct servo_view *v, struct knot start)
{
    return both_enabled(d) && v->path.standing && within_start_window(d, start, reference(d, v->snapshot)) &&
           axis_modes_follow_stream(&d->modes);
}

static void begin_stream(struct drive *d, struct servo_view *v, struct knot start, uint32_t total)
{
    begin_path(d, v, start, total);
    queue_limit_acceleration(&d->queue, d->od->limits.acceleration);
    axis_modes_begin_stream(&d->modes, d->od->axis[0].ip_period.value, start);
}

/* Command 3. Bit 4 must be clear: setting it starts the motion. */
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
    struct servo_view servo = read_servo(d);
    const struct od_stream *s = d->queue.stream;
    const struct knot start = {{s->start_x, s->start_y}};
    if (!servo.path.standing || atomic_load(&d->loop.command.run)) {
        return SDO_ABORT_STATE;
    }
    if (command == STREAM_COMMAND_DISCARD) {
        hold(d, &servo);
        return SDO_OK;
    }
    if (command == STREAM_COMMAND_RESUME) {
        return resume_stream(d);
    }
    if (!may_begin(d, &servo, start) || s->total == 1 || s->total == 2) {
        return SDO_ABORT_STATE;
    }
    begin_stream(d, &servo, start, s->total);
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
    (void)report_knots(d, QUEUE_ACCEPTED);
    return SDO_OK;
}

enum queue_result drive_push(struct drive *d, struct knot knot)
{
    return report_knots(d, queue_push(&d->queue, knot));
}

enum queue_result drive_knot(struct drive *d, const struct od_knot *frame)
{
    if (d->modes.generating) {
        d->queue.stream->rejected_state++;
        return QUEUE_NOT_OPEN;
    }
    const enum queue_result result = report_knots(d, queue_frame(&d->queue, frame));
    d->modes.by_frame = d->modes.by_frame || result == QUEUE_ACCEPTED;
    return result;
}

/* The first record begins a stream at the reference. */
static bool begin_by_record(struct drive *d, struct knot record)
{
    const struct od_axis *axis = d->od->axis;
    struct servo_view servo = read_servo(d);
    if (!may_begin(d, &servo, record) || axis[0].ip_period.value != axis[1].ip_period.value) {
        return false;
    }
    begin_stream(d, &servo, reference(d, servo.snapshot), 0);
    d->modes.by_record = true;
    return true;
}

uint32_t drive_record(struct drive *d, struct knot record)
{
    struct od_stream *s = d->queue.stream;
    const bool open = d->queue.open && s->state != STREAM_DONE;
    if ((!open && !begin_by_record(d, record)) || d->modes.generating || d->modes.by_frame) {
        s->rejected_state++;
        return SDO_ABORT_STATE;
    }
    if (s->free < d->modes.record.ms) {
        s->rejected_full++;
        return SDO_ABORT_STATE;
    }
    for (unsigned k = 0; k < d->modes.record.ms; k++) {
        if (drive_push(d, ip_record_step(&d->modes.record, record)) != QUEUE_ACCEPTED) {
            return SDO_ABORT_STATE;
        }
    }
    return SDO_OK;
}

uint32_t drive_scope_command(struct drive *d, uint8_t command)
{
    if (command == SCOPE_COMMAND_OFF) {
        scope_off(&d->loop.scope);
        return SDO_OK;
    }
    if (command == SCOPE_COMMAND_DEFAULTS) {
        od_restore(d->od, 0, OBJ_SCOPE, OBJ_SCOPE_CHANNELS);
    }
    return scope_arm(&d->loop.scope, d->od, d->queue.origin_nm) ? SDO_OK : SDO_ABORT_INCOMPATIBLE;
}
