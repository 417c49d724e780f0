/* SPDX-License-Identifier: Apache-2.0 */
/* num.h: the numeric contract of the control core.
 *
 * Every signal of the control law is a `num`; every absolute position is a `pos_t`. The control files use
 * these functions only, never an operator on a `num`, so that the back end can be float32 (num_f32.h), fixed point
 * (num_fix.h, -DKONTUR_NUM_FIX) or fixed point checked against double (num_chk.h, -DKONTUR_NUM_CHK).
 *
 * Units of the core
 *   length   1 um
 *   time     T0 = 5 ms
 *   force    1 N
 * so that with e, e' T0, e'' T0^2 every kinematic signal lies within +-4096 and one fixed-point format
 * (Q12.19, 2 pm) can carry them all. What leaves +-4096 saturates there in a fixed-point back end.
 *
 * pos_t: int64, unit 2^-16 nm. Positions are subtracted first; only the difference becomes a `num`:
 * float32 has steps of 7.6 nm at 100 mm.
 *
 * A back end defines: num, NUM(c) for a literal constant c, and
 *   n_add n_sub n_mul n_div (divisor not 0) n_neg n_lt n_sqrt (of >= 0) n_hypot
 *   n_ratio(n, d)      n/d from integers, d > 0
 *   n_to_q32(x)        x * 2^32 as int64, to one step, for |x| < 4096
 *   pos_sub(a, b)      (a - b) in um;   pos_add(p, x)   p + x um, to one step
 *   n_to_scaled(x, k)  round(x * k) as int32, saturated: for telemetry
 *   n_word(x)          the value as 32 bits, for the scope; n_of_word(w) back
 *   n_state(x)         x, kept to the next period: the checking back end starts a new shadow, so that what it checks is a period
 *   n_mad(a, b, c)     a + b c, and n_msub(a, b, c) a - b c, where that rounds once; then NUM_MAD is defined
 *   n_abs(x)           where that is not n_neg() or x; then NUM_ABS is defined
 *   acc_t              an accumulator for slow integrals, to 2^-48: what a step adds to it may be far below the resolution
 *                      of a num. acc_from(num), acc_to(acc), acc_mad(acc, a, b): acc + a b / ACC_GAIN, so that
 *                      rates below the resolution of a num can be given ACC_GAIN times larger. acc_state(acc) is n_state()
 */
#ifndef KONTUR_NUM_H
#define KONTUR_NUM_H
#include <stdbool.h>
#include <stdint.h>

#define ACC_GAIN 1024
#define POS_PER_NM 65536

#ifdef KONTUR_NUM_HEADER /* a back end from elsewhere, which has a pos_t of its own */
#include KONTUR_NUM_HEADER
#else
typedef int64_t pos_t;

static inline pos_t pos_from_nm(int64_t nm)
{
    return nm * POS_PER_NM;
}

/* Nearest nm, saturated to int32 (+-2.147 m). */
static inline int32_t pos_to_nm(pos_t p)
{
    const int64_t nm = (p + (p < 0 ? -POS_PER_NM / 2 : POS_PER_NM / 2)) / POS_PER_NM;
    return nm > INT32_MAX ? INT32_MAX : nm < INT32_MIN ? INT32_MIN : (int32_t)nm;
}

#if defined(KONTUR_NUM_FIX)
#include "core/num_fix.h"
#elif defined(KONTUR_NUM_CHK)
#include "core/num_chk.h"
#else
#include "core/num_f32.h"
#endif
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

/* a within lo..hi, lo <= hi */
static inline num n_clamp(num a, num lo, num hi)
{
    return n_max(lo, n_min(a, hi));
}

/* a within -max..max, max >= 0 */
static inline num n_within(num a, num max)
{
    return n_lt(max, n_abs(a)) ? (n_lt(a, NUM(0)) ? n_neg(max) : max) : a;
}

/* a within lo..hi */
static inline acc_t acc_clamp(acc_t a, num lo, num hi)
{
    const num x = acc_to(a);
    return n_lt(x, lo) ? acc_from(lo) : n_lt(hi, x) ? acc_from(hi) : a;
}

/* sat(x / width): the sign function with a boundary layer, width > 0 */
static inline num n_sat(num x, num width)
{
    if (!n_lt(n_abs(x), width)) {
        return n_lt(x, NUM(0)) ? NUM(-1) : NUM(1);
    }
    return n_div(x, width);
}

/* Neither NaN nor infinite, which fixed point never is */
static inline bool n_finite(num a)
{
    return n_lt(n_sub(a, a), NUM(1)); /* what is left of a NaN or of an infinite is a NaN */
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
