/* SPDX-License-Identifier: Apache-2.0 */
/* observer.h: extended state observer of one axis, from encoder counts and applied force.
 *
 * It is the only source of velocity. Its states are position, velocity, and the acceleration d that the nominal
 * linear plant m a + c v = u does not explain (friction, disturbance, model error). It is of third order with a
 * triple pole. The gains are those of the critically damped (fading memory) filter with pole p per control period.
 *
 * Derivation: predict with the force that acted in the period just ended, then correct by the innovation
 * y - q. The gains (1 - p^3, 3/2 (1 - p)^2 (1 + p) / dt, (1 - p)^3 / dt^2) put all three poles of the error at p.
 *
 * Context: servo_step() (servo.c) calls observer_step() once for each axis in the servo tick. The background loop
 * calls observer_design() when parameters change (drive/configuration.c).
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
    num acc;         /* um/T0^2, as the last step predicted it */
};

/* The gains for a bandwidth (rad/T0, bandwidth dt < 2) and the control period dt. */
struct observer_cfg observer_design(num bandwidth, num dt);
/* Start at rest at pos, with d = 0. */
void observer_reset(struct observer_state *state, pos_t pos);
/* One control period. `measured` is the encoder position, `force` (N) the force that acted since the last step;
 * mass and viscous friction are those of the axis, in core units. */
void observer_step(const struct observer_cfg *cfg, struct observer_state *state, pos_t measured, num force, num mass,
                   num viscous);
#endif
