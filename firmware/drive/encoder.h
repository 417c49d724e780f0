/* SPDX-License-Identifier: Apache-2.0 */
/* drive/encoder.h: from the counts of an encoder to the position of its axis.
 *
 * Context: the servo tick calls encoder_step() in each control period, encoder_count() in each millisecond, and
 * encoder_scale() when a configuration takes effect. The background computes positions at an index pulse with
 * encoder_position_before().
 *
 * The counter of the HAL wraps as int32 does; the position does not. The length of a count is known to 2^-48 nm, and
 * what a count adds to the position is carried to the same resolution, so that no rounding adds up.
 */
#ifndef KONTUR_DRIVE_ENCODER_H
#define KONTUR_DRIVE_ENCODER_H
#include <stdbool.h>

#include "core/num.h"

struct encoder {
    int32_t last;            /* count as read in the last period */
    int32_t moved;           /* counts in the last period */
    int32_t counted;         /* count as read when `count` was taken */
    int64_t count;           /* since power-on, without wrapping */
    pos_t pos;               /* position: count times the length of a count, */
    uint32_t fraction;       /* and its remainder, 2^-32 of the unit of pos_t */
    uint32_t length;         /* of a count, as the nearest multiple of pos_t's unit, */
    int32_t length_fraction; /* and the difference to it, 2^-32 of that unit */
    int32_t edge_nm;         /* position when a limit switch opened or closed last */
    num half_count;          /* half the length of a count, um */
};

/* Before the first tick: the counter stands at `count`. A length must be given before the position is used. */
void encoder_reset(struct encoder *e, int32_t count);
/* Set the length of a count to length_10fm times 10 fm. The position becomes the number of counts since power-on times
 * that length. */
void encoder_scale(struct encoder *e, uint32_t length_10fm);
/* The position that lies `counts` before `pos`. */
pos_t encoder_position_before(const struct encoder *e, pos_t pos, int32_t counts);

/* One control period. Returns the position. */
static inline pos_t encoder_step(struct encoder *e, int32_t count)
{
    const int32_t moved = (int32_t)((uint32_t)count - (uint32_t)e->last);
    const int64_t fraction = (int64_t)moved * e->length_fraction + (int64_t)e->fraction;
    e->last = count;
    e->moved = moved;
    e->fraction = (uint32_t)fraction;
    e->pos += (int64_t)moved * (int64_t)e->length + (fraction >> 32);
    return e->pos;
}

/* Bring e->count up to date: at least once in 2^31 counts. */
static inline void encoder_count(struct encoder *e)
{
    e->count += (int32_t)((uint32_t)e->last - (uint32_t)e->counted);
    e->counted = e->last;
}

/* Whether the counter has jumped: more counts in one period than an axis can move. */
static inline bool encoder_jumped(const struct encoder *e, uint32_t jump_counts)
{
    return (uint32_t)e->moved + jump_counts > 2u * jump_counts;
}
#endif
