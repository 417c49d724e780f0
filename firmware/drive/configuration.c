/* SPDX-License-Identifier: Apache-2.0 */
#include "drive/configuration.h"

#include "core/trig.h"
#include "drive/onchip_configuration.h"
#include "supervision/fault.h"

#define EXCITATION_LONGEST_MS 20000u
#define OSCILLATION_LASTS_MS 60u /* an oscillation is one when it has lasted so long */

/* Core units: um, T0 = 5 ms, N. A value of u wire units of `factor` each is u * factor * core units per SI unit:
 *   m/s    -> um/T0     5000        1/s    -> 1/T0      1/200      1/s2 -> 1/T0^2  1/40000
 *   m/s2   -> um/T0^2   25          kg     -> N T0^2/um 1/25       N s/m -> N T0/um 1/5000 */
static num milli_per_s(uint32_t u)
{
    return n_ratio(u, 200000);
}

static num nano_mps(uint32_t u)
{
    return n_ratio(u, 200000);
}

static num micro_mps2(uint32_t u)
{
    return n_ratio(u, 40000);
}

static num milli(int64_t u)
{
    return n_ratio(u, 1000);
}

static num micro(int32_t u)
{
    return n_ratio(u, 1000000);
}

/* Steps of the velocity estimate grow with the length of a count and with the bandwidth to the power of two and more:
 * for counts longer than ENCODER_FINE the bandwidth goes with the fourth root of their length. The coarser axis
 * counts. */
#define ENCODER_FINE 7629000 /* 76.29 nm in 10 fm */

static num observer_bandwidth(const struct od_data *od)
{
    const uint32_t x = od->axis[0].plant.encoder;
    const uint32_t y = od->axis[1].plant.encoder;
    const uint32_t count = x > y ? x : y;
    const num bandwidth = milli_per_s(od->observer.bandwidth);
    return count <= ENCODER_FINE ? bandwidth : n_mul(bandwidth, n_sqrt(n_sqrt(n_ratio(ENCODER_FINE, count))));
}

static struct plant_cfg plant(const struct od_plant *x, const struct od_plant *y)
{
    const struct plant_cfg p = {
        .mass = v2(n_ratio(x->mass, 25000), n_ratio(y->mass, 25000)),
        .viscous = v2(n_ratio(x->viscous, 5000000), n_ratio(y->viscous, 5000000)),
        .coulomb = v2(milli(x->coulomb), milli(y->coulomb)),
        .force_max = v2(milli(x->force_limit), milli(y->force_limit)),
    };
    return p;
}

static struct friction_axis_cfg friction(const struct od_friction *f)
{
    return friction_design(milli(f->presliding), milli(f->breakaway), nano_mps(f->stribeck));
}

static bool friction_on(const struct od_friction *f)
{
    return f->presliding != 0 || f->breakaway > 1000u;
}

static struct screw_axis_cfg screw(const struct od_screw *s)
{
    return (struct screw_axis_cfg){
        .turns = s->lead == 0 ? 0 : screw_turns(s->lead),
        .harmonic = {{s->order_1, milli(s->cogging_cos_1), milli(s->cogging_sin_1), micro(s->ripple_cos_1),
                      micro(s->ripple_sin_1)},
                     {s->order_2, milli(s->cogging_cos_2), milli(s->cogging_sin_2), micro(s->ripple_cos_2),
                      micro(s->ripple_sin_2)},
                     {s->order_3, milli(s->cogging_cos_3), milli(s->cogging_sin_3), micro(s->ripple_cos_3),
                      micro(s->ripple_sin_3)}},
    };
}

static struct energy_cfg energy(const struct od_motor *m, num sign_speed)
{
    const struct energy_cfg e = {
        .force_constant = milli(m->force_constant),
        .impedance = milli(m->impedance),
        .back_emf = n_ratio(m->back_emf, 5000000),
        .power_factor = milli(m->power_factor),
        .sign_speed = sign_speed,
        .dt_ms = n_ratio((int64_t)SERVO_SLOTS * 1000, CONTROL_HZ),
    };
    return e;
}

