/* SPDX-License-Identifier: Apache-2.0 */
/* core_api.c: the control core for Python, core_api.h. */
#include "core_api.h"

#include <math.h>
#include <stdlib.h>

#include "core/servo.h"
#include "core/trig.h"
#include "num_test.h"

/* The units of the core, 1 um and 5 ms, in SI. */
#define UM 1e-6
#define T0 5e-3
#define MPS (UM / T0)
#define MPS2 (UM / T0 / T0)

struct api_drive {
    struct servo_cfg cfg;
    struct servo_state state;
    struct spline_ring ring;
};

static vec2 in2(const double x[2], double unit)
{
    return mk2(x[0] / unit, x[1] / unit);
}

/* Results are values; in the back end of num_bound.h they are the bounds of their errors. Positions are in 2^-16 nm. */
#ifdef KONTUR_NUM_BOUND_H
double bound_path_time;

static double result(num x)
{
    return x.e + 0x1p-33; /* result() of the other back ends has a resolution of 2^-32 */
}

static int64_t result_pos(pos_t p)
{
    return (int64_t)ceil(p.e / UM_PER_POS);
}

static double result_path_time(path_time_t s)
{
    (void)s;
    return bound_path_time * T0;
}

static pos_t pos_of(int64_t x)
{
    return (pos_t){x, 0.0};
}
#else
static double bound_path_time;

static double result(num x)
{
    return val(x);
}

static int64_t result_pos(pos_t p)
{
    return p;
}

static double result_path_time(path_time_t s)
{
    return (double)s / (double)PATH_ONE * 1e-3;
}

static pos_t pos_of(int64_t x)
{
    return x;
}
#endif

static void out2(vec2 v, double unit, double x[2])
{
    x[0] = result(v.x) * unit;
    x[1] = result(v.y) * unit;
}

int64_t api_path_one(void)
{
    return PATH_ONE;
}

static uint32_t milli(double x)
{
    return (uint32_t)lround(x * 1000);
}

static num inverse(double force)
{
    return mk(force > 0 ? 1 / force : 0);
}

