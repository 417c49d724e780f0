/* SPDX-License-Identifier: Apache-2.0 */
#include "core/contour.h"

/* What a step needs of the curve near the axes: mostly all three points lie on one piece. Actual positions count from
 * its first knot, so that each is subtracted once. */
struct near {
    const struct spline_piece *piece;
    vec2 q; /* from piece->pos */
    num u;  /* path time of the point, knots from piece->knot */
};

/* Where the curve is read. */
struct source {
    const struct spline_ring *ring;
    struct spline_kept *kept;
    uint32_t count;
    const pos_t *axes;
};

static inline struct near take_piece(struct source from, uint32_t knot, num u)
{
    const struct spline_piece *piece = spline_keep(from.kept, from.ring, from.count, knot);
    const vec2 q = v2(pos_sub(from.axes[0], piece->pos[0]), pos_sub(from.axes[1], piece->pos[1]));
    const struct near at = {.piece = piece, .q = q, .u = u};
    return at;
}

/* The point `u` knots from knot `knot`, which lies on another piece; not before the beginning of the path. */
__attribute__((noinline)) static struct near change_piece(struct source from, uint32_t knot, num u)
{
    from.kept->busy = true;
    int32_t on = n_to_scaled(u, 1);
    num rest = n_sub(u, n_ratio(on, 1));
    if (n_lt(rest, NUM(0))) {
        rest = n_add(rest, NUM(1));
        on--;
    }
    const bool before = (int64_t)knot + on < 0;
    return take_piece(from, before ? 0u : knot + (uint32_t)on, before ? NUM(0) : rest);
}

/* On by t_T0, but not to before the beginning of the path. */
static inline void shift(struct source from, struct near *at, num t_T0)
{
    at->u = n_mad(at->u, NUM(SPLINE_PER_T0), t_T0);
    if (!n_lt(n_abs(n_sub(at->u, NUM(0.5))), NUM(0.5))) {
        *at = change_piece(from, at->piece->knot, at->u);
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

/* Direction at a point. `drag` = v_min^2 / |r'| regularises every quotient; at standstill there is no direction: the x axis, all
 * rates 0. Derivatives are divided by the speed |r'|: squares of um/T0 would leave the range of num. */
struct frame {
    bool still;
    vec2 t;
    num speed, drag;
};

static inline vec2 over(vec2 a, num speed)
{
    return v2(n_div(a.x, speed), n_div(a.y, speed));
}

static inline struct frame frame_at(const struct contour_cfg *cfg, vec2 d1)
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
    };
    return f;
}

/* (|r'|^2 - (q - r) . r'') / |r'|: the slope of the foot-point condition with its sign turned. It vanishes where the axes
 * stand at the centre of curvature, and there no foot point exists: kept positive. */
static inline num foot_slope(const struct frame *f, const struct foot *foot)
{
    const num slope = n_sub(f->speed, v2_dot(foot->e, over(foot->d2, f->speed)));
    return n_add(n_max(slope, n_mul(NUM(0.25), f->speed)), f->drag);
}

/* (3)-(6): errors at r(s), delay, foot point; returns the frame there */
static inline struct frame find_foot(const struct contour_cfg *cfg, struct source from, struct near *at, vec2 d1,
                                     struct foot *foot, struct contour_out *o)
{
    const struct frame ref = frame_at(cfg, d1);
    o->e_l = v2_to_frame(ref.t, o->e_w);                                                                      /* (4) */
    o->t_d = ref.still ? NUM(0) : n_within(n_div(n_neg(o->e_l.x), n_add(ref.speed, ref.drag)), cfg->lag_max); /* (5) */
    shift(from, at, n_neg(o->t_d));
    *foot = foot_at(at); /* (6) */

    if (cfg->newton) {
        const struct frame f = frame_at(cfg, foot->d1);
        if (!f.still) {
            const num step = n_div(v2_dot(foot->e, f.t), foot_slope(&f, foot));
            shift(from, at, n_within(step, cfg->lag_max));
            *foot = foot_at(at);
        }
    }
    o->foot_knot = at->piece->knot;
    o->foot_u = at->u;
    return frame_at(cfg, foot->d1);
}