static bool force_filter(struct force_filter_cfg *cfg, int i, const struct od_force_filter *f)
{
    const struct force_section_spec spec[FORCE_SECTIONS] = {
        {f->zero_1, f->zero_damping_1, f->pole_1, f->pole_damping_1},
        {f->zero_2, f->zero_damping_2, f->pole_2, f->pole_damping_2},
        {f->zero_3, f->zero_damping_3, f->pole_3, f->pole_damping_3},
        {f->zero_4, f->zero_damping_4, f->pole_4, f->pole_damping_4},
    };
    return force_filter_design(cfg, i, spec, CONTROL_HZ);
}

static struct force_limit_cfg force_limit(const struct od_axis *x, const struct od_axis *y)
{
    const struct od_force_continuous *const c[2] = {&x->force_continuous, &y->force_continuous};
    num inverse[2], force[2] = {milli(x->plant.force_limit), milli(y->plant.force_limit)};
    for (int i = 0; i < 2; i++) {
        inverse[i] = NUM(0);
        if (c[i]->force != 0) {
            force[i] = milli(c[i]->force);
            inverse[i] = n_ratio(1000, c[i]->force);
        }
    }
    return (struct force_limit_cfg){
        .on = c[0]->force != 0 || c[1]->force != 0,
        .continuous = v2(force[0], force[1]),
        .inverse = v2(inverse[0], inverse[1]),
        .rate = {n_ratio((int64_t)ACC_GAIN * SERVO_SLOTS * 1000, (int64_t)c[0]->time * CONTROL_HZ),
                 n_ratio((int64_t)ACC_GAIN * SERVO_SLOTS * 1000, (int64_t)c[1]->time * CONTROL_HZ)},
    };
}

/* Whether the screw has an error once a turn. */
static bool has_turn_error(const struct od_screw *s)
{
    return s->lead != 0 && (s->error_cos != 0 || s->error_sin != 0);
}

/* Fill what crosses the gap: the mass before it, where the table's is known. It takes half of the largest force at
 * most. */
static void gap(struct geometry_axis_cfg *g, const struct od_axis *a)
{
    const uint32_t mass = a->plant.mass;
    const uint32_t table = a->transmission.table_mass;
    const num quarter = n_ratio(a->plant.force_limit, 4000);
    const num fastest = NUM(GEOMETRY_SIDE_BANDWIDTH);
    g->half_gap = n_ratio(a->transmission.backlash, 2000);
    g->gap_inertia = table == 0 || table >= mass ? NUM(0) : n_mul(n_ratio(mass - table, 25000), g->half_gap);
    g->side_bandwidth = n_lt(n_mul(g->gap_inertia, n_mul(fastest, fastest)), quarter)
                            ? fastest
                            : n_sqrt(n_div(quarter, g->gap_inertia));
}

/* The table behind a spring, a gap and a screw; squareness is that of the axis, seen on the other one. It fills *g,
 * whose points beyond the map are 0: by value its maps would lie on the stack several times. */
static void geometry_axis(struct geometry_axis_cfg *g, const struct od_axis *a, int32_t squareness)
{
    const struct od_transmission *t = &a->transmission;
    const struct od_screw *s = &a->screw;
    g->points = a->lead_map.points;
    g->start_nm = a->lead_map.start;
    g->step_nm = a->lead_map.step;
    g->turns = has_turn_error(s) ? screw_turns(s->lead) : 0;
    g->error_cos = n_ratio(s->error_cos, 1000);
    g->error_sin = n_ratio(s->error_sin, 1000);
    g->squareness = n_ratio(squareness, 1000000);
    g->compliance = t->stiffness == 0 ? NUM(0) : n_ratio(1000, t->stiffness);
    g->mass = n_ratio(t->table_mass, 25000);
    g->coulomb = n_ratio((int64_t)a->plant.coulomb * t->table_friction, 1000000);
    g->viscous = n_ratio((int64_t)a->plant.viscous * t->table_friction, 5000000000);
    gap(g, a);
    for (uint32_t k = 0; k < g->points; k++) {
        g->lead[k] = n_ratio(a->lead_error[k], 1000);
    }
}

static bool has_second(const struct od_data *od, int axis)
{
    return od->axis[axis].second_encoder.length != 0 && od->onchip_plant.simulated == 0; /* that machine has none */
}

static struct dual_feedback_cfg dual_feedback(const struct od_data *od, int axis)
{
    const struct od_second_encoder *e = &od->axis[axis].second_encoder;
    /* w dt = 2 pi f / CONTROL_HZ, of f in mHz; 2 pi is 6283185 / 10^6 */
    const num w_dt = n_ratio((int64_t)e->crossover * 6283185, (int64_t)CONTROL_HZ * 1000000000);
    return (struct dual_feedback_cfg){
        .on = has_second(od, axis), .gain = n_min(w_dt, NUM(1)), .tolerance = milli(e->tolerance)};
}

