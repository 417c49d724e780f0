/* SPDX-License-Identifier: Apache-2.0 */
/* servo.h: one control period of the control law. servo_step()
 * is pure: it reads cfg and in, changes state and fills out.
 *
 * Order of a step: position of the tool, observer, spline and contour error, law (under ccu with its compensator),
 * friction, cogging and ripple, force filters, limits, watch for oscillation.
 * servo_loop_tick() (drive/servo_loop.h) reads the encoders before it and writes the forces after it.
 *
 * Context: servo_loop_tick() calls it once in a control period, in the servo tick. Tests call it in a host process.
 *
 * The force returned acts from the next encoder reading to the one after it, that is with one control period of
 * delay. Observer and reference model are fed with this delay. The observer gets the force without the part that
 * cancels friction, cogging and ripple: that part accelerates nothing, and an observer that takes it for acceleration
 * is wrong by mm/s for some ms at each reversal.
 *
 * Force filters and limits change the force after the law. Observer and reference model get what they let through.
 *
 * Change of the controller in operation: the difference between the last force and the new law's first force becomes
 * an offset that decays with cfg.blend, so that the force does not jump. The reference model gets the offset, too. The
 * same happens where the watch for oscillation lowers the gains, and where the force of an axis becomes the law's again.
 *
 * An axis whose force is given from outside has no errors: it is where it is to be. Limits and watch are as for the law's.
 */
#ifndef KONTUR_SERVO_H
#define KONTUR_SERVO_H
#include "core/cascade.h"
#include "core/compensator.h"
#include "core/controllers.h"
#include "core/dual_feedback.h"
#include "core/energy.h"
#include "core/feedforward.h"
#include "core/force_filter.h"
#include "core/force_limit.h"
#include "core/friction.h"
#include "core/geometry.h"
#include "core/observer.h"
#include "core/oscillation.h"
#include "core/screw.h"

/* Slow computations take turns over this many control periods: slots 0 and 1
 * compute energy and adaptation of axis 0 and axis 1, slots 2 and 3 the adaptive
 * feedforward of axis 0 and axis 1. Each uses the time of all slots as its step. */
#define SERVO_SLOTS 4u
#define SERVO_OFFSET_MIN 2.5e-4 /* N: an offset below it is set to 0 */

/* The laws. Their gains may be lowered by a factor: then each law keeps its shape, and its poles move towards zero. */
struct servo_gains {
    struct smc_cfg smc;
    struct compensator_cfg compensator;
    struct cascade_cfg cascade;
};

/* A force acts later than the models have it. What the reference asks for, M r'' + C r', is therefore demanded as of then:
 * with its rate times the delay besides, and friction likewise. What the loop adds stays as late as the force is. */
struct servo_delay_cfg {
    bool on;
    num time[2]; /* T0 */
};

struct servo_cfg {
    num dt;    /* control period, T0 */
    num blend; /* factor per period on the switching offset, 0..1 */
    struct plant_cfg plant;
    struct observer_cfg observer;
    struct contour_cfg contour;
    struct servo_gains gains;
    struct feedforward_cfg feedforward;
    struct energy_cfg energy[2];
    struct force_filter_cfg force_filter;
    struct force_limit_cfg force_limit;
    struct friction_cfg friction;
    struct screw_cfg screw;
    struct oscillation_cfg oscillation;
    struct servo_delay_cfg delay;
    struct dual_feedback_cfg dual_feedback[2]; /* only with geometry.on */
    struct geometry_cfg geometry;              /* last, since it is the largest */
};

/* Only with geometry.on. In memory of its own, so that the tick keeps the rest of its inputs in registers. */
struct servo_table_in {
    int32_t origin_nm[2]; /* user's positions less the servo's */
    pos_t second[2];      /* positions of second encoders, where dual_feedback is on */
};

struct servo_in {
    pos_t measured[2]; /* encoder positions */
    bool enabled[2];   /* of each axis; false: the axis is observed only, and its force is 0 */
    enum controller controller;
    uint32_t
        forced; /* bit 0, 1: the force of axis 0, 1 is `force` and not the law's; then the controller couples no axes */
    vec2 force; /* N; counts where `forced` has the bit */
    struct path_state path;
    const struct spline_ring *ring;
    const struct servo_table_in *table;
};

/* Force demand of a control period, N, as the models see it. */
struct servo_demand {
    vec2 net;   /* the part that accelerates the nominal plant: without friction and mass beyond the nominal */
    vec2 model; /* input of the reference model */
};

struct servo_state {
    struct observer_state observer[2];
    struct smc_state smc;
    struct compensator_state compensator;
    struct feedforward_state feedforward; /* persists when the controller changes or an axis is disabled */
    struct cascade_state cascade;
    struct energy_state energy[2];
    bool enabled[2];
    bool extras; /* one at least of force_limit, geometry, screw, force_filter, delay and friction is on */
    enum controller controller;
    uint32_t forced;    /* servo_in.forced of the last period */
    bool saturated;     /* in the last period */
    bool disagree;      /* two encoders of an axis are further apart than their tolerance */
    bool blending;      /* the offset is not 0 */
    bool gains_lowered; /* by the watch for oscillation */
    bool gains_changed; /* in the last period */
    num gain;           /* factor on the gains that is in effect; 1: those of the configuration */
    vec2 offset;
    uint32_t slot;                 /* of this period, 0..SERVO_SLOTS - 1 */
    vec2 force;                    /* of the last period, N */
    struct servo_demand demand[2]; /* of even and odd periods: the one before the last has just been applied */
    struct servo_gains gains;      /* in effect where gains_lowered */
    struct oscillation_state oscillation[2];
    struct friction_state friction; /* of an axis: persists while it is enabled */
    vec2 filtering;                 /* what the force filters have added to the force of the last period, N */
    vec2 screw;                     /* what cancels cogging and ripple in the next period, N */
    vec2 lead;     /* what the reference asks for besides in the next period, as its force is late, N */
    pos_t tool[2]; /* with geometry.on, its position in this period */
    struct force_limit_state force_limit;
    struct dual_feedback_state dual_feedback[2];
    struct geometry_state geometry;
    struct force_filter_state force_filter;
    /* The tool less the encoders, um: what goes by the user's position and no second encoder sees, and all else */
    vec2 correction, placed;
    /* The caller empties it when in.ring gets another sequence of knots. Last, since it is large, and a float is loaded in
     * one instruction from the first 1020 bytes only. */
    struct spline_cache spline_cache;
};

struct servo_out {
    vec2 force; /* N, within plant.force_max and the continuous limit */
    bool saturated;
    vec2 velocity; /* um/T0 */
    struct contour_out contour;
    struct smc_out smc;                 /* track, cc, ccu */
    struct compensator_out compensator; /* ccu */
};

/* Start at rest at the measured positions: of the encoders, to which the first step adds the geometry. */
void servo_reset(const struct servo_cfg *cfg, struct servo_state *state, const pos_t measured[2]);
/* Forget what the watch for oscillation has seen. The gains are those of the configuration again. */
void servo_reset_oscillation(const struct servo_cfg *cfg, struct servo_state *state);
/* One control period. */
void servo_step(const struct servo_cfg *cfg, struct servo_state *state, const struct servo_in *in,
                struct servo_out *out);
#endif
