/* SPDX-License-Identifier: Apache-2.0 */
#include "loop.h"

#define TICKS_PER_MS (CONTROL_HZ / 1000u)

static void raise(struct loop *loop, enum fault f)
{
    atomic_fetch_or(&loop->faults, FAULT_BIT(f));
}

/* Faults after which the power stage is off at once, without waiting for the background. */
static bool cut_off(uint32_t faults)
{
    for (unsigned f = 0; f < FAULTS; f++) {
        if ((faults & FAULT_BIT(f)) != 0 && fault_table[f].reaction == REACT_DISABLE) {
            return true;
        }
    }
    return false;
}

/* `count` counts of `length` 10 fm each: times 65536 / 100000 = 2048 / 3125, in two parts so that nothing overflows. */
static pos_t position(int64_t count, uint32_t length)
{
    const int64_t x = count * (int64_t)length;
    return x / 3125 * 2048 + x % 3125 * 2048 / 3125;
}

/* Encoder counts since power-on to positions; the counter wraps, the position does not. */
static void measure(struct loop *loop, const struct loop_cfg *cfg, const struct hal_drive_in *in, pos_t measured[2])
{
    for (int i = 0; i < 2; i++) {
        loop->count[i] += (int32_t)((uint32_t)in->count[i] - (uint32_t)loop->last_count[i]);
        loop->last_count[i] = in->count[i];
        measured[i] = position(loop->count[i], cfg->encoder_10fm[i]);
    }
}

/* Returns whether the path runs or stands; keeps `standing`, `at_end`, `executed` up to date. */
static void follow_path(struct loop *loop, const struct loop_cfg *cfg)
{
    const uint32_t begin = atomic_load(&loop->command.begin);
    if (begin != atomic_load(&loop->begun)) {
        path_reset(&loop->path);
        loop->error = (struct loop_error){0};
    }
    /* `complete` is read before the count: a stream that completes in between counts as not complete yet */
    const bool complete = atomic_load(&loop->command.complete);
    const struct path_in in = {
        .complete = complete,
        .count = atomic_load(&loop->ring->count),
        .run = atomic_load(&loop->command.run),
        .stop_time = cfg->stop_time,
        .step = PATH_ONE / TICKS_PER_MS,
    };
    const bool rest = atomic_load(&loop->command.rest);
    const enum path_event event = path_step(&loop->path, &in);
    if (event == PATH_UNDERRUN && !rest) {
        raise(loop, FAULT_UNDERRUN);
    }
    const bool standing = !n_lt(NUM(0), loop->path.at.rate);
    const bool slowed = in.run && !standing && n_lt(loop->path.at.rate, NUM(1));
    atomic_store(&loop->starved, !rest && (event == PATH_STARVED || (slowed && atomic_load(&loop->starved))));
    atomic_store(&loop->at_end, event == PATH_AT_END || (event == PATH_UNDERRUN && rest));
    atomic_store(&loop->standing, standing);
    atomic_store(&loop->executed, path_executed(&loop->path));
    atomic_store(&loop->begun, begin);
}

static void supervise(struct loop *loop, const struct loop_cfg *cfg, const struct hal_drive_in *in,
                      const bool powered[2], const struct servo_out *out)
{
    const num e_w[2] = {out->contour.e_w.x, out->contour.e_w.y};
    const num speed[2] = {out->velocity.x, out->velocity.y};
    for (int i = 0; i < 2; i++) {
        if ((in->inputs[i] & (HAL_AMPLIFIER_FAULT | HAL_ENCODER_FAULT | HAL_STOP)) != 0) {
            raise(loop, FAULT_INPUT);
        }
        loop->late[i] = powered[i] && n_lt(cfg->following_max[i], n_abs(e_w[i])) ? loop->late[i] + 1u : 0u;
        if (!powered[i]) {
            continue;
        }
        if (loop->late[i] > cfg->following_ticks[i]) {
            raise(loop, FAULT_FOLLOWING);
        }
        if (n_lt(cfg->speed_max, n_abs(speed[i]))) {
            raise(loop, FAULT_OVERSPEED);
        }
        /* further out than the soft limits and than its reference, which may come back from there: lost */
        const int64_t nm = pos_to_nm(loop->servo.observer[i].pos);
        const int64_t reference = pos_to_nm(out->contour.ref.pos[i]);
        const int64_t origin = atomic_load(&loop->command.origin_nm[i]);
        const int64_t slack = n_to_scaled(cfg->following_max[i], 1000);
        if ((nm < cfg->min_nm[i] - origin - slack && nm < reference - slack) ||
            (nm > cfg->max_nm[i] - origin + slack && nm > reference + slack)) {
            raise(loop, FAULT_TRAVEL);
        }
    }
}

/* Where the encoder was at a limit switch's edge: to a control period, however late the background is */
static void watch_switches(struct loop *loop, const struct hal_drive_in *in, const pos_t measured[2])
{
    for (int i = 0; i < 2; i++) {
        if (((in->inputs[i] ^ loop->inputs[i]) & (HAL_LIMIT_MIN | HAL_LIMIT_MAX)) != 0) {
            loop->edge_nm[i] = pos_to_nm(measured[i]);
        }
        loop->inputs[i] = in->inputs[i];
    }
}

static void add_error(struct loop_error *error, int32_t e_n2_nm)
{
    const uint32_t size = e_n2_nm < 0 ? 0u - (uint32_t)e_n2_nm : (uint32_t)e_n2_nm;
    error->sum_nm += size;
    error->max_nm = size > error->max_nm ? size : error->max_nm;
    error->samples++;
}

