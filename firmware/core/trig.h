/* SPDX-License-Identifier: Apache-2.0 */
/* trig.h: the only transcendental functions the law needs, those of the sliding surface (11).
 *
 * Angles never appear: the frame of (4) is the unit tangent itself, and the rates of its inclination come
 * from cross products, so no sine, cosine or arc tangent is evaluated anywhere.
 */
#ifndef KONTUR_TRIG_H
#define KONTUR_TRIG_H
#include "core/num.h"

#define TRIG_COSH_MAX 4

struct trig_cosh {
    num cosh_x;
    num sinh_x;
};

/* cosh and sinh of x, |x| clamped to TRIG_COSH_MAX; error below 1e-6 of cosh x in float32, 2e-5 in fixed point. */
struct trig_cosh trig_cosh(num x);
#endif
