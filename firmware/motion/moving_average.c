/* SPDX-License-Identifier: Apache-2.0 */
#include "motion/moving_average.h"

void moving_average_fill(struct moving_average *b, unsigned length, int64_t value)
{
    b->length = (uint8_t)length;
    b->at = 0;
    b->sum = value * (int64_t)length;
    for (unsigned i = 0; i < length; i++) {
        b->past[i] = value;
    }
}

int64_t moving_average_step(struct moving_average *b, int64_t value)
{
    b->sum += value - b->past[b->at];
    b->past[b->at] = value;
    b->at = (uint8_t)((b->at + 1u) % b->length);
    return b->sum;
}

int64_t moving_average_round(int64_t a, int64_t b)
{
    return (a < 0 ? a - b / 2 : a + b / 2) / b;
}
