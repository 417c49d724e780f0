/* SPDX-License-Identifier: Apache-2.0 */
/* oscillation.h: the watch for oscillation of an axis. Not in the paper.
 *
 * What it looks at is the force after the limits, less what the path needs and what cancels friction:
 *   x = u - M r'' - C r'
 * Steps of a reference and of its friction are not in x, and what is left of them does not swing to both sides for long.
 * x goes through a first-order high-pass filter with the corner frequency f_c:
 *   h = x - l,   l' = 2 pi f_c h
 *
 * A half wave is a time in which |h| exceeds the limit with one sign; the next one begins where it does with the other
 * sign, by half of the peak or more. It is an oscillation when
 *   - half waves have followed each other for at least cfg.lasts periods, each within 1/f_c of the one before,
 *   - no amplitude, the mean of the peaks of two half waves, was below 70 % of the largest one,
 *   - each of the last OSCILLATION_STEADY half waves had a peak of no less than 90 % of the one a period before, and
 *     lasted as long, within a fifth of the period, and
 *   - a free mass would swing by a count of the encoder or more under this force: amplitude >= m (2 pi / T)^2 count. An
 *     amplitude beyond half of the force limit counts at any period T.
 * What decays is the answer to a step. What changes its period is the answer to a path, where the mass that the drive
 * believes is off, and so is the force that the path needs. What moves less than a count is a drive at rest that hunts
 * for its count. A disturbance of half a wave or less, noise below the limit, and the reversals of a path are none of
 * this.
 *
 * Symbols
 *   x, h, l   force, N/4 (the quarter keeps x and h within the range of fixed point)
 *   f_c, T    corner frequency, Hz; period, s
 *   m, count  mass; length of a count of the encoder
 *
 * Context: servo_step() (servo.c) calls oscillation_step() once in a control period, in the servo tick.
 */
#ifndef KONTUR_OSCILLATION_H
#define KONTUR_OSCILLATION_H
#include "core/smc.h"

#define OSCILLATION_STEADY 4u
#define OSCILLATION_GAIN_MIN 0.05 /* the factor on the gains is not lowered to less */

struct oscillation_axis {
    num limit;     /* amplitude, N/4 */
    num count;     /* m (pi f_c)^2 count: amplitude that moves a mass by a count at the longest period, N/4 */
    num force_max; /* amplitude that counts at any period, N/4 */
};

struct oscillation_cfg {
    bool on;
    bool lower;    /* an oscillation lowers the gains */
    num gain_step; /* by this factor, 0..1 */
    num slow;      /* share of h that l follows in a control period, 0..1 */
    struct oscillation_axis axis[2];
    vec2 mass, viscous;  /* of the plant, a quarter of each */
    uint16_t half_wave;  /* longest half wave, control periods */
    uint16_t lasts;      /* control periods */
    uint32_t control_hz; /* control periods a second */
};

/* Of an axis. */
struct oscillation_state {
    num slow;             /* l, N/4 */
    num peak;             /* of the half wave that goes on, N/4 */
    num before[2];        /* the same of the two before, the latest first */
    num largest;          /* amplitude so far, N/4 */
    uint16_t age;         /* of the half wave that goes on, control periods */
    uint16_t lasted[2];   /* the two before, the latest first, control periods */
    uint16_t ticks;       /* from the first half wave to the one that goes on, control periods */
    uint16_t half_waves;  /* so far; 0: none */
    uint16_t steady;      /* half waves in a row that were like the one a period before */
    bool positive;        /* sign of the half wave that goes on */
    int32_t count;        /* oscillations seen; counts on while one lasts */
    num frequency, force; /* of the latest one: Hz, and the amplitude in N */
};

/* One control period of both axes with the force `net` (N), which is without the part that cancels friction. An axis that
 * is not enabled begins anew. Returns whether an oscillation was seen. */
bool oscillation_step(const struct oscillation_cfg *cfg, struct oscillation_state state[2], const bool enabled[2],
                      vec2 net, vec2 r_dot, vec2 r_ddot);
#endif
