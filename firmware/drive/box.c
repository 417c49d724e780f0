/* SPDX-License-Identifier: Apache-2.0 */
#include "box.h"

void box_fill(struct box *b, unsigned length, int64_t value)
{
    b->length = (uint8_t)length;
    b->at = 0;
    b->sum = value * (int64_t)length;
    for (unsigned i = 0; i < length; i++) {
        b->past[i] = value;
    }
}

int64_t box_step(struct box *b, int64_t value)
{
    b->sum += value - b->past[b->at];
    b->past[b->at] = value;
    b->at = (uint8_t)((b->at + 1u) % b->length);
    return b->sum;
}

int64_t box_round(int64_t a, int64_t b)
{
    return (a < 0 ? a - b / 2 : a + b / 2) / b;
}
