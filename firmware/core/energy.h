/* SPDX-License-Identifier: Apache-2.0 */
/* energy.h: electrical energy of one axis from its motion, eqs (26)-(30).
 *
 *   I = (l sign(v) + c v + m a) / K_f (28),  V = I Z + K_E v (29),  E = integral sqrt(3) P_f V I dt (26), (27)
 * (30) is the same, multiplied out. Velocity and acceleration are the observer's. Braking gives energy back.
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
    num dt_ms;          /* time between two steps in ms: W ms = mJ */
};

struct energy_state {
    num part_mJ; /* below 1 mJ: what has not been carried into `mJ` */
    int32_t mJ;  /* wraps */
};

void energy_reset(struct energy_state *state);
/* dt_ms at velocity v (um/T0), acceleration a (um/T0^2), nominal mass, viscous, coulomb (core units).
 * Returns the power in W. */
num energy_step(const struct energy_cfg *cfg, struct energy_state *state, num mass, num viscous, num coulomb, num v,
                num a);
#endif