static struct servo_cfg config(const struct api_params *p)
{
    struct servo_cfg c = {
        .dt = mk(p->dt / T0),
        .blend = mk(p->blend),
        .plant = {.mass = in2(p->mass, 1 / MPS2),
                  .viscous = in2(p->viscous, 1 / MPS),
                  .coulomb = in2(p->coulomb, 1),
                  .force_max = in2(p->force_max, 1)},
        .contour = {.v_min = mk(p->v_min / MPS), .lag_max = mk(p->lag_max / T0), .newton = p->newton != 0},
        .gains.smc = {.lambda = mk(p->lambda * T0),
                      .gamma = mk(p->gamma * T0),
                      .beta = mk(p->beta),
                      .stiffness = mk(p->stiffness * T0 * T0),
                      .k_bar = mk(p->k_bar * UM),
                      .e_max = mk(p->e_max / UM),
                      .psi_printed = p->psi_printed != 0,
                      .k_0 = mk(p->k_0 * T0),
                      .k_max = mk(p->k_max * T0),
                      .zeta = mk(p->zeta * T0),
                      .zeta_rate = mk(p->zeta_rate * T0 * T0 * ACC_GAIN),
                      .xi = mk(p->xi * UM * T0 * ACC_GAIN),
                      .epsilon = mk(p->epsilon / MPS),
                      .friction_speed = mk(p->friction_speed / MPS)},
        .gains.compensator = {.alpha = mk(p->alpha * T0),
                              .mu_0 = mk(p->mu_0 / MPS2),
                              .mu_max = mk(p->mu_max / MPS2),
                              .rho = mk(p->rho * T0 * T0 * ACC_GAIN),
                              .phi = mk(p->phi / MPS),
                              .dead_zone = mk(p->dead_zone / MPS),
                              .turning = mk(p->in_axes != 0 ? 0 : 1),
                              .law_printed = p->mu_printed != 0,
                              .input_printed = p->input_printed != 0},
        .feedforward = {.friction_rate = mk(p->friction_rate * T0),
                        .mass_rate = mk(p->mass_rate * T0),
                        .acceleration = mk(p->feedforward_acceleration / MPS2)},
        .gains.cascade = {.k_p = mk(p->k_p * T0),
                          .k_v = mk(p->k_v * T0),
                          .k_i = mk(p->k_i * T0),
                          .coupling = mk(p->coupling),
                          .integral_max = mk(p->integral_max / UM)},
    };
    c.observer = observer_design(mk(p->observer * T0), c.dt);
    static const uint32_t order[SCREW_HARMONICS] = {1, 2, 6};
    for (int i = 0; i < 2; i++) {
        c.friction.on = c.friction.on || p->presliding[i] > 0 || p->breakaway[i] > 1;
        c.friction.axis[i] = friction_design(mk(p->presliding[i] / UM), mk(p->breakaway[i]), mk(p->stribeck[i] / MPS));
        c.delay.on = c.delay.on || p->force_delay[i] > 0;
        c.delay.time[i] = mk(p->force_delay[i] / T0);
        if (p->lead[i] > 0) {
            c.screw.on = true;
            c.screw.axis[i].turns = screw_turns((uint32_t)lround(p->lead[i] * 1e9));
        }
        for (int n = 0; n < SCREW_HARMONICS; n++) {
            c.screw.axis[i].harmonic[n] = (struct screw_harmonic){.order = order[n],
                                                                  .cogging_cos = mk(p->cogging_cos[i][n]),
                                                                  .cogging_sin = mk(p->cogging_sin[i][n]),
                                                                  .ripple_cos = mk(p->ripple_cos[i][n]),
                                                                  .ripple_sin = mk(p->ripple_sin[i][n])};
        }
        c.energy[i] = (struct energy_cfg){.force_constant = mk(p->force_constant[i]),
                                          .impedance = mk(p->impedance[i]),
                                          .back_emf = mk(p->back_emf[i] * MPS),
                                          .power_factor = mk(p->power_factor),
                                          .sign_speed = mk(p->friction_speed / MPS),
                                          .dt_ms = mk(SERVO_SLOTS * p->dt * 1e3)};
    }
    c.force_limit = (struct force_limit_cfg){
        .on = p->continuous[0] > 0 || p->continuous[1] > 0,
        .continuous = v2(mk(p->continuous[0] > 0 ? p->continuous[0] : p->force_max[0]),
                         mk(p->continuous[1] > 0 ? p->continuous[1] : p->force_max[1])),
        .inverse = v2(inverse(p->continuous[0]), inverse(p->continuous[1])),
        .rate = {mk(SERVO_SLOTS * p->dt / p->thermal[0] * ACC_GAIN),
                 mk(SERVO_SLOTS * p->dt / p->thermal[1] * ACC_GAIN)},
    };
    return c;
}

static bool filters(struct servo_cfg *c, const struct api_params *p)
{
    bool fit = true;
    for (int i = 0; i < 2; i++) {
        struct force_section_spec spec[FORCE_SECTIONS];
        for (unsigned n = 0; n < FORCE_SECTIONS; n++) {
            const double *s = p->sections[i][n];
            spec[n] = (struct force_section_spec){milli(s[0]), milli(s[1]), milli(s[2]), milli(s[3])};
        }
        fit = force_filter_design(&c->force_filter, i, spec, (uint32_t)lround(1 / p->dt)) && fit;
    }
    return fit;
}

api_drive *api_new(const struct api_params *p, const int32_t *knots_nm, uint32_t count, const int32_t *start_nm)
{
    api_drive *d = calloc(1, sizeof *d);
    if (d != NULL) {
        d->cfg = config(p);
        if (!filters(&d->cfg, p)) {
            free(d);
            return NULL;
        }
        d->ring.start = (struct knot){{start_nm[0], start_nm[1]}};
        d->ring.count = count;
        for (uint32_t i = 0; i < count; i++) {
            d->ring.knot[i % SPLINE_RING] = (struct knot){{knots_nm[2 * i], knots_nm[2 * i + 1]}};
        }
    }
    return d;
}

void api_free(api_drive *d)
{
    free(d);
}

