/* SPDX-License-Identifier: Apache-2.0 */
/* force_limit.h: the limit of the force of each axis, by what motor and amplifier bear for long (I2t).
 *
 * The heat is the mean square of the force over a thermal time constant tau, as a share of the square of the continuous
 * force F_c:
 *     heat' = ((F / F_c)^2 - heat) / tau
 * The limit is the peak force F_p up to a heat of FORCE_HEAT_LIMITS. From there it falls linearly with the heat, to F_c
 * at a heat of 1:
 *     limit = F_c + (F_p - F_c) (1 - heat) / (1 - FORCE_HEAT_LIMITS)
 * So it is as continuous as the heat, and it ends where it is in balance: at F_c the heat stays at 1. A limit that
 * switches at a heat of 1 would do so at each period of the path.
 *
 * Context: servo.c calls force_limit_step() in the servo tick, where the axes take turns: the heat goes by milliseconds
 * at least, so a force of each turn stands for those between.
 */
#ifndef KONTUR_FORCE_LIMIT_H
#define KONTUR_FORCE_LIMIT_H
#include "core/vec2.h"

#define FORCE_HEAT_LIMITS 0.95
#define FORCE_LIMIT_RATIO 50 /* F_p / F_c is at most this */

struct force_limit_cfg {
    bool on;         /* an axis has a continuous limit */
    vec2 continuous; /* F_c, N; of an axis without such a limit F_p */
    vec2 inverse;    /* 1 / F_c, 1/N; of an axis without such a limit 0 */
    num rate[2];     /* time between two steps of an axis over tau, times ACC_GAIN */
};

struct force_limit_state {
    acc_t heat[2];
    vec2 limit; /* N */
};

/* heat[2] of 0, and the limit is the peak force. */
void force_limit_reset(struct force_limit_state *state, vec2 peak);
/* The new limit of axis 0 or 1, N: at most that of `peak`. `force` is that of the last period. */
void force_limit_step(const struct force_limit_cfg *cfg, struct force_limit_state *state, int axis, vec2 force,
                      vec2 peak);
#endif
