/* SPDX-License-Identifier: Apache-2.0 */
#include "onchip/onchip_plant.h"

#define UNIFORM NUM(1.7320508075688772) /* half the width of a uniform distribution of standard deviation 1 */

/* (1 - phi_1(z)) / z of z within 0..1: a Taylor series by Horner's rule, 1/2 (1 - z/3 (1 - z/4 (...))) */
static num phi_2(num z)
{
    num sum = NUM(1);
    for (int k = 10; k >= 2; k--) {
        sum = n_sub(NUM(1), n_mul(n_mul(z, n_ratio(1, k + 1)), sum));
    }
    return n_mul(NUM(0.5), sum);
}

static num phi_1(num z)
{
    return n_sub(NUM(1), n_mul(z, phi_2(z)));
}

void onchip_plant_design(struct onchip_plant_cfg *cfg)
{
    for (int i = 0; i < AXES; i++) {
        struct onchip_axis_cfg *a = &cfg->axis[i];
        const int masses = n_lt(NUM(0), a->stiffness) ? ONCHIP_MASSES : 1;
        for (int k = 0; k < masses; k++) {
            struct onchip_mass_cfg *m = &a->part[k];
            const num z = n_div(n_mul(m->viscous, cfg->dt), m->mass);
            m->gain = n_mul(phi_1(z), cfg->dt);
            m->share = n_div(phi_2(z), phi_1(z));
        }
        a->lag_mean = NUM(0);
        a->lag_end = NUM(0);
        if (n_lt(NUM(0), a->lag)) {
            const num z = n_div(cfg->dt, a->lag);
            a->lag_mean = phi_1(z);
            a->lag_end = n_msub(NUM(1), z, a->lag_mean);
        }
    }
}

void onchip_plant_reset(const struct onchip_plant_cfg *cfg, struct onchip_plant *m)
{
    *m = (struct onchip_plant){.random = cfg->seed};
    for (int i = 0; i < AXES; i++) {
        for (int k = 0; k < ONCHIP_MASSES; k++) {
            m->axis[i].part[k].pos = (int64_t)cfg->axis[i].start * ((int64_t)1 << 32);
        }
    }
}

/* Of the mass that the encoder is at, rounded to the nearest count */
static int32_t encoder(const struct onchip_axis_cfg *c, const struct onchip_axis *a)
{
    const int64_t pos = a->part[c->encoder_at_motor ? ONCHIP_MOTOR : ONCHIP_TABLE].pos;
    return (int32_t)((uint64_t)(pos + ((int64_t)1 << 31)) >> 32);
}

static uint8_t limit_switches(const struct onchip_axis_cfg *c, int64_t pos)
{
    const int32_t count = (int32_t)((uint64_t)pos >> 32);
    const unsigned low = count <= c->switches[0] ? HAL_LIMIT_MIN : 0u;
    const unsigned high = count >= c->switches[1] ? HAL_LIMIT_MAX : 0u;
    return (uint8_t)(low | high);
}

void onchip_plant_read(const struct onchip_plant_cfg *cfg, const struct onchip_plant *m, struct hal_drive_in *in)
{
    *in = (struct hal_drive_in){0};
    for (int i = 0; i < AXES; i++) {
        const struct onchip_axis *a = &m->axis[i];
        in->count[i] = encoder(&cfg->axis[i], a);
        in->inputs[i] = limit_switches(&cfg->axis[i], a->part[ONCHIP_TABLE].pos);
        in->index_pulses[i] = a->index_pulses;
        in->index_count[i] = a->index_count;
    }
}

/* The index pulse below a count, numbered from that at 0 */
static int32_t pulse_below(int32_t count, int32_t pitch)
{
    return count / pitch - (count % pitch < 0 ? 1 : 0);
}

static void pass_index(const struct onchip_axis_cfg *c, struct onchip_axis *a, int32_t before)
{
    if (c->index == 0) {
        return;
    }
    const int32_t from = pulse_below(before, c->index);
    const int32_t to = pulse_below(encoder(c, a), c->index);
    if (from != to) {
        a->index_pulses++;
        a->index_count = (from < to ? to : from) * c->index;
    }
}

static void end_at(struct onchip_mass *m, num counts, num dx, num v_end)
{
    m->vel = n_state(v_end);
    m->pos += n_to_q32(n_mul(dx, counts));
}

/* A period of a mass whose friction does not depend on where it is */
static void move_with_stiction(const struct onchip_mass_cfg *c, struct onchip_mass *m, num friction, num force, num dt,
                               num counts)
{
    const num v = m->vel;
    const bool sticks = !n_lt(friction, n_abs(force)); /* from standstill */
    const bool stands = !n_lt(v, NUM(0)) && !n_lt(NUM(0), v);
    if (stands && sticks) {
        return;
    }
    const bool forward = n_lt(NUM(0), stands ? force : v);
    const num against = forward ? n_neg(friction) : friction;
    const num dv = n_mul(c->gain, n_div(n_sub(n_add(force, against), n_mul(c->viscous, v)), c->mass));
    num dx = n_mul(dt, n_mad(v, c->share, dv));
    num v_end = n_add(v, dv);
    if (!stands && (forward ? n_lt(v_end, NUM(0)) : n_lt(NUM(0), v_end))) {
        const num part = n_div(v, n_neg(dv)); /* share of the period until v = 0 */
        const num remainder = n_sub(NUM(1), part);
        v_end = sticks ? NUM(0) : n_mul(n_mul(remainder, c->gain), n_div(n_sub(force, against), c->mass));
        dx = n_mul(n_mul(NUM(0.5), dt), n_mad(n_mul(part, v), remainder, v_end));
    }
    end_at(m, counts, dx, v_end);
}

