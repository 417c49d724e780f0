/* SPDX-License-Identifier: Apache-2.0 */
#include "contour.h"

/* What a step needs of the curve near the axes: mostly all three points lie on one piece. Actual positions count from
 * its first knot, so that each is subtracted once. */
struct near {
    const struct spline_ring *ring;
    struct spline_kept *kept;
    uint32_t count;
    const pos_t *axes;
    const struct spline_piece *piece;
    vec2 q; /* from piece->pos */
    num u;  /* path time of the point, knots from piece->begin */
};

static inline void take_piece(struct near *at, uint32_t knot, num u)
{
    at->piece = spline_keep(at->kept, at->ring, at->count, knot);
    at->u = u;
    at->q = v2(pos_sub(at->axes[0], at->piece->pos[0]), pos_sub(at->axes[1], at->piece->pos[1]));
}

/* The same for path time s >= 0. */
static void take_piece_at(struct near *at, path_t s)
{
    uint32_t rest;
    const uint32_t knot = path_knots(s, &rest);
    take_piece(at, knot, n_ratio(rest, PATH_ONE));
}

/* Onto another piece; not to before the beginning of the path. */
__attribute__((noinline)) static void change_piece(struct near *at)
{
    const uint32_t knot = at->piece->knot;
    if (knot > 0 && n_lt(at->u, NUM(0)) && n_lt(NUM(-1), at->u)) { /* mostly to the one before */
        take_piece(at, knot - 1u, n_add(at->u, NUM(1)));
    } else if (!n_lt(at->u, NUM(1)) && n_lt(at->u, NUM(2))) {
        take_piece(at, knot + 1u, n_sub(at->u, NUM(1)));
    } else {
        const path_t s = path_time(at->piece->begin, at->u);
        take_piece_at(at, s > 0 ? s : 0);
    }
}

/* On by t_T0, but not to before the beginning of the path. */
static inline void shift(struct near *at, num t_T0)
{
    at->u = n_mad(at->u, NUM(SPLINE_PER_T0), t_T0);
    if (n_lt(at->u, NUM(0)) || !n_lt(at->u, NUM(1))) {
        change_piece(at);
    }
}

/* A point of the curve, and its distance to the axes. */
struct foot {
    vec2 e; /* q - r */
    vec2 d1, d2, d3;
};

static inline struct foot foot_at(const struct near *at)
{
    const struct spline_local p = spline_on(at->piece, at->u);
    const struct foot f = {v2_sub(at->q, p.way), p.d1, p.d2, p.d3};
    return f;
}

/* Direction and derivatives at a point, divided by the speed |r'|: squares of um/T0 would leave the range of num.
 * `drag` = v_min^2 / |r'| regularises every quotient; at standstill there is no direction: the x axis, all rates 0. */
struct frame {
    bool still;
    vec2 t;
    num speed, drag;
    vec2 d2, d3; /* second and third derivative / |r'| */
};

static inline vec2 over(vec2 a, num speed)
{
    return v2(n_div(a.x, speed), n_div(a.y, speed));
}

static inline struct frame frame_at(const struct contour_cfg *cfg, vec2 d1, vec2 d2, vec2 d3)
{
    const num speed = v2_norm(d1);
    if (!n_lt(NUM(CONTOUR_STILL), speed)) {
        const struct frame still = {.still = true, .t = {NUM(1), NUM(0)}};
        return still;
    }
    const struct frame f = {
        .t = over(d1, speed),
        .speed = speed,
        .drag = n_mul(n_div(cfg->v_min, speed), cfg->v_min),
        .d2 = over(d2, speed),
        .d3 = over(d3, speed),
    };
    return f;
}

/* (|r'|^2 - (q - r) . r'') / |r'|: the slope of the foot-point condition with its sign turned. It vanishes where the axes
 * stand at the centre of curvature, and there no foot point exists: kept positive. */
static inline num foot_slope(const struct frame *f, vec2 e)
{
    const num slope = n_sub(f->speed, v2_dot(e, f->d2));
    return n_add(n_max(slope, n_mul(NUM(0.25), f->speed)), f->drag);
}

/* (3)-(6): errors at r(s), delay, foot point; returns the frame there */
static inline struct frame find_foot(const struct contour_cfg *cfg, struct near *at, struct foot *foot,
                                     struct contour_out *o)
{
    const vec2 none = {NUM(0), NUM(0)};
    const struct frame ref = frame_at(cfg, o->ref.d1, none, none);
    o->e_l = v2_to_frame(ref.t, o->e_w); /* (4) */
    o->t_d = ref.still ? NUM(0) : n_within(n_div(n_neg(o->e_l.x), n_add(ref.speed, ref.drag)), cfg->lag_max); /* (5) */
    shift(at, n_neg(o->t_d));
    *foot = foot_at(at); /* (6) */

    if (cfg->newton) {
        const struct frame f = frame_at(cfg, foot->d1, foot->d2, none);
        if (!f.still) {
            const num step = n_div(v2_dot(foot->e, f.t), foot_slope(&f, foot->e));
            shift(at, n_within(step, cfg->lag_max));
            *foot = foot_at(at);
        }
    }
    o->foot_begin = at->piece->begin;
    o->foot_u = at->u;
    return frame_at(cfg, foot->d1, foot->d2, foot->d3);
}

/* Rates of the frame, which moves with nu. */
static inline void frame_rates(const struct path_state *path, const struct frame *f, vec2 e_a, vec2 q_dot,
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
    o->nu = n_within(nu, NUM(4));
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
static inline void adjust_reference(const struct foot *foot, vec2 q_dot, struct contour_out *o)
{
    const vec2 t = o->t;
    const vec2 n = v2_normal(t);
    const vec2 d = v2_sub(o->e_w, foot->e); /* r_a - r */
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
    o->e_n = v2(v2_dot(t, o->e_w), v2_dot(n, foot->e));
    o->e_n_dot = v2_to_frame(t, v2_mad(o->e_wn_dot, w, v2_ie(o->e_wn))); /* (9) */
}

void contour_step(const struct contour_cfg *cfg, struct spline_kept *kept, const struct spline_ring *ring,
                  const struct path_state *path, const pos_t q[2], vec2 q_dot, struct contour_out *out)
{
    struct near at;
    at.ring = ring;
    at.kept = kept;
    at.count = path->count;
    at.axes = q;
    take_piece_at(&at, path->s);
    const struct spline_local ref = spline_on(at.piece, at.u);
    out->ref.pos[0] = pos_add(at.piece->pos[0], ref.way.x);
    out->ref.pos[1] = pos_add(at.piece->pos[1], ref.way.y);
    out->ref.d1 = ref.d1;
    out->ref.d2 = ref.d2;
    out->ref.d3 = ref.d3;
    out->r_dot = v2_scale(path->rate, ref.d1);
    out->r_ddot = v2_mad(v2_scale(n_mul(path->rate, path->rate), ref.d2), path->rate_dot, ref.d1);
    out->e_w = v2_sub(at.q, ref.way); /* (3) */
    out->e_w_dot = v2_sub(q_dot, out->r_dot);

    struct foot foot;
    const struct frame f = find_foot(cfg, &at, &foot, out);
    out->t = f.t;
    frame_rates(path, &f, foot.e, q_dot, out);
    if (f.still) {
        keep_reference(q_dot, out);
    } else {
        adjust_reference(&foot, q_dot, out);
    }
}
