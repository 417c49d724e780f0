/* SPDX-License-Identifier: Apache-2.0 */
/* fix.h: fixed-point arithmetic, Q12.19 in int32, products and quotients in int64.
 *
 * The range is +-4096 and the resolution 1.9e-6 (2 pm, 0.4 nm/s). Every operation rounds to nearest (halves up) and
 * saturates. The code needs an arithmetic right shift of negative numbers, which the supported compilers have.
 * num_fix.h makes it the `num` of the control core; num_chk.h checks it against double at every step.
 *
 * Context: pure functions, called wherever a num is computed.
 */
#ifndef KONTUR_FIX_H
#define KONTUR_FIX_H

#define FIX_BITS 19
#define FIX(c) ((int32_t)((c) < 0 ? (c) * 524288.0 - 0.5 : (c) * 524288.0 + 0.5))

static inline int32_t fix_sat(int64_t x)
{
    return x > INT32_MAX ? INT32_MAX : x < -INT32_MAX ? -INT32_MAX : (int32_t)x;
}

/* n / d rounded to nearest, d != 0 */
static inline int64_t fix_quotient(int64_t n, int64_t d)
{
    const int64_t half = (d < 0 ? -d : d) / 2;
    return (n < 0 ? n - half : n + half) / d;
}

/* floor(sqrt(x)), bit by bit, so that it is the same on every machine */
static inline uint32_t fix_isqrt(uint64_t x)
{
    uint64_t root = 0;
    uint64_t bit = (uint64_t)1 << 62;
    while (bit > x) {
        bit >>= 2;
    }
    for (; bit != 0; bit >>= 2) {
        if (x >= root + bit) {
            x -= root + bit;
            root = (root >> 1) + bit;
        } else {
            root >>= 1;
        }
    }
    return (uint32_t)root;
}

static inline int32_t fix_add(int32_t a, int32_t b)
{
    return fix_sat((int64_t)a + b);
}

static inline int32_t fix_sub(int32_t a, int32_t b)
{
    return fix_sat((int64_t)a - b);
}

static inline int32_t fix_neg(int32_t a)
{
    return -a;
}

static inline int32_t fix_mul(int32_t a, int32_t b)
{
    return fix_sat(((int64_t)a * b + ((int64_t)1 << (FIX_BITS - 1))) >> FIX_BITS);
}

static inline int32_t fix_div(int32_t a, int32_t b)
{
    return fix_sat(fix_quotient((int64_t)a * ((int64_t)1 << FIX_BITS), b));
}

static inline bool fix_lt(int32_t a, int32_t b)
{
    return a < b;
}

static inline int32_t fix_sqrt(int32_t a)
{
    return (int32_t)fix_isqrt((uint64_t)(a > 0 ? a : 0) << FIX_BITS);
}

static inline int32_t fix_hypot(int32_t a, int32_t b)
{
    return fix_sat(fix_isqrt((uint64_t)((int64_t)a * a) + (uint64_t)((int64_t)b * b)));
}

static inline int32_t fix_ratio(int64_t n, int64_t d)
{
    return fix_sat(fix_quotient(n * ((int64_t)1 << FIX_BITS), d));
}

static inline int64_t fix_to_q32(int32_t x)
{
    return (int64_t)x * ((int64_t)1 << (32 - FIX_BITS));
}

/* A step of num, 2^-19 um, is 65536000 / 524288 = 125 steps of a position, 2^-16 nm. */
static inline int32_t fix_pos_sub(pos_t a, pos_t b)
{
    return fix_sat(fix_quotient(a - b, 125));
}

static inline pos_t fix_pos_add(pos_t p, int32_t x)
{
    return p + (int64_t)x * 125;
}

static inline int32_t fix_to_scaled(int32_t x, int32_t k)
{
    const int64_t y = ((int64_t)x * k + ((int64_t)1 << (FIX_BITS - 1))) >> FIX_BITS;
    return y > INT32_MAX ? INT32_MAX : y < INT32_MIN ? INT32_MIN : (int32_t)y;
}

/* An accumulator is an int64 in units of 2^-48; its range is +-32768. */
static inline int64_t fix_acc_from(int32_t x)
{
    return (int64_t)x * ((int64_t)1 << 29);
}

static inline int32_t fix_acc_to(int64_t a)
{
    return fix_sat((a + ((int64_t)1 << 28)) >> 29);
}

/* a + x y / ACC_GAIN: the unit of x y / ACC_GAIN is 2^-19 2^-19 2^-10 = 2^-48. */
static inline int64_t fix_acc_mad(int64_t a, int32_t x, int32_t y)
{
    return a + (int64_t)x * y;
}
#endif
