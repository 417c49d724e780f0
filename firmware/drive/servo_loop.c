/* SPDX-License-Identifier: Apache-2.0 */
#include "drive/servo_loop.h"

#include <string.h>

#define TICKS_PER_MS (CONTROL_HZ / 1000u)

/* The tick interrupts the background on the same core (or both run in one thread): its own loads and stores need no
 * barrier, and the fences in servo_loop_tick() keep the compiler from moving them out of it. */
#define LOAD(x) atomic_load_explicit(&(x), memory_order_relaxed)
#define STORE(x, value) atomic_store_explicit(&(x), value, memory_order_relaxed)

/* What a period seldom has to do is kept out of the way of what it always does. */
#define SELDOM __attribute__((noinline, cold))

SELDOM void servo_loop_raise(struct servo_loop *loop, enum fault f)
{
    if (atomic_fetch_or(&loop->faults, FAULT_BIT(f)) == 0) {
        STORE(loop->first, (uint8_t)f);
    }
}

/* The machine at the connector, or the simulated one, which leaves the outputs off. */
static inline void read_machine(const struct servo_loop *loop, struct hal_drive_in *in)
{
    loop->hal->drive_read(loop->hal->ctx, in);
    if (loop->simulated) {
        onchip_plant_read(&loop->onchip_plant, in);
    }
}

SELDOM static void write_simulated(struct servo_loop *loop, const struct hal_drive_out *out)
{
    static const struct hal_drive_out off;
    loop->hal->drive_write(loop->hal->ctx, &off);
    onchip_plant_step(&loop->use->onchip_plant, &loop->onchip_plant, out);
}

static inline void write_machine(struct servo_loop *loop, const struct hal_drive_out *out)
{
    if (loop->simulated) {
        write_simulated(loop, out);
    } else {
        loop->hal->drive_write(loop->hal->ctx, out);
    }
}

/* Encoder counts since power-on to positions; the counter wraps, the position does not. What a count adds is kept to
 * 2^-48 nm, so that no error adds up. */
static inline void measure(struct servo_loop *loop, const struct hal_drive_in *in, pos_t measured[2])
{
    for (int i = 0; i < 2; i++) {
        struct servo_loop_encoder *e = &loop->encoder[i];
        const int32_t moved = (int32_t)((uint32_t)in->count[i] - (uint32_t)e->last);
        const int64_t rest = (int64_t)moved * e->length_rest + (int64_t)e->rest;
        e->last = in->count[i];
        e->moved = moved;
        e->rest = (uint32_t)rest;
        e->pos += (int64_t)moved * (int64_t)e->length + (rest >> 32);
        e->count += moved;
        measured[i] = e->pos;
    }
}

/* One count is `length` 10 fm: times 65536 / 100000 = 2048 / 3125. Both parts of the position follow from the count. */
static void scale_encoder(struct servo_loop_encoder *e, uint32_t length)
{
    const uint64_t x = (uint64_t)length * 2048u;
    const uint32_t part = (uint32_t)((x % 3125u << 32) / 3125u);
    e->length = (uint32_t)(x / 3125u) + (part >> 31);
    e->length_rest = (int32_t)part;
    const int64_t low = (e->count & 0xFFFF) * (int64_t)e->length_rest;
    const int64_t high = (e->count >> 16) * (int64_t)e->length_rest + (low >> 16);
    e->pos = e->count * (int64_t)e->length + (high >> 16);
    e->rest = (uint32_t)((uint64_t)high << 16) | ((uint32_t)low & 0xFFFFu);
}

/* sigma that the path may run at: a quotient only when it changes */
static num wanted_rate(struct servo_loop *loop)
{
    const uint16_t permille = LOAD(loop->command.rate);
    if (permille != loop->permille) {
        loop->permille = permille;
        loop->rate = n_ratio(permille, 1000);
    }
    return loop->rate;
}

static const path_time_t STEP = PATH_ONE / TICKS_PER_MS;