static bool has_geometry(const struct od_data *od, int axis)
{
    const struct od_axis *a = &od->axis[axis];
    return has_second(od, axis) || a->lead_map.points != 0 || a->transmission.stiffness != 0 ||
           a->transmission.backlash != 0 || has_turn_error(&a->screw);
}

static void geometry(struct geometry_cfg *c, const struct od_data *od, num dt)
{
    const struct od_geometry *g = &od->geometry;
    c->on = has_geometry(od, 0) || has_geometry(od, 1) || g->squareness_x != 0 || g->squareness_y != 0;
    c->dt = n_mul(NUM(2), dt); /* the axes take turns */
    geometry_axis(&c->axis[0], &od->axis[0], g->squareness_x);
    geometry_axis(&c->axis[1], &od->axis[1], g->squareness_y);
}

/* Whether a map is one: between two points the table moves in the encoder's direction, by 0.5 to 1.5 times as much. */
static bool lead_map_fits(const struct od_axis *a)
{
    const struct od_lead_map *m = &a->lead_map;
    for (uint32_t k = 1; k < m->points; k++) {
        const int64_t change = (int64_t)a->lead_error[k] - a->lead_error[k - 1];
        if (2 * (change < 0 ? -change : change) > (int64_t)m->step) {
            return false;
        }
    }
    return m->points != 1;
}

/* Whether an error once a turn of the screw is as flat as that of a map: amplitude times 2 pi / lead is at most 0.5. */
static bool turn_error_fits(const struct od_screw *s)
{
    const int64_t square = (int64_t)s->error_cos * s->error_cos + (int64_t)s->error_sin * s->error_sin;
    return s->lead == 0 || 158 * square <= (int64_t)s->lead * s->lead; /* (4 pi)^2 */
}

/* The watch for oscillation of an axis with `mass` N T0^2/um / 4: no more than half of the largest force counts. */
static struct oscillation_axis oscillation_axis(const struct od_data *od, int i, num mass)
{
    const struct od_oscillation *o = &od->oscillation;
    const uint32_t half = od->axis[i].plant.force_limit / 2u;
    const num rate = n_ratio((int64_t)355 * o->corner, (int64_t)113 * 200000); /* pi f_c T0 */
    return (struct oscillation_axis){
        .limit = n_ratio(o->limit < half ? o->limit : half, 4000),
        .count = n_mul(n_mul(n_mul(mass, rate), rate), n_ratio(od->axis[i].plant.encoder, 100000000)),
        .force_max = n_ratio(half, 4000),
    };
}

static struct oscillation_cfg oscillation(const struct od_data *od)
{
    const struct od_oscillation *o = &od->oscillation;
    const struct od_plant *x = &od->axis[0].plant;
    const struct od_plant *y = &od->axis[1].plant;
    const vec2 mass = v2(n_ratio(x->mass, 100000), n_ratio(y->mass, 100000));
    return (struct oscillation_cfg){
        .on = o->limit != 0,
        .lower = o->reaction == OSCILLATION_LOWER_GAINS,
        .gain_step = milli(o->gain_step),
        /* 1 - exp(-2 pi f_c dt) to second order: w / (1 + w / 2) with w = 2 pi f_c dt, pi as 355/113 */
        .slow = n_ratio((int64_t)710 * o->corner, (int64_t)113000 * CONTROL_HZ + (int64_t)355 * o->corner),
        .axis = {oscillation_axis(od, 0, mass.x), oscillation_axis(od, 1, mass.y)},
        .mass = mass,
        .viscous = v2(n_ratio(x->viscous, 20000000), n_ratio(y->viscous, 20000000)),
        .half_wave = (uint16_t)((uint64_t)CONTROL_HZ * 1000u / o->corner),
        .lasts = (uint16_t)(CONTROL_HZ * OSCILLATION_LASTS_MS / 1000u),
        .control_hz = CONTROL_HZ,
    };
}

