/* SPDX-License-Identifier: Apache-2.0 */
/* contour.h: contour-error estimation and reference adjustment, eqs (3)-(9).
 *
 * Source: "Adaptive Sliding Mode Contouring Control Design Based on Reference Adjustment and Uncertainty
 * Compensation for Feed Drive Systems". Equation numbers throughout `core` are that paper's.
 *
 * Differences from the source
 * - (5) is singular at standstill; here t_d = -e_lt / (|r'| + v_min^2/|r'|), clamped to +-lag_max, goes to 0 there
 *   and the adjusted reference becomes r: the law turns into plain tracking by itself.
 * - One Newton step on the foot-point condition (q - r(tau)) . r'(tau) = 0 follows (6), unless `newton` is off.
 * - The rate nu = d tau/dt of the foot point comes from differentiating that condition, which needs no |r'| in a
 *   denominator by itself, in place of 1 - d t_d/dt.
 * - The frame's rates use tau'' = 0: theta'' = theta''(tau) nu^2.
 * - Of the derivatives of r_n (8) only what the law needs of them is computed, in the frame: e_n' and a_n.
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

/* Path speed, um/T0, at and below which there is no direction (4 um/s): quotients by it keep three digits in fixed point. */
#define CONTOUR_STILL 0.02

struct contour_cfg {
    num v_min;   /* regularising speed, um/T0, > 0 */
    num lag_max; /* limit of |t_d|, T0, > 0 */
    bool newton;
};

/* Where the reference is on its path: written once a control period by the drive layer. */
struct path_state {
    uint32_t knot, rest; /* path time s: knots passed, and path time since the last of them */
    num rate;            /* sigma = ds/dt, 0..1.2 */
    num rate_dot;        /* d sigma/dt, 1/T0 */
    uint32_t count;      /* valid knots */
};

struct contour_out {
    vec2 r_dot, r_ddot; /* derivatives of r(s) by time */
    vec2 e_w, e_w_dot;  /* q - e_w: r(s) */
    vec2 e_l;
    num t_d;
    uint32_t foot_knot; /* tau: the last knot before, and knots from there */
    num foot_u;
    num nu;
    vec2 t;
    num theta_dot, theta_ddot; /* of the frame at the foot point, 1/T0, 1/T0^2 */
    vec2 e_wn;
    vec2 e_n, e_n_dot;
    vec2 a_n;
};

/* One evaluation for actual position q and velocity q_dot (um/T0). Nothing is kept but pieces of the curve. */
void contour_step(const struct contour_cfg *cfg, struct spline_kept *kept, const struct spline_ring *ring,
                  const struct path_state *path, const pos_t q[2], vec2 q_dot, struct contour_out *out);

static inline path_time_t contour_tau(const struct contour_out *out)
{
    return path_time(out->foot_knot, out->foot_u);
}

static inline path_time_t path_s(const struct path_state *path)
{
    return (path_time_t)path->knot * PATH_ONE + (path_time_t)path->rest;
}

/* s >= 0 */
static inline void path_set(struct path_state *path, path_time_t s)
{
    path->knot = path_knots(s, &path->rest);
}
#endif
