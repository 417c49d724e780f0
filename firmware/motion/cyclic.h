/* SPDX-License-Identifier: Apache-2.0 */
/* motion/cyclic.h: set-points that come with each SYNC, made into knots: cyclic synchronous position and velocity
 * of CiA 402-2. A velocity set-point adds to the position of the one before.
 *
 * Set-point i is where the axis is to be at SYNC i. Between two of them the way is a polynomial of degree 5, which takes
 * over position, velocity and acceleration of the one before: it is C2, and the knots give the law its tangent and
 * curvature. Position, velocity and acceleration at a set-point are those of the cubic through it and the three before. A
 * set-point that has not come is extrapolated from those before.
 *
 * The way is followed two cycles after the SYNCs, or 2.5 ms and a quarter more than one cycle where that is less. It runs in
 * the master's time (motion/sync_clock.h), which CYCLIC_TURN smoothes, so its speed differs from the nominal one by
 * 1 / SYNC_DRIFT at most. All axes follow it at the same time, so they are on the path that their set-points make.
 *
 * Positions are the user's, in nm; those within a cycle in 1/256 nm. Pure, background only; axis_modes.c uses it.
 */
#ifndef KONTUR_CYCLIC_H
#define KONTUR_CYCLIC_H
#include <stdbool.h>

#include "motion/sync_clock.h"

enum {
    CYCLIC_MS_MAX = 20,    /* 60C2h */
    CYCLIC_AHEAD = 3,      /* ms that knots are made ahead of path time: two that its spline needs, and one of slack */
    CYCLIC_PAST = 8,       /* set-points that are kept; a power of two */
    CYCLIC_TURN = 64,      /* ms: time constant of the smoothing */
    CYCLIC_MISSING = 3,    /* cycles without set-point, and */
    CYCLIC_MISSING_MS = 8, /* ms, that are bridged */
    CYCLIC_BLEND = 64,     /* ms in which the distance to the first set-point is made up for */
    CYCLIC_REST = 6        /* knots after which an axis whose set-points stay the same stands */
};

/* Whether set-points are followed, and why not: too fast a change, not where the axis may be, or missing. */
enum cyclic_result { CYCLIC_TAKEN, CYCLIC_ACCELERATION, CYCLIC_RANGE, CYCLIC_MISSED };

/* Position, velocity and acceleration at a set-point: 1/256 nm, per cycle and per cycle squared */
struct cyclic_state {
    int64_t pos, vel, acc;
};

/* What a set-point must keep to, and where the first one must be. */
struct cyclic_limits {
    int64_t max_nmpms2;     /* second difference in time */
    int64_t min_nm, max_nm; /* an axis stays inside or, from outside, moves back */
    uint32_t stop_umps2;    /* with which an axis stops before these */
};

struct cyclic_axis {
    bool fresh;                  /* a set-point has come since the latest SYNC */
    bool told;                   /* one has come with the latest SYNC, */
    int32_t told_nm;             /* this one, */
    uint32_t told_cycle;         /* for this cycle, */
    struct cyclic_limits limits; /* with these limits */
    bool known;                  /* there is a set-point */
    uint32_t latest;             /* cycle of the newest one, */
    int32_t past[CYCLIC_PAST];   /* which is past[latest % CYCLIC_PAST]; the cycles before go backwards from there */
    bool moved;                  /* these set-points differ; */
    uint32_t rest;               /* up to this cycle they were the same */
    enum cyclic_result refused;  /* why set-points are no longer followed, until the axis is enabled anew */
    bool follows;                /* the axis is where the set-points are, or on their way */
    struct cyclic_state from;    /* at the begin */
    struct cyclic_state to;      /* and at the end of the present cycle of the way */
    int32_t at_nm;               /* where it stood when it began to */
    int32_t offset_nm;           /* distance of the axis from its first set-point, */
    uint8_t blended;             /* made up for since so many knots */
    uint8_t same;                /* knots since the last one that differed */
    int32_t knot_nm, step_nm;    /* the latest knot, and its difference to the one before */
};

struct cyclic {
    struct sync_clock clock;
    uint8_t ms;     /* nominal cycle */
    bool runs;      /* knots are made of the set-points */
    uint32_t cycle; /* of the way: its number, */
    int64_t within; /* how much of it is over, 0..SYNC_CYCLE - 1, */
    int64_t rate;   /* cycles in a ms */
    struct cyclic_axis axis[2];
};

struct cyclic_in {
    bool enabled, halt;
    bool stands;        /* the axis stands, and follows nothing else */
    int32_t at_nm;      /* there */
    uint32_t window_nm; /* the first set-point is so close */
    uint32_t now;       /* control periods since power-on */
};

/* Forget SYNCs and set-points. */
void cyclic_reset(struct cyclic *c);
/* A SYNC has come in control period `now` of `per_ms` a ms; its cycle has `ms` ms, 1..CYCLIC_MS_MAX. The set-points follow. */
void cyclic_sync(struct cyclic *c, uint32_t now, uint32_t per_ms, uint8_t ms);
/* A set-point of an axis has come. It is that of the next SYNC. */
void cyclic_told(struct cyclic *c, int axis);
/* Take the set-point `nm` of an axis for the latest SYNC, if one has come. */
void cyclic_take(struct cyclic *c, int axis, int32_t nm, const struct cyclic_limits *limits);
/* The same for a velocity, which is that of the cycle before this SYNC: 1 um/s is 1 nm each ms. */
void cyclic_take_velocity(struct cyclic *c, int axis, int64_t umps, const struct cyclic_limits *limits);
/* Let an axis begin or cease to follow its set-points. Returns whether these ask it to move. */
bool cyclic_update(struct cyclic *c, int axis, const struct cyclic_in *in);
/* Whether set-points of an axis whose newest one is that of cycle `latest` have not come for longer than is bridged. */
bool cyclic_missing(const struct cyclic *c, uint32_t latest, uint32_t now);
/* Whether an axis at `nm` that moves by d1 in `ms` could not stop inside its limits. */
bool cyclic_leaves(const struct cyclic_limits *limits, int64_t nm, int64_t d1, unsigned ms);
/* The way begins, for the axes that follow and stand at `at_nm`. ahead_ms: from now to its first knot. */
void cyclic_begin(struct cyclic *c, uint32_t now, unsigned ahead_ms, const int32_t at_nm[2]);
/* Go on by a ms, to the knot `ahead_ms` from now. */
void cyclic_step(struct cyclic *c, uint32_t now, unsigned ahead_ms);
/* The knot of an axis that follows. */
int32_t cyclic_knot(struct cyclic *c, int axis);
/* Whether an axis that follows stands. */
bool cyclic_stands(const struct cyclic *c, int axis);
#endif