bool configuration_fits(const struct od_data *od)
{
    const struct od_smc *a = &od->smc;
    const struct od_compensator *u = &od->compensator;
    const uint64_t damping_range = (uint64_t)a->k_bar * a->e_max; /* k_bar e_max in 1e-9 */
    for (int i = 0; i < 2; i++) {
        const struct od_axis *axis = &od->axis[i];
        const uint64_t continuous = axis->force_continuous.force;
        const bool bearable = continuous == 0 || continuous * FORCE_LIMIT_RATIO >= axis->plant.force_limit;
        struct force_filter_cfg filter = {.on = false};
        if (axis->position_limit.min > axis->position_limit.max || !bearable ||
            !force_filter(&filter, i, &axis->force_filter) || !lead_map_fits(axis) || !turn_error_fits(&axis->screw)) {
            return false;
        }
    }
    return damping_range <= (uint64_t)TRIG_COSH_MAX * 1000000000u && a->k_0 <= a->k_max && u->mu_0 <= u->mu_max &&
           onchip_configuration_fits(od);
}

struct servo_cfg configuration_servo(const struct od_data *od)
{
    const struct od_smc *a = &od->smc;
    const struct od_compensator *u = &od->compensator;
    const struct od_cascade *c = &od->cascade;
    const num friction_speed = nano_mps(od->contour.friction_speed);
    const num dt = n_ratio(200, CONTROL_HZ);
    const struct od_axis *x = &od->axis[0];
    const struct od_axis *y = &od->axis[1];
    /* exp(-dt / blend_time) to first order: dt / (dt + blend_time) is left out of the offset each period */
    const uint32_t dt_us = 1000000u / CONTROL_HZ;
    struct servo_cfg cfg = {
        .dt = dt,
        .blend = n_ratio(od->contour.blend_time, (int64_t)od->contour.blend_time + dt_us),
        .plant = plant(&od->axis[0].plant, &od->axis[1].plant),
        .observer = observer_design(observer_bandwidth(od), dt),
        .dual_feedback = {dual_feedback(od, 0), dual_feedback(od, 1)},
        .contour = {.v_min = nano_mps(od->contour.v_min),
                    .lag_max = n_ratio(od->contour.lag_max, 5000),
                    .newton = od->contour.newton != 0},
        .gains.smc = {.lambda = milli_per_s(a->lambda),
                      .gamma = milli_per_s(a->gamma),
                      .beta = milli(a->beta),
                      .stiffness = n_ratio(a->stiffness, 4000000), /* centi/s2 to 1/T0^2 */
                      .k_bar = n_ratio(a->k_bar, 1000000),
                      .e_max = milli(a->e_max),
                      .psi_printed = a->psi_printed != 0,
                      .k_0 = milli_per_s(a->k_0),
                      .k_max = milli_per_s(a->k_max),
                      .zeta = milli_per_s(a->zeta),
                      .zeta_rate = n_ratio((int64_t)a->zeta * ACC_GAIN, 40000000),
                      .xi = n_ratio((int64_t)a->xi * ACC_GAIN, 200000000000), /* milli/(m s) to 1/(um T0) */
                      .epsilon = nano_mps(a->epsilon),
                      .friction_speed = friction_speed},
        .gains.compensator = {.alpha = milli_per_s(u->alpha),
                              .mu_0 = micro_mps2(u->mu_0),
                              .mu_max = micro_mps2(u->mu_max),
                              .rho = n_ratio((int64_t)u->rho * ACC_GAIN, 40000000),
                              .phi = nano_mps(u->phi),
                              .dead_zone = nano_mps(u->dead_zone),
                              .turning = u->in_axes != 0 ? NUM(0) : NUM(1),
                              .law_printed = u->law_printed != 0,
                              .input_printed = u->input_printed != 0},
        .feedforward = {.friction_rate = milli_per_s(od->feedforward.friction_rate),
                        .mass_rate = milli_per_s(od->feedforward.mass_rate),
                        .acceleration = micro_mps2(od->feedforward.acceleration)},
        .delay = {.on = x->plant.force_delay != 0 || y->plant.force_delay != 0,
                  .time = {n_ratio(x->plant.force_delay, 5000), n_ratio(y->plant.force_delay, 5000)}},
        .friction = {.on = friction_on(&x->friction) || friction_on(&y->friction),
                     .axis = {friction(&x->friction), friction(&y->friction)}},
        .screw = {.on = x->screw.lead != 0 || y->screw.lead != 0, .axis = {screw(&x->screw), screw(&y->screw)}},
        .gains.cascade = {.k_p = milli_per_s(c->position_gain),
                          .k_v = milli_per_s(c->velocity_gain),
                          .k_i = milli_per_s(c->integral_gain),
                          .coupling = milli(c->coupling_gain),
                          .integral_max = NUM(1000)},
        .energy = {energy(&od->axis[0].motor, friction_speed), energy(&od->axis[1].motor, friction_speed)},
        .force_limit = force_limit(&od->axis[0], &od->axis[1]),
        .oscillation = oscillation(od),
    };
    geometry(&cfg.geometry, od, dt);
    for (int i = 0; i < 2; i++) {
        (void)force_filter(&cfg.force_filter, i, &od->axis[i].force_filter);
    }
    return cfg;
}

