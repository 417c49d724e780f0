/* SPDX-License-Identifier: Apache-2.0 */
/* core/compensator.h: sliding mode uncertainty compensator, eqs (2), (17)-(25).
 *
 * A linear reference model (2) runs beside the plant under the same contouring input; what the plant does
 * otherwise, z = q - q_bar, is driven to zero.
 *
 * Differences from the source
 * - (2) is driven by the linear part of u_bar: with the Coulomb term in it, z would carry the whole friction and
 *   the compensator would cancel it a second time. `whole_input` selects the printed form.
 * - The model sees the input as late as the plant does (one control period).
 * - (24) sign(s) becomes sat(s / phi); phi -> 0 gives the paper's law.
 * - v is an acceleration in the frame at the foot point: the force is M R v.
 * - (25) mu starts at mu_0, grows only while |s| > dead_zone, and is clamped; `law_printed`: from 0, by rho |s| alone.
 * - |z| is held within phi/alpha: beyond it sat() is full and z would only wind up.
 *
 * | symbol | meaning                                   | unit      |
 * |--------|-------------------------------------------|-----------|
 * | q_bar  | position of the reference model           | pos_t     |
 * | z_n    | q - q_bar in the frame                    | um        |
 * | s      | sliding variable (21)                     | um/T0     |
 * | v      | compensation (24), in the frame           | um/T0^2   |
 * | mu     | adaptive gain (25)                        | um/T0^2   |
 * | alpha  | slope of the surface                      | 1/T0      |
 * | phi    | boundary layer                            | um/T0     |
 */
#ifndef KONTUR_UNCERTAINTY_H
#define KONTUR_UNCERTAINTY_H
#include "core/smc.h"

struct compensator_cfg {
    num alpha;
    num mu_0, mu_max;
    num rho;       /* 1/T0^2, times ACC_GAIN */
    num phi;       /* > 0 */
    num dead_zone; /* um/T0 */
    bool law_printed;
    bool whole_input;
};

struct compensator_state {
    pos_t q_bar[2];
    vec2 q_bar_dot;
    acc_t mu[2]; /* um/T0^2 */
};

struct compensator_out {
    vec2 z_n, s, v;
    vec2 mu; /* in use in this period */
    vec2 u;  /* M R v, N */
};

/* The model starts where the plant is. */
void compensator_reset(const struct compensator_cfg *cfg, struct compensator_state *state, const pos_t q[2],
                       vec2 q_dot);
/* (17)-(24) in the frame t, theta_dot at position q, velocity q_dot. */
void compensator_step(const struct compensator_cfg *cfg, const struct plant_cfg *plant, struct compensator_state *state,
                      const pos_t q[2], vec2 q_dot, vec2 t, num theta_dot, struct compensator_out *out);
/* (25) over dt (T0), for one axis of the frame: 0 along the path, 1 across. */
void compensator_adapt(const struct compensator_cfg *cfg, struct compensator_state *state, int axis, vec2 s, num dt);
/* (2) over one control period under the force u_bar that acted in it. */
void compensator_model(const struct plant_cfg *plant, struct compensator_state *state, vec2 u_bar, num dt);
#endif
