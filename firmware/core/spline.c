/* SPDX-License-Identifier: Apache-2.0 */
#include "spline.h"

static const struct knot *knot_at(const struct spline_ring *ring, uint32_t count, int64_t i)
{
    if (i < 0 || count == 0) {
        return &ring->start;
    }
    const uint32_t last = count - 1u;
    return &ring->knot[(i > (int64_t)last ? last : (uint32_t)i) % SPLINE_RING];
}

static num um(int64_t nm)
{
    return n_ratio(nm, 1000);
}

/* One axis as a Taylor polynomial in u = fraction of the knot interval: differences of knots are exact
 * integers, so nothing cancels in floating point. */
static void axis_at(const int64_t c[4], num u, pos_t *pos, num *d1, num *d2, num *d3)
{
    const num a0 = um(c[0] - 2 * c[1] + c[2]); /* second differences */
    const num a1 = um(c[1] - 2 * c[2] + c[3]);
    const num v = n_mul(NUM(0.5), um(c[2] - c[0]));
    const num jerk = n_sub(a1, a0);
    const num acc = n_mad(a0, u, jerk);
    const num half_u = n_mul(NUM(0.5), u);

    /* r = c1 + a0/6 + u (v + u/2 (a0 + u/3 jerk)) */
    const num inner = n_mad(v, half_u, n_mad(a0, u, n_mul(jerk, NUM(1.0 / 3))));
    *pos = pos_add(pos_from_nm(c[1]), n_mad(n_mul(a0, NUM(1.0 / 6)), u, inner));
    *d1 = n_mul(NUM(SPLINE_PER_T0), n_mad(v, half_u, n_add(a0, acc)));
    *d2 = n_mul(NUM(SPLINE_PER_T0 * SPLINE_PER_T0), acc);
    *d3 = n_mul(NUM(SPLINE_PER_T0 * SPLINE_PER_T0 * SPLINE_PER_T0), jerk);
}

void spline_at(const struct spline_ring *ring, uint32_t count, path_t s, struct spline_point *out)
{
    const int64_t i = s / PATH_ONE;
    const num u = n_ratio(s - i * PATH_ONE, PATH_ONE);
    int64_t c[2][4];
    for (int k = 0; k < 4; k++) {
        const struct knot *knot = knot_at(ring, count, i - 1 + k);
        c[0][k] = knot->nm[0];
        c[1][k] = knot->nm[1];
    }
    axis_at(c[0], u, &out->pos[0], &out->d1.x, &out->d2.x, &out->d3.x);
    axis_at(c[1], u, &out->pos[1], &out->d1.y, &out->d2.y, &out->d3.y);
}