void api_trig_cosh(double x, double out[2])
{
    const struct trig_cosh r = trig_cosh(mk(x));
    out[0] = result(r.cosh_x);
    out[1] = result(r.sinh_x);
}

double api_trig_decay(double x)
{
    return result(trig_decay(mk(x)));
}

void api_trig_circle(uint32_t phase, double out[2])
{
    const struct trig_circle r = trig_circle(phase);
    out[0] = result(r.cos);
    out[1] = result(r.sin);
}

void api_spline(const api_drive *d, int64_t s, struct api_point *out)
{
    struct spline_point p;
    bound_path_time = 0;
    spline_at(&d->ring, d->ring.count, s, &p);
    for (int i = 0; i < 2; i++) {
        out->r[i] = (double)result_pos(p.pos[i]) / (POS_PER_NM * 1e9);
    }
    out2(p.d1, MPS, out->d1);
    out2(p.d2, MPS2, out->d2);
    out2(p.d3, MPS2 / T0, out->d3);
}

static struct path_state path_in(const api_drive *d, const struct api_path *path)
{
    struct path_state at = {.rate = mk(path->rate), .rate_dot = mk(path->rate_dot * T0), .count = d->ring.count};
    path_set(&at, path->s);
    return at;
}

void api_contour(const api_drive *d, const struct api_path *path, const int64_t *q, const double *q_dot,
                 struct api_contour *out)
{
    const struct path_state ps = path_in(d, path);
    const pos_t at[2] = {pos_of(q[0]), pos_of(q[1])};
    struct contour_out c;
    bound_path_time = 0;
    contour_step(&d->cfg.contour, &(struct spline_cache){0}, &d->ring, &ps, at, in2(q_dot, MPS), &c);
    out2(c.r_dot, MPS, out->r_dot);
    out2(c.r_ddot, MPS2, out->r_ddot);
    out2(c.e_w, UM, out->e_w);
    out2(c.e_w_dot, MPS, out->e_w_dot);
    out2(c.e_l, UM, out->e_l);
    out->t_d = result(c.t_d) * T0;
    out->tau = result_path_time(contour_tau(&c));
    out->nu = result(c.nu);
    out2(c.t, 1, out->t);
    out->theta_dot = result(c.theta_dot) / T0;
    out->theta_ddot = result(c.theta_ddot) / T0 / T0;
    out2(c.e_wn, UM, out->e_wn);
    out2(c.e_n, UM, out->e_n);
    out2(c.e_n_dot, MPS, out->e_n_dot);
    out2(c.a_n, MPS2, out->a_n);
}

void api_law(const api_drive *d, const struct api_law_in *in, double *k_hat, struct api_law_out *out)
{
    const struct smc_in x = {.t = in2(in->t, 1),
                             .e = in2(in->e, UM),
                             .e_dot = in2(in->e_dot, MPS),
                             .a_n = in2(in->a_n, MPS2),
                             .q_dot = in2(in->q_dot, MPS),
                             .direction = smc_direction(d->cfg.gains.smc.friction_speed, in2(in->r_dot, MPS))};
    struct smc_state state = {.k_hat = {acc_from(mk(k_hat[0] * T0)), acc_from(mk(k_hat[1] * T0))}};
    struct smc_out o;
    smc_step(&d->cfg.gains.smc, &d->cfg.plant, &state, &x, &o);
    smc_adapt(&d->cfg.gains.smc, &state, 0, o.s_bar, d->cfg.dt);
    smc_adapt(&d->cfg.gains.smc, &state, 1, o.s_bar, d->cfg.dt);
    out2(v2(acc_to(state.k_hat[0]), acc_to(state.k_hat[1])), 1 / T0, k_hat);
    out2(o.s_bar, MPS, out->s_bar);
    out2(o.u_linear, 1, out->u_linear);
    out2(o.u_friction, 1, out->u_friction);
}

