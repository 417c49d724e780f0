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

#include "core/vec2.h"

#define SPLINE_RING 1024u /* knots; a power of two */
#define SPLINE_PAST 32u   /* knots kept behind path time */
#define SPLINE_PER_T0 5   /* knots in T0: one a ms */

struct knot {
    int32_t nm[2];
};

struct spline_ring {
    struct knot start;             /* position before knot 0 */
    _Atomic uint32_t count;        /* knots accepted so far; written by the background loop only */
    struct knot knot[SPLINE_RING]; /* knot i in knot[i % SPLINE_RING] */
};

/* Path time: knots times PATH_ONE, chosen so that 10 kHz and 20 kHz control periods are whole numbers. */
typedef int64_t path_time_t;
#define PATH_ONE ((path_time_t)5 << 29)

/* Knots passed at path time s >= 0; `rest`: path time since the last of them. No 64-bit division. */
static inline uint32_t path_knots(path_time_t s, uint32_t *rest)
{
    const uint64_t fifths = (uint64_t)s >> 29;
    const uint32_t high = (uint32_t)(fifths >> 32);
    const uint32_t low = (uint32_t)fifths;
    uint32_t knots = low / 5u;
    uint32_t left = low % 5u;
    if (high != 0) { /* 2^32 = 5 * 858993459 + 1 */
        knots += high * 858993459u + (left + high) / 5u;
        left = (left + high) % 5u;
    }
    *rest = left << 29 | ((uint32_t)s & 0x1FFFFFFFu);
    return knots;
}

/* u knots after knot `knot` */
static inline path_time_t path_time(uint32_t knot, num u)
{
    return (path_time_t)knot * PATH_ONE + n_to_q32(u) / 8 * (PATH_ONE / (1 << 29));
}

struct spline_point {
    pos_t pos[2];
    vec2 d1, d2, d3; /* derivatives by path time: um/T0, um/T0^2, um/T0^3 */
};

/* The curve from one knot to the next as a polynomial: differences of knots are exact integers, so nothing cancels in
 * floating point. All in um and knots. */
struct spline_piece {
    uint32_t knot;  /* number of its first knot */
    uint32_t whole; /* ... plus one, if all four of its control points are there, so that it changes no more; else 0 */
    uint32_t made;  /* knots that there were when it was */
    pos_t pos[2];   /* control point of that knot: what `way` of a point counts from */
    vec2 c0, c1, c2, c3; /* way = c0 + u (c1 + v (c2 + v c3)), v = u / 4: fixed point keeps more digits of c2 and c3 */
    vec2 d1;             /* 5 c1, um/T0, with its own digits: where the path begins to move they give its direction */
};

/* The pieces in use, kept from period to period: ten periods share one, and the foot point mostly lies on the same or on
 * the one before, but where the path is about to stand it may be anywhere within contour_cfg.lag_max. Those that path time comes
 * to are made before it does, not more than one in a period. Zero is empty; it must be emptied when the ring gets another
 * sequence of knots. */
#define SPLINE_KEPT 16u /* a power of two */
#define SPLINE_READY 7u /* made ahead of path time */
struct spline_kept {
    struct spline_piece piece[SPLINE_KEPT]; /* that from knot i on in piece[i % SPLINE_KEPT] */
    uint32_t ready;                         /* knot of the next one to make */
    bool busy;                              /* the foot point has changed its piece since one was made, or not, last */
};

/* A point of a piece. */
struct spline_local {
    vec2 way;        /* from piece->pos, um */
    vec2 d1, d2, d3; /* as in spline_point */
};

/* The piece from knot `knot` on. `count` knots are valid (a snapshot of ring->count), and second differences below 2.1 m. */
void spline_piece(const struct spline_ring *ring, uint32_t count, uint32_t knot, struct spline_piece *piece);
/* The same, where it is not kept as a whole one: */
const struct spline_piece *spline_make(struct spline_kept *kept, const struct spline_ring *ring, uint32_t count,
                                       uint32_t knot);
static inline const struct spline_piece *spline_keep(struct spline_kept *kept, const struct spline_ring *ring,
                                                     uint32_t count, uint32_t knot)
{
    const struct spline_piece *piece = &kept->piece[knot % SPLINE_KEPT];
    return piece->whole == knot + 1u && knot + 2u < count ? piece : spline_make(kept, ring, count, knot);
}
/* Make the next piece ready of those that path time, at knot `knot`, comes to, if its knots have come and the period has not been
 * busy: at most once in a period. */
void spline_make_next(struct spline_kept *kept, const struct spline_ring *ring, uint32_t count, uint32_t knot);
static inline void spline_prepare(struct spline_kept *kept, const struct spline_ring *ring, uint32_t count,
                                  uint32_t knot)
{
    if (kept->ready != knot + SPLINE_READY + 1u) {
        spline_make_next(kept, ring, count, knot);
    }
}

/* The curve at path time s >= 0. */
void spline_at(const struct spline_ring *ring, uint32_t count, path_time_t s, struct spline_point *out);

/* The curve at path time u after the first knot of p, 0..1 knot, with its derivatives: Horner's rule, for each of them once more on
 * what it has come to (D. E. Knuth, The Art of Computer Programming 2, 4.6.4), a multiply-add each. */
static inline struct spline_local spline_on(const struct spline_piece *p, num u)
{
    const num v = n_mul(NUM(1.0 / 4), u);
    const num v_T0 = n_mul(NUM(SPLINE_PER_T0 / 4.0), u);
    const vec2 a2 = v2_mad(p->c2, v, p->c3);
    const vec2 a1 = v2_mad(p->c1, v, a2);
    const vec2 b2 = v2_mad(a2, v, p->c3);
    const struct spline_local at = {
        .way = v2_mad(p->c0, u, a1),
        .d1 = v2_mad(p->d1, v_T0, v2_add(a2, b2)),
        .d2 = v2_scale(NUM(2 * SPLINE_PER_T0 * SPLINE_PER_T0 / 4.0), v2_mad(b2, v, p->c3)),
        .d3 = v2_scale(NUM(6 * SPLINE_PER_T0 * SPLINE_PER_T0 * SPLINE_PER_T0 / 16.0), p->c3),
    };
    return at;
}
#endif
