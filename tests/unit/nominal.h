/* SPDX-License-Identifier: Apache-2.0 */
/* nominal.h: the drive of Table 1 in core units (um, T0 = 5 ms, N) and simple paths, for the tests of the core. */
#ifndef KONTUR_NOMINAL_H
#define KONTUR_NOMINAL_H
#include <math.h>

#include "core/servo.h"
#include "num_test.h"

#define T0 0.005
#define MPS (1e-6 / T0)       /* 1 um/T0 in m/s */
#define MPS2 (1e-6 / T0 / T0) /* 1 um/T0^2 in m/s^2 */
#define DT val(NUM(0.02))     /* 100 us in T0, as the back end represents it */

#define MASS_X (88.08 * MPS2)
#define MASS_Y (97.90 * MPS2)
#define VISCOUS_X (467.2 * MPS)
#define VISCOUS_Y (631.0 * MPS)

static inline struct servo_cfg nominal(void)
{
    const struct energy_cfg energy = {.force_constant = mk(72),
                                      .impedance = mk(2.5),
                                      .back_emf = mk(41.6 * MPS),
                                      .power_factor = mk(0.9),
                                      .sign_speed = mk(50e-6 / MPS),
                                      .dt_ms = mk(0.1)};
    const struct servo_cfg cfg = {
        .dt = mk(DT),
        .blend = mk(0.995),
        .plant = {.mass = mk2(MASS_X, MASS_Y),
                  .viscous = mk2(VISCOUS_X, VISCOUS_Y),
                  .coulomb = mk2(45.5, 54.8),
                  .force_max = mk2(600, 600)},
        .observer = observer_design(mk(1300 * T0), mk(DT)),
        .contour = {.v_min = mk(1e-4 / MPS), .lag_max = mk(1.2), .newton = true},
        .gains.smc = {.lambda = mk(200 * T0),
                      .gamma = mk(1.2 * T0),
                      .beta = mk(6),
                      .k_bar = mk(1e-3),
                      .e_max = mk(1000),
                      .k_0 = mk(100 * T0),
                      .k_max = mk(400 * T0),
                      .zeta = mk(100 * T0),
                      .zeta_rate = mk(100 * T0 * T0 * ACC_GAIN),
                      .xi = mk(1e4 * T0 * 1e-6 * ACC_GAIN),
                      .epsilon = mk(1e-3 / MPS),
                      .friction_speed = mk(50e-6 / MPS)},
        .gains.compensator = {.alpha = mk(60 * T0),
                              .mu_0 = mk(1 / MPS2),
                              .mu_max = mk(4 / MPS2),
                              .rho = mk(0.5 * T0 * T0 * ACC_GAIN),
                              .phi = mk(1e-3 / MPS),
                              .dead_zone = mk(1e-3 / MPS),
                              .turning = mk(1)},
        .feedforward = {.acceleration = mk(0.5 / MPS2)}, /* both rates are 0, so that it is off */
        .gains.cascade = {.k_p = mk(67.4 * T0),
                          .k_v = mk(307 * T0),
                          .k_i = mk(77 * T0),
                          .coupling = mk(1),
                          .integral_max = mk(1000)},
        .energy = {energy, energy},
    };
    return cfg;
}

static inline path_time_t path_time_of(double knots)
{
    return (path_time_t)llround(knots * (double)PATH_ONE);
}

static inline struct path_state path_at(const struct spline_ring *ring, double knots)
{
    struct path_state path = {.rate = mk(1), .rate_dot = mk(0), .count = ring->count};
    path_set(&path, path_time_of(knots));
    return path;
}

static inline void add_knot(struct spline_ring *ring, double x_um, double y_um)
{
    const struct knot k = {{(int32_t)lround(x_um * 1e3), (int32_t)lround(y_um * 1e3)}};
    ring->knot[ring->count % SPLINE_RING] = k;
    ring->count++;
}

/* A circle about the origin with `step` rad between knots, and angle 0 at path time 0. Its control points lie on a
 * larger circle: at the knots, (c_-1 + 4 c_0 + c_1)/6 has 4/6 + 2/6 cos(step) of their radius. Between knots the
 * curve is less than 1e-8 of the radius off the circle. */
static inline void circle_ring(struct spline_ring *ring, double radius_um, double step, uint32_t count)
{
    const double r = radius_um * 6.0 / (4.0 + 2.0 * cos(step));
    ring->count = 0;
    for (uint32_t i = 0; i < count; i++) {
        add_knot(ring, r * cos(i * step), r * sin(i * step));
    }
    ring->start.nm[0] = (int32_t)lround(r * cos(step) * 1e3);
    ring->start.nm[1] = (int32_t)lround(-r * sin(step) * 1e3);
}

/* A straight line at constant speed through (x0, y0) at path time 0. */
static inline void line_ring(struct spline_ring *ring, double x0, double y0, double dx, double dy, uint32_t count)
{
    ring->count = 0;
    for (uint32_t i = 0; i < count; i++) {
        add_knot(ring, x0 + i * dx, y0 + i * dy);
    }
    ring->start.nm[0] = (int32_t)lround((x0 - dx) * 1e3);
    ring->start.nm[1] = (int32_t)lround((y0 - dy) * 1e3);
}

static inline void at_um(double x, double y, pos_t q[2])
{
    q[0] = (pos_t)llround(x * 1e3 * POS_PER_NM);
    q[1] = (pos_t)llround(y * 1e3 * POS_PER_NM);
}
#endif