void api_compensation(const api_drive *d, const struct api_frame *frame, const int64_t *q, const double *q_dot,
                      int64_t *q_bar, const double *q_bar_dot, double *mu, struct api_compensation *out)
{
    struct compensator_state state = {.q_bar = {pos_of(q_bar[0]), pos_of(q_bar[1])},
                                      .q_bar_dot = in2(q_bar_dot, MPS),
                                      .mu = {acc_from(mk(mu[0] / MPS2)), acc_from(mk(mu[1] / MPS2))}};
    const pos_t at[2] = {pos_of(q[0]), pos_of(q[1])};
    struct compensator_out o;
    bound_path_time = 0;
    compensator_step(&d->cfg.gains.compensator, &d->cfg.plant, &state, at, in2(q_dot, MPS), in2(frame->t, 1),
                     mk(frame->theta_dot * T0), &o);
    compensator_adapt(&d->cfg.gains.compensator, &state, 0, o.s, d->cfg.dt);
    compensator_adapt(&d->cfg.gains.compensator, &state, 1, o.s, d->cfg.dt);
    q_bar[0] = result_pos(state.q_bar[0]);
    q_bar[1] = result_pos(state.q_bar[1]);
    out2(v2(acc_to(state.mu[0]), acc_to(state.mu[1])), MPS2, mu);
    out2(o.z_n, UM, out->z_n);
    out2(o.s, MPS, out->s);
    out2(o.v, MPS2, out->v);
    out2(o.u, 1, out->u);
}

void api_model(const api_drive *d, const double *u_bar, int64_t *q_bar, double *q_bar_dot)
{
    struct compensator_state state = {.q_bar = {pos_of(q_bar[0]), pos_of(q_bar[1])}, .q_bar_dot = in2(q_bar_dot, MPS)};
    compensator_model(&d->cfg.plant, &state, in2(u_bar, 1), d->cfg.dt);
    q_bar[0] = result_pos(state.q_bar[0]);
    q_bar[1] = result_pos(state.q_bar[1]);
    out2(state.q_bar_dot, MPS, q_bar_dot);
}

void api_observe(const api_drive *d, int i, int64_t measured, double force, int64_t *pos, double *state)
{
    const struct plant_cfg *p = &d->cfg.plant;
    struct observer_state s = {.pos = pos_of(*pos), .vel = mk(state[0] / MPS), .disturbance = mk(state[1] / MPS2)};
    observer_step(&d->cfg.observer, &s, pos_of(measured), mk(force), i == 0 ? p->mass.x : p->mass.y,
                  i == 0 ? p->viscous.x : p->viscous.y);
    *pos = result_pos(s.pos);
    state[0] = result(s.vel) * MPS;
    state[1] = result(s.disturbance) * MPS2;
    state[2] = result(s.acc) * MPS2;
}

void api_geometry(const api_drive *d, struct api_geometry_axis axis[2], const int64_t *encoder)
{
    static struct geometry_cfg cfg;
    struct geometry_state state = {.started = true};
    cfg.dt = d->cfg.dt;
    for (int i = 0; i < 2; i++) {
        const struct api_geometry_axis *a = &axis[i];
        cfg.axis[i] = (struct geometry_axis_cfg){.points = a->points,
                                                 .start_nm = a->start_nm,
                                                 .step_nm = a->step_nm,
                                                 .turns = screw_turns((uint32_t)lround(a->screw * 1e9)),
                                                 .error_cos = mk(a->error_cos / UM),
                                                 .error_sin = mk(a->error_sin / UM),
                                                 .squareness = mk(a->squareness * 1e3),
                                                 .compliance = mk(a->compliance / UM),
                                                 .mass = mk(a->mass * MPS2),
                                                 .coulomb = mk(a->coulomb),
                                                 .viscous = mk(a->viscous * MPS),
                                                 .half_gap = mk(0.5 * a->backlash / UM),
                                                 .side_bandwidth = mk(a->side_bandwidth * T0),
                                                 .gap_inertia = mk(a->mass_before * MPS2 * 0.5 * a->backlash / UM)};
        for (uint32_t k = 0; k < a->points; k++) {
            cfg.axis[i].lead[k] = mk(a->lead[k] / UM);
        }
        state.axis[i] = (struct geometry_axis_state){.origin_nm = a->last_origin_nm,
                                                     .position = {mk(a->placed / UM), mk(a->bridge / UM)},
                                                     .turn = {mk(a->turn / UM), mk(a->turn_bridge / UM)},
                                                     .deflection = mk(a->deflection / UM),
                                                     .target = mk(a->target),
                                                     .side = mk(a->side),
                                                     .side_rate = mk(a->side_rate * T0)};
    }
    const int32_t origin_nm[2] = {axis[0].origin_nm, axis[1].origin_nm};
    const pos_t from[2] = {pos_of(encoder[0]), pos_of(encoder[1])};
    geometry_step(&cfg, &state, from, origin_nm, -1);
    for (int i = 0; i < 2; i++) {
        geometry_push(&cfg, &state, i, mk(axis[i].r_dot / MPS), mk(axis[i].r_ddot / MPS2), mk(axis[i].direction));
        const struct geometry_axis_state *x = &state.axis[i];
        struct api_geometry_axis *a = &axis[i];
        a->placed = result(x->position.placed) * UM;
        a->bridge = result(x->position.bridge) * UM;
        a->turn = result(x->turn.placed) * UM;
        a->turn_bridge = result(x->turn.bridge) * UM;
        a->deflection = result(x->deflection) * UM;
        a->target = result(x->target);
        a->side = result(x->side);
        a->side_rate = result(x->side_rate) / T0;
        a->gap_force = result(x->gap_force);
        a->by_position = result(i == 0 ? state.position.x : state.position.y) * UM;
        a->by_angle = result(i == 0 ? state.turn.x : state.turn.y) * UM;
        a->by_force = result(i == 0 ? state.force.x : state.force.y) * UM;
    }
}

