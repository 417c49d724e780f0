/* SPDX-License-Identifier: Apache-2.0 */
/* contour.c: the contour error and the adjusted reference of contour.h. Runs in the servo tick. */
#include "core/contour.h"

/* A point of the curve, and the actual position relative to the start of its piece. Mostly reference and foot
 * point lie on one piece, so that the actual position is subtracted once. */
struct curve_point {
    const struct spline_piece *piece;
    vec2 q; /* actual position from piece->pos, um */
    num u;  /* path time of the point, knots from piece->knot */
};

/* The curve, and the actual position that is compared with it. */
struct curve {
    const struct spline_ring *ring;
    struct spline_cache *cache;
    uint32_t count;
    const pos_t *q;
};

static inline struct curve_point point_on_piece(const struct curve *curve, uint32_t knot, num u)
{
    const struct spline_piece *piece = spline_cached_piece(curve->cache, curve->ring, curve->count, knot);
    const vec2 q = v2(pos_sub(curve->q[0], piece->pos[0]), pos_sub(curve->q[1], piece->pos[1]));
    const struct curve_point at = {.piece = piece, .q = q, .u = u};
    return at;
}

/* The point u knots after knot `knot`, where u is outside 0..1, so
 * that it lies on another piece. Path time 0 is the earliest point. */
__attribute__((noinline)) static struct curve_point change_piece(const struct curve *curve, uint32_t knot, num u)
{
    curve->cache->piece_changed = true;
    int32_t knots = n_to_scaled(u, 1);
    num fraction = n_sub(u, n_ratio(knots, 1));
    if (n_lt(fraction, NUM(0))) {
        fraction = n_add(fraction, NUM(1));
        knots--;
    }
    const bool before = (int64_t)knot + knots < 0;
    return point_on_piece(curve, before ? 0u : knot + (uint32_t)knots, before ? NUM(0) : fraction);
}

/* Move the point along the path by t_T0, but not to before path time 0. */
static inline void move_along(const struct curve *curve, struct curve_point *at, num t_T0)
{
    at->u = n_mad(at->u, NUM(SPLINE_PER_T0), t_T0);
    if (rarely(!n_is_part(at->u))) {
        *at = change_piece(curve, at->piece->knot, at->u);
    }
}

/* Derivatives of the curve at a point by path time, and the error of the actual position there. */
struct foot {
    vec2 e; /* q - r */
    vec2 d1, d2, d3;
    bool limited; /* by lag_max: it is not where the actual position would have it */
};

static inline struct foot foot_at(const struct curve_point *at)
{
    const struct spline_local p = spline_eval(at->piece, at->u);
    const struct foot f = {.e = v2_sub(at->q, p.offset), .d1 = p.d1, .d2 = p.d2, .d3 = p.d3};
    return f;
}

/* Direction and speed of the path at a point. v_reg = v_min^2 / |r'| regularises every quotient. At standstill
 * there is no direction: t is the x axis, and all rates are 0. Derivatives are divided by the speed |r'|, because
 * squares of um/T0 would leave the range of num. */
struct frame {
    bool standstill;
    vec2 t;
    num speed, v_reg;
};

static inline vec2 divide(vec2 a, num speed)
{
    return v2(n_div(a.x, speed), n_div(a.y, speed));
}

static inline struct frame frame_at(const struct contour_cfg *cfg, vec2 d1)
{
    const num speed = v2_norm(d1);
    if (rarely(!n_lt(NUM(CONTOUR_SPEED_MIN), speed))) {
        const struct frame standstill = {.standstill = true, .t = {NUM(1), NUM(0)}};
        return standstill;
    }
    const struct frame f = {
        .t = divide(d1, speed),
        .speed = speed,
        .v_reg = n_mul(n_div(cfg->v_min, speed), cfg->v_min),
    };
    return f;
}

/* (|r'|^2 - (q - r) . r'') / |r'|, which is minus the slope of the foot-point
 * condition. It is 0 where the actual position is the centre of curvature, which
 * has no foot point. It is therefore limited to a quarter of the speed or more. */
static inline num foot_slope(const struct frame *f, const struct foot *foot)
{
    const num slope = n_sub(f->speed, v2_dot(foot->e, divide(foot->d2, f->speed)));
    return n_add(n_max(slope, n_mul(NUM(0.25), f->speed)), f->v_reg);
}

/* (4)-(6): the error in the frame at r(s), the delay t_d and the foot point. Returns the frame at the foot point. */
static inline struct frame find_foot(const struct contour_cfg *cfg, const struct curve *curve, struct curve_point *at,
                                     vec2 d1, struct foot *foot, struct contour_out *o)
{
    const struct frame ref = frame_at(cfg, d1);
    o->e_l = v2_to_frame(ref.t, o->e_w); /* (4) */
    num step = ref.standstill ? NUM(0) : n_div(n_neg(o->e_l.x), n_add(ref.speed, ref.v_reg));
    o->t_d = n_within(step, cfg->lag_max); /* (5) */
    move_along(curve, at, n_neg(o->t_d));
    *foot = foot_at(at); /* (6) */

    if (cfg->newton) {
        const struct frame f = frame_at(cfg, foot->d1);
        if (usually(!f.standstill)) {
            step = n_div(v2_dot(foot->e, f.t), foot_slope(&f, foot));
            move_along(curve, at, n_within(step, cfg->lag_max));
            *foot = foot_at(at);
        }
    }
    foot->limited = n_lt(cfg->lag_max, n_abs(step));
    o->foot_knot = at->piece->knot;
    o->foot_u = at->u;
    return frame_at(cfg, foot->d1);
}

