/* SPDX-License-Identifier: Apache-2.0 */
/* screw.c: cogging and ripple by the angle of the screw, screw.h. Runs in the servo tick. */
#include "core/screw.h"

#include "core/trig.h"

uint64_t screw_turns(uint32_t lead_nm)
{
    const uint32_t half = lead_nm / 2u;
    return (((uint64_t)1 << 48) + half) / lead_nm; /* 2^64 / POS_PER_NM / lead_nm */
}

num screw_cancel(const struct screw_axis_cfg *cfg, pos_t at, num demand)
{
    if (cfg->turns == 0) {
        return demand;
    }
    const uint32_t phase = pos_phase(at, cfg->turns);
    num cogging = NUM(0);
    num gain = NUM(1);
    for (int n = 0; n < SCREW_HARMONICS; n++) {
        const struct screw_harmonic *h = &cfg->harmonic[n];
        const struct trig_circle c = trig_circle(h->order * phase);
        cogging = n_mad(n_mad(cogging, h->cogging_cos, c.cos), h->cogging_sin, c.sin);
        gain = n_mad(n_mad(gain, h->ripple_cos, c.cos), h->ripple_sin, c.sin);
    }
    return n_div(n_sub(demand, cogging), gain);
}
