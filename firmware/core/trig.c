/* SPDX-License-Identifier: Apache-2.0 */
/* trig.c: cosh and sinh, trig.h. Runs in the servo tick. */
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
    if (!n_lt(SMALL, n_abs(x))) {
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
