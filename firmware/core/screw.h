/* SPDX-License-Identifier: Apache-2.0 */
/* screw.h: forces that repeat with the angle a of an axis's screw, and their cancellation. The motor gives
 *
 *   F = u (1 + ripple(a)) + cogging(a)
 *
 * for a force demand u. Both are sums of three harmonics, c_n cos(o_n a) + s_n sin(o_n a). So that the law's demand
 * acts on the axis, u = (demand - cogging(a)) / (1 + ripple(a)).
 *
 * The angle is 0 at position 0 of the encoder.
 *
 * Context: servo_step() (servo.c) calls it in the servo tick. The background loop calls screw_turns() when parameters
 * change (drive/configuration.c).
 */
#ifndef KONTUR_SCREW_H
#define KONTUR_SCREW_H
#include "core/vec2.h"

#define SCREW_HARMONICS 3

struct screw_harmonic {
    uint32_t order;               /* o_n, periods a turn */
    num cogging_cos, cogging_sin; /* N */
    num ripple_cos, ripple_sin;   /* within +-0.1 */
};

struct screw_axis_cfg {
    uint64_t turns; /* screw_turns(); 0: off */
    struct screw_harmonic harmonic[SCREW_HARMONICS];
};

struct screw_cfg {
    bool on; /* for one of the axes at least */
    struct screw_axis_cfg axis[2];
};

/* The factor of pos_phase() for a lead of lead_nm > 0. */
uint64_t screw_turns(uint32_t lead_nm);
/* The demand u of an axis that gives `demand` (N) at encoder position `at`. */
num screw_cancel(const struct screw_axis_cfg *cfg, pos_t at, num demand);
#endif