/* Path time that begins, stands, or changes its rate. */
__attribute__((noinline)) static void change_path(struct servo_loop *loop, const struct servo_loop_cfg *cfg,
                                                  bool complete, bool run)
{
    const uint32_t begin = LOAD(loop->command.begin);
    if (begin != LOAD(loop->begun)) {
        path_clock_reset(&loop->path);
        loop->servo.spline_cache = (struct spline_cache){0};
        loop->error = (struct contour_statistics){0};
    }
    const struct path_clock_in in = {
        .complete = complete,
        .count = LOAD(loop->ring->count),
        .rate = run ? wanted_rate(loop) : NUM(0),
        .stop_time = cfg->stop_time,
        .step = STEP,
    };
    const bool rest = LOAD(loop->command.rest);
    const enum path_clock_event event = path_clock_step(&loop->path, &in);
    if (event == PATH_UNDERRUN && !rest) {
        servo_loop_raise(loop, FAULT_UNDERRUN);
    }
    const bool standing = !n_lt(NUM(0), loop->path.at.rate);
    const bool slowed = !standing && n_lt(loop->path.at.rate, in.rate);
    STORE(loop->starved, !rest && (event == PATH_STARVED || (slowed && LOAD(loop->starved))));
    STORE(loop->at_end, event == PATH_AT_END || (event == PATH_UNDERRUN && rest));
    STORE(loop->standing, standing);
    STORE(loop->executed, path_clock_executed(&loop->path));
    STORE(loop->begun, begin);
}

/* Keeps `standing`, `at_end`, `executed` up to date. */
static inline void follow_path(struct servo_loop *loop, const struct servo_loop_cfg *cfg)
{
    /* `complete` is read before the count: a stream that completes in between counts as not complete yet */
    const bool complete = LOAD(loop->command.complete);
    const bool run = LOAD(loop->command.run) && (LOAD(loop->faults) & cfg->stop) == 0;
    const bool on = run && LOAD(loop->command.rate) == 1000u && LOAD(loop->command.begin) == LOAD(loop->begun);
    if (on && path_clock_run_on(&loop->path, LOAD(loop->ring->count), complete, STEP)) {
        STORE(loop->executed, loop->path.at.knot + 1u);
    } else {
        change_path(loop, cfg, complete, run);
    }
}

SELDOM static void watch_inputs(struct servo_loop *loop, unsigned inputs)
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
}

/* Whatever in the law is no number, the velocity or what was left of the force is none either. */
static bool finite(const struct servo_loop *loop, const struct servo_out *out)
{
    const vec2 model = loop->servo.demand[loop->servo.slot % 2u].model;
    const vec2 nought = v2_add(v2_sub(out->velocity, out->velocity), v2_sub(model, model));
    return n_finite(n_add(nought.x, nought.y));
}

static inline bool jumps(const struct servo_loop *loop, const struct servo_loop_cfg *cfg, int i)
{
    return (uint32_t)loop->encoder[i].moved + cfg->jump_counts[i] > 2u * cfg->jump_counts[i];
}

static void supervise_axis(struct servo_loop *loop, const struct servo_loop_cfg *cfg, int i, num e_w, num speed)
{
    if (jumps(loop, cfg, i)) {
        servo_loop_raise(loop, FAULT_ENCODER_JUMP);
    }
    if (!n_lt(n_abs(speed), cfg->speed_max)) {
        servo_loop_raise(loop, FAULT_OVERSPEED);
    }
    if (!n_lt(cfg->following_max[i], n_abs(e_w))) {
        loop->late[i] = 0;
        return;
    }
    if (++loop->late[i] > cfg->following_ticks[i]) {
        servo_loop_raise(loop, FAULT_FOLLOWING);
    }
    /* further out than the soft limits and than its reference, which may come back from there: lost */
    const pos_t user = loop->servo.observer[i].pos + pos_from_nm(LOAD(loop->command.origin_nm[i]));
    if (n_lt(e_w, NUM(0)) ? user < loop->lowest[i] : user > loop->highest[i]) {
        servo_loop_raise(loop, FAULT_TRAVEL);
    }
}

