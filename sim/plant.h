/* SPDX-License-Identifier: Apache-2.0 */
/* plant.h: the machine: two axes of eq (1) with true stiction, in double precision.
 *
 *   m x'' = f - c x' - friction + noise
 * - friction: Coulomb, times the schedule of eq (32), with a breakaway level and Stribeck decay if the machine
 *   has them. An axis at rest stays at rest while the force on it is below breakaway (Karnopp).
 * - f: the force asked for, `delay_periods` old, clipped to the amplifier's limit, through a first-order lag.
 * - noise: Gaussian, one draw an axis and control period, from the seed alone.
 * - end stops hold an axis at the ends of travel; limit switches lie before them; index pulses come at equal distances.
 * Integrated with `substeps` steps a control period (semi-implicit, second order in position).
 */
#ifndef KONTUR_PLANT_H
#define KONTUR_PLANT_H
#include "sim/kontur_sim.h"

enum { PLANT_DELAY_MAX = 4 };

struct plant {
    struct ks_machine machine;
    double period_s;
    uint64_t rng[4];
    double next_gaussian; /* second value of the last Gaussian pair */
    int has_next_gaussian;
    double pos_m[2], vel_mps[2];
    double demand_N[PLANT_DELAY_MAX + 1][2]; /* [0]: newest */
    double lagged_N[2];
    double friction_N[2];    /* that acted in the last sub-step */
    uint8_t index_pulses[2]; /* so far, modulo 256 */
    int32_t index_count[2];  /* encoder at the latest */
    uint64_t period;         /* control periods so far */
    uint64_t schedule_start;
};

/* NULL: usable; else the name of the first field of m that is not. */
const char *plant_check(const struct ks_machine *m);
/* At rest at machine.start_m; m must have passed plant_check(). */
void plant_init(struct plant *p, const struct ks_machine *m, uint64_t seed, double period_s);
/* Limit switches now, as enum hal_input. */
void plant_switches(const struct plant *p, uint8_t inputs[2]);
/* Encoder counts now: the nearest count to the true position. */
void plant_encoders(const struct plant *p, int32_t count[2]);
/* Let one control period pass; force_N: asked for on the encoder reading at its start. */
void plant_step(struct plant *p, const double force_N[2]);
#endif
