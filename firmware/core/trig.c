/* SPDX-License-Identifier: Apache-2.0 */
/* trig.c: transcendental functions, trig.h. Runs in the servo tick. */
#include "core/trig.h"

#define SMALL NUM(0.5)

/* For |a| <= 1/2: sinh by its Taylor series, whose first omitted term is below 6e-9, and cosh from sinh. */
static struct trig_cosh cosh_small(num a)
{
    const num a2 = n_mul(a, a);
    num s = n_mad(NUM(1.0 / 120), a2, NUM(1.0 / 5040));
    s = n_mad(NUM(1.0 / 6), a2, s);
    s = n_mad(NUM(1), a2, s);
    const num sinh = n_mul(a, s);
    const struct trig_cosh r = {n_sqrt(n_mad(NUM(1), sinh, sinh)), sinh};
    return r;
}

/* For |x| > 1/2, x/8 is doubled three times: sinh 2a = 2 sinh a cosh a, cosh 2a = 1 + 2 sinh^2 a. */
struct trig_cosh trig_cosh(num x)
{
    if (usually(!n_lt(SMALL, n_abs(x)))) {
        return cosh_small(x);
    }
    struct trig_cosh r = cosh_small(n_mul(n_within(x, NUM(TRIG_COSH_MAX)), NUM(0.125)));
    for (int i = 0; i < 3; i++) {
        const num s2 = n_mul(r.sinh_x, r.sinh_x);
        r.sinh_x = n_mul(NUM(2), n_mul(r.sinh_x, r.cosh_x));
        r.cosh_x = n_mad(NUM(1), NUM(2), s2);
    }
    return r;
}

/* exp(-x) = (1 / exp(x/16))^16, where exp() is its Taylor series to the fourth power. */
num trig_decay(num x)
{
    const num y = n_mul(x, NUM(1.0 / 16));
    num e = n_mad(NUM(1.0 / 6), y, NUM(1.0 / 24));
    e = n_mad(NUM(0.5), y, e);
    e = n_mad(NUM(1), y, e);
    e = n_mad(NUM(1), y, e);
    num r = n_div(NUM(1), e);
    for (int i = 0; i < 4; i++) {
        r = n_mul(r, r);
    }
    return r;
}

/* In x, quarter turns from the nearest multiple of a quarter turn, |x| <= 1/2: the Taylor series of the sine, whose
 * first omitted term is below 4e-7, and of all polynomials of its degree with the value 1 at 0 the one that is closest
 * to the cosine: 4e-8 at most. */
struct trig_circle trig_circle(uint32_t phase)
{
    const uint32_t quarter = (phase + 0x20000000u) >> 30;
    const num x = n_ratio((int32_t)(phase - (quarter << 30)), 0x40000000);
    const num x2 = n_mul(x, x);
    num s = n_mad(NUM(0.07969262624616703), x2, NUM(-0.004681754135318687)); /* (pi/2)^5 / 5!, -(pi/2)^7 / 7! */
    s = n_mad(NUM(-0.6459640975062462), x2, s);
    s = n_mul(x, n_mad(NUM(1.5707963267948966), x2, s));
    num c = n_mad(NUM(0.25360636), x2, NUM(-0.02042625));
    c = n_mad(NUM(-1.23369795), x2, c);
    c = n_mad(NUM(1), x2, c);
    /* Turned by whole quarters, whose sine and cosine these are: products with 0 and 1, exact and without a branch. */
    NUM_TABLE num sine[5] = {NUM(0), NUM(1), NUM(0), NUM(-1), NUM(0)};
    const num cos_q = sine[quarter + 1u], sin_q = sine[quarter];
    return (struct trig_circle){n_msub(n_mul(cos_q, c), sin_q, s), n_mad(n_mul(cos_q, s), sin_q, c)};
}
