/* SPDX-License-Identifier: Apache-2.0 */
#include "drive/drive.h"

#include <stddef.h>

#include "drive/configuration.h"
#include "drive/excite.h"

/* Whether an axis is in operation enabled with a live amplifier. */
static bool enabled(const struct drive *d, int i)
{
    return cia402_enabled(&d->axis[i]) && d->amplifier[i].state == AMPLIFIER_LIVE;
}

static bool both_enabled(const struct drive *d)
{
    return enabled(d, 0) && enabled(d, 1);
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

/* ---- the step ---- */

/* A capture that a fault or a warning triggered stays until the fault is reset or the axes get power. Then the scope is
 * armed again. */
static void release_capture(struct drive *d)
{
    if (scope_holds_fault(&d->loop.scope)) {
        (void)scope_arm(&d->loop.scope, d->od, d->path.queue.origin_nm);
    }
}

/* Whether an axis without power moves: it coasts, or somebody moves it. */
static bool coasting(const struct drive *d)
{
    const struct servo_snapshot *s = &d->loop.snapshot;
    const int32_t least = (int32_t)(d->od->limits.velocity / 100u);
    for (int i = 0; i < 2; i++) {
        if (!cia402_powered(&d->axis[i]) && (s->velocity_umps[i] > least || s->velocity_umps[i] < -least)) {
            return true;
        }
    }
    return false;
}

/* A stop goes on as it began. */
static void take_options(struct cia402 *axis, const struct od_axis *od)
{
    if (axis->state != CIA402_QUICK_STOP_ACTIVE) {
        axis->quick_stop = od->quick_stop_option;
    }
    if (axis->standing == axis->state) {
        axis->shutdown = od->shutdown_option;
        axis->disable = od->disable_option;
    }
}

/* Act on the controlword of one axis. `fresh`: it has just come. */
static void take_controlword(struct drive *d, int i, bool fresh, bool may_enable)
{
    struct cia402 *axis = &d->axis[i];
    const bool was_fault = axis->state == CIA402_FAULT;
    const bool permitted =
        fresh && command_guard_permits(&d->command_guard, i, axis->changes, d->od->claim_required != 0, drive_now(d));
    take_options(axis, &d->od->axis[i]);
    cia402_command(axis, d->od->axis[i].controlword, may_enable && permitted);
    if (fresh && cia402_enable_pending(axis)) {
        command_guard_refused(&d->command_guard, i, drive_now(d));
        if (may_enable) { /* all other conditions hold, so the command guard refused it */
            fault_monitor_event(&d->fault_monitor, FAULT_STALE_COMMAND);
        }
    }
    if (was_fault && axis->state != CIA402_FAULT) {
        d->od->axis[i].error_code = 0;
    }
}

/* Both axes have left the state fault: clear the latched faults. */
static void reset_faults(struct drive *d)
{
    if (d->faults != 0) {
        release_capture(d);
    }
    (void)atomic_fetch_and(&d->loop.faults, ~d->faults); /* the tick may have raised another one meanwhile */
    d->faults = 0;
}

/* Bit 0, 1 of `received`: the controlword of axis 0, 1 is fresh. An old one enables nothing. */
static void take_controlwords(struct drive *d, unsigned received)
{
    const bool moves = coasting(d);
    /* From the second snapshot on it is known where the axes are by the new configuration. An axis that is enabled makes
     * the path start anew, which the other one can follow from standstill only. */
    const bool may_enable =
        d->faults == 0 && !moves && d->path.progress.standing && d->loop.snapshot.ms - d->configured_ms >= 2u;
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

/* On which axes the law is active */
static void get_held(const struct drive *d, bool held[2])
{
    for (int i = 0; i < 2; i++) {
        held[i] = amplifier_holds(&d->amplifier[i]);
    }
}

/* The tick reads the words that were written for it. */
static bool command_intact(const struct drive *d)
{
    const struct servo_loop_command *c = &d->loop.command;
    bool intact = atomic_load(&c->controller) == d->od->controller.select &&
                  atomic_load(&c->configured) == d->configured && atomic_load(&c->stream) == d->path.stream;
    for (int i = 0; i < 2; i++) {
        intact = intact && atomic_load(&c->powered[i]) == amplifier_word(&d->amplifier[i]) &&
                 (!amplifier_holds(&d->amplifier[i]) ||
                  servo_loop_simulated(&d->loop) == cfg_in_use(d)->onchip_plant.simulated);
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
    configuration_servo_loop(d->od, &d->loop.cfg[next % 2u]);
    d->configured = next;
    atomic_store(&d->loop.command.configured, next);
    if (hal->drive_configure != NULL) {
        struct hal_axis_cfg cfg[AXES];
        configuration_hal(d->od, cfg);
        hal->drive_configure(hal->ctx, cfg);
    }
}

/* The soft limits of the next path */
static void limit_path(struct drive *d)
{
    for (int i = 0; i < 2; i++) {
        d->path.queue.min_nm[i] = d->od->axis[i].position_limit.min;
        d->path.queue.max_nm[i] = d->od->axis[i].position_limit.max;
    }
}

static void seal(struct drive *d, bool reset)
{
    integrity_seal(&d->integrity, cfg_in_use(d), sizeof *cfg_in_use(d), d->od, reset);
}

void drive_configure(struct drive *d, bool reset)
{
    configure(d);
    limit_path(d);
    seal(d, reset);
}

void drive_configure_live(struct drive *d)
{
    configuration_live(d->od, &d->loop.cfg[d->configured % 2u]);
    limit_path(d);
    seal(d, false);
}

/* A bit has flipped: switch the power off, and make a state in which FAULT_MEMORY can be reset. */
static void restore_memory(struct drive *d)
{
    for (int i = 0; i < 2; i++) {
        cia402_fault(&d->axis[i], false);
        atomic_store(&d->loop.command.powered[i], SERVO_LOOP_OFF);
    }
    atomic_store(&d->loop.command.controller, d->od->controller.select);
    atomic_store(&d->loop.command.stream, d->path.stream);
    d->faults = 0; /* the flipped bit may be one of these */
    if (!d->integrity.corrupt) {
        drive_configure(d, false);
    }
}

/* Whether a stream or set-points have run an axis into a limit switch. Profiles stop there without a fault. */
static bool path_on_switch(const struct drive *d)
{
    unsigned inputs = 0;
    for (int i = 0; i < 2; i++) {
        inputs |= axis_modes_led(&d->path.modes, i) ? d->loop.snapshot.inputs[i] : 0u;
    }
    return !d->path.progress.standing && (inputs & (HAL_LIMIT_MIN | HAL_LIMIT_MAX)) != 0;
}

/* Faults of the set-points of cyclic modes */
static uint32_t find_refused(const struct drive *d)
{
    static const uint32_t bits[CYCLIC_MISSED + 1] = {[CYCLIC_TAKEN] = 0,
                                                     [CYCLIC_ACCELERATION] = FAULT_BIT(FAULT_KNOT_ACCELERATION),
                                                     [CYCLIC_RANGE] = FAULT_BIT(FAULT_KNOT_RANGE),
                                                     [CYCLIC_MISSED] = FAULT_BIT(FAULT_UNDERRUN)};
    return bits[axis_modes_refused(&d->path.modes, 0)] | bits[axis_modes_refused(&d->path.modes, 1)];
}

/* FAULT_BIT()s of what is wrong now, whatever the reaction. */
static uint32_t find_faults(struct drive *d, const struct drive_in *in)
{
    const struct queue *queue = &d->path.queue;
    bool held[2];
    get_held(d, held);
    const struct fault_monitor_in monitor = {.od = d->od,
                                             .snapshot = &d->loop.snapshot,
                                             .powered = held,
                                             .enable_refused = d->enable_refused,
                                             .parameters_invalid = in->parameters_invalid};
    return fault_monitor_step(&d->fault_monitor, &monitor) | atomic_load(&d->loop.faults) |
           (in->heartbeat_lost ? FAULT_BIT(FAULT_HEARTBEAT) : 0u) |
           (queue->open && queue->outside ? FAULT_BIT(FAULT_KNOT_RANGE) : 0u) |
           (queue->open && queue->over_acceleration ? FAULT_BIT(FAULT_KNOT_ACCELERATION) : 0u) | find_refused(d) |
           (d->path.ran_out ? FAULT_BIT(FAULT_UNDERRUN) : 0u) |
           (path_on_switch(d) ? FAULT_BIT(FAULT_LIMIT_SWITCH) : 0u);
}

/* Of several new faults the one that the tick saw first is latched first. */
static void supervise(struct drive *d, const struct drive_in *in)
{
    if (!memory_intact(d)) {
        servo_loop_raise(&d->loop, FAULT_MEMORY); /* the next tick cuts the power, whatever happens here */
        restore_memory(d);
        drive_fault(d, FAULT_MEMORY);
    }
    const uint32_t warn = fault_mask(d->od, REACT_WARN);
    const uint32_t raised = find_faults(d, in);
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

/* Carry out the transitions that waited for standstill and for the brake, and then what the controlword commands in the
 * new state. */
static void settle(struct drive *d)
{
    for (int i = 0; i < 2; i++) {
        const bool stands = axis_modes_stands(&d->path.modes, i, d->path.progress.standing);
        const bool leaves = stands && cia402_leaves(&d->axis[i]);
        const bool free = amplifier_engage(&d->amplifier[i], &d->od->axis[i], leaves, d->loop.snapshot.ms);
        if (stands && free) {
            cia402_standstill(&d->axis[i]);
        }
    }
    take_controlwords(d, 0);
}

/* Decide which axes have power from now on, and hold, suspend or end the path accordingly. */
static void switch_power(struct drive *d)
{
    bool was_held[2];
    bool held[2];
    bool off = false;
    get_held(d, was_held);
    for (int i = 0; i < 2; i++) {
        const bool wanted = cia402_powered(&d->axis[i]);
        off = off || (d->amplifier[i].state != AMPLIFIER_OFF && !wanted);
        amplifier_step(&d->amplifier[i], &d->od->axis[i], wanted, d->loop.snapshot.inputs[i], d->loop.snapshot.ms);
    }
    get_held(d, held);
    const bool on = (held[0] && !was_held[0]) || (held[1] && !was_held[1]);
    if (on) {
        path_power_on(&d->path, d->od, was_held);
    }
    if (on && !was_held[0] && !was_held[1]) {
        release_capture(d); /* the capture of a warning: that of a fault was released at its reset */
    }
    if (off && !d->path.modes.generating) {
        path_power_off(&d->path);
    }
    if (off || both_enabled(d)) {
        command_guard_disarm(&d->command_guard);
    }
}

static void get_axes(const struct drive *d, struct path_axis axis[2])
{
    for (int i = 0; i < 2; i++) {
        const struct cia402 *a = &d->axis[i];
        axis[i] = (struct path_axis){
            .controlword = a->controlword,
            .enabled = enabled(d, i),
            .powered = amplifier_holds(&d->amplifier[i]),
            .quick_stop = a->state == CIA402_QUICK_STOP_ACTIVE ? a->quick_stop : NO_QUICK_STOP,
        };
    }
}

static bool may_run(const struct drive *d)
{
    struct path_axis axis[2];
    get_axes(d, axis);
    return path_may_run(&d->path, d->od, axis, d->faults != 0);
}

/* Update the progress of the path, and step the modes of operation. */
static void follow_path(struct drive *d)
{
    const bool run = may_run(d);
    struct path_axis axis[2];
    if (!path_follow(&d->path, run, drive_powered(d))) {
        drive_fault(d, FAULT_UNDERRUN);
    }
    get_axes(d, axis);
    path_step_modes(&d->path, d->od, axis, run);
}

/* Whether an axis may be excited: it is in operation enabled, and is not halted. */
static bool may_excite(const struct drive *d, unsigned i)
{
    return enabled(d, (int)i) && (d->axis[i].controlword & CW_HALT) == 0;
}

/* Write the words that the tick reads, except those of the path (path.c). */
static void write_command(struct drive *d)
{
    struct servo_loop_command *c = &d->loop.command;
    for (int i = 0; i < 2; i++) {
        atomic_store(&c->powered[i], amplifier_word(&d->amplifier[i]));
    }
    atomic_store(&c->rate, path_rate(&d->path, d->od));
    atomic_store(&c->run, may_run(d));
    atomic_store(&c->kept, (uint16_t)(d->faults == 0 ? d->od->outputs_kept : 0u));
    if (atomic_load(&c->excite) == SERVO_LOOP_EXCITE && !may_excite(d, d->loop.excitation.cfg.axis % 2u)) {
        excite_end(&d->loop);
    }
}

static unsigned state_bits(const struct drive *d, int i)
{
    const enum amplifier_state amplifier = d->amplifier[i].state;
    return cia402_statusword(&d->axis[i], amplifier == AMPLIFIER_LIVE || amplifier == AMPLIFIER_ENGAGING);
}

/* Bit 13 of 6041h in modes 1 and 8 */
static unsigned following_error(const struct drive *d, int i)
{
    const struct od_axis *axis = &d->od->axis[i];
    const int8_t mode = d->path.modes.axis[i].mode;
    const int64_t error = axis->following_error;
    const bool far = error > axis->following_window || error < -(int64_t)axis->following_window;
    return far && (mode == MODE_PROFILE_POSITION || mode == MODE_CYCLIC_POSITION) ? SW_FOLLOWING_ERROR : 0u;
}

static void report_status(struct drive *d)
{
    enum { SET_BRAKE = 1 }; /* bit 0 of 60FEh:1 */
    const unsigned warning = d->warnings != 0 || d->node_warns ? SW_WARNING : 0u;
    path_report_outputs(&d->path, &d->od->outputs);
    for (int i = 0; i < 2; i++) {
        const unsigned mode = axis_modes_status(&d->path.modes, i, d->od->stream.state, d->path.progress.standing) |
                              following_error(d, i);
        d->od->axis[i].mode_display = d->path.modes.axis[i].mode;
        d->od->axis[i].statusword = (uint16_t)(state_bits(d, i) | mode | warning);
        const uint32_t brake = amplifier_released(&d->amplifier[i]) ? 0u : SET_BRAKE;
        d->od->axis[i].digital_outputs.physical = (uint32_t)d->od->outputs.digital << 16 | brake;
    }
}

void drive_step(struct drive *d, const struct drive_in *in)
{
    path_read(&d->path);
    if (in->received != 0) {
        take_controlwords(d, in->received);
    }
    supervise(d, in);
    settle(d);
    switch_power(d);
    follow_path(d);
    write_command(d);
    d->node_warns = in->node_warns;
    report_status(d);
}

void drive_statusword_sent(struct drive *d, int axis)
{
    const unsigned now = state_bits(d, axis);
    if (((now ^ d->od->axis[axis].statusword) & SW_STATE) == 0) {
        command_guard_sent(&d->command_guard, axis, d->axis[axis].changes);
    }
}

/* ---- requests ---- */

void drive_set_point(struct drive *d, int axis)
{
    axis_modes_set_point(&d->path.modes, axis);
}

void drive_sync(struct drive *d)
{
    path_sync(&d->path, d->od);
}

uint32_t drive_stream_command(struct drive *d, uint8_t command)
{
    struct path_axis axis[2];
    get_axes(d, axis);
    path_read(&d->path);
    const uint32_t code = path_command(&d->path, d->od, axis, command);
    report_status(d); /* bit 10 of the path before is gone before the answer is sent */
    return code;
}

uint32_t drive_record(struct drive *d, struct knot record)
{
    struct path_axis axis[2];
    get_axes(d, axis);
    path_read(&d->path);
    const uint32_t code = path_record(&d->path, d->od, axis, record);
    report_status(d);
    return code;
}

void drive_stop(struct drive *d)
{
    path_read(&d->path);
    for (int i = 0; i < 2; i++) {
        d->od->axis[i].controlword = (uint16_t)(d->od->axis[i].controlword & ~(unsigned)CW_QUICK_STOP);
        cia402_stop(&d->axis[i]);
    }
    take_controlwords(d, 0);
    switch_power(d);
    write_command(d);
}

void drive_reset(struct drive *d)
{
    path_read(&d->path);
    for (int i = 0; i < 2; i++) {
        cia402_init(&d->axis[i]);
        d->od->axis[i].error_code = 0;
    }
    axis_modes_reset(&d->path.modes);
    switch_power(d);
    write_command(d); /* the power goes off first, so that the tick moves nothing from here on */
    atomic_store(&d->loop.command.controller, d->od->controller.select);
    path_reset(&d->path, &d->od->stream);
    drive_configure(d, true);
    (void)scope_arm(&d->loop.scope, d->od, d->path.queue.origin_nm);
}

void drive_init(struct drive *d, struct od_data *od, const struct hal *hal, struct spline_ring *ring)
{
    *d = (struct drive){.od = od};
    servo_loop_init(&d->loop, hal, ring);
    path_init(&d->path, &d->loop, ring, &od->stream);
    drive_reset(d);
}

uint32_t drive_excite(struct drive *d, bool begin)
{
    excite_end(&d->loop);
    if (!begin) {
        return SDO_OK;
    }
    return may_excite(d, d->od->excitation.axis) ? excite_begin(&d->loop, d->od) : SDO_ABORT_STATE;
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
    return scope_arm(&d->loop.scope, d->od, d->path.queue.origin_nm) ? SDO_OK : SDO_ABORT_INCOMPATIBLE;
}
