/* SPDX-License-Identifier: Apache-2.0 */
/* servo.h: one control period, composed. Pure: servo_step() reads cfg and in, changes state, fills out.
 *
 * Order: observer -> spline and contour -> law (-> uncertainty) -> limits. Reading encoders before and writing forces
 * after is loop_tick()'s (drive/loop.h).
 *
 * The force returned acts from the next encoder reading to the one after (one control period of delay); observer and
 * reference model are fed accordingly. The observer gets the force less what balances friction: that accelerates
 * nothing, and an observer that thinks it does is wrong by mm/s for some ms at each reversal.
 *
 * Switching the controller at run time: the difference between the last force and the new law's first one is kept as
 * an offset that decays with cfg.blend, so that the force does not jump. The reference model sees the offset too.
 */
#ifndef KONTUR_SERVO_H
#define KONTUR_SERVO_H
#include "cascade.h"
#include "energy.h"
#include "learning.h"
#include "observer.h"
#include "uncertainty.h"

enum controller {
    CONTROLLER_TRACK,   /* sliding mode law on each axis */
    CONTROLLER_CC,      /* contouring law */
    CONTROLLER_CCU,     /* contouring law and uncertainty compensator */
    CONTROLLER_CASCADE, /* P-PI with feedforward */
    CONTROLLER_CCC,     /* the same, cross-coupled */
    CONTROLLERS
};

#define SERVO_TURNS 4 /* periods in which energy and learning of both axes have had theirs: they are slow */

struct servo_cfg {
    num dt;    /* control period, T0 */
    num blend; /* factor per period on the switching offset, 0..1 */
    struct plant_cfg plant;
    struct observer_cfg observer;
    struct contour_cfg contour;
    struct asmc_cfg asmc;
    struct uncertainty_cfg uncertainty;
    struct learning_cfg learning;
    struct cascade_cfg cascade;
    struct energy_cfg energy[2];
};

struct servo_in {
    pos_t measured[2]; /* encoder positions */
    bool enabled[2];   /* per axis; false: observed only, force 0 */
    enum controller controller;
    struct path_state path;
    const struct spline_ring *ring;
};

/* What a period asked for, N. */
struct servo_history {
    vec2 force;
    vec2 balance;  /* its part that balances friction, and mass beyond the nominal: it accelerates nothing that is known */
    vec2 model;    /* its part that the reference model sees */
};

struct servo_state {
    struct observer_state observer[2];
    struct asmc_state asmc;
    struct uncertainty_state uncertainty;
    struct learning_state learning; /* kept when the controller changes or the power goes */
    struct cascade_state cascade;
    struct energy_state energy[2];
    bool enabled[2];
    enum controller controller;
    vec2 offset;
    bool saturated; /* in the last period */
    int turn;       /* in this period: energy of axis 0, 1, learning of axis 0, 1; each with the worth of all turns */
    struct servo_history last[2]; /* of the last period, and of the one before: that one's force has just acted */
    struct spline_kept kept;      /* emptied by who gives another sequence of knots (in.ring) */
};

struct servo_out {
    vec2 force;    /* N, within plant.force_max */
    bool saturated;
    vec2 velocity; /* um/T0 */
    struct contour_out contour;
    struct asmc_out asmc;              /* track, cc, ccu */
    struct uncertainty_out uncertainty; /* ccu */
};

/* At rest at the measured positions. */
void servo_reset(const struct servo_cfg *cfg, struct servo_state *state, const pos_t measured[2]);
void servo_step(const struct servo_cfg *cfg, struct servo_state *state, const struct servo_in *in,
                struct servo_out *out);
#endif
