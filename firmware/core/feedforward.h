/* SPDX-License-Identifier: Apache-2.0 */
/* core/feedforward.h: friction and mass feedforward that learns from the compensator. Not in the paper; off with both rates 0.
 *
 * Whatever the compensator (24) has to add in the long run along the sign of the reference velocity is Coulomb friction that
 * the plant parameters do not know, and what it adds along the reference acceleration is mass. Both are learned by the
 * gradient rule
 *   l' = rate_l d u,             d = sat(r' / friction_speed)
 *   m' = rate_m u a / (a^2 + a_0^2),   a = r''
 * for each axis with the compensator's force u, and l d + m a is fed forward. At a reversal the friction learned turns with
 * the reference at once, where the compensator alone would have to build it up anew.
 *
 * Both rates are far below the compensator's mu/phi, so that it has settled to what is learned.
 */
#ifndef KONTUR_LEARNING_H
#define KONTUR_LEARNING_H
#include "core/smc.h"

struct feedforward_cfg {
    num friction_rate; /* 1/T0 */
    num mass_rate;     /* 1/T0 */
    num acceleration;  /* a_0, um/T0^2, > 0: below it little is learned of the mass */
};

struct feedforward_state {
    acc_t friction[2]; /* N, within -L .. 3 L */
    acc_t mass[2];     /* N T0^2/um, within -M/2 .. M */
};

void feedforward_reset(struct feedforward_state *state);
/* The force learned so far for a reference that moves in `direction` (smc_direction) with r_ddot. */
vec2 feedforward_force(const struct feedforward_state *state, vec2 direction, vec2 r_ddot);
/* dt (T0) in which the compensator added `u` (N), for one axis: 0 x, 1 y. */
void feedforward_step(const struct feedforward_cfg *cfg, const struct plant_cfg *plant, struct feedforward_state *state,
                      int axis, vec2 direction, vec2 r_ddot, vec2 u, num dt);
#endif
