/* SPDX-License-Identifier: Apache-2.0 */
/* spline.h: the reference trajectory, a uniform cubic B-spline in time over a ring of knots.
 *
 * A knot is a commanded position; the host sends one for each millisecond. Knot i is the control point c_i (integer
 * nm), and r at path time i is (c_{i-1} + 4 c_i + c_{i+1}) / 6. The curve is C2, as (8) needs, and its third
 * derivative is constant between knots. Before knot 0 every control point is `start`; after the last accepted knot
 * every control point is that knot.
 *
 * The ring holds knots of the past, too, because the foot point of a lagging axis lies on them.
 *
 * Context: the background loop appends knots to the ring (motion/queue.h). The servo tick evaluates the curve:
 * contour.c does so in servo_step(), and servo_loop.c prefetches pieces. Both may run at the same time, since the
 * ring has one writer and one reader.
 */
#ifndef KONTUR_SPLINE_H
#define KONTUR_SPLINE_H
#include <stdatomic.h>

#include "core/vec2.h"

/* Knots; a power of two, chosen when the firmware is compiled. A chip's memory sets it (port/stm32f405/kontur.ld). */
#ifndef SPLINE_RING
#define SPLINE_RING 4096u
#endif
#define SPLINE_PAST 32u /* knots that stay in the ring behind path time */
#define SPLINE_PER_T0 5 /* knots in T0, one each millisecond */

struct knot {
    int32_t nm[2];
};

/* Outputs beside the axes from a knot on, in one word: digital ones in the low half, power (1/65535) in the high
 * one. */
#define KNOT_DIGITAL 0x0FFFu /* the digital outputs */
#define KNOT_HOLD 0x4000u    /* the path is held at this knot until it is released */
#define KNOT_BY_RATE 0x8000u /* the power goes with the rate of path time */

struct spline_ring {
    struct knot start;             /* position before knot 0 */
    _Atomic uint32_t count;        /* knots accepted so far; written by the background loop only */
    struct knot knot[SPLINE_RING]; /* knot i in knot[i % SPLINE_RING] */
    uint32_t outputs[SPLINE_RING]; /* likewise; 0: all off */
};

/* Path time is counted in knots times PATH_ONE. PATH_ONE is
 * such that a control period of 10 kHz or 20 kHz is an integer. */
typedef int64_t path_time_t;
#define PATH_ONE ((path_time_t)5 << 29)

/* The last knot at or before path time s >= 0. *fraction is the path time since that knot, 0..PATH_ONE - 1. There is no
 * division of 64 bits in it, which would take long on a Cortex-M. */
static inline uint32_t path_knots(path_time_t s, uint32_t *fraction)
{
    const uint64_t fifths = (uint64_t)s >> 29;
    const uint32_t high = (uint32_t)(fifths >> 32);
    const uint32_t low = (uint32_t)fifths;
    uint32_t knots = low / 5u;
    uint32_t remainder = low % 5u;
    if (high != 0) { /* 2^32 = 5 * 858993459 + 1 */
        knots += high * 858993459u + (remainder + high) / 5u;
        remainder = (remainder + high) % 5u;
    }
    *fraction = remainder << 29 | ((uint32_t)s & 0x1FFFFFFFu);
    return knots;
}

/* Path time u knots after knot `knot`. */
static inline path_time_t path_time(uint32_t knot, num u)
{
    return (path_time_t)knot * PATH_ONE + n_to_q32(u) / 8 * (PATH_ONE / (1 << 29));
}

struct spline_point {
    pos_t pos[2];
    vec2 d1, d2, d3; /* derivatives by path time: um/T0, um/T0^2, um/T0^3 */
};

/* The curve from one knot to the next as a polynomial. Differences of knots are exact integers, so nothing cancels in
 * floating point. Lengths are in um, and the parameter u is in knots. */
struct spline_piece {
    uint32_t knot;       /* number of its first knot */
    uint32_t final;      /* knot + 1 when all four control points are accepted, so that it changes no more; else 0 */
    uint32_t count;      /* knots accepted when it was computed */
    pos_t pos[2];        /* position of control point `knot`, from which `offset` of a point counts */
    vec2 c0, c1, c2, c3; /* offset = c0 + u (c1 + v (c2 + v c3)), v = u / 4: fixed point has more digits of c2 and c3 */
    vec2 d1;             /* 5 c1, um/T0, with its own digits: where the path starts to move they give its direction */
};

