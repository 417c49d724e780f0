/* SPDX-License-Identifier: Apache-2.0 */
/* energy.c: the energy of one axis, energy.h. Runs in the servo tick. */
#include "core/energy.h"

void energy_reset(struct energy_state *state)
{
    state->fraction_mJ = NUM(0);
    state->mJ = 0;
}

num energy_step(const struct energy_cfg *cfg, struct energy_state *state, num mass, num viscous, num coulomb, num v,
                num a)
{
    const num force = n_mad(n_mad(n_mul(coulomb, n_sat(v, cfg->sign_speed)), viscous, v), mass, a);
    const num current = n_div(force, cfg->force_constant);                                               /* (28) */
    const num voltage = n_mad(n_mul(current, cfg->impedance), cfg->back_emf, v);                         /* (29) */
    const num power = n_mul(n_mul(NUM(1.7320508075688772), cfg->power_factor), n_mul(voltage, current)); /* (26) */

    state->fraction_mJ = n_mad(state->fraction_mJ, power, cfg->dt_ms); /* (27) */
    const int32_t carried_mJ = n_to_scaled(state->fraction_mJ, 1);
    state->fraction_mJ = n_state(n_sub(state->fraction_mJ, n_ratio(carried_mJ, 1)));
    const int64_t mJ = (int64_t)state->mJ + carried_mJ;
    state->mJ = mJ > INT32_MAX ? INT32_MAX : (int32_t)mJ; /* after 6 h at 100 W */
    return power;
}
