/* SPDX-License-Identifier: Apache-2.0 */
#include "drive/servo_loop.h"

#define TICKS_PER_MS (CONTROL_HZ / 1000u)

/* The tick interrupts the background on the same core, or both run in one thread. So its own loads and stores need no
 * barrier: the fences in servo_loop_tick() keep the compiler from moving them out of it. */
#define LOAD(x) atomic_load_explicit(&(x), memory_order_relaxed)
#define STORE(x, value) atomic_store_explicit(&(x), value, memory_order_relaxed)

/* What few periods have to do stands in functions of its own, so that it costs the usual period nothing. */
#define SELDOM __attribute__((noinline, cold))

SELDOM void servo_loop_raise(struct servo_loop *loop, enum fault f)
{
    if (atomic_fetch_or(&loop->faults, FAULT_BIT(f)) == 0) {
        STORE(loop->first, (uint8_t)f);
    }
}

/* The rate of path time that is wanted. The division takes place only when it has changed. */
static num wanted_rate(struct servo_loop *loop)
{
    const uint16_t permille = LOAD(loop->command.rate);
    if (permille != loop->rate_permille) {
        loop->rate_permille = permille;
        loop->rate = n_ratio(permille, 1000);
    }
    return loop->rate;
}

static const path_time_t STEP = PATH_ONE / TICKS_PER_MS;

/* The general case of path time: it starts, stands, or changes its rate. */
__attribute__((noinline)) static void change_path(struct servo_loop *loop, const struct servo_loop_cfg *cfg,
                                                  bool complete, bool run)
{
    const uint32_t stream = LOAD(loop->command.stream);
    if (stream != LOAD(loop->stream)) {
        path_clock_reset(&loop->path);
        loop->servo.spline_cache = (struct spline_cache){0};
        loop->contour_statistics = (struct contour_statistics){0};
        STORE(loop->hold, 0u);
        STORE(loop->outputs, 0u);
    }
    if (LOAD(loop->hold) == LOAD(loop->command.released)) {
        STORE(loop->hold, 0u);
    }
    const struct path_clock_in in = {
        .complete = complete,
        .count = LOAD(loop->ring->count),
        .rate = run ? wanted_rate(loop) : NUM(0),
        .stop_time = cfg->stop_time,
        .step = STEP,
    };
    const bool may_end = LOAD(loop->command.may_end);
    const enum path_clock_event event = path_clock_step(&loop->path, &in);
    if (event == PATH_UNDERRUN && !may_end) {
        servo_loop_raise(loop, FAULT_UNDERRUN);
    }
    const bool standing = !n_lt(NUM(0), loop->path.at.rate);
    const bool slowed = !standing && n_lt(loop->path.at.rate, in.rate);
    STORE(loop->starved, !may_end && (event == PATH_STARVED || (slowed && LOAD(loop->starved))));
    STORE(loop->at_end, event == PATH_AT_END || (event == PATH_UNDERRUN && may_end));
    STORE(loop->standing, standing);
    STORE(loop->executed, path_clock_executed(&loop->path));
    STORE(loop->stream, stream);
}

/* Whether path time may run, as far as the tick knows. */
static inline bool may_run(const struct servo_loop *loop, const struct servo_loop_cfg *cfg)
{
    return LOAD(loop->command.run) && (LOAD(loop->faults) & cfg->stop) == 0 && LOAD(loop->hold) == 0u;
}

/* One control period of path time, with the flags `standing`, `at_end`, `starved` and `executed`. */
static inline void step_path(struct servo_loop *loop, const struct servo_loop_cfg *cfg)
{
    /* `complete` is read before the count, so that a count read too early is never the count of a complete stream. */
    const bool complete = LOAD(loop->command.complete);
    const bool run = may_run(loop, cfg);
    const bool on = run && LOAD(loop->command.rate) == 1000u && LOAD(loop->command.stream) == LOAD(loop->stream);
    if (usually(on && path_clock_run_on(&loop->path, LOAD(loop->ring->count), complete, STEP))) {
        STORE(loop->executed, loop->path.at.knot + 1u);
    } else {
        change_path(loop, cfg, complete, run);
    }
}

