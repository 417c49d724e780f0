/* SPDX-License-Identifier: Apache-2.0 */
/* energy.h: electrical energy of one axis from its motion, eqs (26)-(30).
 *
 *   I = (l sign(v) + c v + m a) / K_f (28),  V = I Z + K_E v (29),  E = integral sqrt(3) P_f V I dt (26), (27)
 * (30) is (26)-(29) multiplied out. Velocity and acceleration are the observer's. Power is negative while braking.
 *
 * Context: servo_step() (servo.c) calls energy_step() for each
 * axis once in SERVO_SLOTS control periods, in the servo tick.
 */
#ifndef KONTUR_ENERGY_H
#define KONTUR_ENERGY_H
#include "core/num.h"

struct energy_cfg {
    num force_constant; /* K_f, N/A, > 0 */
    num impedance;      /* Z, ohm */
    num back_emf;       /* K_E, V per um/T0 */
    num power_factor;   /* P_f */
    num sign_speed;     /* boundary layer of sign(v), um/T0 */
    num dt_ms;          /* time between two steps, ms */
};

struct energy_state {
    num fraction_mJ; /* the part below 1 mJ that is not yet in `mJ` */
    int32_t mJ;      /* saturates */
};

/* Set the energy to 0. */
void energy_reset(struct energy_state *state);
/* Add the energy of dt_ms at velocity v (um/T0) and acceleration a (um/T0^2), with the nominal mass, viscous and
 * Coulomb friction (core units). Returns the power in W. */
num energy_step(const struct energy_cfg *cfg, struct energy_state *state, num mass, num viscous, num coulomb, num v,
                num a);
#endif