/* Rates of the frame at the foot point, whose path time changes at the rate nu. v_t is t . q'. A foot point that is
 * limited keeps its distance in path time to the reference. */
static inline void frame_rates(const struct path_state *path, const struct frame *f, const struct foot *foot, num v_t,
                               struct contour_out *o)
{
    const num speed = n_add(f->speed, f->v_reg);
    const num theta_1 = n_div(v2_cross(f->t, foot->d2), speed);
    const num theta_2 =
        n_msub(n_div(v2_cross(f->t, foot->d3), speed), n_mul(NUM(2), theta_1), n_div(v2_dot(f->t, foot->d2), speed));
    const num nu = n_div(n_mad(v_t, f->v_reg, path->rate), foot_slope(f, foot));
    o->nu = foot->limited ? path->rate : n_within(nu, NUM(4));
    o->theta_dot = n_mul(theta_1, o->nu);
    o->theta_ddot = n_mul(theta_2, n_mul(o->nu, o->nu));
}

/* Where the path stands still there is no direction to adjust
 * the reference along: r_n = r, and the frame does not turn. */
static inline void reference_at_standstill(const struct path_state *path, struct contour_out *o)
{
    o->nu = path->rate;
    o->theta_dot = o->theta_ddot = NUM(0);
    o->e_wn = o->e_n = o->e_w;
    o->e_n_dot = o->e_w_dot;
    o->a_n = o->r_ddot;
}

/* The share of an error that the turning of the frame acts on: 1 up to the error of which (5) makes lag_max, and beyond
 * it as much as makes this error. A path that is all but at rest turns as its knots are rounded, and its rates times a
 * large error would shake the axes. */
static inline num share_of(const struct contour_cfg *cfg, const struct frame *f, vec2 error)
{
    const num eighth = NUM(0.125); /* at full speed the reach itself would leave the range of num */
    const num reach = n_mul(n_mul(eighth, cfg->lag_max), n_add(f->speed, f->v_reg));
    const num size = n_mul(eighth, n_max(n_abs(error.x), n_abs(error.y)));
    return rarely(n_lt(reach, size)) ? n_div(reach, size) : NUM(1);
}

/* (7)-(9). r_a is the foot point, and r_n = r + f n with f = n . (r_a - r). In the frame, most of what (8) adds to
 * (9) and (15) cancels. With e = q - r_a, w = theta' and n . r_a' = 0, what remains is
 *   e_n   = (t . e_w, n . e)
 *   e_n'  = (t . e_w' + w n . e_w, n . q' - w t . e)
 *   e_n'' = R^T q'' - a_n
 *   a_n   = (t . r'' - w (2 n . e_w' - w t . e_w) - w' n . e_w, w (2 t . q' - t . r_a' + w n . e) + w' t . e)
 * where w and w' act on a share of e_w and e.
 */
static inline void adjust_reference(const struct contour_cfg *cfg, const struct path_state *path, const struct frame *f,
                                    const struct foot *foot, vec2 q_dot, struct contour_out *o)
{
    const vec2 v = v2_to_frame(f->t, q_dot);
    const vec2 e_w = v2_to_frame(f->t, o->e_w);
    const vec2 e_w_dot = v2_to_frame(f->t, o->e_w_dot);
    const vec2 e = v2_to_frame(f->t, foot->e);
    frame_rates(path, f, foot, v.x, o);
    const num w = o->theta_dot;
    const num share = share_of(cfg, f, e_w);
    const num w_e = n_mul(w, share);
    const num w_dot_e = n_mul(o->theta_ddot, share);
    const num slip = n_msub(v.x, f->speed, o->nu); /* t . (q' - r_a') */

    /* e_n.y is computed from the foot point, where the difference of positions is smallest and so the most precise. */
    o->e_n = v2(e_w.x, e.y);
    o->e_n_dot = v2(n_mad(e_w_dot.x, w_e, e_w.y), n_msub(v.y, w_e, e.x));
    o->e_wn = v2_mad(o->e_w, n_sub(e.y, e_w.y), v2_normal(f->t));
    const num along = n_msub(n_mul(NUM(2), e_w_dot.y), w_e, e_w.x);
    const num across = n_mad(n_add(v.x, slip), w_e, e.y);
    o->a_n =
        v2(n_msub(n_msub(v2_dot(f->t, o->r_ddot), w, along), w_dot_e, e_w.y), n_mad(n_mul(w, across), w_dot_e, e.x));
}

void contour_step(const struct contour_cfg *cfg, struct spline_cache *cache, const struct spline_ring *ring,
                  const struct path_state *path, const pos_t q[2], vec2 q_dot, struct contour_out *out)
{
    const struct curve curve = {ring, cache, path->count, q};
    struct curve_point at = point_on_piece(&curve, path->knot, n_ratio(path->fraction, PATH_ONE));
    const struct spline_local ref = spline_eval(at.piece, at.u);
    out->r_dot = v2_scale(path->rate, ref.d1);
    out->r_ddot = v2_mad(v2_scale(n_mul(path->rate, path->rate), ref.d2), path->rate_dot, ref.d1);
    out->e_w = v2_sub(at.q, ref.offset); /* (3) */
    out->e_w_dot = v2_sub(q_dot, out->r_dot);

    struct foot foot;
    const struct frame f = find_foot(cfg, &curve, &at, ref.d1, &foot, out);
    out->t = f.t;
    if (rarely(f.standstill)) {
        reference_at_standstill(path, out);
    } else {
        adjust_reference(cfg, path, &f, &foot, q_dot, out);
    }
}
