/* SPDX-License-Identifier: Apache-2.0 */
/* plant.h: the simulated machine, two axes of eq (1) with true stiction, in double precision.
 *
 *   m x'' = f - c x' - friction + noise
 * - friction: Coulomb friction times the schedule of eq (32), with a breakaway level and Stribeck decay if the
 *   machine has them. An axis at rest stays at rest while the force on it is below breakaway (Karnopp).
 * - f: the force demand of `delay_periods` ago, limited by the amplifier, through a first-order lag.
 * - noise: Gaussian, one value for each axis and control period, a function of the seed alone.
 * - End stops hold an axis at the ends of travel. Limit switches lie before them. Index pulses come at equal
 *   distances.
 * It is integrated with `substeps` steps in a control period (semi-implicit, second order in position).
 *
 * Context: a host process. libkontur.c calls it once in a control period, and tests call it directly.
 */
#ifndef KONTUR_PLANT_H
#define KONTUR_PLANT_H
#include "sim/kontur_sim.h"

enum { PLANT_DELAY_MAX = 4 };

struct plant {
    struct ks_machine machine;
    double period_s;
    uint64_t rng[4];
    double next_gaussian; /* the second value of the last pair, if it is not used yet */
    int has_next_gaussian;
    double pos_m[2], vel_mps[2];
    double demand_N[PLANT_DELAY_MAX + 1][2]; /* [0]: newest */
    double lagged_N[2];
    double friction_N[2];    /* friction that acted in the last sub-step */
    uint8_t index_pulses[2]; /* number so far, modulo 256 */
    int32_t index_count[2];  /* encoder count at the last index pulse */
    uint64_t period;         /* control periods so far */
    uint64_t schedule_start;
};

/* NULL when m is usable, else the name of the first field that is out of range. */
const char *plant_check(const struct ks_machine *m);
/* Start at rest at machine.start_m. m must have passed plant_check(). */
void plant_init(struct plant *p, const struct ks_machine *m, uint64_t seed, double period_s);
/* The limit switches, as enum hal_input. */
void plant_switches(const struct plant *p, uint8_t inputs[2]);
/* The encoder counts, which are the nearest to the true positions. */
void plant_encoders(const struct plant *p, int32_t count[2]);
/* Let one control period pass. force_N is the force demand from the encoder reading at its start. */
void plant_step(struct plant *p, const double force_N[2]);
#endif
