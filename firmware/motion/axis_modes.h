/* SPDX-License-Identifier: Apache-2.0 */
/* motion/axis_modes.h: the modes of operation of both axes (6060h, CiA 402-2).
 *
 * - Interpolated position (7): both axes follow one stream of knots or of interpolation data records (60C1h). The
 *   stream moves them only while both are in this mode.
 * - Profile velocity (3) and homing (6): each axis by itself. Velocity profiles (motion/profile.h) give knots for both
 *   axes, some milliseconds ahead of path time, and the servo follows these knots like those of a stream: by the same
 *   law, with the same limits, faults and stop on the path. An axis in mode 7 beside one in mode 3 or 6 is held in place.
 * - Cyclic synchronous position (8): knots of the same path are made of the set-points that come with SYNC
 *   (motion/cyclic.h), fewer milliseconds ahead. At a stop a profile takes over where the set-points have brought the axis.
 * - Cyclic synchronous torque (10): the master's force acts in place of the law's, and the knots follow the axis
 *   (motion/cyclic_torque.h).
 *
 * An axis takes over another mode when it stands and its homing is not running; a stream that waits is discarded then.
 *
 * Pure, background only. drive_step() calls axis_modes_end(), axis_modes_step() and axis_modes_generate() once each, in
 * this order, and carries out the output of axis_modes_step() in between.
 */
#ifndef KONTUR_AXIS_MODES_H
#define KONTUR_AXIS_MODES_H
#include "motion/axis_target.h"
#include "motion/cyclic_torque.h"
#include "motion/ip_record.h"
#include "motion/path_clock.h"
#include "motion/queue.h"
#include "od/od.h"

struct axis_modes {
    struct axis_mode axis[2];
    struct cyclic cyclic;
    struct cyclic_torque torque[2];
    bool generating; /* the path in the queue is that of the profiles and of the set-points of cyclic modes */
    bool ending;     /* these stand, and the queue has all their knots */
    struct ip_record record;
    bool by_record; /* the stream consists of interpolation data records */
    bool by_frame;  /* knot frames were accepted: then records, which CAN's checksum alone protects, are not */
};

struct axis_modes_in {
    const struct od_data *od;
    const struct path_progress *path;
    uint32_t now;      /* control periods since power-on */
    bool path_may_run; /* path time may run in this step */
    struct axis_mode_in axis[2];
};

/* What drive_step() is to do, in this order. */
struct axis_modes_out {
    bool hold;          /* discard the stream and hold the axes, because the mode in use has changed */
    bool begin;         /* begin a path at the reference; axis_modes_generate() fills it */
    bool set_origin[2]; /* homing has found its point: the user's position becomes the servo's plus origin_nm */
    int32_t origin_nm[2];
};

/* Reset to the state at power-on. */
void axis_modes_reset(struct axis_modes *m);
/* End the path of the profiles where it stands. Returns true if it stands because axis_modes_generate() has not been called
 * for PROFILE_AHEAD milliseconds, which is FAULT_UNDERRUN. */
bool axis_modes_end(struct axis_modes *m, struct queue *q, const struct path_progress *path, bool powered);
/* Change to the modes of 6060h where the axes stand, and compute the target velocities of this step. */
void axis_modes_step(struct axis_modes *m, const struct axis_modes_in *in, struct axis_modes_out *out);
/* While `generating`: put knots into the queue, up to PROFILE_AHEAD milliseconds ahead of path time, or CYCLIC_AHEAD. */
void axis_modes_generate(struct axis_modes *m, struct queue *q, const struct od_data *od, uint32_t now);
/* A set-point of a cyclic mode has come for this axis. It is that of the next SYNC. */
void axis_modes_set_point(struct axis_modes *m, int axis);
/* A SYNC has come in control period `now`, with the set-points in `od`. */
void axis_modes_sync(struct axis_modes *m, const struct od_data *od, uint32_t now);
/* The path of the profiles is discarded, because an axis gets power. */
void axis_modes_interrupt(struct axis_modes *m);

/* Whether the axis stands, whatever the other one does. `standing`: path time stands. */
bool axis_modes_stands(const struct axis_modes *m, int axis, bool standing);
/* Whether both axes are in interpolated position, so that a stream may move them. */
bool axis_modes_follow_stream(const struct axis_modes *m);
/* Bits 10 to 13 of 6041h. */
uint16_t axis_modes_status(const struct axis_modes *m, int axis, uint8_t stream_state, bool standing);

/* A stream begins at `start`: its first record follows from there. */
void axis_modes_begin_stream(struct axis_modes *m, uint8_t record_ms, struct knot start);
/* Whether the stream has enough knots to start. A stream of records needs those of record_lag (ms) and of a record,
 * which may be a quarter of its time late. */
bool axis_modes_enough_knots(const struct axis_modes *m, const struct queue *q, uint32_t record_lag);
/* The knots of a stream end on its way: profiles lead on from the last one, and stop. */
void axis_modes_take_over(struct axis_modes *m, const struct queue *q);

/* Whether a stream or set-points of the master may move the axis. */
bool axis_modes_led(const struct axis_modes *m, int axis);

/* Why set-points of an axis are not followed, which is a fault. */
enum cyclic_result axis_modes_refused(const struct axis_modes *m, int axis);

/* Whether a value of 6060h is one of the modes above. */
bool axis_modes_known(int64_t mode);
#endif
