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
 * was written `delay` periods before, as in the simulator sim/plant.h.
 *
 * It may have what a real axis has, as far as object 210Eh says so:
 * - L is more at rest (breakaway, Stribeck curve), or builds up over the presliding distance: core/friction.h.
 * - Motor and table are two masses with a spring, a damper and a gap (backlash) between them. The spring is taken in the
 *   middle of the period, x + h v / 2, so that the step adds no damping and takes none away. The mode comes out higher by
 *   (omega h)^2 / 24: 0.01 % at 90 Hz, 1.6 % at 1 kHz.
 * - F lags behind, of first order: the mean of each period is exact.
 * - End stops, limit switches, index pulses, and an encoder at the motor or at the table.
 * sim/plant.h has what is left out: a second encoder, what goes by the angle of a screw, errors of screw and geometry, and
 * limits of the amplifier.
 *
 * All is `num` and integers, without exp(): equal seeds give the same bits on every machine. Noise is uniform, by the
 * generator of Numerical Recipes (x' = 1664525 x + 1013904223), and drawn while an axis has power.
 */
#ifndef KONTUR_ONCHIP_PLANT_H
#define KONTUR_ONCHIP_PLANT_H
#include "core/friction.h"
#include "hal/hal.h"

enum { ONCHIP_TABLE, ONCHIP_MOTOR, ONCHIP_MASSES };
enum { ONCHIP_DELAY_MAX = 4 };

struct onchip_mass_cfg {
    num mass, viscous, coulomb; /* N per um/T0^2, N per um/T0, N */
    num gain, share;            /* phi_1 h (T0), phi_2 / phi_1: filled by onchip_plant_design() */
};

struct onchip_axis_cfg {
    struct onchip_mass_cfg part[ONCHIP_MASSES]; /* without a spring all of the axis is the table */
    num stiffness, damping;                     /* between the masses: N/um, N per um/T0; stiffness 0: no spring */
    num gap;                                    /* half of the backlash, um; with a spring only */
    struct friction_cfg friction;               /* axis[0]: of the table, axis[1]: of the motor; on */
    num lag;                                    /* time constant of the force, T0: 0, or h at least */
    num counts;                                 /* encoder counts per um */
    num noise;                                  /* standard deviation of the force, N */
    int32_t start;                              /* encoder count after onchip_plant_reset() */
    int32_t travel[2];                          /* end stops, counts; INT32_MIN, INT32_MAX: there are none */
    int32_t switches[2];                        /* at and beyond these counts the limit switches are active */
    int32_t index;                              /* counts from an index pulse to the next one; 0: there are none */
    uint8_t delay;                              /* periods from writing a force until it acts, 1..ONCHIP_DELAY_MAX */
    bool encoder_at_motor;                      /* with a spring only */
    num lag_mean, lag_end; /* what is left of a step of the force: filled by onchip_plant_design() */
};

struct onchip_plant_cfg {
    bool simulated; /* this plant takes the place of the one at the connector */
    num dt;         /* control period, T0 */
    uint32_t seed;  /* of the noise */
    struct onchip_axis_cfg axis[AXES];
};

struct onchip_plant {
    struct onchip_axis {
        struct onchip_mass {
            int64_t pos; /* 2^-32 encoder counts */
            num vel;     /* um/T0 */
        } part[ONCHIP_MASSES];
        struct friction_state friction;
        num demand[ONCHIP_DELAY_MAX]; /* N, [0]: written in the last period */
        num force;                    /* N, behind the lag */
        uint8_t index_pulses;         /* so far, modulo 256 */
        int32_t index_count;          /* count at the last one */
    } axis[AXES];
    uint32_t random;
};

/* Fill in what does not change from period to period. C h <= M of each mass. */
void onchip_plant_design(struct onchip_plant_cfg *cfg);
/* Reset the plant to standstill at `start`. */
void onchip_plant_reset(const struct onchip_plant_cfg *cfg, struct onchip_plant *m);
/* Its encoders and limit switches. */
void onchip_plant_read(const struct onchip_plant_cfg *cfg, const struct onchip_plant *m, struct hal_drive_in *in);
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
