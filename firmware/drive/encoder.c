/* SPDX-License-Identifier: Apache-2.0 */
#include "drive/encoder.h"

void encoder_reset(struct encoder *e, int32_t count)
{
    *e = (struct encoder){.last = count, .counted = count, .count = count};
}

/* 10 fm are 2^16 / 10^5 = 2048 / 3125 of the unit of pos_t. */
void encoder_scale(struct encoder *e, uint32_t length_10fm)
{
    const uint64_t x = (uint64_t)length_10fm * 2048u;
    const uint32_t part = (uint32_t)((x % 3125u << 32) / 3125u);
    e->length = (uint32_t)(x / 3125u) + (part >> 31);
    e->length_fraction = (int32_t)part;
    encoder_count(e);
    e->half_count = n_mul(NUM(0.5), pos_sub((pos_t)e->length, 0));
    const int64_t low = (e->count & 0xFFFF) * (int64_t)e->length_fraction;
    const int64_t high = (e->count >> 16) * (int64_t)e->length_fraction + (low >> 16);
    e->pos = e->count * (int64_t)e->length + (high >> 16);
    e->fraction = (uint32_t)((uint64_t)high << 16) | ((uint32_t)low & 0xFFFFu);
}

pos_t encoder_position_before(const struct encoder *e, pos_t pos, int32_t counts)
{
    const int64_t n = counts;
    return pos - n * (int64_t)e->length - (n * (int64_t)e->length_fraction >> 32);
}
