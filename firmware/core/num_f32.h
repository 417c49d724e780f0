/* SPDX-License-Identifier: Apache-2.0 */
/* num_f32.h: the float32 back end of num.h. Built with -ffp-contract=off,
 * it gives the same bits on every machine. Only num.h includes it. */
#ifndef KONTUR_NUM_F32_H
#define KONTUR_NUM_F32_H

typedef float num;
typedef struct {
    num sum, error; /* the exact value is sum + error: error is what rounding has taken off the sum so far */
} acc_t;
#define NUM_NAME "f32"
#define NUM_ABS
#define NUM_MAD
#define NUM_PART
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

static inline num n_abs(num a)
{
    return __builtin_fabsf(a);
}

static inline bool n_lt(num a, num b)
{
    return a < b;
}

static inline uint32_t n_word(num x)
{
    union {
        num x;
        uint32_t word;
    } u = {.x = x};
    return u.word;
}

/* The bits of positive numbers are in the order of the numbers. */
static inline bool n_is_part(num a)
{
    return n_word(a) < 0x3F800000u;
}

/* The instruction VSQRT on the target. With -fno-math-errno it needs no libm. */
static inline num n_sqrt(num a)
{
    return __builtin_sqrtf(a);
}

/* Product and sum are rounded once (IEEE 754-2019, 5.4.1 fusedMultiplyAdd). It is one instruction on the target
 * and on a host that has it; on other hosts it is the C library's fmaf(), which gives the same bits. */
static inline num n_mad(num a, num b, num c)
{
    return __builtin_fmaf(b, c, a);
}

static inline num n_msub(num a, num b, num c)
{
    return __builtin_fmaf(-b, c, a);
}

static inline num n_hypot(num a, num b)
{
    return n_sqrt(n_mad(b * b, a, a));
}

static inline num n_state(num a)
{
    return a;
}

/* ---- Conversions between int64 and float32. A Cortex-M4F converts 32 bits in
 * one instruction; the compiler's library takes more than a hundred for 64 bits.
 * The results are those of C's conversions, the same bits on every machine. ---- */

static inline num n_from_bits(uint32_t bits)
{
    union {
        uint32_t bits;
        num x;
    } u = {.bits = bits};
    return u.x;
}

/* The nearest num; a half is rounded to even. n_from_wide() converts the rare numbers that need more than 32 bits. */
num n_from_wide(int64_t i);
static inline num n_from_i64(int64_t i)
{
    if (__builtin_expect(i == (int32_t)i, 1)) {
        return (num)(int32_t)i;
    }
    return i == (uint32_t)i ? (num)(uint32_t)i : n_from_wide(i);
}

/* x rounded towards 0, saturated at 4e18: conversions of numbers out of range differ between machines. */
int64_t n_to_wide(num x);
static inline int64_t n_to_i64(num x)
{
    if (usually((n_word(x) << 1) < 0x9E000000u)) { /* |x| < 2^31 */
        return (int32_t)x;
    }
    const num size = __builtin_fabsf(x);
    /* Below 2^38 the 24 bits of the mantissa stand for multiples of 2^8 or more, so the division by 128 is exact. */
    return size < 274877906944.0f ? (int64_t)(int32_t)(x * (1.0f / 128)) * 128 : n_to_wide(x);
}

static inline num n_ratio(int64_t n, int64_t d)
{
    return n_from_i64(n) / n_from_i64(d);
}

static inline num n_of_word(uint32_t word)
{
    union {
        uint32_t word;
        num x;
    } u = {.word = word};
    return u.x;
}

static inline int64_t n_to_q32(num x)
{
    return n_to_i64(x * 4294967296.0f);
}

static inline num pos_sub(pos_t a, pos_t b)
{
    return n_from_i64((int64_t)((uint64_t)a - (uint64_t)b)) *
           (1.0f / 65536000.0f); /* wraps: a bit flip must not overflow */
}

static inline pos_t pos_add(pos_t p, num x)
{
    return (int64_t)((uint64_t)p + (uint64_t)n_to_i64(x * 65536000.0f));
}

/* round(x * k), saturated; a half is rounded to even. n_to_wide_scaled() converts a product of 2^22 or more. */
int32_t n_to_wide_scaled(num y);
static inline int32_t n_to_scaled(num x, int32_t k)
{
    const num y = x * (num)k;
    /* The last bit of 1.5 * 2^23 + y has the value 1 while that is from 2^23 up to 2^24. */
    const uint32_t bits = n_word(y + 12582912.0f);
    if (usually((bits >> 23) == 0x96u)) {
        return (int32_t)(bits - 0x4B400000u);
    }
    return n_to_wide_scaled(y);
}

static inline acc_t acc_from(num x)
{
    const acc_t a = {x, 0.0f};
    return a;
}

static inline num acc_to(acc_t a)
{
    return a.sum;
}

static inline acc_t acc_state(acc_t a)
{
    return a;
}

/* Compensated summation: where the addend is smaller than the sum, the rounding error of the sum is a float32
 * itself (T. J. Dekker, A floating-point technique for extending the available precision, Numer. Math. 18, 1971).
 * It is added in the next call, so the accumulator resolves 2^-48 of its value. Where the addend is larger, it
 * resolves 2^-24 of the addend. */
static inline acc_t acc_mad(acc_t a, num x, num y)
{
    const num add = n_mad(a.error, x * (1.0f / ACC_GAIN), y);
    const num sum = a.sum + add;
    const acc_t r = {sum, add - (sum - a.sum)};
    return r;
}
#endif
