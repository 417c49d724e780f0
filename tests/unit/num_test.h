/* SPDX-License-Identifier: Apache-2.0 */
/* num_test.h: how tests make, read and compare a `num` of any back end. */
#ifndef KONTUR_NUM_TEST_H
#define KONTUR_NUM_TEST_H
#include "core/vec2.h"

static inline num mk(double x)
{
    return NUM(x);
}

static inline vec2 mk2(double x, double y)
{
    return v2(mk(x), mk(y));
}

/* The value of x. In fixed point |x| must be below 4096. */
static inline double val(num x)
{
#if defined(KONTUR_NUM_FIX) || defined(KONTUR_NUM_CHK) || defined(KONTUR_NUM_HEADER)
    return (double)n_to_q32(x) / 4294967296.0;
#else
    return (double)x;
#endif
}

static inline double acc_val(acc_t a)
{
    return val(acc_to(a));
}

/* A rounding errs by NUM_ROUNDING of its result and by NUM_STEP. Fixed point errs by half a step, whatever the
 * result is. Its inputs do, too: a product with an input as a factor errs by half a step of the other factor,
 * which is one of `terms`. */
#if defined(KONTUR_NUM_FIX) || defined(KONTUR_NUM_CHK)
#define NUM_FIXED 1
#define NUM_ROUNDING 0x1p-20
#define NUM_STEP 0x1p-20
#else
#define NUM_FIXED 0
#define NUM_ROUNDING 0x1p-24
#define NUM_STEP 0x1p-33
#endif
/* The tolerance of n half steps in fixed point, 0 in float32. */
#define HALF_STEPS(n) (NUM_FIXED * 0x1p-20 * (n))
/* Compare a result of up to 16 roundings of terms whose magnitudes add up to `terms`. */
#define ASSERT_NEAR(expected, actual, terms)                                                                           \
    TEST_ASSERT_DOUBLE_WITHIN(16 * (NUM_ROUNDING * (terms) + NUM_STEP), expected, actual)
#endif
