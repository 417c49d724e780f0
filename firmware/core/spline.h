/* SPDX-License-Identifier: Apache-2.0 */
/* spline.h: the reference trajectory, a uniform cubic B-spline in time over a ring of knots.
 *
 * Knot i is the control point c_i (integer nm); r at path time i is (c_{i-1} + 4 c_i + c_{i+1}) / 6. The curve
 * is C2, as (8) needs, and its third derivative is constant between knots. Before knot 0 the sequence goes
 * on with `start`, after the last accepted knot with that knot.
 *
 * The ring keeps knots of the past, since the foot point of a lagging axis lies there.
 */
#ifndef KONTUR_SPLINE_H
#define KONTUR_SPLINE_H
#include <stdatomic.h>

#include "vec2.h"

#define SPLINE_RING 1024u  /* knots; a power of two */
#define SPLINE_PAST 32u    /* knots kept behind path time */
#define SPLINE_PER_T0 5    /* knots in T0: one a ms */

struct knot {
    int32_t nm[2];
};

struct spline_ring {
    struct knot start;              /* position before knot 0 */
    _Atomic uint32_t count;         /* knots accepted so far; written by the background loop only */
    struct knot knot[SPLINE_RING];  /* knot i in knot[i % SPLINE_RING] */
};

/* Path time: knots times PATH_ONE, chosen so that 10 kHz and 20 kHz control periods are whole numbers. */
typedef int64_t path_t;
#define PATH_ONE ((path_t)5 << 29)

struct spline_point {
    pos_t pos[2];
    vec2 d1, d2, d3;  /* derivatives by path time: um/T0, um/T0^2, um/T0^3 */
};

/* The curve at path time s >= 0. `count` knots are valid (a snapshot of ring->count). */
void spline_at(const struct spline_ring *ring, uint32_t count, path_t s, struct spline_point *out);
#endif
