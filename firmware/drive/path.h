/* SPDX-License-Identifier: Apache-2.0 */
/* drive/path.h: the path that the axes follow, between the queue of knots and the servo tick.
 *
 * The knots of a path come from the master, as knot frames (2201h) or interpolation data records (60C1h), or from the
 * profiles of the modes of operation (motion/axis_modes.h). This module begins, suspends and ends the path, and writes the
 * command words of the tick that belong to it: stream, complete, may_end, origin_nm, and the forces of mode 10.
 *
 * Context: background. drive.c calls it in drive_step() and for requests of the master; device.c hands knots over.
 */
#ifndef KONTUR_DRIVE_PATH_H
#define KONTUR_DRIVE_PATH_H
#include "drive/servo_loop.h"
#include "motion/axis_modes.h"
#include "motion/path_clock.h"
#include "motion/queue.h"

#define PATH_FOLLOW_MAX 5 /* 1/1000 */

struct path {
    struct queue queue;
    struct axis_modes modes;
    struct servo_loop *loop;
    struct path_progress progress;   /* as read last */
    uint32_t stream;                 /* loop->command.stream as it is to be */
    struct knot suspended_at;        /* where a suspended path stands */
    bool short_lag;                  /* the records of this stream wait for less time than a stop on the path takes */
    bool ran_out;                    /* its records ceased on its way, and no halt had stopped it before */
    bool overflow;                   /* a record was lost because the queue was full: the path goes no further */
    uint32_t follow_ms;              /* of the last snapshot by which path time has followed the records' clock */
    int32_t waiting, waiting_wanted; /* knots of records that wait, averaged, and as at the start; 1/4096 */
};

/* What the CiA 402 state machine says of an axis. */
struct path_axis {
    uint16_t controlword;
    bool enabled;       /* operation enabled */
    bool powered;       /* operation enabled, or stopping */
    int16_t quick_stop; /* 605Ah while a quick stop is active, else NO_QUICK_STOP */
};

/* 2200h:1 */
enum { STREAM_COMMAND_BEGIN = 1, STREAM_COMMAND_DISCARD, STREAM_COMMAND_RESUME, STREAM_COMMAND_RELEASE };

/* Initialise at power-on, without knots. The tick reads the knots of p->queue. */
void path_init(struct path *p, struct servo_loop *loop, struct spline_ring *ring, struct od_stream *stream);
/* Discard all knots while the tick goes on; the origin does not change. To be called when no axis has power and the modes
 * have been reset. */
void path_reset(struct path *p, struct od_stream *stream);
/* Read the snapshot of the servo and the progress of path time, with which the rest of the step works. */
void path_read(struct path *p);

/* Axes get power. They are held where they are, unless a suspended path can go on from there. */
void path_power_on(struct path *p, const struct od_data *od, const bool powered[2]);
/* Axes lose power. A stream that stands is suspended and may be resumed. */
void path_power_off(struct path *p);
/* Whether path time may run. */
bool path_may_run(const struct path *p, const struct od_data *od, const struct path_axis axis[2], bool fault);
/* Update the progress of the path and end it where it is complete. Returns false if the profiles had no knots in time, which
 * is FAULT_UNDERRUN. */
bool path_follow(struct path *p, bool may_run, bool powered);
/* Step the modes of operation, and carry out their output. */
void path_step_modes(struct path *p, struct od_data *od, const struct path_axis axis[2], bool may_run);

/* SYNC has come, after the set-points of its cycle. */
void path_sync(struct path *p, const struct od_data *od);
/* Carry out the command written to object 2200h. Returns SDO_OK, or the abort code. */
uint32_t path_command(struct path *p, const struct od_data *od, const struct path_axis axis[2], uint8_t command);
/* Before object 2200h total is written: an open-ended stream that is open will end after `total` knots. Returns SDO_OK, or
 * the abort code. */
uint32_t path_total(struct path *p, uint32_t total);
/* A knot frame (2201h) has come. */
enum queue_result path_knot(struct path *p, const struct od_knot *frame);
/* An outputs frame (2182h) has come, for the next knot. */
enum queue_result path_outputs(struct path *p, const struct od_knot_outputs *frame);
/* A knot has come by its absolute position. */
enum queue_result path_push(struct path *p, struct knot knot);
/* A record of 60C1h for both axes has come. The first one opens a stream if none is open. Returns SDO_OK, or the abort
 * code. */
uint32_t path_record(struct path *p, const struct od_data *od, const struct path_axis axis[2], struct knot record);

/* Write 2180h: the outputs as the tick has written them, those that path time has passed, and where it is held. */
void path_report_outputs(const struct path *p, struct od_outputs *od);

/* Measured positions of the axes, and where they are to be: user's positions in nm. */
struct knot path_position(const struct path *p);
struct knot path_reference(const struct path *p);
/* The rate of path time to go to, 1/1000: the feed override. Records of 60C1h come by the clock of their master, and so path
 * time goes by up to PATH_FOLLOW_MAX faster or slower, that neither more nor fewer of them wait as time goes by. Once a step. */
uint16_t path_rate(struct path *p, const struct od_data *od);
#endif
