/* SPDX-License-Identifier: Apache-2.0 */
#include "drive/onchip_configuration.h"

#define WHOLE 10000u /* of a share */

/* An axis of 2103h, and the shares of its mass and its friction that are at the table */
struct values {
    uint32_t mass, viscous, coulomb, noise;
    int32_t start;
    uint32_t mass_share, friction_share;
    const struct od_onchip_axis *has; /* besides */
};

static struct values values_of(const struct od_data *od, int axis)
{
    const struct od_onchip_plant *m = &od->onchip_plant;
    const bool is_x = axis == AXIS_X;
    struct values v = {.mass = is_x ? m->mass_x : m->mass_y,
                       .viscous = is_x ? m->viscous_x : m->viscous_y,
                       .coulomb = is_x ? m->coulomb_x : m->coulomb_y,
                       .noise = is_x ? m->noise_x : m->noise_y,
                       .start = is_x ? m->start_x : m->start_y,
                       .mass_share = WHOLE,
                       .friction_share = WHOLE,
                       .has = &od->axis[axis].onchip_axis};
    if (v.has->resonance != 0) {
        v.mass_share = WHOLE - v.has->motor_share;
        v.friction_share = v.has->friction_share;
    }
    return v;
}

/* Whether friction lets a mass move on within a period */
static bool moves_on(uint64_t viscous, uint64_t mass)
{
    return viscous / WHOLE / CONTROL_HZ <= mass / WHOLE;
}

bool onchip_configuration_fits(const struct od_data *od)
{
    bool fits = true;
    for (int i = 0; i < AXES; i++) {
        const struct values v = values_of(od, i);
        const uint64_t table_viscous = (uint64_t)v.viscous * v.friction_share;
        const uint64_t motor_viscous = (uint64_t)v.viscous * (WHOLE - v.friction_share);
        fits = fits && moves_on(table_viscous, (uint64_t)v.mass * v.mass_share) &&
               moves_on(motor_viscous, (uint64_t)v.mass * (WHOLE - v.mass_share)) &&
               v.has->travel_min <= v.has->travel_max &&
               (v.has->lag == 0 || (uint64_t)v.has->lag * CONTROL_HZ >= 1000000u);
    }
    return fits;
}

/* The nearest count of `length` 1e-8 um to a position, saturated */
static int32_t counts(int64_t nm, uint32_t length)
{
    const int64_t half = nm < 0 ? -(int64_t)(length / 2) : (int64_t)(length / 2);
    const int64_t n = (nm * 100000 + half) / (int64_t)length;
    return n > INT32_MAX ? INT32_MAX : n < INT32_MIN ? INT32_MIN : (int32_t)n;
}

static struct onchip_mass_cfg mass(const struct values *v, uint32_t mass_share, uint32_t friction_share)
{
    return (struct onchip_mass_cfg){
        .mass = n_ratio((int64_t)v->mass * mass_share, (int64_t)25000 * WHOLE),
        .viscous = n_ratio((int64_t)v->viscous * friction_share, (int64_t)5000000 * WHOLE),
        .coulomb = n_ratio((int64_t)v->coulomb * friction_share, (int64_t)1000 * WHOLE),
    };
}

/* Spring and damper of a mode: m (2 pi f)^2 and 2 m damping 2 pi f, with the reduced mass m */
static void spring(struct onchip_axis_cfg *c, const struct od_onchip_axis *a)
{
    const num reduced = n_mul(c->part[ONCHIP_TABLE].mass, n_ratio(a->motor_share, WHOLE));
    const num omega = n_ratio((int64_t)a->resonance * 6283185, 200000000000); /* 1/T0, of mHz */
    c->stiffness = n_mul(n_mul(reduced, omega), omega);
    c->damping = n_mul(n_mul(reduced, omega), n_ratio(a->damping, WHOLE / 2));
    c->gap = n_ratio(a->backlash, 2000);
    c->encoder_at_motor = a->encoder_at_table == 0;
}

static void ends(struct onchip_axis_cfg *c, const struct od_onchip_axis *a, uint32_t length)
{
    c->travel[0] = INT32_MIN;
    c->travel[1] = INT32_MAX;
    c->switches[0] = INT32_MIN;
    c->switches[1] = INT32_MAX;
    if (a->travel_min < a->travel_max) {
        c->travel[0] = counts(a->travel_min, length);
        c->travel[1] = counts(a->travel_max, length);
        if (a->limit_switch != 0) {
            c->switches[0] = counts((int64_t)a->travel_min + a->limit_switch, length);
            c->switches[1] = counts((int64_t)a->travel_max - a->limit_switch, length);
        }
    }
}

static void axis(struct onchip_axis_cfg *c, const struct values *v, uint32_t nominal_length)
{
    const struct od_onchip_axis *a = v->has;
    const uint32_t length = a->encoder != 0 ? a->encoder : nominal_length;
    *c = (struct onchip_axis_cfg){
        .part = {mass(v, v->mass_share, v->friction_share), mass(v, WHOLE - v->mass_share, WHOLE - v->friction_share)},
        .lag = n_ratio(a->lag, 5000),
        .counts = n_ratio(100000000, length),
        .noise = n_ratio(v->noise, 1000),
        .start = counts(v->start, length),
        .index = counts(a->index, length),
        .delay = a->delay,
    };
    for (int k = 0; k < ONCHIP_MASSES; k++) {
        c->friction.axis[k] =
            friction_design(n_ratio(a->presliding, 1000), n_ratio(a->breakaway, 1000), n_ratio(a->stribeck, 200000));
    }
    ends(c, a, length);
    if (a->resonance != 0) {
        spring(c, a);
    }
}

void onchip_configuration(const struct od_data *od, struct onchip_plant_cfg *c)
{
    c->simulated = od->onchip_plant.simulated != 0;
    c->dt = n_ratio(200, CONTROL_HZ);
    c->seed = od->onchip_plant.seed;
    for (int i = 0; i < AXES; i++) {
        const struct values v = values_of(od, i);
        axis(&c->axis[i], &v, od->axis[i].plant.encoder);
    }
    onchip_plant_design(c);
}
