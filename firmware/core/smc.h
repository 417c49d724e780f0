/* SPDX-License-Identifier: Apache-2.0 */
/* smc.h: adaptive nonlinear sliding mode contouring law, eqs (10)-(16).
 *
 * Context: servo_step() (servo.c) calls it in the servo tick.
 *
 * Differences from the source
 * - (11) psi = beta / cosh(k_bar e), which shrinks far from the contour, as the paper's text demands. `psi_printed`
 *   selects the printed beta cosh(k_bar e).
 * - (15) B = diag(psi' gamma), theta'^2 and 2 theta' have the dots that (9) demands; a_n (contour.h) contains the
 *   last two.
 * - (15) L sign(q') uses the reference velocity with a boundary layer, because a measured sign chatters at
 *   standstill. It is a separate output, because the reference model (2) must not see it.
 * - (15) B has `stiffness` besides, so that the error can decay with a pair of complex poles; 0 is the paper's law.
 *
 * | symbol        | meaning                                   | unit          |
 * |---------------|-------------------------------------------|---------------|
 * | s_bar         | sliding variable (10)                     | um/T0         |
 * | lambda, gamma | linear terms of the surface               | 1/T0          |
 * | psi           | nonlinear function (11)                   | -             |
 * | k_hat         | adaptive gain (16)                        | 1/T0          |
 * | u_bar         | control force without friction term (15)  | N             |
 */
#ifndef KONTUR_SMC_H
#define KONTUR_SMC_H
#include "core/contour.h"

/* Nominal plant (1) in core units. */
struct plant_cfg {
    vec2 mass;      /* N per um/T0^2 */
    vec2 viscous;   /* N per um/T0 */
    vec2 coulomb;   /* N */
    vec2 force_max; /* N */
};

struct smc_cfg {
    num lambda, gamma, beta;
    num stiffness; /* 1/T0^2, >= 0 */
    num k_bar;     /* 1/um; k_bar e_max <= TRIG_COSH_MAX */
    num e_max;     /* um */
    bool psi_printed;
    num k_0, k_max;     /* start and upper clamp of k_hat, 1/T0 */
    num zeta;           /* floor of k_hat, 1/T0 */
    num zeta_rate;      /* rate of k_hat at or below the floor, 1/T0^2, times ACC_GAIN; in (16) it is zeta, too */
    num xi;             /* adaptation rate, 1/(um T0), times ACC_GAIN */
    num epsilon;        /* um/T0 */
    num friction_speed; /* boundary layer of the reference velocity's sign, um/T0 */
};

struct smc_state {
    acc_t k_hat[2]; /* 1/T0 */
};

/* Errors and a_n of contour.h, in the frame of tangent t. The controller `track` uses the axis frame, which does
 * not turn, e_w in place of e_n, and a_n = r''. */
struct smc_in {
    vec2 t;
    vec2 e, e_dot;
    vec2 a_n;
    vec2 q_dot;     /* in the axis frame */
    vec2 direction; /* smc_direction() of the programmed velocity, for the friction term */
};

struct smc_out {
    vec2 s_bar;
    vec2 k_hat;      /* used in this period */
    vec2 u_linear;   /* (15) without L sign(.) */
    vec2 u_friction; /* L sign(.) */
};

/* Set both gains to k_0. */
void smc_reset(const struct smc_cfg *cfg, struct smc_state *state);
/* The force of one control period: (10), (11), (15). */
void smc_step(const struct smc_cfg *cfg, const struct plant_cfg *plant, const struct smc_state *state,
              const struct smc_in *in, struct smc_out *out);
/* Adapt the gain by (16) over dt (T0), for one axis of the frame: 0 is along the path, 1 is along its normal. */
void smc_adapt(const struct smc_cfg *cfg, struct smc_state *state, int axis, vec2 s_bar, num dt);
/* sign(r_dot) with a boundary layer: sat(r_dot / friction_speed). Every controller uses it for Coulomb friction. */
vec2 smc_direction(num friction_speed, vec2 r_dot);
#endif
