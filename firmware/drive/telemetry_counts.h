/* SPDX-License-Identifier: Apache-2.0 */
/* drive/telemetry_counts.h: scale a signal to counts, and limit a value of the snapshot to the range of its object.
 * Background only; the generated telemetry_gen.h calls it.
 */
#ifndef KONTUR_TELEMETRY_COUNTS_H
#define KONTUR_TELEMETRY_COUNTS_H
#include <stdint.h>

#include "core/num.h"

/* A signal in counts, `scale` of them to a unit of the core. It is not inline, because there are many signals and
 * the flash is small. */
int32_t telemetry_counts(num x, int32_t scale);

static inline int32_t telemetry_limit(int32_t x, int32_t low, int32_t high)
{
    return x < low ? low : x > high ? high : x;
}

/* The low `bits` of x, as a signed number. */
static inline int32_t telemetry_low_bits(int32_t x, unsigned bits)
{
    const uint32_t half = 1u << (bits - 1u);
    return (int32_t)(((uint32_t)x + half) & (2u * half - 1u)) - (int32_t)half;
}

/* The sum, or 0 if it is negative. */
static inline uint32_t telemetry_sum(int32_t one, int32_t other)
{
    const int64_t sum = (int64_t)one + other;
    return sum < 0 ? 0u : (uint32_t)sum;
}
#endif
