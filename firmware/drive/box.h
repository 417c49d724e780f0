/* SPDX-License-Identifier: Apache-2.0 */
/* box.h: the sum of the last few values of a sequence, in integers: an average that loses nothing. Background only.
 *
 * It rounds the ramps of jog.h and refines the records of record.h.
 */
#ifndef KONTUR_BOX_H
#define KONTUR_BOX_H
#include <stdint.h>

enum { BOX_MAX = 50 };

struct box {
    int64_t past[BOX_MAX];
    int64_t sum;
    uint8_t length, at;
};

/* As if `value` had always come; length 1..BOX_MAX. */
void box_fill(struct box *b, unsigned length, int64_t value);
/* The sum of the last `length` values, this one included. */
int64_t box_step(struct box *b, int64_t value);
/* a / b, rounded to the nearest; b > 0. */
int64_t box_round(int64_t a, int64_t b);
#endif