static void move(const struct onchip_axis_cfg *c, struct onchip_axis *a, int k, num force, num dt)
{
    const struct onchip_mass_cfg *part = &c->part[k];
    struct onchip_mass *m = &a->part[k];
    const num friction = n_mul(part->coulomb, friction_step(&c->friction, &a->friction, k, true, m->vel, NUM(1), dt));
    if (n_lt(NUM(0), c->friction.axis[k].presliding)) {
        /* The elements are stretched by the velocities so far, and so are where the mass is in the middle of the period. */
        const num dv =
            n_mul(part->gain, n_div(n_sub(n_sub(force, friction), n_mul(part->viscous, m->vel)), part->mass));
        end_at(m, c->counts, n_mul(dt, n_mad(m->vel, part->share, dv)), n_add(m->vel, dv));
    } else {
        move_with_stiction(part, m, friction, force, dt, c->counts);
    }
}

/* The force with which the motor pushes the table */
static num spring(const struct onchip_axis_cfg *c, const struct onchip_axis *a, num dt)
{
    const struct onchip_mass *table = &a->part[ONCHIP_TABLE];
    const struct onchip_mass *motor = &a->part[ONCHIP_MOTOR];
    const num speed = n_sub(motor->vel, table->vel);
    const num apart =
        n_mad(n_div(n_ratio((motor->pos - table->pos) >> 12, (int64_t)1 << 20), c->counts), n_mul(NUM(0.5), dt), speed);
    const num stretch = n_sub(apart, n_within(apart, c->gap));
    const bool in_gap = n_lt(n_abs(apart), c->gap);
    const num force = n_mad(n_mul(c->stiffness, stretch), c->damping, speed);
    const bool pulls_back = n_lt(NUM(0), stretch) ? n_lt(force, NUM(0)) : n_lt(NUM(0), force);
    /* nothing sticks at the end of a gap */
    return in_gap || (n_lt(NUM(0), c->gap) && pulls_back) ? NUM(0) : force;
}

static void hold_within(const struct onchip_axis_cfg *c, struct onchip_mass *table)
{
    const int64_t low = (int64_t)c->travel[0] * ((int64_t)1 << 32);
    const int64_t high = (int64_t)c->travel[1] * ((int64_t)1 << 32);
    if (table->pos <= low || table->pos >= high) {
        table->pos = table->pos <= low ? low : high;
        table->vel = NUM(0);
    }
}

/* The force of this period, in the mean */
static num lagged(const struct onchip_axis_cfg *c, struct onchip_axis *a)
{
    const num demand = a->demand[c->delay - 1];
    const num behind = n_sub(a->force, demand);
    a->force = n_state(n_mad(demand, c->lag_end, behind));
    return n_mad(demand, c->lag_mean, behind);
}

static void axis_step(const struct onchip_axis_cfg *c, struct onchip_axis *a, num force, num dt)
{
    const int32_t before = encoder(c, a);
    if (n_lt(NUM(0), c->stiffness)) {
        const num push = spring(c, a, dt);
        move(c, a, ONCHIP_MOTOR, n_sub(force, push), dt);
        move(c, a, ONCHIP_TABLE, push, dt);
    } else {
        move(c, a, ONCHIP_TABLE, force, dt);
    }
    hold_within(c, &a->part[ONCHIP_TABLE]);
    pass_index(c, a, before);
}

void onchip_plant_step(const struct onchip_plant_cfg *cfg, struct onchip_plant *m, const struct hal_drive_out *out)
{
    for (int i = 0; i < AXES; i++) {
        struct onchip_axis *a = &m->axis[i];
        num force = lagged(&cfg->axis[i], a);
        for (int k = ONCHIP_DELAY_MAX - 1; k > 0; k--) {
            a->demand[k] = a->demand[k - 1];
        }
        a->demand[0] = out->enable[i] ? n_ratio(out->force_mN[i], 1000) : NUM(0);
        if (out->enable[i]) {
            m->random = m->random * 1664525u + 1013904223u;
            const num uniform = n_ratio((int32_t)(m->random >> 16) - 0x8000, 0x8000);
            force = n_mad(force, n_mul(UNIFORM, cfg->axis[i].noise), uniform);
        }
        axis_step(&cfg->axis[i], a, force, cfg->dt);
    }
}

/* ---- the plant in front of a HAL ----
 * A table has no use for it, so it is compiled for size. */

static void read_plant(void *ctx, struct hal_drive_in *in)
{
    const struct onchip_hal *o = ctx;
    o->behind->drive_read(o->behind->ctx, in);
    onchip_plant_read(o->cfg, &o->plant, in);
}

__attribute__((cold)) static void write_plant(void *ctx, const struct hal_drive_out *out)
{
    static const struct hal_drive_out off;
    struct onchip_hal *o = ctx;
    o->behind->drive_write(o->behind->ctx, &off);
    onchip_plant_step(o->cfg, &o->plant, out);
}

void onchip_hal_init(struct onchip_hal *o, const struct hal *behind)
{
    *o = (struct onchip_hal){
        .hal = {.ctx = o, .drive_read = read_plant, .drive_write = write_plant},
        .behind = behind,
    };
}

const struct hal *onchip_hal_select(struct onchip_hal *o, const struct onchip_plant_cfg *cfg)
{
    o->cfg = cfg;
    if (cfg->simulated != o->selected) {
        o->selected = cfg->simulated;
        onchip_plant_reset(cfg, &o->plant);
    }
    return o->selected ? &o->hal : o->behind;
}