SELDOM static void look_closer(struct servo_loop *loop, const struct servo_loop_cfg *cfg, unsigned inputs,
                               const bool powered[2], const struct servo_out *out)
{
    watch_inputs(loop, inputs);
    if (!finite(loop, out)) {
        servo_loop_raise(loop, FAULT_LAW);
        loop->configured = UINT32_MAX; /* what is no number stays so: the next tick starts anew */
        return;
    }
    const num e_w[2] = {out->contour.e_w.x, out->contour.e_w.y};
    const num speed[2] = {out->velocity.x, out->velocity.y};
    for (int i = 0; i < 2; i++) {
        if (powered[i]) {
            supervise_axis(loop, cfg, i, e_w[i], speed[i]);
        } else {
            loop->late[i] = 0;
        }
    }
}

/* Mostly nothing is wrong with either axis, powered or not: then nothing more is to be found out. */
static inline void supervise(struct servo_loop *loop, const struct servo_loop_cfg *cfg, const struct hal_drive_in *in,
                             const bool powered[2], const struct servo_out *out)
{
    const unsigned inputs = in->inputs[0] | in->inputs[1];
    const vec2 v = out->velocity;
    const vec2 e_w = out->contour.e_w;
    const vec2 model = loop->servo.demand[loop->servo.slot % 2u].model;
    if ((inputs & (HAL_AMPLIFIER_FAULT | HAL_ENCODER_FAULT | HAL_STOP)) == 0 && !jumps(loop, cfg, 0) &&
        !jumps(loop, cfg, 1) && n_lt(n_abs(v.x), cfg->speed_max) && n_lt(n_abs(v.y), cfg->speed_max) &&
        !n_lt(cfg->following_max[0], n_abs(e_w.x)) && !n_lt(cfg->following_max[1], n_abs(e_w.y)) &&
        n_finite(n_add(n_sub(model.x, model.x), n_sub(model.y, model.y)))) {
        loop->late[0] = loop->late[1] = 0;
    } else {
        look_closer(loop, cfg, inputs, powered, out);
    }
}

/* Where the encoder was at a limit switch's edge: to a control period, however late the background is */
SELDOM static void watch_switches(struct servo_loop *loop, const struct hal_drive_in *in, const pos_t measured[2])
{
    for (int i = 0; i < 2; i++) {
        if (((in->inputs[i] ^ loop->inputs[i]) & (HAL_LIMIT_MIN | HAL_LIMIT_MAX)) != 0) {
            loop->edge_nm[i] = pos_to_nm(measured[i]);
        }
        loop->inputs[i] = in->inputs[i];
    }
}

static void add_error(struct contour_statistics *error, int32_t e_n2_nm)
{
    const uint32_t size = e_n2_nm < 0 ? 0u - (uint32_t)e_n2_nm : (uint32_t)e_n2_nm;
    error->sum_nm += size;
    error->max_nm = size > error->max_nm ? size : error->max_nm;
    error->samples++;
}

/* Of a record, what moves slowly: in another period than the rest, so that none has to do it all. */
__attribute__((noinline)) static void record_slow(struct servo_loop *loop, const struct hal_drive_in *in,
                                                  struct servo_loop_record *r)
{
    for (int i = 0; i < 2; i++) {
        r->energy_mJ[i] = loop->servo.energy[i].mJ;
        r->friction[i] = acc_to(loop->servo.feedforward.friction[i]);
        r->mass[i] = acc_to(loop->servo.feedforward.mass[i]);
        r->measured[i] = loop->encoder[i].pos;
        r->since_index[i] = (int32_t)((uint32_t)in->count[i] - (uint32_t)in->index_count[i]);
        r->index_pulses[i] = in->index_pulses[i];
        r->inputs[i] = in->inputs[i];
        r->edge_nm[i] = loop->edge_nm[i];
        r->count[i] = in->count[i];
    }
}

/* The rest, beside what servo_step() has put there. To scale it for the wire is the background's. */
__attribute__((noinline)) static void publish(struct servo_loop *loop, struct servo_loop_record *r,
                                              enum controller controller)
{
    const uint32_t n = LOAD(loop->published) + 1u;
    r->ms = n;
    for (int i = 0; i < 2; i++) {
        r->position[i] = loop->servo.observer[i].pos;
    }
    if (!LOAD(loop->standing)) {
        add_error(&loop->error, n_to_scaled(r->out.contour.e_n.y, 1000));
    }
    r->error = loop->error;
    r->rate = loop->path.at.rate;
    r->controller = (uint8_t)controller;
    loop->next = &loop->record[(n + 1u) % SERVO_LOOP_RECORDS];
    atomic_signal_fence(memory_order_release);
    STORE(loop->published, n);
}

