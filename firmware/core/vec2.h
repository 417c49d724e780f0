/* SPDX-License-Identifier: Apache-2.0 */
/* vec2.h: plane vectors of `num`, and the rotation R = [t n] of
 * eq (4). Pure functions; the law calls them in the servo tick. */
#ifndef KONTUR_VEC2_H
#define KONTUR_VEC2_H
#include "core/num.h"

typedef struct {
    num x, y;
} vec2;

static inline vec2 v2(num x, num y)
{
    const vec2 v = {x, y};
    return v;
}

static inline vec2 v2_add(vec2 a, vec2 b)
{
    return v2(n_add(a.x, b.x), n_add(a.y, b.y));
}

static inline vec2 v2_sub(vec2 a, vec2 b)
{
    return v2(n_sub(a.x, b.x), n_sub(a.y, b.y));
}

static inline vec2 v2_scale(num k, vec2 a)
{
    return v2(n_mul(k, a.x), n_mul(k, a.y));
}

/* a + k b */
static inline vec2 v2_mad(vec2 a, num k, vec2 b)
{
    return v2(n_mad(a.x, k, b.x), n_mad(a.y, k, b.y));
}

/* The product of each component. */
static inline vec2 v2_mul(vec2 a, vec2 b)
{
    return v2(n_mul(a.x, b.x), n_mul(a.y, b.y));
}

static inline num v2_dot(vec2 a, vec2 b)
{
    return n_mad(n_mul(a.x, b.x), a.y, b.y);
}

/* The z component of a x b. */
static inline num v2_cross(vec2 a, vec2 b)
{
    return n_msub(n_mul(a.x, b.y), a.y, b.x);
}

static inline num v2_norm(vec2 a)
{
    return n_hypot(a.x, a.y);
}

/* I_e a of (9), where I_e = [[0, 1], [-1, 0]]. */
static inline vec2 v2_ie(vec2 a)
{
    return v2(a.y, n_neg(a.x));
}

/* The unit normal of the unit tangent t, which is t turned to the left by 90 degrees. */
static inline vec2 v2_normal(vec2 t)
{
    return v2(n_neg(t.y), t.x);
}

/* R^T a, the components of a along t and n. */
static inline vec2 v2_to_frame(vec2 t, vec2 a)
{
    return v2(v2_dot(t, a), v2_cross(t, a));
}

/* R a, the vector with components a along t and n, in the axis frame. */
static inline vec2 v2_from_frame(vec2 t, vec2 a)
{
    return v2_mad(v2_scale(a.x, t), a.y, v2_normal(t));
}
#endif