/* The power of a knot, at the rate of path time where it goes with that. */
static uint32_t power_of(const struct servo_loop *loop, uint32_t at)
{
    const uint32_t power = at >> 16;
    if ((at & KNOT_BY_RATE) == 0) {
        return power;
    }
    const uint32_t by_rate = power * (uint32_t)n_to_scaled(loop->path.at.rate, 1000) / 1000u;
    return by_rate < UINT16_MAX ? by_rate : UINT16_MAX;
}

/* Where path time is at a knot with a hold it goes no further, unless this one has been released. So it does not go on
 * from a stop either, on the way to which it has passed the hold. */
static void hold_path(struct servo_loop *loop, uint32_t at)
{
    const uint32_t knot = loop->path.at.knot + 1u;
    if ((at & KNOT_HOLD) != 0 && LOAD(loop->command.released) != knot && !LOAD(loop->standing)) {
        STORE(loop->hold, knot);
    }
}

/* Whether the path runs an axis into a limit switch. The background makes a fault of it (FF12h) a millisecond later. */
static bool on_switch(const struct servo_loop *loop)
{
    return !LOAD(loop->standing) && ((loop->inputs[0] | loop->inputs[1]) & (HAL_LIMIT_MIN | HAL_LIMIT_MAX)) != 0;
}

/* Some output beside the axes is on, or the knot that path time is at switches it on. While the path stands or is to
 * stop they are off, but for those that are kept. Without power on both axes, and with what stops them, all are. */
__attribute__((noinline)) static void switch_outputs(struct servo_loop *loop, const struct servo_loop_cfg *cfg,
                                                     uint32_t at, struct hal_drive_out *out)
{
    hold_path(loop, at);
    uint32_t now = 0;
    if (out->enable[0] && out->enable[1] && (LOAD(loop->faults) & cfg->stop) == 0 && !on_switch(loop)) {
        const bool on = may_run(loop, cfg) && LOAD(loop->command.rate) != 0u && !LOAD(loop->standing);
        now = on ? power_of(loop, at) << 16 | (at & KNOT_DIGITAL) : LOAD(loop->outputs) & LOAD(loop->command.kept);
    }
    out->digital = (uint16_t)now;
    out->power = (uint16_t)(now >> 16);
    STORE(loop->outputs, now);
}

SELDOM static void supervise_inputs(struct servo_loop *loop, unsigned inputs)
{
    if ((inputs & HAL_AMPLIFIER_FAULT) != 0) {
        servo_loop_raise(loop, FAULT_AMPLIFIER);
    }
    if ((inputs & HAL_ENCODER_FAULT) != 0) {
        servo_loop_raise(loop, FAULT_ENCODER);
    }
    if ((inputs & HAL_STOP) != 0) {
        servo_loop_raise(loop, FAULT_STOP);
    }
    if (loop->servo.disagree) {
        servo_loop_raise(loop, FAULT_SECOND_ENCODER);
    }
}

/* If any value in the law is no finite number, the velocity or the model's force is none, too. */
static bool finite(const struct servo_loop *loop, const struct servo_out *out)
{
    const vec2 model = loop->servo.demand[loop->servo.slot % 2u].model;
    const vec2 zero = v2_add(v2_sub(out->velocity, out->velocity), v2_sub(model, model));
    return n_finite(n_add(zero.x, zero.y));
}

