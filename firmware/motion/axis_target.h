/* SPDX-License-Identifier: Apache-2.0 */
/* motion/axis_target.h: where the profile of one axis goes, in the modes in which it moves by itself: profile position (1),
 * profile velocity (3) and homing (6).
 *
 * Pure, background only; axis_modes.c calls it for each axis in each drive step.
 */
#ifndef KONTUR_AXIS_TARGET_H
#define KONTUR_AXIS_TARGET_H
#include "motion/homing.h"
#include "motion/positioning.h"
#include "motion/profile.h"
#include "od/od.h"

enum {
    MODE_PROFILE_POSITION = 1,
    MODE_PROFILE_VELOCITY = 3,
    MODE_HOMING = 6,
    MODE_INTERPOLATED_POSITION = 7,
    MODE_CYCLIC_POSITION = 8,
    MODE_CYCLIC_VELOCITY = 9,
    MODE_CYCLIC_TORQUE = 10
};

/* Bits of the controlword 6040h whose meaning depends on the mode */
enum {
    CW_ENABLE_IP = 1u << 4, /* interpolated position: path time may run; homing: start */
    CW_HALT = 1u << 8
};

/* Bits of the statusword 6041h whose meaning depends on the mode */
enum {
    SW_TARGET_REACHED = 1u << 10,
    SW_INTERNAL_LIMIT = 1u << 11,
    SW_ACKNOWLEDGED = 1u << 12, /* a set-point of profile position has been taken */
    SW_IP_ACTIVE = 1u << 12,
    SW_SPEED_0 = 1u << 12,
    SW_FOLLOWS = 1u << 12, /* the axis follows its set-points */
    SW_HOMING_ATTAINED = 1u << 12,
    SW_HOMING_ERROR = 1u << 13,
    SW_FOLLOWING_ERROR = 1u << 13
};

/* What a movement goes by. It is taken over from the dictionary when the movement begins: at standstill or, in profile
 * velocity, with another target. The limits are those of the path, which begins when both axes stand. */
struct axis_settings {
    int32_t min_nm, max_nm; /* 607Dh */
    uint32_t up_umps2, down_umps2, quick_umps2, homing_umps2;
    int32_t search_umps, zero_umps, home_offset_nm;
    int16_t halt_option;
    int8_t homing_method;
};

struct axis_mode {
    int8_t mode; /* in use: 6061h */
    struct axis_settings settings;
    struct profile profile;
    struct profile_in target; /* of the profile, from this step on */
    struct homing homing;
    struct positioning positioning;
    uint16_t controlword;   /* of the step before */
    int32_t requested_umps; /* before limits */
    bool limited;           /* a limit keeps the axis from the requested velocity */
};

enum { NO_QUICK_STOP = -1 };

struct axis_mode_in {
    uint16_t controlword;
    bool enabled;         /* operation enabled */
    bool powered;         /* operation enabled, or stopping */
    int16_t quick_stop;   /* 605Ah while a quick stop is active, else NO_QUICK_STOP */
    uint8_t inputs;       /* enum hal_input */
    uint8_t index_pulses; /* their number, modulo 256 */
    int32_t reference_nm; /* user's position */
    /* This and the next two: the servo's positions, which homing does not shift, without what the geometry adds by
     * position: that depends on the origin which homing sets. */
    int64_t position_nm;
    int32_t index_nm; /* at the latest index pulse */
    int32_t edge_nm;  /* at the latest edge of a limit switch */
    const struct od_axis *od;
    int32_t velocity_max_umps; /* FAULT_OVERSPEED trips at 2130h velocity: a profile stays a tenth below */
    uint32_t now;              /* control periods since power-on */
    bool generating;           /* the path consists of the axes' own knots */
    bool stands;               /* by its own knots, or path time stands */
};

/* Reset to the state at power-on. */
void axis_target_reset(struct axis_mode *a);
/* Enter another mode, at standstill. */
void axis_target_enter(struct axis_mode *a, int8_t mode);
/* Take over what a movement goes by, where one may begin, and compute a->target. */
void axis_target_step(struct axis_mode *a, const struct axis_mode_in *in);
/* Whether the axis is in one of these modes. */
bool axis_target_own(const struct axis_mode *a);
/* Bits 10 to 13 of 6041h, in these modes. */
unsigned axis_target_status(const struct axis_mode *a, bool generating, bool stands);
#endif
