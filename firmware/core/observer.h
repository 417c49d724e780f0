/* SPDX-License-Identifier: Apache-2.0 */
/* observer.h: extended state observer of one axis, from encoder counts and applied force.
 *
 * The only source of velocity. States: position, velocity, and the acceleration d that the nominal linear plant
 * m a + c v = u does not explain (friction, disturbance, model error). Third order with a triple pole; the gains are
 * those of the critically damped (fading memory) filter with pole p per control period.
 *
 * Derivation: predict with the force that acted in the period just ended, then correct by the innovation
 * y - q: gains (1 - p^3, 3/2 (1 - p)^2 (1 + p) / dt, (1 - p)^3 / dt^2) put all three poles of the error at p.
 */
#ifndef KONTUR_OBSERVER_H
#define KONTUR_OBSERVER_H
#include "core/num.h"

struct observer_cfg {
    num gain_pos; /* - */
    num gain_vel; /* 1/T0 */
    num gain_acc; /* 1/T0^2 */
    num dt;       /* T0 */
};

struct observer_state {
    pos_t pos;
    num vel;         /* um/T0 */
    num disturbance; /* um/T0^2 */
    num acc;         /* um/T0^2, of the last prediction */
};

/* Gains for a bandwidth (rad/T0, bandwidth dt < 2) and control period dt. */
struct observer_cfg observer_design(num bandwidth, num dt);
/* At rest at pos, nothing unexplained. */
void observer_reset(struct observer_state *state, pos_t pos);
/* measured: encoder position. force (N): what acted since the last step. mass, viscous: of this axis (core units). */
void observer_step(const struct observer_cfg *cfg, struct observer_state *state, pos_t measured, num force, num mass,
                   num viscous);
#endif
