/* SPDX-License-Identifier: Apache-2.0 */
/* cascade.h: what most drives do, to be measured against: P position, PI velocity, with velocity, acceleration and
 * friction feedforward; and Koren's cross-coupled control on top of it.
 *
 *   e_v = r' + K_p (r - q) - q',   u = M (r'' + K_v (e_v + K_i integral e_v)) + C r' + friction
 *
 * Cross-coupled (Y. Koren, "Cross-Coupled Biaxial Computer Control for Manufacturing Systems", 1980): the same PI
 * law applied to the contour error e_n2 acts along the normal, weighted by the coupling gain W:
 *   u += M n W K_v (w + K_i integral w),   w = -(e_n2' + K_p e_n2)
 * It gets this project's contour error estimate, so the comparison is of the laws alone.
 */
#ifndef KONTUR_CASCADE_H
#define KONTUR_CASCADE_H
#include "core/smc.h"

struct cascade_cfg {
    num k_p;          /* 1/T0 */
    num k_v;          /* 1/T0 */
    num k_i;          /* 1/T0 */
    num coupling;     /* W, >= 0 */
    num integral_max; /* clamp of the integrals, um */
};

struct cascade_state {
    vec2 integral; /* of e_v, um */
    num coupled;   /* of w, um */
};

void cascade_reset(struct cascade_state *state);
/* Force without friction feedforward, N. Coupled control acts where `coupled` is set. */
vec2 cascade_step(const struct cascade_cfg *cfg, const struct plant_cfg *plant, struct cascade_state *state,
                  const struct contour_out *c, bool coupled, num dt);
#endif
