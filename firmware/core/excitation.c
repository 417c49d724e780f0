/* SPDX-License-Identifier: Apache-2.0 */
/* excitation.c: the excitation of excitation.h. Runs in the servo tick. */
#include "core/excitation.h"

void excitation_begin(const struct excitation_cfg *cfg, struct excitation_state *s)
{
    *s = (struct excitation_state){.ticks = 0};
    for (uint32_t k = 0; k < cfg->lines; k++) {
        const uint64_t turns = (uint64_t)cfg->periods[k] << 32;
        s->step[k] = (uint32_t)((turns + cfg->window / 2u) / cfg->window);
        s->phase[k] = (uint32_t)(((uint64_t)(k * (k + 1u)) << 31) / cfg->lines); /* pi k (k + 1) / lines */
    }
}

num excitation_step(const struct excitation_cfg *cfg, struct excitation_state *s)
{
    num sum = NUM(0);
    for (uint32_t k = 0; k < cfg->lines; k++) {
        s->at[k] = trig_circle(s->phase[k]);
        s->phase[k] += s->step[k];
        sum = n_add(sum, s->at[k].cos);
    }
    if (!s->settled) {
        s->settled = s->ticks >= cfg->settle;
        sum = s->settled ? sum : n_mul(sum, n_ratio((int64_t)s->ticks, (int64_t)cfg->settle));
        s->ticks = s->settled ? 0u : s->ticks + 1u;
    }
    return n_mul(cfg->amplitude, sum);
}

bool excitation_correlate(const struct excitation_cfg *cfg, struct excitation_state *s,
                          const num signal[EXCITATION_SIGNALS])
{
    if (!s->settled) {
        return false;
    }
    struct excitation_sums *sums = &s->sums[s->done % 2u];
    for (uint32_t k = 0; k < cfg->lines; k++) {
        const struct trig_circle at = s->at[k];
        for (int i = 0; i < EXCITATION_SIGNALS; i++) {
            sums->re[k][i] = acc_state(acc_mad(sums->re[k][i], signal[i], at.cos));
            sums->im[k][i] = acc_state(acc_mad(sums->im[k][i], signal[i], n_neg(at.sin)));
        }
    }
    s->ticks++;
    if (s->ticks == cfg->window) {
        s->ticks = 0;
        s->done++;
        s->sums[s->done % 2u] = (struct excitation_sums){.re[0][0] = acc_from(NUM(0))};
    }
    return s->done >= cfg->windows;
}

num excitation_result(const struct excitation_cfg *cfg, const struct excitation_state *s, uint32_t line,
                      enum excitation_signal signal, bool imaginary)
{
    if (s->done == 0 || line >= cfg->lines) {
        return NUM(0);
    }
    const struct excitation_sums *sums = &s->sums[(s->done - 1u) % 2u];
    const acc_t sum = imaginary ? sums->im[line][signal] : sums->re[line][signal];
    return n_mul(acc_to(sum), n_ratio((int64_t)2 * ACC_GAIN, (int64_t)cfg->window));
}
