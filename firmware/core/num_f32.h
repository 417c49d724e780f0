/* SPDX-License-Identifier: Apache-2.0 */
/* num_f32.h: the float32 back end of num.h. Built with -ffp-contract=off: the same bits on every machine. */
#ifndef KONTUR_NUM_F32_H
#define KONTUR_NUM_F32_H

typedef float num;
typedef struct {
    num sum, rest; /* rest: what rounding has kept out of the sum so far */
} acc_t;
#define NUM_NAME "f32"
#define NUM_ABS
#define NUM_MAD
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

/* VSQRT on the target; no libm with -fno-math-errno */
static inline num n_sqrt(num a)
{
    return __builtin_sqrtf(a);
}

/* Product and sum rounded once (IEEE 754-2019, 5.4.1 fusedMultiplyAdd): one instruction on the target, and on a host
 * that has one; elsewhere the C library's, with the same bits. */
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

/* ---- int64 and float32. A Cortex-M4F converts 32 bits in one instruction; what the compiler's library does for 64 takes a
 * hundred and more. Results are those of C's conversions, so the same bits on every machine. ---- */

static inline num n_from_bits(uint32_t bits)
{
    union {
        uint32_t bits;
        num x;
    } u = {.bits = bits};
    return u.x;
}

static inline uint32_t n_bits(num x)
{
    union {
        num x;
        uint32_t bits;
    } u = {.x = x};
    return u.bits;
}

/* The nearest num, halves to even; n_from_wide() for what 32 bits do not hold. Mostly they do. */
num n_from_wide(int64_t i);
static inline num n_from_i64(int64_t i)
{
    if (__builtin_expect(i == (int32_t)i, 1)) {
        return (num)(int32_t)i;
    }
    return i == (uint32_t)i ? (num)(uint32_t)i : n_from_wide(i);
}

/* The integer next to x towards 0; saturated at 4e18, where an out-of-range conversion would differ between machines. */
int64_t n_to_wide(num x);
static inline int64_t n_to_i64(num x)
{
    const num size = __builtin_fabsf(x);
    if (__builtin_expect(size < 2147483648.0f, 1)) {
        return (int32_t)x;
    }
    return size < 274877906944.0f ? (int64_t)(int32_t)(x * (1.0f / 128)) * 128
                                  : n_to_wide(x); /* 24 bits: nothing is cut */
}

static inline num n_ratio(int64_t n, int64_t d)
{
    return n_from_i64(n) / n_from_i64(d);
}

static inline uint32_t n_word(num x)
{
    union {
        num x;
        uint32_t word;
    } u = {.x = x};
    return u.word;
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
    return n_from_i64((int64_t)((uint64_t)a - (uint64_t)b)) * (1.0f / 65536000.0f); /* wraps, whatever is in memory */
}

static inline pos_t pos_add(pos_t p, num x)
{
    return (int64_t)((uint64_t)p + (uint64_t)n_to_i64(x * 65536000.0f));
}

/* Halves to even */
int32_t n_to_wide_scaled(num y);
static inline int32_t n_to_scaled(num x, int32_t k)
{
    const num y = x * (num)k;
    if (__builtin_expect(__builtin_fabsf(y) < 4194304.0f, 1)) { /* 2^22: the last bit of 1.5 * 2^23 + y stands for 1 */
        return (int32_t)(n_bits(y + 12582912.0f) - 0x4B400000u);
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

/* Compensated: what rounding takes off a sum is exact in float32 where less is added than is there (T. J. Dekker, A floating-point
 * technique for extending the available precision, Numer. Math. 18, 1971) and goes into the next one, so the accumulator
 * resolves 2^-48 of its value; where more is added, 2^-24 of that. */
static inline acc_t acc_mad(acc_t a, num x, num y)
{
    const num add = n_mad(a.rest, x * (1.0f / ACC_GAIN), y);
    const num sum = a.sum + add;
    const acc_t r = {sum, add - (sum - a.sum)};
    return r;
}
#endif
