/* SPDX-License-Identifier: Apache-2.0 */
/* num_bound.h: a back end of num.h that computes, beside each value, how far the rounding of another back end may
 * have moved it (running error analysis). Compiled with it, the control files themselves compute their precision. The
 * tests call it through core_api.h, in a host process.
 *
 * With BOUND_FIXED it bounds fixed point, where a product, a quotient and an input err by half a step, 2^-20, and a
 * sum is exact; without it float32, where every operation errs by 2^-24 of its result. Values are doubles and not
 * rounded, so that they are the results of exact arithmetic on the inputs as given; the error of an input is that of
 * its rounding. Errors propagate through positions and path time, too. Comparisons go by the value: close to a limit,
 * the other back end may take the other branch, whose error is not computed here.
 */
#ifndef KONTUR_NUM_BOUND_H
#define KONTUR_NUM_BOUND_H
#include <math.h>

typedef struct {
    double d, e; /* value, bound of its error */
} num;

typedef num acc_t;

typedef struct {
    int64_t v; /* 2^-16 nm */
    double e;  /* um */
} pos_t;

/* The error of path time since api_*() was called, T0. n_to_q32() adds to it, and n_ratio() of a path time adds it. */
extern double bound_path_time;

#define NUM_NAME "bound"
#define NUM(c) bound_input(c)
#define NUM_TABLE const
#define UM_PER_POS (1e-3 / 65536)
#ifdef BOUND_FIXED
#define BOUND(d, roundings) (0x1p-20 * (roundings))
#define BOUND_SUM(d) 0.0
#else
#define BOUND(d, roundings) (0x1p-24 * (roundings) * fabs(d))
#define BOUND_SUM(d) BOUND(d, 1)
#endif

static inline num bound_input(double c)
{
#ifdef BOUND_FIXED
    return (num){c, fabs(c - floor(c * 0x1p19 + 0.5) * 0x1p-19)};
#else
    return (num){c, fabs(c - (double)(float)c)};
#endif
}

static inline num n_add(num a, num b)
{
    return (num){a.d + b.d, a.e + b.e + BOUND_SUM(a.d + b.d)};
}

static inline num n_sub(num a, num b)
{
    return (num){a.d - b.d, a.e + b.e + BOUND_SUM(a.d - b.d)};
}

static inline num n_neg(num a)
{
    return (num){-a.d, a.e};
}

/* |x| e. It is 0 for x = 0, even where e is infinite. */
static inline double bound_share(double x, double e)
{
    return x == 0.0 || e == 0.0 ? 0.0 : fabs(x) * e;
}

static inline num n_mul(num a, num b)
{
    return (num){a.d * b.d,
                 bound_share(a.d, b.e) + bound_share(b.d, a.e) + bound_share(a.e, b.e) + BOUND(a.d * b.d, 1)};
}

#ifndef BOUND_FIXED /* float32 rounds a product and its sum once */
#define NUM_MAD
static inline num n_mad(num a, num b, num c)
{
    const double d = a.d + b.d * c.d;
    const double product = bound_share(b.d, c.e) + bound_share(c.d, b.e) + bound_share(b.e, c.e);
    return (num){d, a.e + product + BOUND(d, 1)};
}

static inline num n_msub(num a, num b, num c)
{
    return n_mad(a, n_neg(b), c);
}
#endif

static inline num n_div(num a, num b)
{
    const double q = a.d / b.d;
    return (num){q, (a.e + bound_share(q, b.e)) / fmax(fabs(b.d) - b.e, 0.0) + BOUND(q, 1)};
}

static inline bool n_lt(num a, num b)
{
    return a.d < b.d;
}

/* Fixed point rounds a root down, which errs by up to two half steps. */
static inline num n_sqrt(num a)
{
    const double r = sqrt(fmax(a.d, 0.0));
    return (num){r, fmin(sqrt(a.e), a.e / r) + BOUND(r, 2)};
}

static inline num n_hypot(num a, num b)
{
    const double r = hypot(a.d, b.d);
    return (num){r, a.e + b.e + BOUND(r, 3)};
}

static inline num n_state(num a)
{
    return a;
}

static inline num n_ratio(int64_t n, int64_t d)
{
    const double q = (double)n / (double)d;
    const bool of_path_time = d == (int64_t)5 << 29;
    return (num){q, BOUND(q, 3) + (of_path_time ? 5 * bound_path_time : 0.0)};
}

static inline int64_t n_to_q32(num x)
{
    bound_path_time += x.e + 0x1p-29; /* the caller drops three bits */
    return (int64_t)(x.d * 4294967296.0);
}

static inline int32_t n_to_scaled(num x, int32_t k)
{
    return (int32_t)lround(x.d * k);
}

static inline pos_t pos_from_nm(int64_t nm)
{
    return (pos_t){nm * POS_PER_NM, 0.0};
}

static inline int32_t pos_to_nm(pos_t p)
{
    return (int32_t)llround((double)p.v / POS_PER_NM);
}

static inline pos_t pos_moved(pos_t p, int32_t nm)
{
    return (pos_t){p.v + (int64_t)nm * POS_PER_NM, p.e};
}

static inline int64_t pos_to_wide_nm(pos_t p)
{
    return pos_to_nm(p);
}

static inline num pos_sub(pos_t a, pos_t b)
{
    const double d = (double)(a.v - b.v) * UM_PER_POS;
    return (num){d, a.e + b.e + BOUND(d, 3)};
}

static inline pos_t pos_add(pos_t p, num x)
{
    return (pos_t){p.v + llround(x.d / UM_PER_POS), p.e + x.e + BOUND_SUM(x.d) + 0.5 * UM_PER_POS};
}

/* As exact as p: what the error of p does is small, since screws are long. */
static inline uint32_t pos_phase(pos_t p, uint64_t turns)
{
    return (uint32_t)(((uint64_t)p.v * turns) >> 32);
}

static inline acc_t acc_from(num x)
{
    return (acc_t){x.d, x.e + 0x1p-49};
}

static inline acc_t acc_state(acc_t a)
{
    return a;
}

static inline num acc_to(acc_t a)
{
    return (num){a.d, a.e + BOUND(a.d, 1)};
}

static inline acc_t acc_mad(acc_t a, num x, num y)
{
    const num p = {x.d * y.d, fabs(x.d) * y.e + fabs(y.d) * x.e + x.e * y.e + 3 * BOUND_SUM(x.d * y.d)};
    return (acc_t){a.d + p.d / ACC_GAIN, a.e + p.e / ACC_GAIN + 0x1p-48};
}
#endif
