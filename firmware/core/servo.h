/* SPDX-License-Identifier: Apache-2.0 */
/* servo.h: one control period, composed. Pure: servo_step() reads cfg and in, changes state, fills out.
 *
 * Order: observer -> spline and contour -> law (-> uncertainty) -> limits. Reading encoders before and writing forces
 * after is servo_loop_tick()'s (drive/servo_loop.h).
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
#include "core/cascade.h"
#include "core/compensator.h"
#include "core/energy.h"
#include "core/feedforward.h"
#include "core/observer.h"

enum controller {
    CONTROLLER_TRACK,   /* sliding mode law on each axis */
    CONTROLLER_CC,      /* contouring law */
    CONTROLLER_CCU,     /* contouring law and uncertainty compensator */
    CONTROLLER_CASCADE, /* P-PI with feedforward */
    CONTROLLER_CCC,     /* the same, cross-coupled */
    CONTROLLERS
};

#define SERVO_TURNS 4u /* periods in which what is slow has had its turn on both axes: energy, adaptation, learning */
#define SERVO_BLENDED 2.5e-4 /* N: a switching offset below this is none */

struct servo_cfg {
    num dt;    /* control period, T0 */
    num blend; /* factor per period on the switching offset, 0..1 */
    struct plant_cfg plant;
    struct observer_cfg observer;
    struct contour_cfg contour;
    struct smc_cfg smc;
    struct compensator_cfg compensator;
    struct feedforward_cfg feedforward;
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

/* Parts of the force that a period asked for, N. */
struct servo_asked {
    vec2 moving; /* what observer and plant are moved by: without what balances friction, and mass beyond the nominal */
    vec2 model;  /* what the reference model sees */
};

struct servo_state {
    struct observer_state observer[2];
    struct smc_state smc;
    struct compensator_state compensator;
    struct feedforward_state feedforward; /* kept when the controller changes or the power goes */
    struct cascade_state cascade;
    struct energy_state energy[2];
    bool enabled[2];
    enum controller controller;
    bool saturated; /* in the last period */
    bool blending;  /* there is an offset */
    vec2 offset;
    uint32_t
        turn; /* in this period: energy and adaptation of axis 0, 1, learning of axis 0, 1; each for all turns' time */
    vec2 force;                  /* of the last period, N */
    struct servo_asked asked[2]; /* of even and odd periods: that of the one before the last has just acted */
    struct spline_kept kept;     /* emptied by who gives another sequence of knots (in.ring) */
};

struct servo_out {
    vec2 force; /* N, within plant.force_max */
    bool saturated;
    vec2 velocity; /* um/T0 */
    struct contour_out contour;
    struct smc_out smc;                 /* track, cc, ccu */
    struct compensator_out compensator; /* ccu */
};

/* At rest at the measured positions. */
void servo_reset(const struct servo_cfg *cfg, struct servo_state *state, const pos_t measured[2]);
void servo_step(const struct servo_cfg *cfg, struct servo_state *state, const struct servo_in *in,
                struct servo_out *out);
#endif
