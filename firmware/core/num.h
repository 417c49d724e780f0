/* SPDX-License-Identifier: Apache-2.0 */
/* num.h: the numeric contract of the control core.
 *
 * Every signal of the control law is a `num`; every absolute position is a `pos_t`. The control files use only these
 * functions and never an operator on a `num`. So the back end can be float32 (num_f32.h), fixed point (num_fix.h,
 * -DKONTUR_NUM_FIX), or fixed point checked against double (num_chk.h, -DKONTUR_NUM_CHK).
 *
 * Context: pure functions for the servo tick; the background loop uses them, too, when it computes the configuration.
 *
 * Units of the core
 *   length   1 um
 *   time     T0 = 5 ms
 *   force    1 N
 * With e, e' T0 and e'' T0^2, every kinematic signal lies within +-4096, so that one fixed-point format (Q12.19, 2
 * pm) can carry them all. A fixed-point back end saturates at +-4096.
 *
 * pos_t is an int64 in units of 2^-16 nm. Positions are subtracted first, and only the difference becomes a `num`,
 * because float32 has steps of 7.6 nm at 100 mm.
 *
 * A back end defines the type num, NUM(c) for a literal constant c, and
 *   n_add n_sub n_mul n_div (divisor not 0) n_neg n_lt n_sqrt (of >= 0) n_hypot
 *   n_ratio(n, d)      n/d from integers, d > 0
 *   n_to_q32(x)        x * 2^32 as int64, to one step, for |x| < 4096
 *   pos_sub(a, b)      (a - b) in um
 *   pos_add(p, x)      p + x um, to one step
 *   n_to_scaled(x, k)  round(x * k) as int32, saturated, for telemetry
 *   n_word(x)          the value as 32 bits, for the scope
 *   n_of_word(w)       the value of these 32 bits
 *   n_state(x)         x as the state of the next period; the checking back end starts a new shadow, so that it checks
 *                      one period
 *   acc_t              an accumulator for slow integrals with a resolution of 2^-48, since the increment of one step
 *                      may be far below the resolution of a num
 *   acc_from(x), acc_to(a)  conversions from and to num
 *   acc_mad(a, x, y)   a + x y / ACC_GAIN: rates below the resolution of a num are given ACC_GAIN times as large
 *   acc_state(a)       a as the state of the next period, like n_state()
 * A back end may also define
 *   NUM_MAD with n_mad(a, b, c), a + b c, and n_msub(a, b, c), a - b c, where they round once
 *   NUM_ABS with n_abs(x), where there is something better than a comparison with 0
 *   NUM_PART with n_is_part(x), whether 0 <= x < 1
 *   NUM_TABLE, what a table of constants is declared with, where NUM(c) is no constant for the compiler
 */
#ifndef KONTUR_NUM_H
#define KONTUR_NUM_H
#include <stdbool.h>
#include <stdint.h>

/* What holds in nearly every control period, and what does not: the compiler keeps the usual way together. */
static inline bool usually(bool holds)
{
    return __builtin_expect(holds, true) != 0;
}

static inline bool rarely(bool holds)
{
    return __builtin_expect(holds, false) != 0;
}

#define ACC_GAIN 1024
#define POS_PER_NM 65536

#ifdef KONTUR_NUM_HEADER /* a back end of a test, which has its own pos_t */
#include KONTUR_NUM_HEADER
#else
typedef int64_t pos_t;

static inline pos_t pos_from_nm(int64_t nm)
{
    return nm * POS_PER_NM;
}

/* The nearest nm, saturated to int32 (+-2.147 m). */
static inline int32_t pos_to_nm(pos_t p)
{
    const int64_t nm = (p + POS_PER_NM / 2 - (p < 0 ? 1 : 0)) >> 16; /* a half away from 0 */
    if (usually(nm == (int32_t)nm)) {
        return (int32_t)nm;
    }
    return nm < 0 ? INT32_MIN : INT32_MAX;
}

/* p + nm. It wraps: a bit flip must not overflow. */
static inline pos_t pos_moved(pos_t p, int32_t nm)
{
    return (pos_t)((uint64_t)p + (uint64_t)pos_from_nm(nm));
}

/* The nearest nm of any position but the last one. */
static inline int64_t pos_to_wide_nm(pos_t p)
{
    return (pos_t)((uint64_t)p + POS_PER_NM / 2) >> 16;
}

/* The position in turns, of which there are `turns` 2^-64 a step of a position: the fraction, in 2^-32 turns. */
static inline uint32_t pos_phase(pos_t p, uint64_t turns)
{
    return (uint32_t)(((uint64_t)p * turns) >> 32);
}

#if defined(KONTUR_NUM_FIX)
#include "core/num_fix.h"
#elif defined(KONTUR_NUM_CHK)
#include "core/num_chk.h"
#else
#include "core/num_f32.h"
#endif
#endif

#ifndef NUM_TABLE
#define NUM_TABLE static const
#endif

#ifndef NUM_PART
static inline bool n_is_part(num a)
{
    return !n_lt(a, NUM(0)) && n_lt(a, NUM(1));
}
#endif

#ifndef NUM_ABS
static inline num n_abs(num a)
{
    return n_lt(a, NUM(0)) ? n_neg(a) : a;
}
#endif

static inline num n_min(num a, num b)
{
    return n_lt(b, a) ? b : a;
}

static inline num n_max(num a, num b)
{
    return n_lt(a, b) ? b : a;
}

/* a limited to lo..hi, lo <= hi */
static inline num n_clamp(num a, num lo, num hi)
{
    return n_max(lo, n_min(a, hi));
}

/* a limited to -max..max, max >= 0 */
static inline num n_within(num a, num max)
{
    return n_lt(max, n_abs(a)) ? (n_lt(a, NUM(0)) ? n_neg(max) : max) : a;
}

/* a limited to lo..hi, lo <= hi */
static inline acc_t acc_clamp(acc_t a, num lo, num hi)
{
    const num x = acc_to(a);
    return n_lt(x, lo) ? acc_from(lo) : n_lt(hi, x) ? acc_from(hi) : a;
}

/* sat(x / width), the sign function with a boundary layer; width > 0 */
static inline num n_sat(num x, num width)
{
    if (!n_lt(n_abs(x), width)) {
        return n_lt(x, NUM(0)) ? NUM(-1) : NUM(1);
    }
    return n_div(x, width);
}

/* Whether a is neither NaN nor infinite. In fixed point it always is. */
static inline bool n_finite(num a)
{
    return n_lt(n_sub(a, a), NUM(1)); /* a - a of NaN or infinity is NaN, which is not less than 1 */
}

#ifndef NUM_MAD
static inline num n_mad(num a, num b, num c)
{
    return n_add(a, n_mul(b, c));
}

static inline num n_msub(num a, num b, num c)
{
    return n_sub(a, n_mul(b, c));
}
#endif
#endif