static void publish(struct loop *loop, const struct loop_cfg *cfg, const struct hal_drive_in *in,
                    const struct servo_out *out, enum controller controller)
{
    const uint32_t n = atomic_load(&loop->published) + 1u;
    struct loop_snapshot *s = &loop->snapshot[n % 2u];
    const num v[2] = {out->velocity.x, out->velocity.y};
    const num e_w[2] = {out->contour.e_w.x, out->contour.e_w.y};
    const num e_n[2] = {out->contour.e_n.x, out->contour.e_n.y};
    const num force[2] = {out->force.x, out->force.y};
    const num k_hat[2] = {out->asmc.k_hat.x, out->asmc.k_hat.y};
    const num mu[2] = {out->uncertainty.mu.x, out->uncertainty.mu.y};
    const num friction[2] = {acc_to(loop->servo.learning.friction[0]), acc_to(loop->servo.learning.friction[1])};
    const num mass[2] = {acc_to(loop->servo.learning.mass[0]), acc_to(loop->servo.learning.mass[1])};
    s->ms = n;
    for (int i = 0; i < 2; i++) {
        s->position_nm[i] = pos_to_nm(loop->servo.observer[i].pos);
        s->reference_nm[i] = pos_to_nm(out->contour.ref.pos[i]);
        s->velocity_umps[i] = n_to_scaled(v[i], 200);
        s->following_nm[i] = n_to_scaled(e_w[i], 1000);
        s->e_n_nm[i] = n_to_scaled(e_n[i], 1000);
        s->force_dN[i] = n_to_scaled(force[i], 10);
        s->k_hat[i] = n_to_scaled(k_hat[i], 2000);
        s->mu[i] = n_to_scaled(mu[i], 40);
        s->energy_mJ[i] = loop->servo.energy[i].mJ;
        s->learned_mN[i] = n_to_scaled(friction[i], 1000);
        s->learned_g[i] = n_to_scaled(mass[i], 25000);
        const int32_t since_index = (int32_t)((uint32_t)in->count[i] - (uint32_t)in->index_count[i]);
        s->index_nm[i] = pos_to_nm(position(loop->count[i] - since_index, cfg->encoder_10fm[i]));
        s->index_pulses[i] = in->index_pulses[i];
        s->inputs[i] = in->inputs[i];
        s->edge_nm[i] = loop->edge_nm[i];
    }
    if (!atomic_load(&loop->standing)) {
        add_error(&loop->error, s->e_n_nm[1]);
    }
    s->error = loop->error;
    s->rate = n_to_scaled(loop->path.at.rate, 1000);
    s->controller = (uint8_t)controller;
    atomic_store(&loop->published, n);
}

void loop_init(struct loop *loop, const struct hal *hal, const struct spline_ring *ring)
{
    struct hal_drive_in in = {0};
    *loop = (struct loop){.hal = hal, .ring = ring};
    hal->drive_read(hal->ctx, &in);
    for (int i = 0; i < 2; i++) {
        loop->last_count[i] = in.count[i];
        loop->count[i] = in.count[i];
    }
    loop->cfg_used = UINT8_MAX; /* the first tick resets the servo */
    atomic_store(&loop->standing, true);
}

void loop_tick(struct loop *loop)
{
    const uint8_t index = atomic_load(&loop->command.cfg_index);
    const struct loop_cfg *cfg = &loop->cfg[index];
    struct hal_drive_in in;
    struct servo_in servo = {.ring = loop->ring};
    struct servo_out out;

    /* read */
    loop->hal->drive_read(loop->hal->ctx, &in);
    measure(loop, cfg, &in, servo.measured);
    watch_switches(loop, &in, servo.measured);
    if (index != loop->cfg_used) { /* configured anew, which happens without power only */
        loop->cfg_used = index;
        servo_reset(&cfg->servo, &loop->servo, servo.measured);
    }
    if (atomic_exchange(&loop->command.energy_reset, false)) {
        energy_reset(&loop->servo.energy[0]);
        energy_reset(&loop->servo.energy[1]);
    }

    /* reference, law */
    follow_path(loop, cfg);
    const bool cut = cut_off(atomic_load(&loop->faults));
    for (int i = 0; i < 2; i++) {
        servo.enabled[i] = !cut && atomic_load(&loop->command.powered[i]);
    }
    servo.controller = (enum controller)atomic_load(&loop->command.controller);
    servo.path = loop->path.at;
    servo_step(&cfg->servo, &loop->servo, &servo, &out);

    /* limits */
    supervise(loop, cfg, &in, servo.enabled, &out);
    if (cut_off(atomic_load(&loop->faults))) {
        servo.enabled[0] = servo.enabled[1] = false;
        out.force = v2(NUM(0), NUM(0));
    }

    /* write */
    const struct hal_drive_out drive = {
        .force_mN = {n_to_scaled(out.force.x, 1000), n_to_scaled(out.force.y, 1000)},
        .enable = {servo.enabled[0], servo.enabled[1]},
    };
    loop->hal->drive_write(loop->hal->ctx, &drive);

    if (++loop->ticks % TICKS_PER_MS == 0) {
        publish(loop, cfg, &in, &out, servo.controller);
    }
}

const struct loop_snapshot *loop_snapshot(const struct loop *loop)
{
    return &loop->snapshot[atomic_load(&loop->published) % 2u];
}
