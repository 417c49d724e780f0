/* SPDX-License-Identifier: Apache-2.0 */
/* plant.h: the simulated machine, two axes in double precision. Each axis is eq (1) with true stiction,
 *
 *   m x'' = f - c x' - friction + noise
 *
 * and has what real axes have besides, as far as struct ks_machine (kontur_sim.h) says so:
 * - f: the force demand of `delay_periods` ago, limited by the amplifier, through a first-order lag. The amplifier may
 *   have a resolution and a continuous limit; the motor may have ripple (a share of the force) and cogging, by angle.
 * - friction: Coulomb friction times the schedule of eq (32), with a breakaway level and Stribeck decay. An axis at
 *   rest stays at rest while the force on it is below breakaway (Karnopp). With `presliding_m` it is that of Maxwell
 *   slip elements instead (Rizos and Fassois 2004): it builds up over this distance after each reversal.
 * - Two masses with a spring and a damper between motor and table, and a gap (backlash) in front of the spring. The
 *   spring pushes at the end of the gap, and pulls at the other one. It does not stick.
 * - noise: Gaussian, one value for each axis and control period, a function of the seed alone.
 * - End stops hold the table at the ends of travel. Limit switches lie before them. Index pulses come at equal
 *   distances of the encoder.
 * - Errors of the screw, which lie between motor and table, and of geometry, which no sensor sees. An axis with a scale
 *   has been homed: its table is counted from where, at the start, the scale says what the first encoder says.
 * It is integrated with `substeps` steps in a control period: semi-implicit, second order in position, with spring and
 * slip elements taken in the middle of the step, so that the step adds no damping and takes none away.
 *
 * The lines between CDEF-BEGIN and CDEF-END are plain C declarations that cffi reads as they are, for tests.
 *
 * Context: a host process. libkontur.c calls it once in a control period, and tests call it directly.
 */
#ifndef KONTUR_PLANT_H
#define KONTUR_PLANT_H
#include "sim/kontur_sim.h"

/* CDEF-BEGIN */
enum {
    PLANT_DELAY_MAX = 4,
    PLANT_BRISTLES = 10,    /* Maxwell slip elements of a mass */
    PLANT_SUBSTEPS_MIN = 20 /* of an axis with a spring or with slip elements */
};

struct plant {
    struct ks_machine machine;
    double period_s;
    uint64_t rng[4];
    double next_gaussian; /* the second value of the last pair, if it is not used yet */
    int has_next_gaussian;
    double pos_m[2], vel_mps[2];             /* table, which is the whole axis where there is no spring */
    double motor_pos_m[2], motor_vel_mps[2]; /* motor, in travel of the table; followed where it is not the table */
    double home_m[2];                        /* error of the screw at the start, where a scale takes it off */
    double accel_mps2[2];                    /* table, in the last control period */
    double bristle[2][2][PLANT_BRISTLES];    /* [axis][PLANT_TABLE or PLANT_MOTOR], of full force, -1..1 */
    double demand_N[PLANT_DELAY_MAX + 1][2]; /* [0]: newest */
    double lagged_N[2];
    double heat_N2[2];       /* mean square of the force over thermal_s */
    double friction_N[2];    /* friction that acted in the last sub-step, but for the viscous one */
    int cutting;             /* the cutting force acts */
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
/* The encoder counts, which are the nearest to what the encoders see. */
void plant_encoders(const struct plant *p, int32_t count[2]);
/* The counts of the second encoders, which are at the table; 0 where there is none. */
void plant_scales(const struct plant *p, int32_t count[2]);
/* Where the tool really is. */
void plant_tool(const struct plant *p, double pos_m[2]);
/* Let one control period pass. force_N is the force demand from the encoder reading at its start. */
void plant_step(struct plant *p, const double force_N[2]);
/* Let one control period pass in which the axes go to pos_m, whatever the machine says. */
void plant_follow(struct plant *p, const double pos_m[2]);
/* CDEF-END */
#endif
