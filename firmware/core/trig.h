/* SPDX-License-Identifier: Apache-2.0 */
/* trig.h: transcendental functions: cosh and sinh for the sliding surface (11), exp(-x) for the Stribeck curve, and
 * cosine and sine of the angle of a screw.
 *
 * The law has no angles: the frame of (4) is the unit tangent itself, and the rates of its inclination come from cross
 * products.
 *
 * Context: smc.c, friction.c and screw.c call it in the servo tick.
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

#define TRIG_DECAY_MAX 16

/* exp(-x) of x within 0..TRIG_DECAY_MAX. The error is below 3e-6 in float32 and 5e-5 in fixed point. */
num trig_decay(num x);

struct trig_circle {
    num cos, sin;
};

/* Cosine and sine of an angle in 2^-32 turns. The error is below 5e-7 in float32 and 1e-5 in fixed point. */
struct trig_circle trig_circle(uint32_t phase);
#endif
