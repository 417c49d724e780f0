/* SPDX-License-Identifier: Apache-2.0 */
/* motion/cyclic_torque.h: cyclic synchronous torque of CiA 402-2 (mode 10). The force of an axis is the master's: 6071h +
 * 60B2h, in 1/1000 of the force limit, as they are at each SYNC. It acts from the drive step after SYNC on and stays until the
 * next one. The servo tick lets it act in place of the law's force, within the same limits.
 *
 * Meanwhile the path follows the axis: its knots are where the axis will be by its speed. So wherever the master's force ends
 * (a stop, a halt, a fault, SYNCs that cease), law and profile take over from there.
 *
 * A force other than 0, and an axis that moves, needs a set-point with each SYNC; what is bridged is CYCLIC_MISSING. The axis
 * has to be able to stop inside its soft limits. Pure, background only; axis_modes.c uses one for each axis.
 */
#ifndef KONTUR_CYCLIC_TORQUE_H
#define KONTUR_CYCLIC_TORQUE_H
#include "motion/cyclic.h"
#include "od/od.h"

/* All 0 is reset. */
struct cyclic_torque {
    bool known;      /* a set-point has come since the axis may follow */
    bool follows;    /* the axis is to move by it */
    bool acts;       /* the force acts: the path follows the axis */
    bool limited;    /* the set-point is beyond the limit */
    uint8_t rest;    /* knots in which the axis has hardly moved */
    uint32_t latest; /* cycle of the newest set-point */
    int32_t force_mN;
    enum cyclic_result refused; /* why set-points are no longer followed, until the axis is enabled anew */
    int64_t at, step;           /* of the path: position and speed, 1/256 nm and in a ms */
    int32_t knot_nm, step_nm;   /* the same of its latest knot, rounded */
};

struct cyclic_torque_in {
    bool enabled;                   /* and in this mode */
    const struct cyclic_in *cyclic; /* all but .enabled */
    const struct od_axis *od;
    struct cyclic_limits limits;
};

/* Take the set-point in `od` for the latest SYNC, if one has come. */
void cyclic_torque_take(struct cyclic_torque *t, struct cyclic *c, int axis, const struct od_axis *od);
/* Let the axis begin or cease to follow. Returns whether it needs a path. */
bool cyclic_torque_update(struct cyclic_torque *t, const struct cyclic *c, const struct cyclic_torque_in *in);
/* A path begins, with the axis at nm. */
void cyclic_torque_join(struct cyclic_torque *t, int32_t nm);
/* The knot `ahead_ms` from now. */
int32_t cyclic_torque_knot(struct cyclic_torque *t, const struct od_axis *od, uint32_t ahead_ms);
/* Whether the axis stands. */
bool cyclic_torque_stands(const struct cyclic_torque *t);
/* Bits 11 and 12 of 6041h. */
unsigned cyclic_torque_status(const struct cyclic_torque *t);
#endif