double api_dual_feedback(const api_drive *d, double crossover, double tolerance, double offset, const int64_t *encoder,
                         int *agree)
{
    const struct dual_feedback_cfg cfg = {
        .on = true, .gain = n_mul(mk(crossover * T0), d->cfg.dt), .tolerance = mk(tolerance / UM)};
    struct dual_feedback_state state = {.offset = mk(offset / UM)};
    *agree = dual_feedback_step(&cfg, &state, pos_sub(pos_of(encoder[1]), pos_of(encoder[0])));
    return result(state.offset) * UM;
}

int api_oscillations(const api_drive *d, int i, double limit, double count, double force_max, double share,
                     int half_wave, int lasts, int periods, const double *net, const double *r_dot,
                     const double *r_ddot, int room, int *at, double *frequency, double *amplitude)
{
    const struct plant_cfg *p = &d->cfg.plant;
    const num quarter = mk(0.25);
    const struct oscillation_axis axis = {mk(limit / 4.0), mk(count / 4.0), mk(force_max / 4.0)};
    const struct oscillation_cfg cfg = {.on = true,
                                        .slow = mk(share),
                                        .axis = {axis, axis},
                                        .mass = v2_scale(quarter, p->mass),
                                        .viscous = v2_scale(quarter, p->viscous),
                                        .half_wave = (uint16_t)half_wave,
                                        .lasts = (uint16_t)lasts,
                                        .control_hz = 10000};
    const bool enabled[2] = {i == 0, i == 1};
    struct oscillation_state state[2] = {{.count = 0}, {.count = 0}};
    int found = 0;
    for (int k = 0; k < periods; k++) {
        const num v = mk(r_dot[k] / MPS), a = mk(r_ddot[k] / MPS2), u = mk(net[k]);
        if (oscillation_step(&cfg, state, enabled, v2(u, u), v2(v, v), v2(a, a)) && found < room) {
            at[found] = k;
            frequency[found] = result(state[i].frequency);
            amplitude[found] = result(state[i].force);
            found++;
        }
    }
    return found;
}

void api_cascade(const api_drive *d, const struct api_contour *c, int coupled, double *integral, double *force)
{
    const struct contour_out x = {.r_dot = in2(c->r_dot, MPS),
                                  .r_ddot = in2(c->r_ddot, MPS2),
                                  .e_w = in2(c->e_w, UM),
                                  .e_w_dot = in2(c->e_w_dot, MPS),
                                  .t = in2(c->t, 1),
                                  .e_n = in2(c->e_n, UM),
                                  .e_n_dot = in2(c->e_n_dot, MPS)};
    struct cascade_state state = {.integral = in2(integral, UM), .coupled = mk(integral[2] / UM)};
    out2(cascade_step(&d->cfg.gains.cascade, &d->cfg.plant, &state, &x, coupled != 0, d->cfg.dt), 1, force);
    out2(state.integral, UM, integral);
    integral[2] = result(state.coupled) * UM;
}