static void supervise_axis(struct servo_loop *loop, const struct servo_loop_cfg *cfg, int i, num e_w, num speed)
{
    if (encoder_jumped(&loop->encoder[i], cfg->jump_counts[i])) {
        servo_loop_raise(loop, FAULT_ENCODER_JUMP);
    }
    if (!n_lt(n_abs(speed), cfg->speed_max)) {
        servo_loop_raise(loop, FAULT_OVERSPEED);
    }
    if (!n_lt(cfg->following_max[i], n_abs(e_w))) {
        loop->following_ticks[i] = 0;
        return;
    }
    /* The axis is beyond a position limit by more than the following error may be, and moves out from its reference. Or
     * it is so far from where it was at power-on that no reference is there. This is the cause, so it is raised
     * first. */
    const pos_t servo = loop->servo.observer[i].pos;
    const pos_t user = servo + pos_from_nm(LOAD(loop->command.origin_nm[i]));
    if (servo > pos_from_nm(INT32_MAX) || servo < pos_from_nm(INT32_MIN) ||
        (n_lt(e_w, NUM(0)) ? user < pos_add(pos_from_nm(cfg->min_nm[i]), n_neg(cfg->following_max[i]))
                           : user > pos_add(pos_from_nm(cfg->max_nm[i]), cfg->following_max[i]))) {
        servo_loop_raise(loop, FAULT_TRAVEL);
    }
    if (++loop->following_ticks[i] > cfg->following_ticks[i]) {
        servo_loop_raise(loop, FAULT_FOLLOWING);
    }
}

/* What the fault inputs of an axis say. Without power a "ready" output says nothing. */
static inline unsigned watched(const struct servo_loop_cfg *cfg, const struct hal_drive_in *in, const bool powered[2],
                               int i)
{
    return in->inputs[i] & ~(powered[i] ? 0u : cfg->ready[i]);
}

SELDOM static void supervise_in_detail(struct servo_loop *loop, const struct servo_loop_cfg *cfg,
                                       const struct hal_drive_in *in, const bool powered[2],
                                       const struct servo_out *out)
{
    supervise_inputs(loop, watched(cfg, in, powered, 0) | watched(cfg, in, powered, 1));
    if (!finite(loop, out)) {
        servo_loop_raise(loop, FAULT_LAW);
        loop->configured = UINT32_MAX; /* The state has to be reset: the next tick takes the configuration over anew. */
        return;
    }
    const num e_w[2] = {out->contour.e_w.x, out->contour.e_w.y};
    const num speed[2] = {out->velocity.x, out->velocity.y};
    for (int i = 0; i < 2; i++) {
        if (powered[i]) {
            supervise_axis(loop, cfg, i, e_w[i], speed[i]);
        } else {
            loop->following_ticks[i] = 0;
        }
    }
}

/* The usual period: nothing is wrong with an axis, with or without power, and one condition finds that out. */
static inline void supervise(struct servo_loop *loop, const struct servo_loop_cfg *cfg, const struct hal_drive_in *in,
                             const bool powered[2], const struct servo_out *out)
{
    const unsigned inputs = (unsigned)in->inputs[0] | in->inputs[1];
    const vec2 v = out->velocity;
    const vec2 e_w = out->contour.e_w;
    const vec2 model = loop->servo.demand[loop->servo.slot % 2u].model;
    if ((inputs & (HAL_AMPLIFIER_FAULT | HAL_ENCODER_FAULT | HAL_STOP)) == 0 && !loop->servo.disagree &&
        !encoder_jumped(&loop->encoder[0], cfg->jump_counts[0]) &&
        !encoder_jumped(&loop->encoder[1], cfg->jump_counts[1]) && n_lt(n_abs(v.x), cfg->speed_max) &&
        n_lt(n_abs(v.y), cfg->speed_max) && !n_lt(cfg->following_max[0], n_abs(e_w.x)) &&
        !n_lt(cfg->following_max[1], n_abs(e_w.y)) &&
        n_finite(n_add(n_sub(model.x, model.x), n_sub(model.y, model.y)))) {
        loop->following_ticks[0] = loop->following_ticks[1] = 0;
    } else {
        supervise_in_detail(loop, cfg, in, powered, out);
    }
}

