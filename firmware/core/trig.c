/* SPDX-License-Identifier: Apache-2.0 */
#include "trig.h"

/* Taylor series at x/8 (|x/8| <= 1/2: the first term left out is below 1e-9), then three doublings:
 * sinh 2a = 2 sinh a cosh a, cosh 2a = 1 + 2 sinh^2 a. */
struct trig_cosh trig_cosh(num x)
{
    const num a = n_mul(n_clamp(x, NUM(-TRIG_COSH_MAX), NUM(TRIG_COSH_MAX)), NUM(0.125));
    const num a2 = n_mul(a, a);
    num s = n_mad(NUM(1), a2, NUM(1.0 / 72));
    s = n_mad(NUM(1), n_mul(a2, NUM(1.0 / 42)), s);
    s = n_mad(NUM(1), n_mul(a2, NUM(1.0 / 20)), s);
    s = n_mad(NUM(1), n_mul(a2, NUM(1.0 / 6)), s);
    struct trig_cosh r = {n_sqrt(n_mad(NUM(1), n_mul(a, s), n_mul(a, s))), n_mul(a, s)};
    for (int i = 0; i < 3; i++) {
        const num s2 = n_mul(r.sinh_x, r.sinh_x);
        r.sinh_x = n_mul(NUM(2), n_mul(r.sinh_x, r.cosh_x));
        r.cosh_x = n_mad(NUM(1), NUM(2), s2);
    }
    return r;
}
