/* SPDX-License-Identifier: Apache-2.0 */
/* onchip/onchip_plant.h: a simulated machine for a drive with no motor attached: two axes of eq (1), cheap enough for the servo tick.
 *
 *   M v' = F - C v - L sign(v) + noise
 * solved exactly over a control period as long as the sign of v holds:
 *   v' = v + phi_1 h w,  x' = x + h (v + (phi_2 / phi_1) (v' - v)),  w = (F - C v - L sign(v)) / M,
 *   z = C h / M,  phi_1 = (1 - exp(-z)) / z,  phi_2 = (1 - phi_1) / z
 * Where v changes its sign within the period it is a straight line up to there; then the axis sticks if |F| <= L, as it does
 * at rest, or goes on from rest for what is left of the period. F is the force that was written a period before, as in the
 * simulator (sim/plant.h, which has what is left out here: breakaway force, a lag of the force, end stops).
 *
 * Everything is `num` and integers, without exp(): the same bits on every machine for the same seed. Noise is uniform,
 * by the generator of Numerical Recipes (x' = 1664525 x + 1013904223), drawn while an axis has power.
 * onchip_plant_reset() and onchip_plant_step() are the servo tick's; object 2103h describes the machine.
 */
#ifndef KONTUR_MACHINE_H
#define KONTUR_MACHINE_H
#include "core/vec2.h"
#include "hal/hal.h"

struct machine_axis_cfg {
    num mass, viscous, coulomb; /* N per um/T0^2, N per um/T0, N */
    num counts;                 /* encoder counts per um */
    num noise;                  /* standard deviation, N */
    int32_t start;              /* encoder count at rest after onchip_plant_reset() */
    num gain, share;            /* phi_1 h (T0), phi_2 / phi_1: filled by machine_design() */
};

struct onchip_plant_cfg {
    bool simulated; /* this machine in place of the one at the connector */
    num dt;         /* control period, T0 */
    uint32_t seed;
    struct machine_axis_cfg axis[AXES];
};

struct onchip_plant {
    struct machine_axis {
        int64_t pos; /* 2^-32 encoder counts */
        num vel;     /* um/T0 */
        num force;   /* N, as written: acts in the next period */
    } axis[AXES];
    uint32_t random;
};

/* Fill in what does not change from period to period; C h <= M. */
void machine_design(struct onchip_plant_cfg *cfg);
/* At rest at the start. */
void onchip_plant_reset(const struct onchip_plant_cfg *cfg, struct onchip_plant *m);
/* In place of the encoders; no input is active. */
void onchip_plant_read(const struct onchip_plant *m, struct hal_drive_in *in);
/* One control period; `out` acts in the next one. */
void onchip_plant_step(const struct onchip_plant_cfg *cfg, struct onchip_plant *m, const struct hal_drive_out *out);
#endif
