/* SPDX-License-Identifier: Apache-2.0 */
/* num_f32.h: the float32 back end of num.h. Built with -ffp-contract=off: the same bits on every machine. */
#ifndef KONTUR_NUM_F32_H
#define KONTUR_NUM_F32_H

typedef float num;
typedef int64_t acc_t;
#define NUM_NAME "f32"
#define NUM(c) ((num)(c))

static inline num n_add(num a, num b)
{
    return a + b;
}

static inline num n_sub(num a, num b)
{
    return a - b;
}

static inline num n_mul(num a, num b)
{
    return a * b;
}

static inline num n_div(num a, num b)
{
    return a / b;
}

static inline num n_neg(num a)
{
    return -a;
}

static inline bool n_lt(num a, num b)
{
    return a < b;
}

/* VSQRT on the target; no libm with -fno-math-errno */
static inline num n_sqrt(num a)
{
    return __builtin_sqrtf(a);
}

static inline num n_hypot(num a, num b)
{
    return n_sqrt(a * a + b * b);
}

static inline num n_state(num a)
{
    return a;
}

static inline num n_ratio(int64_t n, int64_t d)
{
    return (num)n / (num)d;
}

/* Clamped first: an out-of-range conversion differs between machines. */
static inline int64_t n_to_i64(num x)
{
    const num limit = 4.0e18f;
    const num y = x < -limit ? -limit : x > limit ? limit : x == x ? x : 0.0f;
    const int64_t whole = (int64_t)y;
    const num rest = y - (num)whole; /* exact; y + 0.5 is not, just below 0.5 and above 2^23 */
    return rest >= 0.5f ? whole + 1 : rest <= -0.5f ? whole - 1 : whole;
}

static inline int64_t n_to_q32(num x)
{
    return n_to_i64(x * 4294967296.0f);
}

static inline num pos_sub(pos_t a, pos_t b)
{
    return (num)(a - b) * (1.0f / 65536000.0f);
}

static inline pos_t pos_add(pos_t p, num x)
{
    return p + n_to_i64(x * 65536000.0f);
}

static inline int32_t n_to_scaled(num x, int32_t k)
{
    const int64_t y = n_to_i64(x * (num)k);
    return y > INT32_MAX ? INT32_MAX : y < INT32_MIN ? INT32_MIN : (int32_t)y;
}

static inline acc_t acc_from(num x)
{
    return n_to_i64(x * 281474976710656.0f);
}

static inline num acc_to(acc_t a)
{
    return (num)a * (1.0f / 281474976710656.0f);
}

static inline acc_t acc_state(acc_t a)
{
    return a;
}

static inline acc_t acc_mad(acc_t a, num x, num y)
{
    return a + n_to_i64(x * y * 274877906944.0f);
}
#endif
