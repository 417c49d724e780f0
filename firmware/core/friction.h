/* SPDX-License-Identifier: Apache-2.0 */
/* friction.h: friction of each axis over Coulomb friction, -breakaway..breakaway, as the reference demands it. Every
 * controller multiplies it by Coulomb friction and feeds it forward.
 *
 *   shape = slip(x) (1 + (breakaway - 1) exp(-|r'| / stribeck))
 *
 * - slip: friction does not jump at a reversal. It builds up over the `presliding` distance D. N elastic elements in
 *   parallel carry 1/N of it each, and element k slips after k D / N (Maxwell slip: D. D. Rizos, S. D. Fassois,
 *   "Presliding friction identification based upon the Maxwell Slip model structure", Chaos 14, 2004):
 *     s_k += dx, within +-w_k,   w_k = k D / (2 N),   slip = sum of s_k / (N w_k)
 *   dx is the distance of the reference in a step. So the elements remember each reversal within D, and
 *   keep their friction while the reference rests, as the real ones do. With D = 0, slip is smc_direction().
 * - The second factor is the Stribeck curve, from breakaway at rest to Coulomb friction.
 *
 * Context: in the servo tick, servo_step() (servo.c) calls friction_step() of each axis once in FRICTION_PERIODS periods,
 * and friction_move() in each. The background loop calls friction_design() when parameters change
 * (drive/configuration.c).
 */
#ifndef KONTUR_FRICTION_H
#define KONTUR_FRICTION_H
#include "core/vec2.h"

#define FRICTION_ELEMENTS 8
#define FRICTION_PERIODS 4 /* control periods in a step of an axis */

struct friction_axis_cfg {
    num presliding; /* D, um; 0: slip is smc_direction() */
    struct {
        num width; /* w_k, um */
        num share; /* 1 / (N w_k), 1/um */
    } element[FRICTION_ELEMENTS];
    num excess;   /* breakaway - 1, >= 0 */
    num stribeck; /* um/T0, > 0 */
};

struct friction_cfg {
    bool on; /* false: shape is smc_direction() */
    struct friction_axis_cfg axis[2];
};

struct friction_axis_state {
    num stretch[FRICTION_ELEMENTS]; /* s_k, um */
};

struct friction_state {
    vec2 shape;  /* with on: of the next period, friction_move(); else smc_direction() of the last one */
    vec2 change; /* of the shape in a period */
    struct friction_axis_state axis[2];
};

/* The configuration of an axis: presliding um >= 0, breakaway >= 1, stribeck um/T0 > 0. */
struct friction_axis_cfg friction_design(num presliding, num breakaway, num stribeck);
/* A time dt (T0) of axis 0 or 1 with cfg->on: returns the shape at its end, at which state->shape arrives in
 * FRICTION_PERIODS periods. `direction` is smc_direction() of r_dot. The shape of an axis that is not enabled is 0:
 * without power it has relaxed. */
num friction_step(const struct friction_cfg *cfg, struct friction_state *state, int axis, bool enabled, num r_dot,
                  num direction, num dt);
/* One control period of both axes: the shape goes on towards that of the last steps. In one step it would be felt. */
static inline void friction_move(struct friction_state *state)
{
    state->shape = v2_add(state->shape, state->change);
}
#endif
