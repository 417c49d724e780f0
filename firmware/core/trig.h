/* SPDX-License-Identifier: Apache-2.0 */
/* trig.h: cosh and sinh for the sliding surface (11), the only transcendental functions that the law needs.
 *
 * The law has no angles: the frame of (4) is the unit tangent itself, and the rates of its inclination come from cross
 * products. So it evaluates no sine, cosine or arc tangent.
 *
 * Context: smc.c calls it in the servo tick.
 */
#ifndef KONTUR_TRIG_H
#define KONTUR_TRIG_H
#include "core/num.h"

#define TRIG_COSH_MAX 4

struct trig_cosh {
    num cosh_x;
    num sinh_x;
};

/* cosh and sinh of x, with |x| clamped to TRIG_COSH_MAX. The error
 * is below 1e-6 cosh x in float32 and 2e-5 cosh x in fixed point. */
struct trig_cosh trig_cosh(num x);
#endif