static void scale(struct servo_loop *loop, const struct servo_loop_record *r)
{
    struct servo_snapshot *s = &loop->snapshot;
    const struct servo_out *o = &r->out;
    const num v[2] = {o->velocity.x, o->velocity.y};
    const num e_w[2] = {o->contour.e_w.x, o->contour.e_w.y};
    const num force[2] = {o->force.x, o->force.y};
    const num k_hat[2] = {o->smc.k_hat.x, o->smc.k_hat.y};
    const num mu[2] = {o->compensator.mu.x, o->compensator.mu.y};
    s->ms = r->ms;
    s->tangential_error_nm = n_to_scaled(o->contour.e_n.x, 1000);
    s->contour_error_nm = n_to_scaled(o->contour.e_n.y, 1000);
    for (int i = 0; i < 2; i++) {
        s->position_nm[i] = pos_to_nm(r->position[i]);
        s->reference_nm[i] = pos_to_nm(pos_add(r->position[i], n_neg(e_w[i])));
        s->velocity_umps[i] = n_to_scaled(v[i], 200);
        s->following_error_nm[i] = n_to_scaled(e_w[i], 1000);
        s->force_dN[i] = n_to_scaled(force[i], 10);
        s->adaptive_gain_per_10s[i] = n_to_scaled(k_hat[i], 2000);
        s->switching_gain_mmps2[i] = n_to_scaled(mu[i], 40);
        s->energy_mJ[i] = r->energy_mJ[i];
        s->feedforward_friction_mN[i] = n_to_scaled(r->friction[i], 1000);
        s->feedforward_mass_g[i] = n_to_scaled(r->mass[i], 25000);
        const struct servo_loop_encoder *e = &loop->encoder[i];
        const int64_t since_index = r->since_index[i];
        s->index_nm[i] = pos_to_nm(r->measured[i] - since_index * (int64_t)e->length -
                                   (since_index * (int64_t)e->length_rest >> 32));
        s->index_pulses[i] = r->index_pulses[i];
        s->inputs[i] = r->inputs[i];
        s->edge_nm[i] = r->edge_nm[i];
        s->encoder_count[i] = r->count[i];
    }
    s->contour_statistics = r->error;
    s->path_rate_permille = n_to_scaled(r->rate, 1000);
    s->controller = r->controller;
}

/* Where an axis has power one of the two numbers has changed by itself; but in the first tick, and after FAULT_LAW. */
SELDOM static bool may_configure(struct servo_loop *loop)
{
    const bool powered =
        LOAD(loop->command.powered[0]) == SERVO_LOOP_ON || LOAD(loop->command.powered[1]) == SERVO_LOOP_ON;
    if (powered && loop->configured != UINT32_MAX) {
        servo_loop_raise(loop, FAULT_MEMORY);
        return false;
    }
    return true;
}

/* A configuration is taken over, which happens without power only: the machine's part before it is read, */
SELDOM static void configure_machine(struct servo_loop *loop, uint32_t configured)
{
    loop->use = &loop->cfg[configured % 2u];
    if (loop->use->onchip_plant.simulated != loop->simulated) {
        loop->simulated = loop->use->onchip_plant.simulated;
        onchip_plant_reset(&loop->use->onchip_plant, &loop->onchip_plant);
    }
}

/* and then the rest. */
SELDOM static void configure(struct servo_loop *loop, uint32_t configured, pos_t measured[2])
{
    const struct servo_loop_cfg *cfg = loop->use;
    loop->configured = configured;
    for (int i = 0; i < 2; i++) {
        scale_encoder(&loop->encoder[i], cfg->encoder_10fm[i]);
        measured[i] = loop->encoder[i].pos;
    }
    servo_reset(&cfg->servo, &loop->servo, measured);
    loop->path.spare = 0; /* another stop_time */
    for (int i = 0; i < 2; i++) {
        loop->lowest[i] = pos_add(pos_from_nm(cfg->min_nm[i]), n_neg(cfg->following_max[i]));
        loop->highest[i] = pos_add(pos_from_nm(cfg->max_nm[i]), cfg->following_max[i]);
    }
}

