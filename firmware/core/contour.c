/* SPDX-License-Identifier: Apache-2.0 */
#include "contour.h"

static vec2 difference(const pos_t a[2], const pos_t b[2])
{
    return v2(pos_sub(a[0], b[0]), pos_sub(a[1], b[1]));
}

/* Direction and derivatives at a point, divided by the speed |r'|: squares of um/T0 would leave the range of num.
 * `drag` = v_min^2 / |r'| regularises every quotient; at standstill there is no direction: the x axis, all rates 0. */
struct frame {
    bool still;
    vec2 t;
    num speed, drag;
    vec2 d2, d3; /* second and third derivative / |r'| */
};

static struct frame frame_at(const struct contour_cfg *cfg, const struct spline_point *p)
{
    const num speed = v2_norm(p->d1);
    if (!n_lt(NUM(CONTOUR_STILL), speed)) {
        const struct frame still = {.still = true, .t = {NUM(1), NUM(0)}};
        return still;
    }
    const struct frame f = {
        .t = v2(n_div(p->d1.x, speed), n_div(p->d1.y, speed)),
        .speed = speed,
        .drag = n_mul(n_div(cfg->v_min, speed), cfg->v_min),
        .d2 = v2(n_div(p->d2.x, speed), n_div(p->d2.y, speed)),
        .d3 = v2(n_div(p->d3.x, speed), n_div(p->d3.y, speed)),
    };
    return f;
}

static path_t path_shift(path_t s, num t_T0)
{
    const path_t p = s + n_to_q32(t_T0) / 8 * (SPLINE_PER_T0 * PATH_ONE / (1 << 29));
    return p > 0 ? p : 0;
}

/* (|r'|^2 - (q - r) . r'') / |r'|: the slope of the foot-point condition with its sign turned. It vanishes where the axes
 * stand at the centre of curvature, and there no foot point exists: kept positive. */
static num foot_slope(const struct frame *f, vec2 e)
{
    const num slope = n_sub(f->speed, v2_dot(e, f->d2));
    return n_add(n_max(slope, n_mul(NUM(0.25), f->speed)), f->drag);
}

static num clamp_lag(const struct contour_cfg *cfg, num t_T0)
{
    return n_clamp(t_T0, n_neg(cfg->lag_max), cfg->lag_max);
}

/* (3)-(6): errors at r(s), delay, foot point; returns the frame there */
static struct frame find_foot(const struct contour_cfg *cfg, const struct spline_ring *ring,
                              const struct path_state *path, const pos_t q[2], struct spline_point *foot,
                              struct contour_out *o)
{
    const struct frame ref = frame_at(cfg, &o->ref);
    o->e_w = difference(q, o->ref.pos);  /* (3) */
    o->e_l = v2_to_frame(ref.t, o->e_w); /* (4) */
    o->t_d = ref.still ? NUM(0) : clamp_lag(cfg, n_div(n_neg(o->e_l.x), n_add(ref.speed, ref.drag))); /* (5) */
    o->tau = path_shift(path->s, n_neg(o->t_d));
    spline_at(ring, path->count, o->tau, foot); /* (6) */

    struct frame f = frame_at(cfg, foot);
    if (cfg->newton && !f.still) {
        const vec2 e = difference(q, foot->pos);
        o->tau = path_shift(o->tau, clamp_lag(cfg, n_div(v2_dot(e, f.t), foot_slope(&f, e))));
        spline_at(ring, path->count, o->tau, foot);
        f = frame_at(cfg, foot);
    }
    return f;
}

/* Rates of the frame, which moves with nu. */
static void frame_rates(const struct path_state *path, const struct frame *f, vec2 e_a, vec2 q_dot,
                        struct contour_out *o)
{
    if (f->still) {
        o->nu = path->rate;
        o->theta_dot = o->theta_ddot = NUM(0);
        return;
    }
    const num k = n_div(f->speed, n_add(f->speed, f->drag));
    const num theta_1 = n_mul(k, v2_cross(f->t, f->d2));
    const num theta_2 =
        n_mul(k, n_sub(v2_cross(f->t, f->d3), n_mul(n_mul(NUM(2), theta_1), v2_dot(f->t, f->d2))));
    const num nu = n_div(n_mad(v2_dot(q_dot, f->t), f->drag, path->rate), foot_slope(f, e_a));
    o->nu = n_clamp(nu, NUM(-4), NUM(4));
    o->theta_dot = n_mul(theta_1, o->nu);
    o->theta_ddot = n_mul(theta_2, n_mul(o->nu, o->nu));
}

