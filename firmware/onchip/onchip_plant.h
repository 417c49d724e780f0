/* SPDX-License-Identifier: Apache-2.0 */
/* onchip/onchip_plant.h: a simulated plant for a drive with no motor attached (object 2103h), and the HAL in front of it.
 *
 * Context: the servo tick calls the functions of `struct onchip_hal` in place of the port's drive_read() and
 * drive_write() while the plant is selected. Tests call onchip_plant_step() directly. onchip_plant_design() is the
 * background's, when parameters have changed.
 *
 * Two axes of eq (1), cheap enough for the servo tick:
 *   M v' = F - C v - L sign(v) + noise
 * solved exactly over a control period h as long as the sign of v holds:
 *   v' = v + phi_1 h w,  x' = x + h (v + (phi_2 / phi_1) (v' - v)),  w = (F - C v - L sign(v)) / M,
 *   z = C h / M,  phi_1 = (1 - exp(-z)) / z,  phi_2 = (1 - phi_1) / z
 * Where v changes its sign within the period, it is a straight line up to its zero. Then the axis sticks if |F| <= L, as
 * an axis at standstill does, or it accelerates from standstill for the remaining part of the period. F is the force that
 * was written one period before, as in the simulator sim/plant.h. That one has what this plant leaves out: breakaway
 * force, a lag of the force, end stops.
 *
 * All is `num` and integers, without exp(): equal seeds give the same bits on every machine. Noise is uniform, by the
 * generator of Numerical Recipes (x' = 1664525 x + 1013904223), and drawn while an axis has power.
 */
#ifndef KONTUR_ONCHIP_PLANT_H
#define KONTUR_ONCHIP_PLANT_H
#include "core/vec2.h"
#include "hal/hal.h"

struct onchip_axis_cfg {
    num mass, viscous, coulomb; /* N per um/T0^2, N per um/T0, N */
    num counts;                 /* encoder counts per um */
    num noise;                  /* standard deviation of the force, N */
    int32_t start;              /* encoder count after onchip_plant_reset() */
    num gain, share;            /* phi_1 h (T0), phi_2 / phi_1: filled by onchip_plant_design() */
};

struct onchip_plant_cfg {
    bool simulated; /* this plant takes the place of the one at the connector */
    num dt;         /* control period, T0 */
    uint32_t seed;  /* of the noise */
    struct onchip_axis_cfg axis[AXES];
};

struct onchip_plant {
    struct onchip_axis {
        int64_t pos; /* 2^-32 encoder counts */
        num vel;     /* um/T0 */
        num force;   /* N, written in the last period: acts in the next one */
    } axis[AXES];
    uint32_t random;
};

/* Fill in what does not change from period to period. C h <= M. */
void onchip_plant_design(struct onchip_plant_cfg *cfg);
/* Reset the plant to standstill at `start`. */
void onchip_plant_reset(const struct onchip_plant_cfg *cfg, struct onchip_plant *m);
/* The counts of its encoders. No input is active. */
void onchip_plant_read(const struct onchip_plant *m, struct hal_drive_in *in);
/* One control period; `out` acts in the next one. */
void onchip_plant_step(const struct onchip_plant_cfg *cfg, struct onchip_plant *m, const struct hal_drive_out *out);

/* The plant in front of a HAL: drive_read() gives its encoders, drive_write() its forces. The HAL behind it is read, too,
 * and keeps its power stages off. */
struct onchip_hal {
    struct hal hal; /* drive_read and drive_write only */
    const struct hal *behind;
    const struct onchip_plant_cfg *cfg;
    struct onchip_plant plant;
    bool selected;
};

/* Put the plant in front of `behind`; it is not selected. */
void onchip_hal_init(struct onchip_hal *o, const struct hal *behind);
/* A configuration takes effect; no axis has power. Returns the HAL to read and write from now on: o->hal if the plant is
 * to be simulated, else the one behind. A change from one to the other resets the plant. */
const struct hal *onchip_hal_select(struct onchip_hal *o, const struct onchip_plant_cfg *cfg);
#endif
