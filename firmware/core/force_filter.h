/* SPDX-License-Identifier: Apache-2.0 */
/* force_filter.h: second-order filters through which the force of each axis goes.
 *
 * A section is the continuous transfer function, with w_z, w_p and zeta_z, zeta_p of its zeros and poles,
 *
 *            (s / w_z)^2 + 2 zeta_z s / w_z + 1
 *     H(s) = ----------------------------------        without zeros (low-pass): 1 above
 *            (s / w_p)^2 + 2 zeta_p s / w_p + 1
 *
 * It becomes discrete by the trapezoidal rule, with w_z = tan(pi f_z / f_s), w_p = tan(pi f_p / f_s), so that zeros and
 * poles are exactly at their frequencies f_z and f_p. The gain for a constant force is exactly 1. A notch has
 * f_z = f_p and zeta_z < zeta_p, a lead f_z < f_p, a lag f_p < f_z.
 *
 * It is computed as a state variable filter. Its two states are integrators, which are in the range of the force, so
 * that it is precise in float32 and in fixed point at frequencies far below the control rate, too:
 *     v1 = a1 s1 + a2 (u - s2)      s1' = 2 v1 - s1      a1 = 1 / (1 + g (g + k))   a2 = g a1
 *     v2 = s2 + g v1                s2' = 2 v2 - s2      g = w_p     k = 2 zeta_p   r = w_p / w_z
 *     y  = v2 + c v1 + r^2 (u - v2)                      c = 2 zeta_z r - k r^2
 *
 * Source: V. Zavalishin, The Art of VA Filter Design, 2.1.0 (2018), chapters 3 and 4: trapezoidal integrators and the
 * state variable filter.
 *
 * Context: servo.c calls force_filter_step() in the servo tick. The background designs the filters.
 */
#ifndef KONTUR_FORCE_FILTER_H
#define KONTUR_FORCE_FILTER_H
#include "core/vec2.h"

#define FORCE_SECTIONS 4u
#define FORCE_SECTION_RATIO 10 /* w_p / w_z is at most this; its square is the gain at high frequencies */

/* What a section is to be. Frequencies in mHz, damping in 1/1000. */
struct force_section_spec {
    uint32_t zero_mHz; /* 0: no zeros, a low-pass filter */
    uint32_t zero_damping;
    uint32_t pole_mHz; /* 0: no section */
    uint32_t pole_damping;
};

struct force_section_cfg {
    num g, a1, a2, c, r2;
};

struct force_filter_cfg {
    bool on; /* an axis has a section */
    uint8_t count[2];
    struct force_section_cfg section[2][FORCE_SECTIONS]; /* of each axis, the first `count` */
};

struct force_section_state {
    num s1, s2; /* N */
};

struct force_filter_state {
    struct force_section_state section[2][FORCE_SECTIONS];
};

/* Design the sections of axis i for a control rate of rate_Hz. Returns false, and designs nothing of use, where a
 * frequency is below 1 Hz or above 0.49 rate_Hz, or w_p / w_z is above FORCE_SECTION_RATIO. */
bool force_filter_design(struct force_filter_cfg *cfg, int i, const struct force_section_spec spec[FORCE_SECTIONS],
                         uint32_t rate_Hz);
/* Start in the steady state for this force, N. */
void force_filter_reset(struct force_filter_state *state, vec2 force);
/* The filtered force, N. */
vec2 force_filter_step(const struct force_filter_cfg *cfg, struct force_filter_state *state, vec2 force);
#endif
