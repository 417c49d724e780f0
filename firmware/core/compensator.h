/* SPDX-License-Identifier: Apache-2.0 */
/* compensator.h: sliding mode uncertainty compensator, eqs (2), (17)-(25).
 *
 * A linear reference model (2) runs beside the plant with the same contouring input. The compensator drives the
 * difference between plant and model, z = q - q_bar, to zero.
 *
 * Context: servo_step() (servo.c) calls it in the servo tick under the controller `ccu`.
 *
 * Differences from the source
 * - The input of (2) is the linear part of u_bar. With the Coulomb term in it, z would contain all friction, and the
 *   compensator would cancel it a second time. `input_printed` selects the printed form.
 * - The model gets the input with the delay that the plant has (one control period).
 * - (24) has sat(s / phi) in place of sign(s); phi -> 0 gives the paper's law.
 * - v is an acceleration in the frame at the foot point, so the force is M R v.
 * - (25) mu starts at mu_0, grows only while |s| > dead_zone, and is clamped. `law_printed` selects the printed form:
 *   mu starts at 0 and grows by rho |s|.
 * - z_n' = R^T (z' + theta' I_e z) turns with the frame, and (24) lacks what would take the turning back: on a curve
 *   it may grow (docs/adr/0085). `turning` = 0 takes z_n' = R^T z', whose loop does not depend on theta'.
 * - |z| is limited to phi/alpha, because beyond it sat() saturates and z would only wind up.
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
#ifndef KONTUR_COMPENSATOR_H
#define KONTUR_COMPENSATOR_H
#include "core/smc.h"

struct compensator_cfg {
    num alpha;
    num mu_0, mu_max;
    num rho;       /* 1/T0^2, times ACC_GAIN */
    num phi;       /* > 0 */
    num dead_zone; /* um/T0 */
    num turning;   /* 1, or 0: share of theta' in the rate of z_n */
    bool law_printed;
    bool input_printed;
};

struct compensator_state {
    pos_t q_bar[2];
    vec2 q_bar_dot;
    acc_t mu[2]; /* um/T0^2 */
};

struct compensator_out {
    vec2 z_n, s, v;
    vec2 mu; /* used in this period */
    vec2 u;  /* M R v, N */
};

/* Start the model at the plant's position and velocity. */
void compensator_reset(const struct compensator_cfg *cfg, struct compensator_state *state, const pos_t q[2],
                       vec2 q_dot);
/* The force of one control period, (17)-(24), at position q and velocity q_dot in the frame t, theta_dot. */
void compensator_step(const struct compensator_cfg *cfg, const struct plant_cfg *plant, struct compensator_state *state,
                      const pos_t q[2], vec2 q_dot, vec2 t, num theta_dot, struct compensator_out *out);
/* Adapt the gain by (25) over dt (T0), for one axis of the frame: 0 is along the path, 1 is along its normal. */
void compensator_adapt(const struct compensator_cfg *cfg, struct compensator_state *state, int axis, vec2 s, num dt);
/* Advance the model (2) by one control period dt (T0), in which the force u_bar acted. */
void compensator_model(const struct plant_cfg *plant, struct compensator_state *state, vec2 u_bar, num dt);
#endif
