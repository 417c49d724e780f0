/* SPDX-License-Identifier: Apache-2.0 */
/* contour.h: contour-error estimation and reference adjustment, eqs (3)-(9).
 *
 * Context: servo_step() (servo.c) calls contour_step() once in a control period, in the servo tick. libkontur's
 * ks_estimate() calls it in a host process, without a drive.
 *
 * Source: "Adaptive Sliding Mode Contouring Control Design Based on Reference Adjustment and Uncertainty
 * Compensation for Feed Drive Systems". Equation numbers throughout `core` are that paper's.
 *
 * Differences from the source
 * - (5) is singular at standstill. Here t_d = -e_lt / (|r'| + v_min^2/|r'|), clamped to +-lag_max, which goes to 0
 *   there: the adjusted reference becomes r, and the law becomes plain tracking.
 * - One Newton step on the foot-point condition (q - r(tau)) . r'(tau) = 0 follows (6), unless `newton` is off.
 * - The rate nu = d tau/dt of the foot point comes from differentiating that condition, not from 1 - d t_d/dt: the
 *   condition has no |r'| alone in a denominator. Where lag_max limits the foot point, nu is the rate of the path.
 * - The frame's rates use tau'' = 0: theta'' = theta''(tau) nu^2.
 * - These rates act on a share of the errors: so much as is not larger than the error of which (5) makes lag_max. A
 *   path that is all but at rest turns as its knots are rounded, and its rates times a large error would shake the axes.
 * - The derivatives of r_n (8) are not computed themselves, but what the law needs of them: e_n' and a_n, in the frame.
 *
 * | symbol    | meaning                                              | unit     |
 * |-----------|------------------------------------------------------|----------|
 * | s, sigma  | path time and its rate (1: as programmed)            | knots, - |
 * | tau, nu   | path time of the foot point, its rate                | knots, - |
 * | t, n      | unit tangent and normal at the foot point            | -        |
 * | e_w       | q - r                                        (3)     | um       |
 * | e_l       | e_w in the frame at r(s)                     (4)     | um       |
 * | t_d       | path time from foot point to r(s)            (5)     | T0       |
 * | r_n       | adjusted reference                           (7)     | um       |
 * | e_wn      | q - r_n                                              | um       |
 * | e_n       | e_wn in the frame at the foot point; e_n.y is the    |          |
 * |           | contour error, e_n.x the error along the path  (9)   | um       |
 * | a_n       | e_n'' = R^T q'' - a_n: the acceleration that r_n'',  |          |
 * |           | theta'' and theta' ask for, in the frame   (8), (15) | um/T0^2  |
 */
#ifndef KONTUR_CONTOUR_H
#define KONTUR_CONTOUR_H
#include "core/spline.h"

/* Path speed, um/T0 (4 um/s), at and below which the path is at standstill and has no direction. Quotients by a greater
 * speed have three digits or more in fixed point. */
#define CONTOUR_SPEED_MIN 0.02

struct contour_cfg {
    num v_min;   /* regularising speed, um/T0, > 0 */
    num lag_max; /* limit of |t_d|, T0, > 0 */
    bool newton;
};

/* Where the reference is on its path. motion/path_clock.c writes it once in a control period. */
struct path_state {
    uint32_t knot, fraction; /* path time s: number of the last knot passed, and path time since that knot */
    num rate;                /* sigma = ds/dt, 0..1.2 */
    num rate_dot;            /* d sigma/dt, 1/T0 */
    uint32_t count;          /* valid knots */
};

struct contour_out {
    vec2 r_dot, r_ddot; /* derivatives of r(s) by time */
    vec2 e_w, e_w_dot;  /* q - r(s) */
    vec2 e_l;
    num t_d;
    uint32_t foot_knot; /* tau lies foot_u knots after knot foot_knot */
    num foot_u;
    num nu;
    vec2 t;
    num theta_dot, theta_ddot; /* rates of the frame at the foot point, 1/T0, 1/T0^2 */
    vec2 e_wn;
    vec2 e_n, e_n_dot;
    vec2 a_n;
};

/* One evaluation for actual position q and velocity q_dot (um/T0). It has no state but the cache of the curve. */
void contour_step(const struct contour_cfg *cfg, struct spline_cache *cache, const struct spline_ring *ring,
                  const struct path_state *path, const pos_t q[2], vec2 q_dot, struct contour_out *out);

static inline path_time_t contour_tau(const struct contour_out *out)
{
    return path_time(out->foot_knot, out->foot_u);
}

static inline path_time_t path_s(const struct path_state *path)
{
    return (path_time_t)path->knot * PATH_ONE + (path_time_t)path->fraction;
}

/* Set path time to s >= 0. */
static inline void path_set(struct path_state *path, path_time_t s)
{
    path->knot = path_knots(s, &path->fraction);
}
#endif