/* Recently used pieces. Ten control periods share a piece, and the foot point mostly lies on the same piece or on
 * the one before; where the path is about to stop, the foot point may lie anywhere within contour_cfg.lag_max.
 * Pieces ahead of path time are computed early, at most one in a control period. A cache of zeros is empty. It
 * must be emptied when the ring gets another sequence of knots. */
#define SPLINE_CACHE_SIZE 16u /* pieces; a power of two */
#define SPLINE_LOOKAHEAD 7u   /* pieces computed ahead of path time */
struct spline_cache {
    struct spline_piece piece[SPLINE_CACHE_SIZE]; /* the piece of knot i is piece[i % SPLINE_CACHE_SIZE] */
    uint32_t next;                                /* knot of the next piece to prefetch */
    bool piece_changed;  /* the foot point has moved to another piece since the last call of spline_prefetch_next() */
    bool piece_computed; /* one has been computed since then that had not been prefetched, or not been kept */
};

/* A point of a piece. */
struct spline_local {
    vec2 offset;     /* from piece->pos, um */
    vec2 d1, d2, d3; /* as in spline_point */
};

/* Compute the piece of knot `knot`. `count` knots are valid (a snapshot of ring->count), and the second
 * differences of the knots are below 2.1 m. */
void spline_piece(const struct spline_ring *ring, uint32_t count, uint32_t knot, struct spline_piece *piece);
/* The cache's piece of knot `knot`, computed anew unless it was computed from the same `count` knots. */
const struct spline_piece *spline_update_piece(struct spline_cache *cache, const struct spline_ring *ring,
                                               uint32_t count, uint32_t knot);
/* The piece of knot `knot`, from the cache when it is final and from spline_update_piece() otherwise. */
static inline const struct spline_piece *spline_cached_piece(struct spline_cache *cache, const struct spline_ring *ring,
                                                             uint32_t count, uint32_t knot)
{
    const struct spline_piece *piece = &cache->piece[knot % SPLINE_CACHE_SIZE];
    return usually(piece->final == knot + 1u && knot + 2u < count) ? piece
                                                                   : spline_update_piece(cache, ring, count, knot);
}
/* Prefetch one piece, if there is one within the look-ahead and its control points are accepted. Does nothing in a
 * control period that has computed a piece, so that no period computes two, nor in one in which the foot point has
 * moved to another piece, unless path time is close to the one to prefetch. */
void spline_prefetch_next(struct spline_cache *cache, const struct spline_ring *ring, uint32_t count, uint32_t knot);
/* Once in a control period: prefetch the next of the pieces ahead of path time, which is at knot `knot`. */
static inline void spline_prefetch(struct spline_cache *cache, const struct spline_ring *ring, uint32_t count,
                                   uint32_t knot)
{
    if (cache->next != knot + SPLINE_LOOKAHEAD + 1u) {
        spline_prefetch_next(cache, ring, count, knot);
    }
}

/* The curve at path time s >= 0, without a cache. */
void spline_at(const struct spline_ring *ring, uint32_t count, path_time_t s, struct spline_point *out);

/* The third derivative of an axis, um/T0^3, by its c3. It is the same all over a piece. */
static inline num spline_third(num c3)
{
    return n_mul(NUM(6 * SPLINE_PER_T0 * SPLINE_PER_T0 * SPLINE_PER_T0 / 16.0), c3);
}

/* The point of piece p at u, 0..1 knot after its first knot, with its derivatives. Horner's rule gives the value;
 * applied again to its intermediate results it gives each derivative (D. E. Knuth, The Art of Computer Programming
 * 2, 4.6.4), at one multiply-add each. */
static inline struct spline_local spline_eval(const struct spline_piece *p, num u)
{
    const num v = n_mul(NUM(1.0 / 4), u);
    const num v_T0 = n_mul(NUM(SPLINE_PER_T0 / 4.0), u);
    const vec2 a2 = v2_mad(p->c2, v, p->c3);
    const vec2 a1 = v2_mad(p->c1, v, a2);
    const vec2 b2 = v2_mad(a2, v, p->c3);
    const struct spline_local at = {
        .offset = v2_mad(p->c0, u, a1),
        .d1 = v2_mad(p->d1, v_T0, v2_add(a2, b2)),
        .d2 = v2_scale(NUM(2 * SPLINE_PER_T0 * SPLINE_PER_T0 / 4.0), v2_mad(b2, v, p->c3)),
        .d3 = v2(spline_third(p->c3.x), spline_third(p->c3.y)),
    };
    return at;
}
#endif