/* Where the path stands still there is no direction to adjust along: r_n = r. */
static void keep_reference(vec2 q_dot, struct contour_out *o)
{
    o->rn_dot = o->r_dot;
    o->rn_ddot = o->r_ddot;
    o->e_wn = o->e_n = o->e_w;
    o->e_wn_dot = o->e_n_dot = v2_sub(q_dot, o->r_dot);
}

/* (7), (8): r_n = r + f n with f = n . (r_a - r), and its derivatives */
static void adjust_reference(const struct spline_point *foot, const pos_t q[2], vec2 q_dot, struct contour_out *o)
{
    const vec2 t = o->t;
    const vec2 n = v2_normal(t);
    const vec2 d = difference(foot->pos, o->ref.pos);
    const num w = o->theta_dot;
    const num f = v2_dot(n, d);
    const num g = v2_dot(t, d);
    const num foot_speed = n_mul(v2_dot(t, foot->d1), o->nu); /* t . dr_a/dt; n . dr_a/dt = 0 */
    const num r_dot_t = v2_dot(t, o->r_dot);

    /* f' = -w g - n.r' ;  g' = w f + t.r_a' - t.r' ;  f'' = -w' g - w g' + w t.r' - n.r'' */
    const num f_dot = n_sub(n_mul(n_neg(w), g), v2_dot(n, o->r_dot));
    const num g_dot = n_sub(n_mad(foot_speed, w, f), r_dot_t);
    const num f_ddot = n_sub(n_mad(n_neg(n_mul(o->theta_ddot, g)), w, n_sub(r_dot_t, g_dot)), v2_dot(n, o->r_ddot));

    /* n' = -w t, n'' = -w' t - w^2 n */
    o->rn_dot = v2_mad(v2_mad(o->r_dot, f_dot, n), n_neg(n_mul(f, w)), t);
    const num along = n_neg(n_mad(n_mul(f, o->theta_ddot), n_mul(NUM(2), f_dot), w));
    o->rn_ddot = v2_mad(v2_mad(o->r_ddot, n_sub(f_ddot, n_mul(f, n_mul(w, w))), n), along, t);

    o->e_wn = v2_mad(o->e_w, n_neg(f), n);
    o->e_wn_dot = v2_sub(q_dot, o->rn_dot);
    /* e_n.y = n . (q - r_a): taken from the foot point itself, where the difference is smallest */
    o->e_n = v2(v2_dot(t, o->e_w), v2_dot(n, difference(q, foot->pos)));
    o->e_n_dot = v2_to_frame(t, v2_mad(o->e_wn_dot, w, v2_ie(o->e_wn))); /* (9) */
}

void contour_step(const struct contour_cfg *cfg, const struct spline_ring *ring, const struct path_state *path,
                  const pos_t q[2], vec2 q_dot, struct contour_out *out)
{
    struct spline_point foot;
    spline_at(ring, path->count, path->s, &out->ref);
    out->r_dot = v2_scale(path->rate, out->ref.d1);
    out->r_ddot = v2_mad(v2_scale(n_mul(path->rate, path->rate), out->ref.d2), path->rate_dot, out->ref.d1);
    const struct frame f = find_foot(cfg, ring, path, q, &foot, out);
    out->t = f.t;
    frame_rates(path, &f, difference(q, foot.pos), q_dot, out);
    if (f.still) {
        keep_reference(q_dot, out);
    } else {
        adjust_reference(&foot, q, q_dot, out);
    }
    out->e_w_dot = v2_sub(q_dot, out->r_dot);
}