void servo_loop_init(struct servo_loop *loop, const struct hal *hal, const struct spline_ring *ring)
{
    struct hal_drive_in in = {0};
    *loop = (struct servo_loop){.hal = hal, .ring = ring};
    hal->drive_read(hal->ctx, &in);
    for (int i = 0; i < 2; i++) {
        loop->encoder[i].last = in.count[i];
        loop->encoder[i].count = in.count[i];
    }
    atomic_store(&loop->command.rate, 1000u);
    atomic_store(&loop->command.powered[0], SERVO_LOOP_OFF);
    atomic_store(&loop->command.powered[1], SERVO_LOOP_OFF);
    loop->configured = UINT32_MAX; /* the first tick resets the servo */
    loop->next = &loop->record[1];
    atomic_store(&loop->standing, true);
}

SELDOM static void reset_energy(struct servo_loop *loop)
{
    STORE(loop->command.energy_reset, false);
    energy_reset(&loop->servo.energy[0]);
    energy_reset(&loop->servo.energy[1]);
}

__attribute__((noinline, noclone)) void servo_loop_tick(struct servo_loop *loop)
{
    atomic_signal_fence(memory_order_acquire);
    const uint32_t configured = LOAD(loop->command.configured);
    const bool anew = configured != loop->configured && may_configure(loop);
    struct hal_drive_in in;
    struct servo_in servo;
    struct servo_loop_record *record = loop->next;
    struct servo_out *out = &record->out;

    /* read */
    if (anew) {
        configure_machine(loop, configured);
    }
    const struct servo_loop_cfg *cfg = loop->use;
    read_machine(loop, &in);
    measure(loop, &in, servo.measured);
    if (memcmp(in.inputs, loop->inputs, sizeof in.inputs) != 0) {
        watch_switches(loop, &in, servo.measured);
    }
    if (anew) {
        configure(loop, configured, servo.measured);
    }
    if (LOAD(loop->command.energy_reset)) {
        reset_energy(loop);
    }

    /* reference, law */
    follow_path(loop, cfg);
    const bool cut = (LOAD(loop->faults) & cfg->cut) != 0;
    for (int i = 0; i < 2; i++) {
        servo.enabled[i] = !cut && LOAD(loop->command.powered[i]) == SERVO_LOOP_ON;
    }
    servo.controller = (enum controller)LOAD(loop->command.controller);
    servo.path = loop->path.at;
    servo.ring = loop->ring;
    servo_step(&cfg->servo, &loop->servo, &servo, out);

    /* limits */
    supervise(loop, cfg, &in, servo.enabled, out);
    if ((LOAD(loop->faults) & cfg->cut) != 0) {
        servo.enabled[0] = servo.enabled[1] = false;
        out->force = v2(NUM(0), NUM(0));
    }

    /* write */
    const struct hal_drive_out drive = {
        .force_mN = {n_to_scaled(out->force.x, 1000), n_to_scaled(out->force.y, 1000)},
        .enable = {servo.enabled[0], servo.enabled[1]},
    };
    write_machine(loop, &drive);
    const uint32_t ticks = LOAD(loop->ticks);
    const uint32_t faults = LOAD(loop->faults);
    if (scope_runs(&loop->scope, faults)) {
        scope_step(&loop->scope, (const void *const[SCOPE_BASES]){loop, out}, ticks);
    }

    STORE(loop->ticks, ticks + 1u);
    const uint32_t left = (ticks + 1u) % TICKS_PER_MS;
    if (left == TICKS_PER_MS / 2u) {
        record_slow(loop, &in, record);
    } else if (left == 0) {
        publish(loop, record, servo.controller);
    } else {
        spline_prefetch(&loop->servo.spline_cache, loop->ring, loop->path.at.count, loop->path.at.knot);
    }
}

const struct servo_snapshot *servo_loop_snapshot(struct servo_loop *loop)
{
    const uint32_t published = atomic_load(&loop->published);
    if (published != loop->snapshot.ms) {
        scale(loop, &loop->record[published % SERVO_LOOP_RECORDS]);
    }
    return &loop->snapshot;
}
