/* SPDX-License-Identifier: Apache-2.0 */
/* force_limit.c: the continuous limit of force_limit.h. Runs in the servo tick. */
#include "core/force_limit.h"

void force_limit_reset(struct force_limit_state *state, vec2 peak)
{
    state->heat[0] = state->heat[1] = acc_from(NUM(0));
    state->limit = peak;
}

static inline num limit(acc_t *heat, num share, num rate, num continuous, num peak)
{
    *heat = acc_state(acc_mad(*heat, n_sub(n_mul(share, share), acc_to(*heat)), rate));
    const num left = n_sub(NUM(1), acc_to(*heat));
    if (n_lt(NUM(1 - FORCE_HEAT_LIMITS), left)) {
        return peak;
    }
    const num part = n_mul(n_max(left, NUM(0)), NUM(1 / (1 - FORCE_HEAT_LIMITS)));
    return n_min(peak, n_mad(continuous, part, n_sub(peak, continuous)));
}

void force_limit_step(const struct force_limit_cfg *cfg, struct force_limit_state *state, int axis, vec2 force,
                      vec2 peak)
{
    if (axis == 0) {
        state->limit.x =
            limit(&state->heat[0], n_mul(force.x, cfg->inverse.x), cfg->rate[0], cfg->continuous.x, peak.x);
    } else {
        state->limit.y =
            limit(&state->heat[1], n_mul(force.y, cfg->inverse.y), cfg->rate[1], cfg->continuous.y, peak.y);
    }
}
