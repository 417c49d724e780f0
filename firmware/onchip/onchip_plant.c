/* SPDX-License-Identifier: Apache-2.0 */
#include "onchip/onchip_plant.h"

#define UNIFORM NUM(1.7320508075688772) /* half the width of a uniform distribution of standard deviation 1 */

void onchip_plant_design(struct onchip_plant_cfg *cfg)
{
    for (int i = 0; i < AXES; i++) {
        struct onchip_axis_cfg *a = &cfg->axis[i];
        const num z = n_div(n_mul(a->viscous, cfg->dt), a->mass);
        num phi_2 = NUM(1); /* Taylor series by Horner's rule: 1/2 (1 - z/3 (1 - z/4 (...))) */
        for (int k = 10; k >= 2; k--) {
            phi_2 = n_sub(NUM(1), n_mul(n_mul(z, n_ratio(1, k + 1)), phi_2));
        }
        phi_2 = n_mul(NUM(0.5), phi_2);
        const num phi_1 = n_sub(NUM(1), n_mul(z, phi_2));
        a->gain = n_mul(phi_1, cfg->dt);
        a->share = n_div(phi_2, phi_1);
    }
}

void onchip_plant_reset(const struct onchip_plant_cfg *cfg, struct onchip_plant *m)
{
    *m = (struct onchip_plant){.random = cfg->seed};
    for (int i = 0; i < AXES; i++) {
        m->axis[i].pos = (int64_t)cfg->axis[i].start * ((int64_t)1 << 32);
    }
}

void onchip_plant_read(const struct onchip_plant *m, struct hal_drive_in *in)
{
    *in = (struct hal_drive_in){0};
    for (int i = 0; i < AXES; i++) { /* rounded to the nearest count */
        in->count[i] = (int32_t)((uint64_t)(m->axis[i].pos + ((int64_t)1 << 31)) >> 32);
    }
}

static void axis_step(const struct onchip_axis_cfg *c, struct onchip_axis *a, num force, num dt)
{
    const num v = a->vel;
    const bool sticks = !n_lt(c->coulomb, n_abs(force)); /* from standstill */
    const bool stands = !n_lt(v, NUM(0)) && !n_lt(NUM(0), v);
    if (stands && sticks) {
        return;
    }
    const bool forward = n_lt(NUM(0), stands ? force : v);
    const num against = forward ? n_neg(c->coulomb) : c->coulomb;
    const num dv = n_mul(c->gain, n_div(n_sub(n_add(force, against), n_mul(c->viscous, v)), c->mass));
    num dx = n_mul(dt, n_mad(v, c->share, dv));
    num v_end = n_add(v, dv);
    if (!stands && (forward ? n_lt(v_end, NUM(0)) : n_lt(NUM(0), v_end))) {
        const num part = n_div(v, n_neg(dv)); /* share of the period until v = 0 */
        const num remainder = n_sub(NUM(1), part);
        v_end = sticks ? NUM(0) : n_mul(n_mul(remainder, c->gain), n_div(n_sub(force, against), c->mass));
        dx = n_mul(n_mul(NUM(0.5), dt), n_mad(n_mul(part, v), remainder, v_end));
    }
    a->vel = n_state(v_end);
    a->pos += n_to_q32(n_mul(dx, c->counts));
}

void onchip_plant_step(const struct onchip_plant_cfg *cfg, struct onchip_plant *m, const struct hal_drive_out *out)
{
    for (int i = 0; i < AXES; i++) {
        struct onchip_axis *a = &m->axis[i];
        num force = a->force;
        a->force = out->enable[i] ? n_ratio(out->force_mN[i], 1000) : NUM(0);
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
    onchip_plant_read(&o->plant, in);
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