/* The position at the edge of a limit switch, exact to a control period however late the background is. */
SELDOM static void latch_edges(struct servo_loop *loop, const struct hal_drive_in *in, const pos_t measured[2])
{
    for (int i = 0; i < 2; i++) {
        if (((in->inputs[i] ^ loop->inputs[i]) & (HAL_LIMIT_MIN | HAL_LIMIT_MAX)) != 0) {
            const vec2 placed = loop->servo.placed;
            loop->encoder[i].edge_nm = pos_to_nm(pos_add(measured[i], i == 0 ? placed.x : placed.y));
        }
        loop->inputs[i] = in->inputs[i];
    }
}

static inline void read_axis_for_geometry(struct servo_loop *loop, const struct servo_loop_cfg *cfg,
                                          const struct hal_drive_in *in, struct servo_table_in *table, int i)
{
    if (cfg->servo.dual_feedback[i].on) { /* the first step makes up for those left out */
        table->second[i] = encoder_step(&loop->second[i], in->second[i]);
    }
    table->origin_nm[i] = LOAD(loop->command.origin_nm[i]);
}

/* What the geometry needs. Not inline, so that it costs nothing where the encoders are at the tool. */
__attribute__((noinline)) static void read_for_geometry(struct servo_loop *loop, const struct servo_loop_cfg *cfg,
                                                        const struct hal_drive_in *in, struct servo_table_in *table)
{
    read_axis_for_geometry(loop, cfg, in, table, 0);
    read_axis_for_geometry(loop, cfg, in, table, 1);
}

/* Counts without wrapping. */
static void count_encoders(struct servo_loop *loop)
{
    for (int i = 0; i < 2; i++) {
        encoder_count(&loop->encoder[i]);
        encoder_count(&loop->second[i]);
    }
}

/* The background changes the number of the configuration without power only. With power one of the two numbers has
 * flipped a bit, but for the first tick and the one after FAULT_LAW. */
SELDOM static bool may_configure(struct servo_loop *loop)
{
    const bool powered =
        LOAD(loop->command.powered[0]) != SERVO_LOOP_OFF || LOAD(loop->command.powered[1]) != SERVO_LOOP_OFF;
    if (powered && loop->configured != UINT32_MAX) {
        servo_loop_raise(loop, FAULT_MEMORY);
        return false;
    }
    return true;
}

/* Use the new configuration, step 1: HAL and encoders. It is called before the tick reads them. */
SELDOM static void select_io(struct servo_loop *loop, uint32_t configured)
{
    loop->cfg_in_use = &loop->cfg[configured % 2u];
    loop->io = onchip_hal_select(&loop->onchip, &loop->cfg_in_use->onchip_plant);
}

/* Use the new configuration, step 2: all other parts. It is called after the tick has read the encoders. */
SELDOM static void configure(struct servo_loop *loop, uint32_t configured, pos_t measured[2])
{
    const struct servo_loop_cfg *cfg = loop->cfg_in_use;
    loop->configured = configured;
    for (int i = 0; i < 2; i++) {
        encoder_scale(&loop->encoder[i], cfg->encoder_10fm[i]);
        measured[i] = loop->encoder[i].pos;
        encoder_scale(&loop->second[i], cfg->second_10fm[i]);
        loop->second[i].pos +=
            encoder_position_before(&loop->encoder[i], measured[i],
                                    (int32_t)((uint32_t)loop->encoder[i].last - (uint32_t)loop->first_count[i]));
    }
    const struct force_limit_state warm = loop->servo.force_limit;
    servo_reset(&cfg->servo, &loop->servo, measured);
    if (cfg->servo.force_limit.on) { /* a motor does not cool by a change of parameters */
        loop->servo.force_limit.heat[0] = warm.heat[0];
        loop->servo.force_limit.heat[1] = warm.heat[1];
    }
    loop->path.enough = 0; /* `enough` depends on stop_time */
}

