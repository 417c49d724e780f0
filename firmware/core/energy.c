/* SPDX-License-Identifier: Apache-2.0 */
#include "core/energy.h"

void energy_reset(struct energy_state *state)
{
    state->part_mJ = NUM(0);
    state->mJ = 0;
}

num energy_step(const struct energy_cfg *cfg, struct energy_state *state, num mass, num viscous, num coulomb, num v,
                num a)
{
    const num force = n_mad(n_mad(n_mul(coulomb, n_sat(v, cfg->sign_speed)), viscous, v), mass, a);
    const num current = n_div(force, cfg->force_constant);                                               /* (28) */
    const num voltage = n_mad(n_mul(current, cfg->impedance), cfg->back_emf, v);                         /* (29) */
    const num power = n_mul(n_mul(NUM(1.7320508075688772), cfg->power_factor), n_mul(voltage, current)); /* (26) */

    state->part_mJ = n_mad(state->part_mJ, power, cfg->dt_ms); /* (27) */
    const int32_t whole = n_to_scaled(state->part_mJ, 1);
    state->part_mJ = n_state(n_sub(state->part_mJ, n_ratio(whole, 1)));
    state->mJ = (int32_t)((uint32_t)state->mJ + (uint32_t)whole); /* wraps: 6 h at 100 W */
    return power;
}
