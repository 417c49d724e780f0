/* SPDX-License-Identifier: Apache-2.0 */
/* spline.c: the cubic B-spline of spline.h, its pieces and their cache. Runs in the servo tick. */
#include "core/spline.h"

static const struct knot *knot_at(const struct spline_ring *ring, uint32_t count, int64_t i)
{
    if (i < 0 || count == 0) {
        return &ring->start;
    }
    const uint32_t last = count - 1u;
    return &ring->knot[(i > (int64_t)last ? last : (uint32_t)i) % SPLINE_RING];
}

/* nm / d, d > 0. nm is a difference of knots, modulo 2^32. */
static num divide(uint32_t nm, int32_t d)
{
    return n_ratio((int32_t)nm, d);
}

__attribute__((noinline)) void spline_piece(const struct spline_ring *ring, uint32_t count, uint32_t knot,
                                            struct spline_piece *piece)
{
    struct knot c[4];
    const bool final = (uint64_t)knot + 2u < count;
    for (uint32_t k = 0; k < 4u; k++) {
        c[k] = final && knot >= 1u ? ring->knot[(knot - 1u + k) % SPLINE_RING]
                                   : *knot_at(ring, count, (int64_t)knot - 1 + k);
    }
    num c0[2] = {NUM(0), NUM(0)}, c1[2] = {NUM(0), NUM(0)}, c2[2] = {NUM(0), NUM(0)}, c3[2] = {NUM(0), NUM(0)};
    num slope[2] = {NUM(0), NUM(0)};
    for (int i = 0; i < 2; i++) {
        const uint32_t d0 = (uint32_t)c[1].nm[i] - (uint32_t)c[0].nm[i];
        const uint32_t d1 = (uint32_t)c[2].nm[i] - (uint32_t)c[1].nm[i];
        const uint32_t d2 = (uint32_t)c[3].nm[i] - (uint32_t)c[2].nm[i];
        piece->pos[i] = pos_from_nm(c[1].nm[i]);
        c0[i] = divide(d1 - d0, 6000);
        c1[i] = divide(d0 + d1, 2000);
        c2[i] = divide(d1 - d0, 2000 / 4);
        c3[i] = n_sub(divide(d2 - d1, 6000 / 16), divide(d1 - d0, 6000 / 16));
        slope[i] = divide(d0 + d1, 2000 / SPLINE_PER_T0);
    }
    piece->knot = knot;
    piece->final = final ? knot + 1u : 0u;
    piece->count = count;
    piece->c0 = v2(c0[0], c0[1]);
    piece->c1 = v2(c1[0], c1[1]);
    piece->c2 = v2(c2[0], c2[1]);
    piece->c3 = v2(c3[0], c3[1]);
    piece->d1 = v2(slope[0], slope[1]);
}

__attribute__((noinline)) const struct spline_piece *spline_update_piece(struct spline_cache *cache,
                                                                         const struct spline_ring *ring, uint32_t count,
                                                                         uint32_t knot)
{
    struct spline_piece *piece = &cache->piece[knot % SPLINE_CACHE_SIZE];
    if (piece->knot != knot || piece->count != count || count == 0) {
        spline_piece(ring, count, knot, piece);
        cache->piece_computed = true;
    }
    return piece;
}

__attribute__((noinline)) void spline_prefetch_next(struct spline_cache *cache, const struct spline_ring *ring,
                                                    uint32_t count, uint32_t knot)
{
    const bool piece_changed = cache->piece_changed;
    const bool piece_computed = cache->piece_computed;
    if (cache->next - knot > SPLINE_LOOKAHEAD) { /* path time has jumped, or gone on without prefetching */
        cache->next = knot;
    }
    if (!piece_computed && (!piece_changed || cache->next - knot <= 2u) && cache->next + 2u < count) {
        (void)spline_cached_piece(cache, ring, count, cache->next);
        cache->next++;
    }
    cache->piece_changed = false;
    cache->piece_computed = false;
}

void spline_at(const struct spline_ring *ring, uint32_t count, path_time_t s, struct spline_point *out)
{
    struct spline_piece piece;
    uint32_t fraction;
    spline_piece(ring, count, path_knots(s, &fraction), &piece);
    const struct spline_local at = spline_eval(&piece, n_ratio(fraction, PATH_ONE));
    out->pos[0] = pos_add(piece.pos[0], at.offset.x);
    out->pos[1] = pos_add(piece.pos[1], at.offset.y);
    out->d1 = at.d1;
    out->d2 = at.d2;
    out->d3 = at.d3;
}