void servo_loop_init(struct servo_loop *loop, const struct hal *hal, const struct spline_ring *ring)
{
    struct hal_drive_in in = {0};
    *loop = (struct servo_loop){.hal = hal, .io = hal, .ring = ring};
    onchip_hal_init(&loop->onchip, hal);
    hal->drive_read(hal->ctx, &in);
    for (int i = 0; i < 2; i++) {
        encoder_reset(&loop->encoder[i], in.count[i]);
        encoder_reset(&loop->second[i], in.second[i]);
        loop->second[i].count = 0;
        loop->first_count[i] = in.count[i];
        atomic_store(&loop->command.powered[i], SERVO_LOOP_OFF);
    }
    atomic_store(&loop->command.rate, 1000u);
    atomic_store(&loop->standing, true);
    loop->configured = UINT32_MAX; /* no number of a configuration: the first tick takes one over */
    loop->record = &loop->records[1];
}

SELDOM static void reset_energy(struct servo_loop *loop)
{
    STORE(loop->command.energy_reset, false);
    energy_reset(&loop->servo.energy[0]);
    energy_reset(&loop->servo.energy[1]);
}

SELDOM static void reset_oscillation(struct servo_loop *loop)
{
    STORE(loop->command.oscillation_reset, false);
    servo_reset_oscillation(&loop->cfg_in_use->servo, &loop->servo);
}

SELDOM static void end_excitation(struct servo_loop *loop, enum excitation_status status)
{
    STORE(loop->excitation.status, (uint8_t)status);
    STORE(loop->command.excite, 0u);
}

/* Put the excitation on top of the force, within its limit, and correlate. */
__attribute__((noinline)) static void excite(struct servo_loop *loop, const struct servo_in *servo,
                                             const struct hal_drive_in *in, struct servo_out *out)
{
    struct servo_loop_excitation *e = &loop->excitation;
    const uint32_t i = e->cfg.axis % 2u; /* a bit may flip */
    const int32_t moved = (int32_t)((uint32_t)in->second[i] - (uint32_t)e->second_count);
    e->second_count = in->second[i];
    if (!servo->enabled[i] || (LOAD(loop->faults) & (loop->cfg_in_use->cut | loop->cfg_in_use->stop)) != 0) {
        end_excitation(loop, EXCITATION_ENDED);
        return;
    }
    num *const force = i == 0 ? &out->force.x : &out->force.y;
    const num limit = i == 0 ? loop->servo.force_limit.limit.x : loop->servo.force_limit.limit.y;
    const num excited = n_add(*force, excitation_step(&e->cfg, &e->state));
    *force = n_within(excited, limit);
    loop->servo.force = out->force;             /* which heats the motor */
    loop->servo.oscillation[i].half_waves = 0u; /* the answer to it is none */
    if (!n_lt(n_abs(excited), limit)) {
        end_excitation(loop, EXCITATION_AT_LIMIT);
        return;
    }
    const num signal[EXCITATION_SIGNALS] = {
        [EXCITATION_FORCE] = excited,
        [EXCITATION_FIRST] = n_ratio(loop->encoder[i].moved, 1),
        [EXCITATION_SECOND] = n_ratio(moved, 1),
    };
    if (excitation_correlate(&e->cfg, &e->state, signal)) {
        end_excitation(loop, EXCITATION_DONE);
    }
}

/* The law that couples no axes, of the same kind */
static enum controller uncoupled(enum controller c)
{
    return c == CONTROLLER_CASCADE || c == CONTROLLER_CCC ? CONTROLLER_CASCADE : CONTROLLER_TRACK;
}

/* The forces of axes that the master gives (mode 10). A fault that stops the axes ends that at once. There is none
 * where the path stands: at rest, and where the background makes no more knots. */
