/* SPDX-License-Identifier: Apache-2.0 */
/* feedforward.h: adaptive feedforward of friction and mass. Not in the paper; it is off while both rates are 0.
 *
 * The force that the compensator (24) adds in the long run along the sign of the reference velocity is Coulomb
 * friction beyond the plant parameters; the force that it adds along the reference acceleration is mass beyond them.
 * Both are estimated for each axis by the gradient rule
 *   l' = rate_l d u,             d = sat(r' / friction_speed)
 *   m' = rate_m u a / (a^2 + a_0^2),   a = r''
 * where u is the compensator's force on the axis, and the force l d + m a is fed forward. At a reversal the estimated
 * friction changes its sign with the reference at once, whereas the compensator alone would have to build it up again.
 *
 * Both rates are far below the compensator's mu/phi, so that
 * the compensator has settled to the force that they adapt to.
 *
 * Context: servo_step() (servo.c) calls it in the servo tick under the controller `ccu`.
 */
#ifndef KONTUR_FEEDFORWARD_H
#define KONTUR_FEEDFORWARD_H
#include "core/smc.h"

struct feedforward_cfg {
    num friction_rate; /* 1/T0 */
    num mass_rate;     /* 1/T0 */
    num acceleration;  /* a_0, um/T0^2, > 0: below it the mass adapts little */
};

struct feedforward_state {
    acc_t friction[2]; /* N, within -L .. 3 L */
    acc_t mass[2];     /* N T0^2/um, within -M/2 .. M */
};

/* Set both estimates to 0. */
void feedforward_reset(struct feedforward_state *state);
/* The force to feed forward for a reference that moves in `direction` (smc_direction()) with r_ddot. */
vec2 feedforward_force(const struct feedforward_state *state, vec2 direction, vec2 r_ddot);
/* Adapt the estimates of one axis (0 is x, 1 is y) over dt (T0), in which the compensator added the force u (N). */
void feedforward_step(const struct feedforward_cfg *cfg, const struct plant_cfg *plant, struct feedforward_state *state,
                      int axis, vec2 direction, vec2 r_ddot, vec2 u, num dt);
#endif
