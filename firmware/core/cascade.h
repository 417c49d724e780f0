/* SPDX-License-Identifier: Apache-2.0 */
/* cascade.h: the control of most drives, to compare the contouring law with. A P position controller and a PI velocity
 * controller with feedforward of velocity, acceleration and friction; optionally Koren's cross-coupled control, too.
 *
 *   e_v = r' + K_p (r - q) - q',   u = M (r'' + K_v (e_v + K_i integral e_v)) + C r' + friction
 *
 * Cross-coupled (Y. Koren, "Cross-Coupled Biaxial Computer Control for Manufacturing Systems", 1980): the PI law,
 * applied to the contour error e_n2, acts along the normal as well, weighted by the coupling gain W:
 *   u += M n W K_v (w + K_i integral w),   w = -(e_n2' + K_p e_n2)
 * It gets the contour error of contour.h, so that a comparison compares the laws alone.
 *
 * Context: servo_step() (servo.c) calls it in the servo tick under the controllers `cascade` and `ccc`.
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

/* Set the integrals to 0. */
void cascade_reset(struct cascade_state *state);
/* The force of one control period dt (T0) without friction feedforward, N. `coupled` adds cross-coupled control. */
vec2 cascade_step(const struct cascade_cfg *cfg, const struct plant_cfg *plant, struct cascade_state *state,
                  const struct contour_out *c, bool coupled, num dt);
#endif