SELDOM static void take_forces(const struct servo_loop *loop, uint32_t forced, struct servo_in *servo)
{
    if ((LOAD(loop->faults) & loop->cfg_in_use->stop) != 0) {
        return;
    }
    const bool runs = !LOAD(loop->standing);
    servo->forced |= (forced & SERVO_LOOP_FORCED_X) == SERVO_LOOP_FORCED_X ? 1u : 0u;
    servo->forced |= (forced & SERVO_LOOP_FORCED_Y) == SERVO_LOOP_FORCED_Y ? 2u : 0u;
    servo->force = v2(n_ratio(runs ? LOAD(loop->command.force_mN[0]) : 0, 1000),
                      n_ratio(runs ? LOAD(loop->command.force_mN[1]) : 0, 1000));
    if (servo->forced != 0u) {
        servo->controller = uncoupled(servo->controller);
    }
}

/* An axis at least has no power, or less of it than usual. */
SELDOM static void power_of_axes(const struct servo_loop *loop, const struct servo_loop_cfg *cfg,
                                 struct servo_in *servo, struct hal_drive_out *drive)
{
    const bool cut = (LOAD(loop->faults) & cfg->cut) != 0;
    for (int i = 0; i < 2; i++) {
        const uint32_t powered = LOAD(loop->command.powered[i]);
        drive->release[i] = !cut && powered == SERVO_LOOP_ON;
        servo->enabled[i] = drive->release[i] || (!cut && powered == SERVO_LOOP_BRAKED);
        drive->enable[i] = servo->enabled[i] || (!cut && powered == SERVO_LOOP_STARTING);
    }
}

/* Add the contour error of this period to the range of the millisecond. */
SELDOM static void widen_range(struct servo_loop *loop, const pos_t measured[2], const struct contour_out *c)
{
    const struct servo_state *servo = &loop->servo;
    const pos_t *at = servo->extras ? servo->tool : measured;
    const vec2 apart = v2(contour_range_apart(at[0], servo->observer[0].pos, loop->encoder[0].half_count),
                          contour_range_apart(at[1], servo->observer[1].pos, loop->encoder[1].half_count));
    contour_range_step(&loop->contour_range, loop->phase == 0u, c, apart);
}

/* Publish the record, and switch to the next one. */
static inline void publish(struct servo_loop *loop)
{
    const uint32_t ms = LOAD(loop->published) + 1u;
    telemetry_complete(loop->record, ms, &loop->servo, &loop->path.at, &loop->contour_statistics, &loop->contour_range,
                       !LOAD(loop->standing));
    loop->record = &loop->records[(ms + 1u) % SERVO_LOOP_RECORDS];
    atomic_signal_fence(memory_order_release);
    STORE(loop->published, ms);
}

