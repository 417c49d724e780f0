/* SPDX-License-Identifier: Apache-2.0 */
/* motion/positioning.h: the set-points of one axis in profile position (CiA 402-2, clause "Profile position mode").
 *
 * A rising edge of controlword bit 4 takes 607Ah with velocity and ramps as they are then. One more set-point waits until
 * the axis has come to the present one; with bit 5 the new one takes its place at once. With bit 6 it counts from the target
 * before it or, where there is none, from where the axis is held. Statusword bit 12 says that it was taken; it is clear
 * again when bit 4 is, and another one would be taken.
 *
 * Pure, background only; axis_target.c calls it in each drive step.
 */
#ifndef KONTUR_POSITIONING_H
#define KONTUR_POSITIONING_H
#include <stdbool.h>
#include <stdint.h>

enum { CW_NEW_SET_POINT = 1u << 4, CW_AT_ONCE = 1u << 5, CW_RELATIVE = 1u << 6 };

struct positioning_set_point {
    int32_t nm;
    uint32_t velocity_umps, up_umps2, down_umps2;
};

struct positioning {
    bool active; /* there is a target: */
    struct positioning_set_point now;
    bool waits; /* another one follows: */
    struct positioning_set_point next;
    bool acknowledged;
    bool reached;          /* the axis is in the window of its target, for its time */
    uint32_t inside_since; /* control period */
};

struct positioning_in {
    uint16_t controlword, before; /* now, and in the step before */
    bool enabled;
    bool arrived;                           /* the reference stands at the target, or where limits end its way */
    int32_t reference_nm;                   /* where the axis is held or goes */
    int64_t distance_nm;                    /* of the axis from where its way ends */
    struct positioning_set_point set_point; /* as it is in the dictionary */
    uint32_t window_nm, window_periods;     /* 6067h, 6068h */
    uint32_t now;                           /* control periods since power-on */
};

/* Forget all set-points. */
void positioning_reset(struct positioning *p);
void positioning_step(struct positioning *p, const struct positioning_in *in);
#endif
