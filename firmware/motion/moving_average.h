/* SPDX-License-Identifier: Apache-2.0 */
/* motion/moving_average.h: the sum of the last values of a sequence, in integers: an average without loss.
 *
 * It rounds the ramps of motion/profile.h and refines the records of motion/ip_record.h. Pure, background only.
 */
#ifndef KONTUR_MOVING_AVERAGE_H
#define KONTUR_MOVING_AVERAGE_H
#include <stdint.h>

enum { MOVING_AVERAGE_MAX = 50 };

struct moving_average {
    int64_t past[MOVING_AVERAGE_MAX];
    int64_t sum;
    uint8_t length, at;
};

/* Start as if all values so far had been `value`. length: 1..MOVING_AVERAGE_MAX. */
void moving_average_fill(struct moving_average *b, unsigned length, int64_t value);
/* Add a value. Returns the sum of the last `length` values, this one included. */
int64_t moving_average_step(struct moving_average *b, int64_t value);
/* a / b, rounded to the nearest integer; b > 0. */
int64_t moving_average_round(int64_t a, int64_t b);
#endif