double api_force_filter(const api_drive *d, int i, double (*state)[2], double force)
{
    struct force_filter_state s;
    force_filter_reset(&s, v2(mk(0), mk(0)));
    for (unsigned n = 0; n < FORCE_SECTIONS; n++) {
        s.section[i][n] = (struct force_section_state){mk(state[n][0]), mk(state[n][1])};
    }
    const vec2 y = force_filter_step(&d->cfg.force_filter, &s, i == 0 ? v2(mk(force), mk(0)) : v2(mk(0), mk(force)));
    for (unsigned n = 0; n < FORCE_SECTIONS; n++) {
        state[n][0] = result(s.section[i][n].s1);
        state[n][1] = result(s.section[i][n].s2);
    }
    return result(i == 0 ? y.x : y.y);
}

void api_force_limit(const api_drive *d, double *heat, const double *force, double *limit)
{
    struct force_limit_state s = {.heat = {acc_from(mk(heat[0])), acc_from(mk(heat[1]))}};
    for (int i = 0; i < 2; i++) {
        force_limit_step(&d->cfg.force_limit, &s, i, in2(force, 1), d->cfg.plant.force_max);
    }
    out2(s.limit, 1, limit);
    out2(v2(acc_to(s.heat[0]), acc_to(s.heat[1])), 1, heat);
}

void api_friction(api_drive *d, const double *r_dot, double *shape)
{
    const vec2 v = in2(r_dot, MPS);
    const vec2 direction = smc_direction(d->cfg.gains.smc.friction_speed, v);
    const num x = friction_step(&d->cfg.friction, &d->state.friction, 0, true, v.x, direction.x, d->cfg.dt);
    const num y = friction_step(&d->cfg.friction, &d->state.friction, 1, true, v.y, direction.y, d->cfg.dt);
    out2(v2(x, y), 1, shape);
}

void api_screw(const api_drive *d, const int64_t *at, const double *demand, double *u)
{
    const vec2 wanted = in2(demand, 1);
    out2(v2(screw_cancel(&d->cfg.screw.axis[0], pos_of(at[0]), wanted.x),
            screw_cancel(&d->cfg.screw.axis[1], pos_of(at[1]), wanted.y)),
         1, u);
}

double api_power(const api_drive *d, int i, double velocity, double acceleration)
{
    const struct plant_cfg *p = &d->cfg.plant;
    struct energy_state state;
    energy_reset(&state);
    return result(energy_step(&d->cfg.energy[i], &state, i == 0 ? p->mass.x : p->mass.y,
                              i == 0 ? p->viscous.x : p->viscous.y, i == 0 ? p->coulomb.x : p->coulomb.y,
                              mk(velocity / MPS), mk(acceleration / MPS2)));
}

void api_servo_reset(api_drive *d, const int64_t *measured)
{
    const pos_t at[2] = {pos_of(measured[0]), pos_of(measured[1])};
    servo_reset(&d->cfg, &d->state, at);
}

void api_servo_step(api_drive *d, const struct api_path *path, const int64_t *measured, int controller, int enabled,
                    double *force, double *velocity, double *e_n, double *energy_J)
{
    const struct servo_in in = {.measured = {pos_of(measured[0]), pos_of(measured[1])},
                                .enabled = {enabled != 0, enabled != 0},
                                .controller = (enum controller)controller,
                                .path = path_in(d, path),
                                .ring = &d->ring};
    struct servo_out out;
    servo_step(&d->cfg, &d->state, &in, &out);
    out2(out.force, 1, force);
    out2(out.velocity, MPS, velocity);
    out2(out.contour.e_n, UM, e_n);
    *energy_J = 0;
    for (int i = 0; i < 2; i++) {
        *energy_J += (d->state.energy[i].mJ + result(d->state.energy[i].fraction_mJ)) * 1e-3;
    }
}