/* More counts in a period than an axis can move: four times those of the speed at which FAULT_OVERSPEED trips. 100
 * counts more leave room where these are few. */
static uint32_t jump_counts(const struct od_data *od, const struct od_axis *a)
{
    const uint64_t jump = (uint64_t)od->limits.velocity * 4u * 100000000u / CONTROL_HZ / a->plant.encoder;
    return jump + 100u < INT32_MAX ? (uint32_t)jump + 100u : INT32_MAX;
}

void configuration_live(const struct od_data *od, struct servo_loop_cfg *c)
{
    c->cut = fault_mask(od, REACT_DISABLE);
    c->stop = fault_mask(od, REACT_PATH_STOP);
    for (int i = 0; i < 2; i++) {
        const struct od_axis *a = &od->axis[i];
        c->following_max[i] = n_ratio(a->following_window, 1000);
        c->min_nm[i] = a->position_limit.min;
        c->max_nm[i] = a->position_limit.max;
    }
}

void configuration_servo_loop(const struct od_data *od, struct servo_loop_cfg *c)
{
    configuration_live(od, c);
    c->servo = configuration_servo(od);
    onchip_configuration(od, &c->onchip_plant);
    c->speed_max = n_ratio(od->limits.velocity, 200);
    c->stop_time = n_ratio(od->limits.path_stop_time, 1);
    for (int i = 0; i < 2; i++) {
        const struct od_axis *a = &od->axis[i];
        c->encoder_10fm[i] = a->plant.encoder;
        c->second_10fm[i] = a->second_encoder.length;
        c->following_ticks[i] = a->following_timeout * (CONTROL_HZ / 1000u);
        c->jump_counts[i] = jump_counts(od, a);
        c->ready[i] = a->wiring.ready != 0 ? HAL_AMPLIFIER_FAULT : 0;
    }
}

bool configuration_excitation(const struct od_data *od, struct excitation_cfg *c)
{
    const struct od_excitation *e = &od->excitation;
    const uint32_t per_ms = CONTROL_HZ / 1000u;
    *c = (struct excitation_cfg){.amplitude = milli(e->amplitude),
                                 .settle = e->settle * per_ms,
                                 .window = e->window * per_ms,
                                 .windows = e->windows,
                                 .axis = e->axis};
    bool below_half = true;
    while (c->lines < EXCITATION_LINES && od->excitation_periods[c->lines] != 0) {
        c->periods[c->lines] = od->excitation_periods[c->lines];
        below_half = below_half && 2u * c->periods[c->lines] < c->window;
        c->lines++;
    }
    const uint32_t whole_ms = e->settle + (uint32_t)e->window * e->windows;
    return below_half && c->lines != 0 && whole_ms <= EXCITATION_LONGEST_MS &&
           2u * c->lines * e->amplitude <= od->axis[e->axis].plant.force_limit;
}

void configuration_hal(const struct od_data *od, struct hal_axis_cfg cfg[AXES])
{
    for (int i = 0; i < AXES; i++) {
        const struct od_axis *a = &od->axis[i];
        cfg[i] = (struct hal_axis_cfg){
            .output = (enum hal_output)a->wiring.output,
            .full_scale_mN = a->wiring.full_scale,
            .offset = a->wiring.offset,
            .pwm = {.hz = od->pwm.frequency,
                    .antiphase = od->pwm.mode != 0,
                    .duty_min = od->pwm.duty_min,
                    .duty_max = od->pwm.duty_max},
            .invert_force = a->wiring.invert_force != 0,
            .invert_encoder = a->wiring.invert_encoder != 0,
            .invert_second = a->second_encoder.invert != 0,
            .index_counts = a->wiring.index_counts,
            .jump_counts = jump_counts(od, a),
        };
    }
}