/* Rates of the frame, which moves with nu; v_t: t . q' */
static inline void frame_rates(const struct path_state *path, const struct frame *f, const struct foot *foot, num v_t,
                               struct contour_out *o)
{
    const num speed = n_add(f->speed, f->drag);
    const num theta_1 = n_div(v2_cross(f->t, foot->d2), speed);
    const num theta_2 =
        n_msub(n_div(v2_cross(f->t, foot->d3), speed), n_mul(NUM(2), theta_1), n_div(v2_dot(f->t, foot->d2), speed));
    const num nu = n_div(n_mad(v_t, f->drag, path->rate), foot_slope(f, foot));
    o->nu = n_within(nu, NUM(4));
    o->theta_dot = n_mul(theta_1, o->nu);
    o->theta_ddot = n_mul(theta_2, n_mul(o->nu, o->nu));
}

/* Where the path stands still there is no direction to adjust along: r_n = r, and the frame stays. */
static inline void keep_reference(const struct path_state *path, struct contour_out *o)
{
    o->nu = path->rate;
    o->theta_dot = o->theta_ddot = NUM(0);
    o->e_wn = o->e_n = o->e_w;
    o->e_n_dot = o->e_w_dot;
    o->a_n = o->r_ddot;
}

/* (7)-(9). With r_n = r + f n, f = n . (r_a - r), most of what (8) adds to (9) and (15) is taken off again in the frame. What
 * remains is, with e = q - r_a, w = theta' and n . r_a' = 0,
 *   e_n   = (t . e_w, n . e)
 *   e_n'  = (t . e_w' + w n . e_w, n . q' - w t . e)
 *   e_n'' = R^T q'' - a_n,  a_n = (t . r'' - w (2 n . e_w' - w t . e_w) - w' n . e_w, w (2 t . q' - t . r_a' + w n . e) + w' t . e) */
static inline void adjust_reference(const struct path_state *path, const struct frame *f, const struct foot *foot,
                                    vec2 q_dot, struct contour_out *o)
{
    const vec2 v = v2_to_frame(f->t, q_dot);
    const vec2 e_w = v2_to_frame(f->t, o->e_w);
    const vec2 e_w_dot = v2_to_frame(f->t, o->e_w_dot);
    const vec2 e = v2_to_frame(f->t, foot->e);
    frame_rates(path, f, foot, v.x, o);
    const num w = o->theta_dot;
    const num w_dot = o->theta_ddot;
    const num slip = n_msub(v.x, f->speed, o->nu); /* t . (q' - r_a') */

    /* of e_n.y, what the foot point itself gives: there the difference is smallest */
    o->e_n = v2(e_w.x, e.y);
    o->e_n_dot = v2(n_mad(e_w_dot.x, w, e_w.y), n_msub(v.y, w, e.x));
    o->e_wn = v2_mad(o->e_w, n_sub(e.y, e_w.y), v2_normal(f->t));
    const num along = n_msub(n_mul(NUM(2), e_w_dot.y), w, e_w.x);
    const num across = n_mad(n_add(v.x, slip), w, e.y);
    o->a_n = v2(n_msub(n_msub(v2_dot(f->t, o->r_ddot), w, along), w_dot, e_w.y), n_mad(n_mul(w, across), w_dot, e.x));
}

void contour_step(const struct contour_cfg *cfg, struct spline_kept *kept, const struct spline_ring *ring,
                  const struct path_state *path, const pos_t q[2], vec2 q_dot, struct contour_out *out)
{
    const struct source from = {ring, kept, path->count, q};
    struct near at = take_piece(from, path->knot, n_ratio(path->rest, PATH_ONE));
    const struct spline_local ref = spline_on(at.piece, at.u);
    out->r_dot = v2_scale(path->rate, ref.d1);
    out->r_ddot = v2_mad(v2_scale(n_mul(path->rate, path->rate), ref.d2), path->rate_dot, ref.d1);
    out->e_w = v2_sub(at.q, ref.way); /* (3) */
    out->e_w_dot = v2_sub(q_dot, out->r_dot);

    struct foot foot;
    const struct frame f = find_foot(cfg, from, &at, ref.d1, &foot, out);
    out->t = f.t;
    if (f.still) {
        keep_reference(path, out);
    } else {
        adjust_reference(path, &f, &foot, q_dot, out);
    }
}