__attribute__((noinline, noclone)) void servo_loop_tick(struct servo_loop *loop)
{
    atomic_signal_fence(memory_order_acquire);
    const uint32_t configured = LOAD(loop->command.configured);
    const bool anew = configured != loop->configured && may_configure(loop);
    struct hal_drive_in in;
    struct servo_table_in table;
    struct servo_in servo;
    struct telemetry_record *record = loop->record;
    struct servo_out *out = &record->out;

    /* read */
    if (anew) {
        select_io(loop, configured);
    }
    const struct servo_loop_cfg *cfg = loop->cfg_in_use;
    loop->io->drive_read(loop->io->ctx, &in);
    for (int i = 0; i < 2; i++) {
        servo.measured[i] = encoder_step(&loop->encoder[i], in.count[i]);
    }
    if (rarely(in.inputs[0] != loop->inputs[0] || in.inputs[1] != loop->inputs[1])) {
        latch_edges(loop, &in, servo.measured);
    }
    if (anew) {
        configure(loop, configured, servo.measured);
    }
    if (cfg->servo.geometry.on) {
        read_for_geometry(loop, cfg, &in, &table);
    }
    if (LOAD(loop->command.energy_reset)) {
        reset_energy(loop);
    }
    if (LOAD(loop->command.oscillation_reset)) {
        reset_oscillation(loop);
    }

    /* reference, law */
    step_path(loop, cfg);
    struct hal_drive_out drive;
    if (usually(LOAD(loop->command.powered[0]) == SERVO_LOOP_ON && LOAD(loop->command.powered[1]) == SERVO_LOOP_ON &&
                (LOAD(loop->faults) & cfg->cut) == 0)) {
        servo.enabled[0] = servo.enabled[1] = true;
        drive.enable[0] = drive.enable[1] = drive.release[0] = drive.release[1] = true;
    } else {
        power_of_axes(loop, cfg, &servo, &drive);
    }
    servo.controller = (enum controller)LOAD(loop->command.controller);
    servo.forced = 0u;
    const uint32_t forced = LOAD(loop->command.forced);
    if (forced != 0u) {
        take_forces(loop, forced, &servo);
    }
    servo.path = loop->path.at;
    servo.ring = loop->ring;
    servo.table = &table;
    servo_step(&cfg->servo, &loop->servo, &servo, out);
    if (LOAD(loop->command.range)) {
        widen_range(loop, servo.measured, &out->contour);
    }

    /* limits */
    supervise(loop, cfg, &in, servo.enabled, out);
    if ((LOAD(loop->faults) & cfg->cut) != 0) {
        drive.enable[0] = drive.enable[1] = drive.release[0] = drive.release[1] = false;
        out->force = v2(NUM(0), NUM(0));
    }
    if (LOAD(loop->command.excite) == SERVO_LOOP_EXCITE) {
        excite(loop, &servo, &in, out);
    }

    /* write */
    drive.force_mN[0] = n_to_scaled(out->force.x, 1000);
    drive.force_mN[1] = n_to_scaled(out->force.y, 1000);
    drive.digital = drive.power = 0;
    const uint32_t outputs = loop->ring->outputs[loop->path.at.knot % SPLINE_RING];
    if ((outputs | LOAD(loop->outputs)) != 0) {
        switch_outputs(loop, cfg, outputs, &drive);
    }
    loop->io->drive_write(loop->io->ctx, &drive);

    /* scope */
    const uint32_t ticks = LOAD(loop->ticks);
    const uint32_t faults = LOAD(loop->faults);
    if (scope_runs(&loop->scope, faults)) {
        const void *const base[SCOPE_BASES] = {
            [SCOPE_BASE_OUT] = out, [SCOPE_BASE_SERVO] = &loop->servo, [SCOPE_BASE_PATH] = &loop->path.at,
            [SCOPE_BASE_IN] = &in,  [SCOPE_BASE_SCOPE] = &loop->scope,
        };
        scope_step(&loop->scope, base, ticks);
    }

    /* telemetry in two periods, each with a part of it; in the other periods a part of the curve ahead */
    STORE(loop->ticks, ticks + 1u);
    loop->phase++; /* not modulo of `ticks`, whose 2^32 are no whole number of milliseconds */
    if (loop->phase == TICKS_PER_MS / 2u) {
        count_encoders(loop);
        telemetry_collect(record, &loop->servo, loop->encoder, &in);
    } else if (loop->phase >= TICKS_PER_MS) {
        loop->phase = 0;
        publish(loop);
    } else if (!loop->servo.extras || loop->servo.slot >= SERVO_SLOTS / 2u) {
        spline_prefetch(&loop->servo.spline_cache, loop->ring, loop->path.at.count, loop->path.at.knot);
    } else { /* friction is computed in this period */
    }
}

const struct servo_snapshot *servo_loop_snapshot(struct servo_loop *loop)
{
    const uint32_t published = atomic_load(&loop->published);
    if (published != loop->snapshot.ms) {
        telemetry_scale(&loop->snapshot, &loop->records[published % SERVO_LOOP_RECORDS], loop->encoder);
    }
    return &loop->snapshot;
}

struct path_progress servo_loop_progress(const struct servo_loop *loop)
{
    struct path_progress p;
    p.current = atomic_load(&loop->stream) == atomic_load(&loop->command.stream);
    p.standing = atomic_load(&loop->standing);
    p.at_end = atomic_load(&loop->at_end); /* before `executed`, which then is the number of all knots */
    p.starved = atomic_load(&loop->starved);
    p.executed = atomic_load(&loop->executed);
    return p;
}
